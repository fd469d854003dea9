"""The true centre line of a thread: a spline through the knit's points, as a function of plan arc length."""

from __future__ import annotations

from collections.abc import Callable
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
    def _plan(self) -> PPoly:
        """x and y [m] over the first period."""
        powers = self._spline.c[..., :2].copy()
        powers[-2, :, 1] += self._climb[1]
        powers[-1, :, 1] += self._climb[1] * self._spline.x[:-1]
        return PPoly(powers, self._spline.x)

    @cached_property
    def reach(self) -> np.ndarray:
        """(2, 2) lowest and highest weft, then warp position [m] of the first period."""
        room, at_knots = self.length / len(self._spline.x), self._plan(self._spline.x)
        return np.stack([at_knots.min(axis=0) - room, at_knots.max(axis=0) + room], axis=1)

    def across(self, normal: np.ndarray) -> Callable[[float], np.ndarray]:
        """Function of a level [m]: rising arc lengths [m] in the first period where normal . (x, y) has it; `normal` is (2,)."""
        arcs, powers = self._plan.x, normal[0] * self._plan.c[..., 0] + normal[1] * self._plan.c[..., 1]
        at_knots, step = PPoly(powers, arcs)(arcs), self.length / (len(arcs) - 1)
        low = np.minimum(at_knots[:-1], at_knots[1:]) - step  # no piece is steeper than the thread is long
        high = np.maximum(at_knots[:-1], at_knots[1:]) + step

        def arcs_at(level: float) -> np.ndarray:
            near = (low <= level) & (level <= high)
            edges = np.flatnonzero(np.diff(near.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
            pieces = (PPoly(powers[:, begin:end], arcs[begin : end + 1]) for begin, end in edges)
            roots = np.concatenate([np.zeros(0), *(piece.solve(level, extrapolate=False) for piece in pieces)])
            return np.unique(roots[np.isfinite(roots) & (roots >= 0.0) & (roots < arcs[-1])])

        return arcs_at
