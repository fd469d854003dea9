"""Scatter of the loop proportions: every loop of a mesh has its own.

Each proportion of each loop is its mean times 1 + s g, s the relative standard deviation and g normally distributed, drawn again
beyond MOST deviations and kept within `RANGES`. A thread stays one smooth curve: its loops are key points of one spline, and
an underlap runs from the foot of one loop to that of the next, wherever these lie. What is added up along a wire, as its
length, scatters with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from .loops import RANGES, LoopProportions

MOST = 2.5  # standard deviations: loops farther off would be faults of the machine


def scattered_proportions(means: Sequence[LoopProportions], scatter: float, seed: int) -> tuple[LoopProportions, ...]:
    """Proportions of loops about their means; `scatter`: relative standard deviation. The same seed gives the same loops."""
    count, shape = len(means), means[0].shape
    names = [field.name for field in fields(LoopProportions) if field.name in RANGES]
    random = np.random.default_rng(seed)
    draws = random.standard_normal((count, len(names)))
    while (beyond := np.abs(draws) > MOST).any():
        draws[beyond] = random.standard_normal(int(beyond.sum()))
    low, high = np.array([RANGES[name] for name in names]).T
    values = np.array([[getattr(mean, name) for name in names] for mean in means]) * (1.0 + scatter * draws)
    # the mean may stand at an end of its range
    values = np.clip(values, low, high)
    return tuple(LoopProportions(**dict(zip(names, row, strict=True)), shape=shape) for row in values.tolist())
