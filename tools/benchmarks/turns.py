"""Timing in turns: what else runs on a machine slows all of them alike, and the best turn of each counts."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import warp as wp


def best(
    works: dict[str, Callable[[], object]], rounds: int, times: int = 1, device: str | wp.Device | None = None
) -> dict[str, float]:
    """Time [s] of one call of each, in the best of the rounds; a turn is `times` calls."""
    found = dict.fromkeys(works, math.inf)
    for _ in range(rounds):
        for name, work in works.items():
            begin = time.perf_counter()
            for _ in range(times):
                work()
            wp.synchronize_device(device)
            found[name] = min(found[name], (time.perf_counter() - begin) / times)
    return found
