"""Residual of a spatial mesh: how far the state is from equilibrium."""

from __future__ import annotations

import math

import numpy as np

from ..numerics import AXIAL_ERROR, ENERGY_FLOOR, FORCE_FLOOR, LOCAL_ALLOWANCE
from .contact_multipliers import OVERLAP_ERROR, ContactMultipliers
from .contacts import Contacts
from .model import SpatialModel
from .rod_relaxation import RodRelaxation


class Residual:
    """Residual of the state last evaluated; converged where its ratio is below 1."""

    def __init__(self, model: SpatialModel, relaxation: RodRelaxation, multipliers: ContactMultipliers | None) -> None:
        """multipliers: of the contacts, where there are any."""
        self.model, self.relaxation, self.multipliers = model, relaxation, multipliers
        self.tolerance = model.scene.solver.residual_tolerance

    def ratio(self, touching: Contacts, forces: np.ndarray) -> float:
        """The largest criterion over its tolerance: residual, and errors of the softened axial strain and of soft contacts."""
        ratio = max(self.measure(touching, forces) / self.tolerance, self.relaxation.stretch_error() / AXIAL_ERROR)
        return ratio if self.multipliers is None else max(ratio, self.multipliers.error(touching) / OVERLAP_ERROR)

    def measure(self, touching: Contacts, forces: np.ndarray) -> float:
        """The larger of the relative unbalanced force and the relative motion, compared with solver.residual_tolerance.

        touching: contacts of the state last evaluated; forces (any, 3) [N] unbalanced.
        """
        relaxation, scene = self.relaxation, self.model.scene
        pushing = touching.force[touching.force > 0.0]
        bent = self.model.bending_stiffness / scene.knit.wale_spacing
        scale = max(float(pushing.mean()) if len(pushing) else 0.0, FORCE_FLOOR * bent / scene.knit.wale_spacing)
        force = np.linalg.norm(forces, axis=1)
        balance = max(float(np.sqrt(np.mean(force**2))), float(force.max()) / LOCAL_ALLOWANCE) / scale
        loops = self.model.rods.node_count / scene.model.nodes_per_loop
        motion = math.sqrt(relaxation.kinetic_energy() / max(relaxation.stepper.energy(), ENERGY_FLOOR * bent * loops))
        return max(balance, motion)
