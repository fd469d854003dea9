"""Scatter of the loop proportions: the loops of every needle and course have their own.

Each proportion is its mean times 1 + s g, s the relative standard deviation and g normally distributed, drawn again beyond MOST
deviations and kept within `RANGES`. Loops of one needle and course are formed together and share g. A thread stays one smooth
curve: its loops are key points of one spline, and an underlap runs from the foot of one loop to that of the next, wherever these
lie. What is added up along a wire, as its length, scatters with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from .loops import RANGES, LoopProportions

MOST = 2.5  # standard deviations: loops farther off would be faults of the machine


def scattered_proportions(
    means: Sequence[LoopProportions],
    scatter: float | NDArray[np.float64],
    seed: int,
    formed_together: Sequence[int] | NDArray[np.intp] | None = None,
) -> tuple[LoopProportions, ...]:
    """Proportions of loops about their means. The same seed gives the same loops.

    scatter: relative standard deviation, also [loop].
    formed_together: [loop] number of the loop whose relative deviations it shares.
    """
    count, shape = len(means), means[0].shape
    names = [field.name for field in fields(LoopProportions) if field.name in RANGES]
    random = np.random.default_rng(seed)
    draws = random.standard_normal((count, len(names)))
    while (beyond := np.abs(draws) > MOST).any():
        draws[beyond] = random.standard_normal(int(beyond.sum()))
    if formed_together is not None:
        draws = draws[formed_together]
    low, high = np.array([RANGES[name] for name in names]).T
    values = np.array([[getattr(mean, name) for name in names] for mean in means]) * (1.0 + np.reshape(scatter, (-1, 1)) * draws)
    # the mean may stand at an end of its range
    values = np.clip(values, low, high)
    return tuple(LoopProportions(**dict(zip(names, row, strict=True)), shape=shape) for row in values.tolist())
