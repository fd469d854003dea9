"""Corrections out of the plane, for a mesh on a paraboloid or on cords.

Long waves out of the plane carry little force: a mesh that is far from its height may be within the tolerance of its residual.
They are balanced on a grid of the mesh as a membrane (membrane.py), whose correction measures the error of the height.
"""

from __future__ import annotations

import numpy as np

from ..mechanics.protocols import Mechanics
from ..mesh.rim import Rim
from .membrane import CORRECTION_CHECKS, CORRECTION_GAIN, MAX_FAILED_CORRECTIONS, Aitken, Correction, Membrane, is_settled

LIFT_TOLERANCE = 0.01  # of the height of the edge above the apex: error of the height of the mesh
LEAST_LIFT = 0.1  # the same, of the thickness of the wire, at least
MAX_SLOPE = 0.05  # of one correction, which tilts loops rigidly
# of a correction: the mesh inside has less tension than its mean, where cut wires at the grips carry more
LARGEST_FACTOR = 2.0
UNKNOWN = 1e30


class Lift:
    """The error of the height of a mesh over its tolerance, and its correction."""

    KEPT = ("imbalance", "_least_imbalance", "_failed", "_next_check", "_residual", "_aitken")

    def __init__(self, mechanics: Mechanics, rim: Rim) -> None:
        self.mechanics = mechanics
        scene = mechanics.model.scene
        self.membrane = Membrane(mechanics, rim, scene.knit.wale_spacing)
        self._tolerance, self._least = scene.solver.residual_tolerance, LEAST_LIFT * scene.wire.thickness
        self._aitken = Aitken(LARGEST_FACTOR)
        self.begin()

    def warm_up(self) -> None:
        """Compile its kernels by launching them."""
        count = len(self.membrane.imbalance())
        self.membrane.lift(Correction(np.zeros((count, 1)), np.zeros((0, 1))))

    def begin(self) -> None:
        """Begin a load level."""
        self.imbalance = self._least_imbalance = self._residual = UNKNOWN
        self._next_check, self._failed = CORRECTION_CHECKS, 0
        self._aitken.begin()

    def correct(self, check: int, residual: float) -> float:
        """Error of the height over its tolerance, after a correction if one is due; by the number and the residual of a check."""
        residual /= self._tolerance
        is_due = check >= self._next_check and is_settled(residual, self._residual)
        self._residual = residual
        if is_due and self._failed <= MAX_FAILED_CORRECTIONS:
            self._next_check = check + CORRECTION_CHECKS
            self._correct()
        return self.imbalance if self._failed <= MAX_FAILED_CORRECTIONS else 0.0

    def _correct(self) -> None:
        """Measure the error of the height, and lift the mesh by it.

        Not where it is small, or has not decreased by many corrections.
        """
        mechanics, membrane = self.mechanics, self.membrane
        membrane.imbalance()
        edge = (mechanics.stations, mechanics.clamp_forces())
        lift = membrane.solve_across(mechanics.state.gradient, mechanics.checked_stress, *edge, MAX_SLOPE)
        if lift is None:  # a slack mesh has no height of its own
            self.imbalance = 0.0
            return
        tolerance = max(LIFT_TOLERANCE * float(np.abs(mechanics.stations[:, 2]).max()), self._least)
        self.imbalance = max(1.0, self._aitken.factor) * float(np.abs(lift.grid).max()) / tolerance
        if self.imbalance <= 1.0:
            return
        self._failed += 1
        if self.imbalance < CORRECTION_GAIN * self._least_imbalance:
            self._least_imbalance, self._failed = self.imbalance, 0
        if self._failed > MAX_FAILED_CORRECTIONS:
            mechanics.notes.append(f"the height of the mesh is balanced to {100.0 * LIFT_TOLERANCE * self.imbalance:.2g} %")
            return
        lift = lift.scaled(self._aitken.next_factor(lift.vector, lift.max_factor))
        membrane.lift(lift)
        mechanics.move_stations(lift.in_space)
        mechanics.search()
