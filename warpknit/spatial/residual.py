"""Residual of a spatial mesh: how far the state is from equilibrium."""

from __future__ import annotations

import math

import numpy as np

from ..kernels import control as c
from ..numerics import AXIAL_ERROR, ENERGY_FLOOR, FORCE_FLOOR, LOCAL_ALLOWANCE
from .model import SpatialModel
from .rod_relaxation import RodRelaxation
from .wire_contact import WireContact


class Residual:
    """Residual of the state last evaluated; converged where its ratio is below 1."""

    def __init__(self, model: SpatialModel, relaxation: RodRelaxation, contact: WireContact) -> None:
        self.model, self.relaxation, self.contact = model, relaxation, contact
        self.tolerance = model.scene.solver.residual_tolerance

    def ratio(self) -> float:
        """The largest criterion over its tolerance: residual, and error of the softened axial strain."""
        return max(self.measure() / self.tolerance, self.relaxation.stretch_error() / AXIAL_ERROR)

    def measure(self) -> float:
        """The larger of the relative unbalanced force and the relative motion, compared with solver.residual_tolerance."""
        relaxation, state, scene = self.relaxation, self.relaxation.stepper.state, self.model.scene
        touching = self.contact.read_contacts().force
        touching = touching[touching > 0.0]
        bent = self.model.bending_stiffness / scene.knit.wale_spacing
        scale = max(float(touching.mean()) if len(touching) else 0.0, FORCE_FLOOR * bent / scene.knit.wale_spacing)
        force = np.linalg.norm(relaxation.unbalanced_forces(), axis=1)
        balance = max(float(np.sqrt(np.mean(force**2))), float(force.max()) / LOCAL_ALLOWANCE) / scale
        loops = self.model.rods.node_count / scene.model.nodes_per_loop
        kinetic = 0.5 * float(state.read_control()[int(c.KINETIC_TWICE)])
        motion = math.sqrt(kinetic / max(relaxation.stepper.energy(), ENERGY_FLOOR * bent * loops))
        return max(balance, motion)
