"""Every eighth point of the wires: the level of detail k8.

A wire keeps its first and its last point, and three at least. The largest stress around a point that is kept stands for
the points that are not, so that no peak is lost.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["STRIDE", "Thinning"]

STRIDE = 8  # points that are kept lie no farther apart


@dataclass(frozen=True, eq=False)
class Thinning:
    """Which points of some curves are kept."""

    kept: NDArray[np.int32]  # [kept point] among the points of the curves
    first: NDArray[np.int32]  # [kept point] the first of the points that it stands for
    counts: NDArray[np.int64]  # [curve] kept points

    @classmethod
    def of(cls, point_counts: NDArray[Any]) -> "Thinning":
        """For curves that follow one another and have so many points each, three or more [curve]."""
        counts = np.maximum(3, 1 - (1 - point_counts) // STRIDE)
        start = np.cumsum(point_counts) - point_counts
        number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        steps, gaps = np.repeat(point_counts - 1, counts), np.repeat(counts - 1, counts)
        kept = np.repeat(start, counts) + number * steps // gaps
        first = np.where(number > 0, (kept + np.roll(kept, 1) + 1) // 2, kept)
        return cls(kept.astype(np.int32), first.astype(np.int32), counts)

    def largest(self, values: NDArray[Any]) -> NDArray[Any]:
        """[kept point]  the largest of `values` [point] among the points that each kept one stands for."""
        return np.maximum.reduceat(values, self.first)
