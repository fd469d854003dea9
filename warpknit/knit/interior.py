"""The point deepest inside outlines in the plane (pole of inaccessibility).

Depth of a point is its distance to the nearest outline where it lies inside all of them, less than nothing elsewhere.
A grid over the smallest outline's box is refined round its deepest point until the grid is finer than 1e-3 of the box.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

GRID = 17


def polygon_area(outline: NDArray[np.float64]) -> float:
    """Signed area [m2] of a closed outline (k, 2), positive anticlockwise."""
    x, y = (outline - outline[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def is_inside(points: NDArray[np.float64], outline: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether points (n, 2) lie inside a closed outline (k, 2), by the even-odd rule."""
    x, y = points[:, :1], points[:, 1:]
    x0, y0 = outline.T
    x1, y1 = np.roll(outline, -1, axis=0).T
    spans = (y0 > y) != (y1 > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        right = x < x0 + (y - y0) * (x1 - x0) / (y1 - y0)
    return np.count_nonzero(spans & right, axis=1) % 2 == 1


def deepest_point(outlines: Sequence[NDArray[np.float64]]) -> NDArray[np.float64] | None:
    """Point (2,) deepest inside all outlines, the first the smallest; None where they have no common inside."""
    thin = [outline[:: max(1, len(outline) // 160)] for outline in outlines]
    low, high = thin[0].min(axis=0), thin[0].max(axis=0)
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    edge = np.concatenate(thin)
    best, best_depth = None, 0.0
    for _ in range(6):
        ticks = np.linspace(-1.0, 1.0, GRID)
        grid = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2) * half + centre
        inside = np.all([is_inside(grid, outline) for outline in thin], axis=0)
        if np.any(inside):
            grid = grid[inside]
            depth = np.sqrt(np.min(np.sum((grid[:, None] - edge) ** 2, axis=2), axis=1))
            k = int(np.argmax(depth))
            if depth[k] > best_depth:
                best, best_depth = grid[k], float(depth[k])
        if best is None:
            return None
        centre, half = best, half * (3.0 / GRID)
    return best
