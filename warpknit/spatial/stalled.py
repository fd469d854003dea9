"""Which softened constraints have stalled: their error stays above its tolerance and makes no progress."""

from __future__ import annotations

import numpy as np


class Stalled:
    """Errors of `count` constraints over the convergence checks."""

    def __init__(self, count: int, tolerance: float, progress: float, patience: int) -> None:
        """An error makes progress if it falls to the share `progress` of itself within `patience` checks."""
        self._tolerance, self._progress, self._patience = tolerance, progress, patience
        self._best = np.full(count, np.inf)  # error at the last progress
        self._checks = np.zeros(count, dtype=int)  # without progress since

    def reset(self) -> None:
        """Start anew."""
        self._best[:], self._checks[:] = np.inf, 0

    def after(self, error: np.ndarray) -> np.ndarray:
        """[constraint] bool: which have stalled with these errors at a check; their count starts anew."""
        waits = (error > self._tolerance) & (error > self._progress * self._best)
        self._best = np.where(waits, self._best, error)
        self._checks = np.where(waits, self._checks + 1, 0)
        stalled = np.asarray(self._checks >= self._patience)
        self._checks[stalled] = 0
        return stalled

    def state_dict(self, name: str) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint, with names that begin with `name`."""
        return {f"{name}_best": self._best.copy(), f"{name}_checks": self._checks.copy()}

    def load_state_dict(self, name: str, kept: dict[str, np.ndarray]) -> None:
        """Restore what `state_dict` returned."""
        self._best, self._checks = kept[f"{name}_best"].copy(), kept[f"{name}_checks"].copy()
