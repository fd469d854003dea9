"""How the contact between two wires is carried: by a free body, as everywhere in a mesh, or in one of the ways that the study
of two hooked wires compares (Guglielmini, Marotta and Salvini 2022, section 2).

| treatment | body | radius | tied to the ground |
|---|---|---|---|
| free-body | a mass | the body's | no |
| point | a node of the left wire | the reach of a body and both wires | no |
| spring-point | a point | 0 | by a spring |
| spring-cylinder | a cylinder | the body's | by a spring |
| ring | a rigid ring that both wires pass through | inner, and outwards: the reach is negative | by a spring |
| friction-plane | a cylinder | the body's | by friction |
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..scene import Scene

ELASTIC_SLIP = 0.01  # diameters of the wire that a body on a plane gives way before it slips
PINBALL = 4.0  # reaches behind its target at which a contact point is no longer taken to be in contact


@dataclass(frozen=True)
class Treatment:
    """Properties of a treatment for the step and the model."""

    reach: float  # [m] distance of body centre and wire centre line at which they touch; negative where a ring holds the wire
    spring_stiffness: float = 0.0  # [N/m] between body and ground
    spring_limit: float = math.inf  # [N] that the spring bears; beyond it the body slips
    anchored: bool = False  # whether there is a spring
    contact_node: int | None = None  # node of the left wire that is the contact point
    pinball: float = math.inf  # [m]
    target_share: float = 1.0  # of the right wire, about its middle, that the contact point may touch

    @property
    def is_free(self) -> bool:
        """Whether bodies move freely, as in a mesh."""
        return not self.anchored and self.contact_node is None


def choose_treatment(scene: Scene, thickness: float, contact_stiffness: float = math.inf) -> Treatment:
    """The treatment of a scene, with `thickness` [m] of the yarn where it touches and the contact penalty [N/m], than which a
    plane holds a body no stiffer before it slips."""
    contact = scene.contact
    reach = scene.model.body_radius + 0.5 * thickness
    spring = contact.spring_stiffness or 0.0
    match contact.treatment:
        case "free-body":
            return Treatment(reach)
        case "point":
            # between the two clamps are nodes 1 .. nodes_per_loop + 1; a clamp itself is no place for a contact
            segments = scene.model.nodes_per_loop
            node = 1 + min(max(round((contact.contact_point or 0.0) * segments), 1), segments - 1)
            pinball = PINBALL * 2.0 * reach
            return Treatment(2.0 * reach, contact_node=node, pinball=pinball, target_share=contact.target_share or 1.0)
        case "spring-point":
            return Treatment(0.5 * thickness, spring, anchored=True)
        case "spring-cylinder":
            return Treatment(reach, spring, anchored=True)
        case "ring":
            return Treatment(0.5 * thickness - (contact.ring_radius or 0.0), spring, anchored=True)
        case _:
            limit = (contact.plane_friction or 0.0) * (contact.plane_load or 0.0)
            stick = min(limit / (ELASTIC_SLIP * scene.wire.diameter), contact_stiffness)
            return Treatment(reach, stick, limit, anchored=True)
