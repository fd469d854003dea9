"""Aitken's relaxation of corrections that are repeated.

Full corrections overshoot where the stiffness is larger than the one they assume. The factor of the next one follows from the
last correction d0, applied with the factor w, and the new one d1:  w -> -w d0 . (d1 - d0)/|d1 - d0|^2
"""

from __future__ import annotations

import numpy as np

FACTORS = (0.1, 1.0)  # smallest and largest


class Aitken:
    """Relaxation factor of one kind of correction."""

    KEPT = ("factor", "_last")

    def __init__(self) -> None:
        self.factor = 1.0  # of the last correction
        self._last = np.zeros(0)

    def begin(self) -> None:
        """Forget earlier corrections."""
        self.factor, self._last = 1.0, np.zeros(0)

    def next_factor(self, correction: np.ndarray, max_factor: float) -> float:
        """Factor to apply to a correction [any], at most `max_factor`."""
        last, self._last, share = self._last, correction, 1.0
        if len(last) == len(correction):
            change = correction - last
            share = float(np.clip(-self.factor * float(last @ change) / max(float(change @ change), 1e-300), *FACTORS))
        self.factor = max_factor * share
        return self.factor
