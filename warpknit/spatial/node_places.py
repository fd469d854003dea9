"""Places of the nodes along a thread in space: close together where it turns, and by its arc length in space.

The knit describes threads by their arc length in plan view. Where a thread climbs steeply between the layers of a mesh it turns
sharply, within a thickness or less, and is long in space but short in plan. Half of the nodes follow the length and half the
turns: with a thread of length S that turns by T, and k the mean curvature over three thicknesses, the spacing is in proportion to

    1/(1/S + k/T)

and changes by at most GRADING along the thread, so that neighbouring segments have similar lengths.
"""

from __future__ import annotations

import numpy as np

from ..mesh.thread_curve import ThreadCurve

GRADING = 0.5  # largest change of the spacing over the distance along the thread
MEAN_OVER = 3.0  # thicknesses, of the curvature
SAMPLES = 12  # a thickness of plan length
LEAST_SHARE = 0.5  # smallest spacing over the mean one, and
LEAST_SPACING = 1.5  # in thicknesses: the smaller one of both


class SpacedThread:
    """A thread by its arc length s in space [m], with the places of its nodes; both go on beyond a period."""

    def __init__(self, curve: ThreadCurve, nodes: int, thickness: float, *, evenly: bool = False) -> None:
        """nodes: of a period; evenly: at equal arc lengths, as the true masses of a ramp want it."""
        self._curve, self.nodes, self.evenly = curve, nodes, evenly
        self._plan = np.linspace(0.0, curve.length, int(np.ceil(SAMPLES * curve.length / thickness)) + 1)
        step = np.diff(curve(self._plan), axis=0)
        size = np.linalg.norm(step, axis=1)
        self._arc = np.concatenate([[0.0], np.cumsum(size)])
        self.length = float(self._arc[-1])  # [m] of a period
        if evenly:
            self._count = self._arc * (nodes / self.length)
        else:
            self._count = self._counted(step / size[:, None], size, thickness)

    def _counted(self, tangent: np.ndarray, size: np.ndarray, thickness: float) -> np.ndarray:
        """Nodes up to each sample, from the directions (m, 3) and lengths [m] of the steps between them."""
        before = np.roll(tangent, 1, axis=0)
        angle = np.arctan2(np.linalg.norm(np.cross(before, tangent), axis=1), np.sum(before * tangent, axis=1))
        turn = np.concatenate([[0.0], np.cumsum(angle)])
        arc, middle = self._around(self._arc, self.length), 0.5 * (self._arc[1:] + self._arc[:-1])
        turns = self._around(turn, float(turn[-1]))
        width = MEAN_OVER * thickness
        bent = np.interp(middle + 0.5 * width, arc, turns) - np.interp(middle - 0.5 * width, arc, turns)
        wanted = 2.0 / (1.0 / self.length + bent / (width * turn[-1])) / self.nodes
        mean = self.length / self.nodes
        least = min(LEAST_SHARE * mean, LEAST_SPACING * thickness)
        low, high = 0.1, 10.0  # factor on the spacing
        for _ in range(40):
            factor = np.sqrt(low * high)
            count = np.cumsum(size / np.maximum(self._graded(factor * wanted), least))
            low, high = (factor, high) if count[-1] > self.nodes else (low, factor)
        return np.concatenate([[0.0], count * (self.nodes / count[-1])])

    def _graded(self, spacing: np.ndarray) -> np.ndarray:
        """Spacing [m] at the samples, reduced to the largest allowed change."""
        rise = GRADING * np.concatenate([self._arc[:-1] + k * self.length for k in range(3)])
        around = np.tile(spacing, 3)
        ahead = np.minimum.accumulate(around - rise) + rise
        both = np.minimum.accumulate((ahead + rise)[::-1])[::-1] - rise
        return both[len(spacing) : 2 * len(spacing)]

    @staticmethod
    def _around(values: np.ndarray, period: float) -> np.ndarray:
        """Values along three periods, the first a period back."""
        return np.concatenate([values[:-1] - period, values[:-1], values + period])

    def _along(self, x: np.ndarray, given: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Linear interpolation from one measure along the thread to another."""
        rounds = np.floor(x / given[-1])
        return rounds * wanted[-1] + np.interp(x - rounds * given[-1], given, wanted)

    def at_plan(self, plan: np.ndarray) -> np.ndarray:
        """Arc lengths [m] at plan arc lengths [m]."""
        return self._along(plan, self._plan, self._arc)

    def at_node(self, number: np.ndarray) -> np.ndarray:
        """Arc lengths [m] of nodes, which need not be whole."""
        return self._along(number, self._count, self._arc)

    def number(self, arc: np.ndarray) -> np.ndarray:
        """Nodes, not whole, at arc lengths [m]."""
        return self._along(arc, self._arc, self._count)

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Points (m, 3) [m]."""
        return self._curve(self._along(s, self._arc, self._plan))

    def slope(self, s: np.ndarray) -> np.ndarray:
        """Unit vectors (m, 3) along it."""
        slope = self._curve.slope(self._along(s, self._arc, self._plan))
        return slope / np.linalg.norm(slope, axis=1, keepdims=True)
