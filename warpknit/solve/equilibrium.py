"""The loop that finds an equilibrium: time steps and convergence checks until a mesh has converged.

It serves one mesh or many side by side. Each mesh is checked by itself, so results do not depend on the others.

A mesh has converged when all criteria of its model are met and its tension no longer changes: a soft mode can be far from
equilibrium although forces nearly balance and velocities are small. A level whose residual ratio does not decrease by a tenth
within the patience is abandoned.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..base.errors import Diverged
from ..measure import tension_scale
from ..mechanics.protocols import Drift
from ..mechanics.worlds import Worlds

RESTART_RATIO = 100.0  # over the best ratio: the mesh snapped to another state, the count restarts
PROGRESS_RATIO = 0.9  # over the best ratio: counts as progress
PATIENCE = 1500  # checks without progress before a level is abandoned
PATIENCE_NODES = 100  # nodes a loop up to which that holds
MOST_WAITING = 100  # checks with all criteria met, for a residual further below its tolerance
UNKNOWN = 1.0  # drift ratio before there are enough checks: not converged
TENSION_FLOOR = 1e-3  # of EI/C^3: lower bound of the tension in its relative change
UNRECORDED = 1.0 + 1e-9  # residual over its tolerance where no record follows: the drift of the tension does not count
ON_THE_WAY = 3.0  # residual over its tolerance to which a mesh with a history converges between two levels
ANY = 1e30  # the same where no wires touch: nothing there has a history


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


class Equilibrium:
    """Finds the equilibria of a group of meshes, each under its own load."""

    def __init__(self, group: Worlds, relaxations: Sequence[Any]) -> None:
        """relaxations: the `Relaxation` (relax.py) of each mesh of the group."""
        self.group, self.relaxations = group, relaxations
        scene = group.model.scene
        self.convergence = Convergence(
            group.members[0].drift,
            len(group.members),
            tolerance=scene.solver.residual_tolerance,
            least_tension=TENSION_FLOOR * tension_scale(group.model),
            nodes_per_loop=scene.model.nodes_per_loop,
        )
        self._check_steps = group.members[0].check_steps
        self._can_overlap = group.members[0].can_overlap

    def begin(self, row: int, to_ratio: float = 1.0) -> None:
        """Start a level: reset its checks; see `Convergence.with_drift`."""
        self.relaxations[row].progress.begin_level(to_ratio)
        self.convergence.begin(row)

    def advance(self, rows: np.ndarray) -> tuple[list[int], dict[int, Diverged]]:
        """Step these meshes to their next convergence check, and check them; return those that converged or failed."""
        failed: dict[int, Diverged] = {}
        taken, diverged = self.group.advance(rows, self._check_steps)
        for row, steps, lost in zip(rows.tolist(), taken.tolist(), diverged.tolist(), strict=True):
            relaxation = self.relaxations[row]
            relaxation.progress.steps += steps
            relaxation.progress.checks += 1
            if lost:
                failed[row] = relaxation.divergence()
        if self._can_overlap:
            for row, overlap in zip(rows.tolist(), self.group.overlap(rows).tolist(), strict=True):
                if row not in failed and (error := self.relaxations[row].overlap_error(overlap)) is not None:
                    failed[row] = error
        rows = rows[~np.isin(rows, list(failed))]
        if not len(rows):
            return [], failed
        checks = np.array([self.relaxations[row].progress.checks for row in rows])
        loading = self.group.is_loading(rows)
        check = self.group.check(rows, checks, loading)
        ratio = check.ratio
        for row, residual in zip(rows[~loading].tolist(), check.residual[~loading].tolist(), strict=True):
            self.relaxations[row].progress.residual = residual
        moved = False
        if len(self.group.members) == 1 and not loading[0]:
            ratio[0], moved = self.relaxations[0].corrected(float(ratio[0]))
        if (met := rows[ratio < 1.0]).size:
            self.group.move_all(met)
        asked = np.array([self.relaxations[row].progress.to_ratio for row in rows])
        at_limit = np.asarray(self.group.strains.at_limit(rows).any(axis=1))
        asked[at_limit] = ON_THE_WAY
        asked[(asked > UNRECORDED) & ~self.group.touches[rows]] = ANY
        if moved:  # it is measured again
            ratio[0], asked[0] = max(ratio[0], 1.0), 1.0
        ratio = self.convergence.with_drift(rows, ratio, self.group.converged_stress, asked, at_limit)
        unconverged = ~(ratio < 1.0)  # not a number has not converged
        checked = unconverged & ~loading
        stalled = self.convergence.is_stalled(rows[checked], ratio[checked])
        for row in rows[checked][stalled].tolist():
            failed[row] = self.relaxations[row].stalled()
        for row, unmet in zip(rows[checked].tolist(), ratio[checked].tolist(), strict=True):
            self.relaxations[row].progress.approach(unmet)
        for row in rows[self.group.strains.is_endless(rows)].tolist():
            failed[row] = self.relaxations[row].not_carried()
        for row, count in zip(rows[unconverged].tolist(), checks[unconverged].tolist(), strict=True):
            if count * self._check_steps > self.relaxations[row].step_limit:
                failed[row] = self.relaxations[row].exceeded_steps()
        self.group.strains.found(rows[~unconverged])
        return rows[~unconverged].tolist(), failed

    def solve(self) -> None:
        """Step one mesh alone until it is in equilibrium. Raises `Diverged`."""
        relaxation, row = self.relaxations[0], np.array([0])
        while True:
            converged, failed = self.advance(row)
            if failed:
                raise failed[0]
            if converged:
                return
            relaxation.monitor(relaxation.progress)
