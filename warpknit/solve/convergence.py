"""Convergence and stagnation of a relaxation, for one mesh or many: arrays [mesh].

A mesh has converged when all criteria of its model are met and its tension no longer changes: a soft mode can be far from
equilibrium although forces nearly balance and velocities are small. A level whose residual ratio does not decrease by a tenth
within the patience is abandoned.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..mechanics.protocols import Drift

RESTART_RATIO = 100.0  # over the best ratio: the mesh snapped to another state, the count restarts
PROGRESS_RATIO = 0.9  # over the best ratio: counts as progress
PATIENCE = 1500  # checks without progress before a level is abandoned
PATIENCE_NODES = 100  # nodes a loop up to which that holds
MOST_WAITING = 100  # checks with all criteria met, for a residual further below its tolerance
UNKNOWN = 1.0  # drift ratio before there are enough checks: not converged
TENSION_FLOOR = 1e-3  # of EI/C^3: lower bound of the tension in its relative change


def patience_of(nodes_per_loop: int) -> int:
    """Checks without progress before a level is abandoned; grows with the square of the nodes, as bending periods do."""
    return round(PATIENCE * max(1.0, (nodes_per_loop / PATIENCE_NODES) ** 2))


class Convergence:
    """Residual ratio and stress over the convergence checks."""

    KEPT = ("_best", "_stalled", "_met", "_stress")

    def __init__(self, drift: Drift, count: int, *, tolerance: float, least_tension: float, nodes_per_loop: int) -> None:
        """`least_tension` [N/m]: lower bound of the tension in its relative change."""
        self.drift, self.tolerance, self.least_tension = drift, tolerance, least_tension
        self.patience = patience_of(nodes_per_loop)
        self._best = np.full((count, 2), np.inf)  # ratio of the residual criteria, and of the drift once these are met
        self._stalled = np.zeros(count, dtype=int)  # checks since the ratio decreased
        self._met = np.zeros(count, dtype=int)  # checks in a row with all criteria met
        self._stress = np.zeros((count, drift.required_checks + 1, 2, 2))  # [N/m] at the last of them

    def begin(self, row: int) -> None:
        """A level of this mesh begins."""
        self._best[row], self._stalled[row], self._met[row] = np.inf, 0, 0

    def with_drift(
        self,
        rows: np.ndarray,
        ratio: np.ndarray,
        stress: Callable[[np.ndarray], np.ndarray],
        to_ratio: np.ndarray | float = 1.0,
        is_followed: np.ndarray | bool = False,
    ) -> np.ndarray:
        """[row] the larger ratio, of the residual or of the drift of the tension; below 1: converged.

        The drift ratio is computed where the residual ratio is small enough; only there `stress` (row, 2, 2) [N/m] is evaluated.
        to_ratio: requested ratios of the residual, of all or [row]. Above 1 the drift does not count. is_followed: whether the
        drift counts above 1, too.
        """
        to_ratio = np.broadcast_to(to_ratio, ratio.shape)
        unmet = ratio / np.maximum(to_ratio, 1.0)
        met = unmet < 1.0
        self._met[rows[~met]] = 0
        met &= (to_ratio <= 1.0) | is_followed
        if met.any():
            drift = self._drift_ratio(rows[met], stress(rows[met]))
            unmet[met] = np.maximum(unmet[met], drift / np.where(drift == UNKNOWN, 1.0, np.maximum(to_ratio[met], 1.0)))
            waits = met & (self._met[rows] <= MOST_WAITING)
            unmet[waits] = np.maximum(unmet[waits], ratio[waits] / to_ratio[waits])
        return unmet

    def _drift_ratio(self, rows: np.ndarray, stress: np.ndarray) -> np.ndarray:
        """[row] extrapolated drift of the stress over its tolerance; 1 with too few checks."""
        self._stress[rows] = np.roll(self._stress[rows], -1, axis=1)
        self._stress[rows, -1] = stress
        self._met[rows] += 1
        span, largest = self.drift.checks, (1, 2)
        now, before = self._stress[rows, -1], self._stress[rows, -1 - span]
        moved = np.abs(now - before).max(axis=largest)
        if self.drift.max_decay_ratio > 0.0:
            earlier = np.abs(before - self._stress[rows, -1 - 2 * span]).max(axis=largest)
            moved = moved / (1.0 - np.minimum(moved / np.maximum(earlier, 1e-300), self.drift.max_decay_ratio))
        scale = np.maximum(np.abs(now).max(axis=largest), self.least_tension)
        drift = moved / (self.tolerance * scale)
        return np.asarray(np.where(self._met[rows] > self.drift.required_checks, drift, UNKNOWN))

    def drifts(self, row: int) -> bool:
        """Whether only the drift of the tension is above its tolerance."""
        return bool(self._met[row] > 0)

    def is_stalled(self, rows: np.ndarray, ratio: np.ndarray) -> np.ndarray:
        """[row] whether a level makes no progress; checks that only wait for the drift do not count."""
        met = self._met[rows]
        waits = (met > 0) & (met <= self.drift.required_checks)
        criterion = (met > 0).astype(int)
        best = self._best[rows, criterion]
        better = ~waits & ((ratio < PROGRESS_RATIO * best) | (ratio > RESTART_RATIO * best))
        self._best[rows, criterion] = np.where(better, ratio, best)
        self._stalled[rows] = np.where(better, 0, self._stalled[rows] + ~waits)
        return np.asarray(self._stalled[rows] > self.patience)
