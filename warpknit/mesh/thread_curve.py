"""The true centre line of a thread: a spline through the knit's points, as a function of plan arc length."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from ..knit.centreline import Thread


class ThreadCurve:
    """Points (x, y, z) [m] of an endless thread at plan arc lengths s [m], unrolled: a period on is `height` up."""

    def __init__(self, thread: Thread, height: float) -> None:
        self.length = thread.length
        self.height = height
        arc = np.linspace(0.0, self.length, len(thread.points) + 1)
        self._climb = np.array([0.0, height, 0.0]) / self.length
        level = np.vstack([thread.points, thread.points[:1]])
        level[-1] += self._climb * self.length
        level -= arc[:, None] * self._climb
        level[-1] = level[0]
        self._spline = CubicSpline(arc, level, bc_type="periodic")

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Points (m, 3) [m] at arc lengths (m,) [m]."""
        return self._spline(np.mod(s, self.length)) + s[:, None] * self._climb

    def slope(self, s: np.ndarray) -> np.ndarray:
        """Derivatives (m, 3) [-] of the points by arc length (m,) [m]."""
        return self._spline(np.mod(s, self.length), 1) + self._climb

    @cached_property
    def _x(self) -> PPoly:
        return PPoly(self._spline.c[..., 0], self._spline.x)

    @cached_property
    def _y(self) -> PPoly:
        powers = self._spline.c[..., 1].copy()
        powers[-2] += self._climb[1]
        powers[-1] += self._climb[1] * self._spline.x[:-1]
        return PPoly(powers, self._spline.x)

    @cached_property
    def reach(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lowest and highest weft and warp positions [m] of the first period."""
        room = self.length / len(self._spline.x)
        bounds = []
        for coordinate in (self._x, self._y):
            at_knots = coordinate(self._spline.x)
            bounds.append((float(at_knots.min()) - room, float(at_knots.max()) + room))
        return bounds[0], bounds[1]

    def across(self, normal: np.ndarray) -> Across:
        """The coordinate normal . (x, y) along the first period; `normal` is (2,)."""
        return Across(normal[0] * self._x.c + normal[1] * self._y.c, self._spline.x, self.length)


class Across:
    """A coordinate of a thread as a function of arc length."""

    def __init__(self, powers: np.ndarray, arcs: np.ndarray, length: float) -> None:
        self._powers, self._arcs = powers, arcs
        at_knots = PPoly(powers, arcs)(arcs)
        step = length / (len(arcs) - 1)
        self._low = np.minimum(at_knots[:-1], at_knots[1:]) - step  # no piece is steeper than the thread is long
        self._high = np.maximum(at_knots[:-1], at_knots[1:]) + step

    def arcs(self, level: float) -> np.ndarray:
        """Rising arc lengths [m] in the first period where the coordinate is `level` [m]."""
        near = (self._low <= level) & (level <= self._high)
        edges = np.flatnonzero(np.diff(near.astype(np.int8), prepend=0, append=0))
        found = [np.zeros(0)]
        for begin, end in edges.reshape(-1, 2):
            piece = PPoly(self._powers[:, begin:end], self._arcs[begin : end + 1])
            found.append(piece.solve(level, extrapolate=False))
        roots = np.concatenate(found)
        return np.unique(roots[np.isfinite(roots) & (roots >= 0.0) & (roots < self._arcs[-1])])
