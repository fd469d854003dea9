"""Which softened constraints have stalled: their error stays above its tolerance and makes no progress."""

from __future__ import annotations

import numpy as np


class Stalled:
    """Errors (world, constraint) over the convergence checks."""

    KEPT = ("best", "checks")

    def __init__(self, worlds: int, count: int, tolerance: float, progress: float, patience: int) -> None:
        """An error makes progress if it falls to the share `progress` of itself within `patience` checks."""
        self._tolerance, self._progress, self._patience = tolerance, progress, patience
        self.best = np.full((worlds, count), np.inf)  # error at the last progress
        self.checks = np.zeros((worlds, count), dtype=int)  # without progress since

    def reset(self, rows: np.ndarray) -> None:
        """Start some worlds anew."""
        self.best[rows], self.checks[rows] = np.inf, 0

    def after(self, error: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(row, constraint) bool: which have stalled with these errors at a check; their count starts anew."""
        waits = (error > self._tolerance) & (error > self._progress * self.best[rows])
        self.best[rows] = np.where(waits, self.best[rows], error)
        checks = np.where(waits, self.checks[rows] + 1, 0)
        stalled = checks >= self._patience
        self.checks[rows] = np.where(stalled, 0, checks)
        return stalled
