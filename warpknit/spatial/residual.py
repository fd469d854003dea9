"""Residual of a spatial mesh: how far the state is from equilibrium."""

from __future__ import annotations

import math

from ..numerics import ENERGY_FLOOR, FORCE_FLOOR, LOCAL_ALLOWANCE
from .contact_checks import ContactSums
from .contact_multipliers import ContactMultipliers
from .model import SpatialModel
from .rod_checks import StateSums
from .rod_relaxation import RodRelaxation


class Residual:
    """Residual of the state last evaluated; converged where its ratio is below 1."""

    def __init__(self, model: SpatialModel, relaxation: RodRelaxation, multipliers: ContactMultipliers | None) -> None:
        """multipliers: of the contacts, where there are any."""
        self.model, self.relaxation, self.multipliers = model, relaxation, multipliers
        self.tolerance = model.scene.solver.residual_tolerance

    def ratio(self, state: StateSums, contacts: ContactSums) -> float:
        """The largest criterion over its tolerance: residual, and errors of the softened axial strain and of soft contacts."""
        ratio = max(self.measure(state, contacts) / self.tolerance, state.excess_ratio)
        return ratio if self.multipliers is None else max(ratio, self.multipliers.error_ratio(contacts))

    def measure(self, state: StateSums, contacts: ContactSums) -> float:
        """The larger of the relative unbalanced force and the relative motion, compared with solver.residual_tolerance.

        Sums of the state last evaluated.
        """
        relaxation, scene = self.relaxation, self.model.scene
        bent = self.model.bending_stiffness / scene.knit.wale_spacing
        scale = max(contacts.mean_push, FORCE_FLOOR * bent / scene.knit.wale_spacing)
        rms = math.sqrt(state.unbalanced_square / max(state.free_nodes, 1))
        loops = relaxation.stepper.strip.whole.node_count / scene.model.nodes_per_loop
        motion = math.sqrt(relaxation.kinetic_energy() / max(state.energy, ENERGY_FLOOR * bent * loops))
        return max(rms / scale, state.unbalanced_max / LOCAL_ALLOWANCE / scale, motion)
