"""When a state counts as at rest: forces balance, and motion has died down."""

from __future__ import annotations

import math

import numpy as np

from . import measure
from .kernels import control as c
from .look import Sums
from .model import Model
from .state import State

ENERGY_FLOOR = 1e-5  # of EI/W a loop: what kinetic energy is compared with where less is stored
FORCE_FLOOR = 0.05  # of EI/W^2: what the residual is compared with where contacts carry less
ROUND_OFF_RMS = 3.0  # rms residual that counts as round-off, over that of an edge: 1.7 of its length, a force has two edges
ROUND_OFF_LARGEST = 4.0  # the same of the largest residual, which is allowed LOCAL_ALLOWANCE times more
ROUND_OFF_SHARE = 0.1  # of the mean contact force: more round-off than this is no balance, and needs double precision
LOCAL_ALLOWANCE = 10.0  # times the tolerance that the largest residual may be; the fourth root of their number if that is more,
# which is as much as one that is alone adds to the mean fourth power of all


class Steadiness:
    """Measures how far a state is from rest, from what a look at it summed up."""

    def __init__(self, model: Model, state: State) -> None:
        self.model = model
        self.state = state
        h = float(model.table.spacing.min())
        epsilon = float(np.finfo(np.float32 if model.precision.name == "single" else np.float64).eps) / 2
        # rounding of an edge, seen through the stretching and the bending stiffness of a segment
        self._round_off_terms = (epsilon, 4 * model.bending_stiffness / h**2)
        self._stretch_energy = h / model.axial_stiffness
        self._bend_energy = model.bending_stiffness / h

    def measure(self, control: np.ndarray, sums: Sums) -> float:
        """The larger of balance and motion, both to be compared with solver.residual_tolerance.

        Balance: rms nodal residual over the mean contact force, and a share of the largest; less where round-off leaves more.
        Motion: root of kinetic over stored energy; it is what soft modes still have to go, which the residual does not see.
        """
        model, tolerance = self.model, self.model.scene.solver.residual_tolerance
        scale = max(sums.force_mean, FORCE_FLOOR * measure.force_scale(model))
        mesh = model.whole.panel
        free = mesh.node_count + mesh.body_count - len(mesh.held_node)
        rms, largest = math.sqrt(control[int(c.FORCE_SQUARE)] / free), float(control[int(c.FORCE_MAX)])
        epsilon, bending = self._round_off_terms
        round_off = epsilon * np.hypot(self.state.wire_axial.numpy().astype(np.float64), bending)  # [wire]
        square = model.ranks.sum(np.array([np.sum(round_off**2 * model.panel.wire_count)])) / mesh.node_count
        round_off_rms = math.sqrt(float(square[0]))
        round_off_largest = float(model.ranks.largest(round_off.max(keepdims=True))[0])
        most = ROUND_OFF_SHARE * scale
        local = max(LOCAL_ALLOWANCE, free**0.25)
        balance = max(
            rms / max(scale, min(ROUND_OFF_RMS * round_off_rms, most) / tolerance),
            largest / (local * max(scale, min(ROUND_OFF_LARGEST * round_off_largest, most) / tolerance)),
        )
        stored = 0.5 * sums.tension_square * self._stretch_energy + 0.5 * sums.turning_square * self._bend_energy
        motion = math.sqrt(
            0.5 * float(control[int(c.KINETIC_TWICE)]) / max(stored, ENERGY_FLOOR * measure.energy_scale(model.whole))
        )
        return max(balance, motion)
