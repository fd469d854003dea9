"""Residual of a spatial mesh: how far the state is from equilibrium."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..mechanics.numerics import ENERGY_FLOOR, FORCE_FLOOR, LOCAL_ALLOWANCE
from .contact_checks import ContactSums
from .contact_multipliers import ContactMultipliers
from .model import SpatialModel
from .rod_checks import StateSums
from .rod_relaxation import RodRelaxation

ROUND_OFF = 1e5  # times that of EA: smallest dead load whose equilibrium is found within the tolerance


class Residual:
    """Residual of the state last evaluated; converged where its ratio is below 1."""

    def __init__(self, model: SpatialModel, relaxation: RodRelaxation, multipliers: ContactMultipliers | None) -> None:
        """multipliers: of the contacts, where there are any."""
        self.model, self.relaxation, self.multipliers = model, relaxation, multipliers
        self.tolerance = model.scene.solver.residual_tolerance

    def ratio(self, state: StateSums, contacts: ContactSums, rows: np.ndarray) -> np.ndarray:
        """[row] the largest criterion over its tolerance: residual, and errors of softened axial strain and soft contacts."""
        ratio = np.maximum(self.measure(state, contacts, rows) / self.tolerance, state.excess_ratio)
        return ratio if self.multipliers is None else np.maximum(ratio, self.multipliers.error_ratio(contacts))

    def _least_force(self, of_knit: float, rows: np.ndarray) -> np.ndarray:
        """[row] [N] least force that residuals are compared with: that of the knit, or a smaller dead load."""
        load, model = self.relaxation.stepper.steering.dead_load[rows], self.model
        round_off = float(np.finfo(wp.dtype_to_numpy(model.precision.real)).eps)
        smallest = ROUND_OFF * round_off * float(model.rods.of_wires("axial_stiffness").max())
        return np.where(load == 0.0, of_knit, np.minimum(of_knit, np.maximum(load, smallest)))

    def measure(self, state: StateSums, contacts: ContactSums, rows: np.ndarray) -> np.ndarray:
        """[row] the larger of the relative unbalanced force and the relative motion, compared with solver.residual_tolerance.

        Sums of the state last evaluated.
        """
        relaxation, scene = self.relaxation, self.model.scene
        bent = self.model.bending_stiffness / scene.knit.wale_spacing
        scale = np.maximum(contacts.mean_push, self._least_force(FORCE_FLOOR * bent / scene.knit.wale_spacing, rows))
        rms = np.sqrt(state.unbalanced_square / max(state.free_nodes, 1))
        stepper = relaxation.stepper
        loops = stepper.strip.whole.node_count / stepper.worlds / scene.model.nodes_per_loop
        motion = np.sqrt(relaxation.kinetic_energy(rows) / np.maximum(state.energy, ENERGY_FLOOR * bent * loops))
        return np.maximum(np.maximum(rms / scale, state.unbalanced_max / LOCAL_ALLOWANCE / scale), motion)
