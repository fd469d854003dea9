"""The loop of a relaxation: steps, a convergence check, and what it decides, until a mesh is in equilibrium under its load.

It serves one mesh or many side by side; each decides for itself, so its answer does not depend on which others there are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..errors import Diverged
from ..measure import tension_scale
from ..mechanics import Group
from ..numerics import CHECK_STEPS
from .convergence import TENSION_FLOOR, Convergence
from .progress import Progress

DEEPEST = 0.5  # of the thickness: an overlap from which wires may pass through each other


class Relaxing(Protocol):
    """A relaxation of one mesh, as the loop sees it (relax.py)."""

    progress: Progress
    watch: Callable[[Progress], None]

    @property
    def most_steps(self) -> int:
        """Steps of a level after which it counts as never converging."""

    def corrected(self, ratio: float) -> float:
        """The ratio of all criteria, after what a drive does beside the steps."""

    def divergence(self) -> Diverged: ...
    def overlap_error(self) -> Diverged | None: ...
    def stalled(self) -> Diverged: ...
    def too_long(self) -> Diverged: ...


@dataclass(frozen=True)
class Advanced:
    """How the meshes stand after a convergence check."""

    converged: list[int]
    failed: dict[int, Diverged]


class Equilibrium:
    """Brings the meshes of a group to equilibrium, each under the load that its relaxation has put on."""

    def __init__(self, group: Group, relaxations: Sequence[Relaxing]) -> None:
        self.group, self.relaxations = group, relaxations
        scene = group.model.scene
        self.convergence = Convergence(
            group.members[0].drift,
            len(group.members),
            tolerance=scene.solver.residual_tolerance,
            least_tension=TENSION_FLOOR * tension_scale(group.model),
            nodes_per_loop=scene.model.nodes_per_loop,
        )
        self._can_overlap = group.members[0].can_overlap

    def begin(self, row: int) -> None:
        """Start to count the checks of a level anew."""
        self.relaxations[row].progress.checks = 0
        self.convergence.begin(row)

    def advance(self, rows: np.ndarray) -> Advanced:
        """Take the steps to the next convergence check of these meshes, and decide."""
        failed: dict[int, Diverged] = {}
        taken, diverged = self.group.advance(rows, CHECK_STEPS)
        for row, steps, lost in zip(rows.tolist(), taken.tolist(), diverged.tolist(), strict=True):
            relaxation = self.relaxations[row]
            relaxation.progress.steps += steps
            relaxation.progress.checks += 1
            if lost:
                failed[row] = relaxation.divergence()
            elif self._can_overlap and (error := relaxation.overlap_error()) is not None:
                failed[row] = error
        rows = rows[~np.isin(rows, list(failed))]
        if not len(rows):
            return Advanced([], failed)
        checks = np.array([self.relaxations[row].progress.checks for row in rows])
        loading = self.group.is_loading(rows)
        found = self.group.check(rows, checks, loading)
        ratio = found.ratio
        for row, residual in zip(rows[~loading].tolist(), found.residual[~loading].tolist(), strict=True):
            self.relaxations[row].progress.residual = residual
        if len(self.group.members) == 1 and not loading[0]:
            ratio = np.array([self.relaxations[0].corrected(float(ratio[0]))])
        ratio = self.convergence.with_drift(rows, ratio, self.group.stress)
        going = ~(ratio < 1.0)  # not a number has not converged
        judged = going & ~loading
        stalled = self.convergence.is_stalled(rows[judged], ratio[judged])
        for row in rows[judged][stalled].tolist():
            failed[row] = self.relaxations[row].stalled()
        for row, count in zip(rows[going].tolist(), checks[going].tolist(), strict=True):
            if count * CHECK_STEPS > self.relaxations[row].most_steps:
                failed[row] = self.relaxations[row].too_long()
        if going.any():
            self.group.renew(rows[going], checks[going])
        return Advanced(rows[~going].tolist(), failed)

    def solve(self) -> None:
        """Step one mesh alone until it is in equilibrium. Raises `Diverged`."""
        relaxation, row = self.relaxations[0], np.array([0])
        while True:
            found = self.advance(row)
            if found.failed:
                raise found.failed[0]
            if found.converged:
                return
            relaxation.watch(relaxation.progress)
