"""Boundary of a state from the control array, in both models."""

from __future__ import annotations

import numpy as np

from ..compute.steering import Steering
from . import strain


class Boundary:
    """Deformation of the boundary and length of the wires of a state."""

    control: Steering  # of this state

    @property
    def gradient(self) -> np.ndarray:
        """(2, 2) deformation gradient of the boundary, relative to which clamps keep their direction."""
        return np.asarray(self.control.gradient)

    @property
    def clamp_rotation(self) -> float:
        """[rad] rotation of the clamps relative to the boundary."""
        return strain.clamp_rotation(self.gradient)

    @property
    def stretch(self) -> np.ndarray:
        """(2, 2) deformation gradient of the boundary without the rotation of the clamps."""
        return strain.stretch(self.gradient)

    @property
    def length_factor(self) -> float:
        """1 + alpha (T - T0) of the wires."""
        return float(self.control.length_factor)

    @property
    def kinetic_energy(self) -> float:
        """[J] of the last step."""
        return 0.5 * float(self.control.kinetic_twice)
