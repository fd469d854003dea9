"""The loop that finds an equilibrium: time steps and convergence checks until a mesh has converged.

It serves one mesh or many side by side. Each mesh is checked by itself, so results do not depend on the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..base.errors import Diverged
from ..measure import tension_scale
from ..mechanics.worlds import Worlds
from .convergence import TENSION_FLOOR, Convergence

ON_THE_WAY = 3.0  # residual over its tolerance to which a mesh with a history converges between two levels
ANY = 1e30  # the same where no wires touch: nothing there has a history


@dataclass(frozen=True)
class CheckOutcome:
    """Meshes that converged or failed at a convergence check."""

    converged: list[int]
    failed: dict[int, Diverged]


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

    def advance(self, rows: np.ndarray) -> CheckOutcome:
        """Step these meshes to their next convergence check, and check them."""
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
            return CheckOutcome([], failed)
        checks = np.array([self.relaxations[row].progress.checks for row in rows])
        loading = self.group.is_loading(rows)
        check = self.group.check(rows, checks, loading)
        ratio = check.ratio
        for row, residual in zip(rows[~loading].tolist(), check.residual[~loading].tolist(), strict=True):
            self.relaxations[row].progress.residual = residual
        if len(self.group.members) == 1 and not loading[0]:
            ratio = np.array([self.relaxations[0].corrected(float(ratio[0]))])
        asked = np.array([self.relaxations[row].progress.to_ratio for row in rows])
        at_limit = np.asarray(self.group.strains.at_limit(rows).any(axis=1))
        asked[at_limit] = ON_THE_WAY
        asked[(asked > 1.0) & ~self.group.touches[rows]] = ANY
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
        return CheckOutcome(rows[~unconverged].tolist(), failed)

    def solve(self) -> None:
        """Step one mesh alone until it is in equilibrium. Raises `Diverged`."""
        relaxation, row = self.relaxations[0], np.array([0])
        while True:
            outcome = self.advance(row)
            if outcome.failed:
                raise outcome.failed[0]
            if outcome.converged:
                return
            relaxation.monitor(relaxation.progress)
