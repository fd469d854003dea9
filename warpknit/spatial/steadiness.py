"""What is left to do until a level of a mesh in space counts as steady, over what the scene's tolerance allows."""

from __future__ import annotations

import math

import numpy as np

from ..kernels import control as c
from .contact import WireContact
from .mesh import SpatialMesh
from .rest import Rest

FORCE_FLOOR = 0.05  # of EI/W^2: what the residual is compared with where contacts carry less
LOCAL_ALLOWANCE = 10.0  # times the tolerance that the largest residual may be
ENERGY_FLOOR = 1e-5  # of EI/W a loop
TENSION_FLOOR = 1e-3  # of EI/C^3
DRIFT_LOOKS = 8  # looks over which the tension must stand still, twice
SLOWEST_FALL = 0.98  # of the change of the tension from one such time to the next, that is reckoned with at most
AXIAL_ERROR = 2e-5  # strain that the softening may still hide


def tension_scale(mesh: SpatialMesh) -> float:
    """EI/C^3 [N/m]: the stiffness of a loose mesh."""
    return mesh.bending_stiffness / mesh.scene.knit.course_spacing**3


class Steadiness:
    """Of the state last evaluated; 1 is the most that counts as steady."""

    def __init__(self, mesh: SpatialMesh, rest: Rest, contact: WireContact) -> None:
        self.mesh, self.rest, self.contact = mesh, rest, contact
        self.tolerance = mesh.scene.solver.residual_tolerance

    def left(self) -> float:
        """By what is out of balance, what moves, and what the softening still hides."""
        return max(self.unrest() / self.tolerance, self.rest.stretch_error() / AXIAL_ERROR)

    def unrest(self) -> float:
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

    def still_to_come(self, tensions: list[list[float]]) -> float:
        """How much the tensions (weft, warp) [N/m] at the last looks will still move; infinite where there are too few.

        From what they moved over the last DRIFT_LOOKS and over as many before: the change goes on to fall by that ratio.
        """
        if len(tensions) <= 2 * DRIFT_LOOKS:
            return math.inf
        now, before, first = (np.array(tensions[-1 - k * DRIFT_LOOKS]) for k in range(3))
        moved, earlier = float(np.linalg.norm(now - before)), float(np.linalg.norm(before - first))
        ratio = min(moved / max(earlier, 1e-300), SLOWEST_FALL)
        floor = TENSION_FLOOR * tension_scale(self.mesh)
        return moved / (1.0 - ratio) / (self.tolerance * max(float(np.abs(now).max()), floor))
