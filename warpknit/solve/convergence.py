"""When a relaxation has converged, when it no longer gets anywhere: for one mesh or many side by side, arrays [mesh].

A mesh has converged when all criteria of its model are met and its tension stands still: a soft mode can be far from
equilibrium where forces are nearly balanced and slow. A level that does not improve by a tenth for a long time is given up.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..mechanics import Drift

WORSE = 100.0  # times the best ratio: the mesh has snapped to another state, and begins anew
BETTER = 0.9  # of the best ratio counts as progress
PATIENCE = 1500  # checks without progress after which a level counts as never converging
PATIENT_NODES = 100  # a loop, up to which that holds
TENSION_FLOOR = 1e-3  # of EI/C^3: what a change of tension is compared with where the mesh carries less


def patience_of(nodes_per_loop: int) -> int:
    """Checks without progress that a level is given: bending waves take steps with the square of the nodes."""
    return round(PATIENCE * max(1.0, (nodes_per_loop / PATIENT_NODES) ** 2))


class Convergence:
    """Follows the ratios of all criteria, and the stress, from check to check."""

    def __init__(self, drift: Drift, count: int, *, tolerance: float, least_tension: float, nodes_per_loop: int) -> None:
        """`least_tension` [N/m]: what a change of tension is compared with where the mesh carries less."""
        self.drift, self.tolerance, self.least_tension = drift, tolerance, least_tension
        self.patience = patience_of(nodes_per_loop)
        self._best = np.full(count, np.inf)
        self._waited = np.zeros(count, dtype=int)  # checks since the ratio came down
        self._still = np.zeros(count, dtype=int)  # checks in a row with all criteria met
        self._stress = np.zeros((drift.needed + 1, count, 2, 2))  # [N/m] at the last of them

    def begin(self, row: int) -> None:
        """A level of this mesh begins."""
        self._best[row], self._waited[row], self._still[row] = np.inf, 0, 0

    def with_drift(self, rows: np.ndarray, ratio: np.ndarray, stress: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """[row] the larger of the ratio of all criteria and that of the drift of the tension, which counts from 1 down once
        the criteria are met. `stress` (row, 2, 2) [N/m] is asked for those rows alone."""
        met = ratio < 1.0
        self._still[rows[~met]] = 0
        ratio = ratio.copy()
        if met.any():
            ratio[met] = np.maximum(ratio[met], self._moved(rows[met], stress(rows[met])))
        return ratio

    def _moved(self, rows: np.ndarray, stress: np.ndarray) -> np.ndarray:
        """[row] how much the stress moved, and will still move, over what the tolerance allows; 1 for lack of checks."""
        self._stress[:, rows] = np.roll(self._stress[:, rows], -1, axis=0)
        self._stress[-1, rows] = stress
        self._still[rows] += 1
        span, largest = self.drift.checks, (1, 2)
        now, before = self._stress[-1, rows], self._stress[-1 - span, rows]
        moved = np.abs(now - before).max(axis=largest)
        if self.drift.slowest_fall > 0.0:
            earlier = np.abs(before - self._stress[-1 - 2 * span, rows]).max(axis=largest)
            moved = moved / (1.0 - np.minimum(moved / np.maximum(earlier, 1e-300), self.drift.slowest_fall))
        scale = np.maximum(np.abs(now).max(axis=largest), self.least_tension)
        found = moved / (self.tolerance * scale)
        return np.asarray(np.where(self._still[rows] > self.drift.needed, found, 1.0))

    def is_stalled(self, rows: np.ndarray, ratio: np.ndarray) -> np.ndarray:
        """[row] whether a level gets no nearer to convergence."""
        better = (ratio < BETTER * self._best[rows]) | (ratio > WORSE * self._best[rows])
        self._best[rows] = np.where(better, ratio, self._best[rows])
        self._waited[rows] = np.where(better, 0, self._waited[rows] + 1)
        return np.asarray(self._waited[rows] > self.patience)

    def state_dict(self) -> dict[str, np.ndarray]:
        """What a checkpoint keeps."""
        return {
            "convergence_best": self._best.copy(),
            "convergence_waited": self._waited.copy(),
            "convergence_still": self._still.copy(),
            "convergence_stress": self._stress.copy(),
        }

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `state_dict` returned."""
        self._best, self._waited, self._still, self._stress = (
            kept[f"convergence_{name}"].copy() for name in ("best", "waited", "still", "stress")
        )
