"""How far a state in space is from equilibrium, over what the scene's tolerance allows."""

from __future__ import annotations

import math

import numpy as np

from ..kernels import control as c
from ..numerics import AXIAL_ERROR, ENERGY_FLOOR, FORCE_FLOOR, LOCAL_ALLOWANCE
from .model import SpatialModel
from .rod_relaxation import RodRelaxation
from .wire_contact import WireContact


class Residual:
    """Of the state last evaluated; 1 is the most that counts as converged."""

    def __init__(self, mesh: SpatialModel, rest: RodRelaxation, contact: WireContact) -> None:
        self.mesh, self.rest, self.contact = mesh, rest, contact
        self.tolerance = mesh.scene.solver.residual_tolerance

    def ratio(self) -> float:
        """By what is out of balance, what moves, and what the softening still hides."""
        return max(self.measure() / self.tolerance, self.rest.stretch_error() / AXIAL_ERROR)

    def measure(self) -> float:
        """The larger of what is out of balance and what moves, to be compared with the tolerance."""
        rest, state, scene = self.rest, self.rest.stepper.state, self.mesh.scene
        touching = self.contact.near().force
        touching = touching[touching > 0.0]
        bent = self.mesh.bending_stiffness / scene.knit.wale_spacing
        scale = max(float(touching.mean()) if len(touching) else 0.0, FORCE_FLOOR * bent / scene.knit.wale_spacing)
        force = np.linalg.norm(rest.out_of_balance(), axis=1)
        balance = max(float(np.sqrt(np.mean(force**2))), float(force.max()) / LOCAL_ALLOWANCE) / scale
        loops = self.mesh.rods.node_count / scene.model.nodes_per_loop
        kinetic = 0.5 * float(state.read_control()[int(c.KINETIC_TWICE)])
        motion = math.sqrt(kinetic / max(rest.stepper.energy(), ENERGY_FLOOR * bent * loops))
        return max(balance, motion)
