"""The drive `relax` of a mesh whose edge is raised to a paraboloid.

Long waves out of the plane carry little force: a mesh that is far from its height may be within the tolerance of its residual.
They are balanced on a grid of the mesh as a membrane (membrane.py), whose correction measures the error of the height.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..mechanics.protocols import Mechanics
from .membrane import Correction, Membrane
from .multilevel import CORRECTION_CHECKS, CORRECTION_GAIN, MAX_FAILED_CORRECTIONS, SETTLED, SLOW_DECAY, Aitken
from .progress import Progress
from .relax import Relaxation

LIFT_TOLERANCE = 0.01  # of the height of the edge above the apex: error of the height of the mesh
MAX_SLOPE = 0.05  # of one correction, which tilts loops rigidly
LEAST_LIFT = 0.01  # the same, of the thickness of the wire, at least


class RaisedRelaxation(Relaxation):
    """A relaxation with corrections out of the plane."""

    KEPT = (*Relaxation.KEPT, "_lift")

    def __init__(
        self,
        mechanics: Mechanics,
        progress: Progress | None = None,
        monitor: Callable[[Progress], None] = lambda _: None,
    ) -> None:
        super().__init__(mechanics, progress, monitor)
        assert mechanics.rim is not None
        self.membrane = Membrane(mechanics, mechanics.rim, self.scene.knit.wale_spacing)
        self._lift = Aitken()

    def compile(self) -> None:
        super().compile()
        kept = self.snapshot()
        count = len(self.membrane.imbalance())
        self.membrane.lift(Correction(np.zeros((count, 1)), np.zeros((0, 2))))
        self.restore(kept)

    def _begin_solving(self, to_ratio: float) -> None:
        super()._begin_solving(to_ratio)
        progress = self.progress
        progress.imbalance = progress.least_imbalance = progress.ratio = 1e30
        progress.next_balance, progress.failed_corrections, progress.is_uncorrected = CORRECTION_CHECKS, 0, False
        self._lift.begin()

    def corrected(self, ratio: float) -> float:
        progress = self.progress
        if math.isinf(ratio) or progress.is_uncorrected:
            return ratio
        residual = progress.residual / self.scene.solver.residual_tolerance
        is_slow = residual > SLOW_DECAY * progress.ratio or residual < SETTLED
        progress.ratio = residual
        if progress.checks >= progress.next_balance and is_slow:
            progress.next_balance = progress.checks + CORRECTION_CHECKS
            self._correct()
        return max(ratio, progress.imbalance)

    def _correct(self) -> None:
        """Measure the error of the height, and lift the mesh by it.

        Not where it is small, or has not decreased by many corrections.
        """
        progress, membrane = self.progress, self.membrane
        membrane.imbalance()
        lift = membrane.solve_across(self.state.gradient, self.mechanics.checked_stress, MAX_SLOPE)
        if lift is None:  # a slack mesh has no height of its own
            progress.imbalance = 0.0
            return
        tolerance = max(LIFT_TOLERANCE * float(np.abs(self.stations[:, 2]).max()), LEAST_LIFT * self.scene.wire.thickness)
        progress.imbalance = float(np.abs(lift.grid).max()) / tolerance
        progress.failed_corrections += 1
        if progress.imbalance < CORRECTION_GAIN * progress.least_imbalance:
            progress.least_imbalance, progress.failed_corrections = progress.imbalance, 0
        if progress.imbalance <= 1.0:
            return
        if progress.failed_corrections > MAX_FAILED_CORRECTIONS:
            self.mechanics.notes.append(
                f"the height of the mesh is balanced to {100.0 * LIFT_TOLERANCE * progress.imbalance:.2g} %"
            )
            progress.is_uncorrected = True
            return
        membrane.lift(lift.scaled(self._lift.next_factor(lift.vector, lift.max_factor)))
        self.mechanics.search()
