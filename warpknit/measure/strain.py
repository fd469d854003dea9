"""Deformation gradients and stresses of a mesh as a membrane: clamp rotation, stretch, true stress; work of its edge.

Clamps keep their direction in the model and the boundary turns the other way, F = R^T U with U upper triangular; what is
measured of the mesh as a whole is turned back, to the frame in which the boundary is strained by U.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..base.text import percent
from ..compute.steering import Steering


def rotation(angle: Any) -> np.ndarray:
    """(..., 2, 2) counter-clockwise by angles [rad]; exactly the unit matrix at 0."""
    matrix = np.empty((*np.shape(angle), 2, 2))
    matrix[..., 0, 0] = matrix[..., 1, 1] = np.cos(angle)
    matrix[..., 1, 0] = np.sin(angle)
    matrix[..., 0, 1] = -matrix[..., 1, 0]
    return matrix


def clamp_rotation(gradient: np.ndarray) -> Any:
    """[rad] counter-clockwise rotation of the clamps relative to the boundary, from deformation gradients (..., 2, 2)."""
    return np.arctan2(0.0 - gradient[..., 1, 0], gradient[..., 0, 0])


def stretch(gradient: np.ndarray) -> np.ndarray:
    """U (..., 2, 2) of F = R^T U, up to rounding."""
    angle = clamp_rotation(gradient)
    if not np.any(angle):
        return gradient.copy()
    turned = np.round(rotation(angle) @ gradient, 14) + 0.0
    return np.where(np.asarray(angle)[..., None, None] != 0.0, turned, gradient)


def strain_text(gradient: np.ndarray) -> str:
    """Strains of a deformation gradient (2, 2) in words.

    >>> strain_text(np.diag([1.02, 1.03]))
    '2.0 % in weft and 3.0 % in warp'
    """
    weft, warp = (percent(strain) for strain in np.diag(stretch(gradient)) - 1.0)
    return f"{weft} in weft and {warp} in warp"


def true_stress(nominal: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Cauchy stress (..., 2, 2) [N/m], force per current width, of a nominal one: P F^T / det F.

    At twice its width a mesh has the same tension in weft, and half of it in warp:

    >>> true_stress(np.diag([1.0, 1.0]), np.diag([2.0, 1.0])).tolist()
    [[1.0, 0.0], [0.0, 0.5]]
    """
    return np.asarray(nominal @ np.swapaxes(gradient, -1, -2) / np.linalg.det(gradient)[..., None, None])


class Boundary:
    """Deformation of the boundary and length of the wires, from the control array."""

    control: Steering  # of this state

    @property
    def gradient(self) -> np.ndarray:
        """(2, 2) deformation gradient of the boundary, relative to which clamps keep their direction."""
        return np.asarray(self.control.gradient)

    @property
    def clamp_rotation(self) -> float:
        """[rad] rotation of the clamps relative to the boundary."""
        return float(clamp_rotation(self.gradient))

    @property
    def stretch(self) -> np.ndarray:
        """(2, 2) deformation gradient of the boundary without the rotation of the clamps."""
        return stretch(self.gradient)

    @property
    def length_factor(self) -> float:
        """1 + alpha (T - T0) of the wires."""
        return float(self.control.length_factor)

    @property
    def kinetic_energy(self) -> float:
        """[J] of the last step."""
        return 0.5 * float(self.control.kinetic_twice)


class EdgeWork:
    """Work of clamps off the affine outline, and of uneven temperatures.

    Integrated over the records of a run by the trapezoidal rule.
    """

    KEPT = ("_work", "_last")

    def __init__(self) -> None:
        self._work = 0.0
        self._last: list[np.ndarray] = []  # forces [N], displacements [m], forces [J] on thermal strains, thermal strains

    def add(self, *terms: tuple[np.ndarray, np.ndarray]) -> float:
        """Add a record, as pairs (force, displacement) of equal shapes; return the work [J] since the first one."""
        now = [values for pair in terms for values in pair]
        if self._last:
            for force in range(0, len(now), 2):
                mean = 0.5 * (now[force] + self._last[force])
                self._work += float(np.sum(mean * (now[force + 1] - self._last[force + 1])))
        self._last = now
        return self._work
