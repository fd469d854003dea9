"""The true centre line of a thread: a spline through the knit's points, as a function of plan arc length."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from .knit.centreline import Thread


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
    def _reach(self) -> tuple[float, float]:
        """Warp positions [m] that a period does not leave."""
        at_knots = self._y(self._spline.x)
        room = self.length / len(self._spline.x)
        return float(at_knots.min()) - room, float(at_knots.max()) + room

    def arcs_at_x(self, x: float) -> np.ndarray:
        """Arc lengths [m] in the first period at which the thread passes weft position x [m], ascending."""
        return _roots(self._x, x, self.length)

    def arcs_at_y(self, y: float) -> np.ndarray:
        """Arc lengths [m] at which the unrolled thread passes warp position y [m], ascending."""
        low, high = self._reach
        periods = np.arange(np.floor((y - high) / self.height), np.ceil((y - low) / self.height) + 1)
        found = [_roots(self._y, y - k * self.height, self.length) + k * self.length for k in periods]
        return np.sort(np.concatenate(found))


def _roots(curve: PPoly, level: float, length: float) -> np.ndarray:
    roots = curve.solve(level, extrapolate=False)
    return np.unique(roots[np.isfinite(roots) & (roots >= 0.0) & (roots < length)])
