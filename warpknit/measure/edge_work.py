"""Work of clamps off the affine outline, and of uneven temperatures.

Integrated over the recorded states by the trapezoidal rule.
"""

from __future__ import annotations

import numpy as np


class EdgeWork:
    """Sum of the edge work over the records of a run."""

    KEPT = ("_work", "_last")

    def __init__(self) -> None:
        self._work = 0.0
        self._last: list[np.ndarray] = []  # forces [N], displacements [m], forces [J] on thermal strains, thermal strains

    def add(self, *terms: tuple[np.ndarray, np.ndarray]) -> float:
        """Add a record, as pairs (force, displacement) of equal shapes; return the work [J] since the first one."""
        now = [values for pair in terms for values in pair]
        if self._last:
            for force in range(0, len(now), 2):
                mean = 0.5 * (now[force] + self._last[force])
                self._work += float(np.sum(mean * (now[force + 1] - self._last[force + 1])))
        self._last = now
        return self._work
