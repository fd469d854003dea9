"""The residual of a state: out-of-balance forces and kinetic energy."""

from __future__ import annotations

import numpy as np

from .. import measure
from ..compute.steering import Steering
from ..mechanics.numerics import ENERGY_FLOOR, FORCE_FLOOR, LOCAL_ALLOWANCE
from .diagnostics import Sums
from .model import Model

ROUND_OFF_RMS = 3.0  # rms residual of round-off over that of an edge: 1.7 of its length, two edges a force
ROUND_OFF_LARGEST = 4.0  # the same for the largest residual
ROUND_OFF_SHARE = 0.1  # of the mean contact force: larger round-off needs double precision


class Residual:
    """Computes the residual from the sums of a convergence check."""

    def __init__(self, model: Model) -> None:
        self.model = model
        h = float(model.table.spacing.min())
        epsilon = float(np.finfo(np.float32 if model.precision.name == "single" else np.float64).eps) / 2
        # rounding of an edge times the stretching and the bending stiffness of a segment
        self._round_off_terms = (epsilon, 4 * model.bending_stiffness / h**2)
        self._stretch_energy = h / model.axial_stiffness
        self._bend_energy = model.bending_stiffness / h

    def measure(self, control: Steering, sums: Sums, axial: np.ndarray) -> np.ndarray:
        """The larger of balance and motion, for solver.residual_tolerance.

        `axial` (wire,) [N]: the stiffnesses of the dynamics. With replicas all arguments have the replica as first axis.

        Balance: rms nodal residual over the mean contact force, and a share of the largest one, limited by round-off.
        Motion: root of kinetic over stored energy, which measures soft modes with small residual forces.
        """
        model, tolerance = self.model, self.model.scene.solver.residual_tolerance
        scale = np.maximum(sums.force_mean, FORCE_FLOOR * measure.force_scale(model))
        mesh = model.global_model.panel
        round_off_rms, round_off_max = self.round_off(axial)
        free = mesh.node_count + mesh.body_count - len(mesh.held_node)
        rms, largest = np.sqrt(control.force_square / free), control.force_max
        limit = ROUND_OFF_SHARE * scale
        local = max(LOCAL_ALLOWANCE, free**0.25)  # one isolated residual changes the mean fourth power of all by this
        balance = np.maximum(
            rms / np.maximum(scale, np.minimum(round_off_rms, limit) / tolerance),
            largest / (local * np.maximum(scale, np.minimum(round_off_max, limit) / tolerance)),
        )
        stored = 0.5 * sums.tension_square * self._stretch_energy + 0.5 * sums.turning_square * self._bend_energy
        least = ENERGY_FLOOR * measure.energy_scale(model.global_model)
        motion = np.sqrt(0.5 * control.kinetic_twice / np.maximum(stored, least))
        return np.maximum(balance, motion)

    def round_off(self, axial: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (...) [N] due to round-off, rms and largest."""
        model = self.model
        epsilon, bending = self._round_off_terms
        force = epsilon * np.hypot(axial.astype(np.float64), bending)  # [..., wire]
        square = (
            model.ranks.sum(np.asarray(np.sum(force**2 * model.panel.wire_count, axis=-1))) / model.global_model.panel.node_count
        )
        return ROUND_OFF_RMS * np.sqrt(square), ROUND_OFF_LARGEST * model.ranks.largest(np.asarray(force.max(axis=-1)))

    def is_lost_in_round_off(self, sums: Sums, axial: np.ndarray) -> bool:
        """Whether round-off exceeds the allowed out-of-balance forces."""
        scale = np.maximum(sums.force_mean, FORCE_FLOOR * measure.force_scale(self.model))
        return bool(self.round_off(axial)[0] > ROUND_OFF_SHARE * scale)
