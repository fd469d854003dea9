"""Two hooked wires: two arcs that bulge through each other, with one contact body in the lens between them.

The left wire bulges to the right and the right wire to the left, each `overlap`/2 beyond the middle. Both run upwards. The
lower ends are clamped; both upper ends keep their direction; the left one is free to move up and down only (x fixed), the right
one is free up and down too and is driven sideways. This is the arrangement of figure 3 of Guglielmini, Marotta and Salvini
(2022), whose text gives the wire, the radius and these constraints, but neither the length of the arcs nor their overlap.

A mesh is driven by the deformation gradient of its frame, by which clamps at c go to F c. A hook has the frame [[1, g], [0, 1]]
with c = 0 for the three ends that stay and c = (0, height) for the driven one: it moves by g height sideways.

The contact between two wires is carried by a free body, as everywhere in a mesh, or in one of the ways that the study
of two hooked wires compares (Guglielmini, Marotta and Salvini 2022, section 2): see docs/theory/contact.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..kernels import clamp
from ..kernels.wire_forces import BLOCK_PAD, BLOCK_SIZE
from ..scene import Hook, Scene
from .panel import END_NODES, Panel, as32
from .rest_table import Table, table_of_lines

LEFT, RIGHT = 0, 1  # wires, and pairs of the body
LEFT_TOP, RIGHT_TOP = 1, 3  # clamps: two a wire, the lower one first
HELD_BEYOND = 1  # nodes beyond each clamp, which stands at a node


class Arc:
    """Centre line of a wire by its arc length s [m]; `before` [m] is below the lower clamp. A circle continues both ends."""

    def __init__(self, hook: Hook, wire: int, before: float = 0.0) -> None:
        self.before = before
        self.radius = hook.radius
        self.half_angle = 0.5 * hook.length / hook.radius
        self.bulge = 1.0 if wire == LEFT else -1.0
        self.centre = np.array([-self.bulge * (hook.radius - 0.5 * hook.overlap), 0.5 * hook.height])

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Points (m, 3) [m]."""
        t = (np.asarray(s) - self.before) / self.radius - self.half_angle
        x = self.centre[0] + self.bulge * self.radius * np.cos(t)
        return np.stack([x, self.centre[1] + self.radius * np.sin(t), np.zeros_like(t)], axis=-1)

    def tangent(self, s: float) -> np.ndarray:
        """Unit vector (2,) upwards along the wire."""
        t = (s - self.before) / self.radius - self.half_angle
        return np.array([-self.bulge * np.sin(t), np.cos(t)])


def lay_out_hook(scene: Scene, hook: Hook) -> tuple[Table, Panel, float]:
    """Nodes of both wires, their panel, wire length of a loop [m].

    A wire counts as a loop. It has even segments between its clamps, and a node beyond each. The body is in the middle of the
    lens; a single contact point is at its node of the left wire, its target the middle of the right wire.
    """
    segments, set_fraction, treatment = scene.model.nodes_per_loop, scene.wire.set_fraction, choose_treatment(scene)
    spacing, contact_node = hook.length / segments, treatment.contact_node
    count = segments + 1 + 2 * HELD_BEYOND
    lines = [(Arc(hook, wire, HELD_BEYOND * spacing), count, spacing) for wire in (LEFT, RIGHT)]
    table = table_of_lines(lines, set_fraction=set_fraction, lead=BLOCK_SIZE + BLOCK_PAD + 6)
    first = np.array([0, count])
    held = np.array([0, 1, count - 2, count - 1])
    # the two nodes of an upper clamp are a block of their own (kernels/slide.py)
    low = [*range(0, count - 2, BLOCK_SIZE), count - 2]
    block_low = np.tile(low, 2)
    block_count = np.tile(np.diff([*low, count]), 2)
    block_wire = np.repeat([LEFT, RIGHT], len(low))
    place = np.stack([[table.x[s : s + count], table.y[s : s + count]] for s in table.start]).transpose(0, 2, 1)
    reference = np.zeros((4, 2))
    reference[RIGHT_TOP] = [0.0, hook.height]
    body = np.array([0.0, 0.5 * hook.height]) if contact_node is None else place[LEFT, contact_node]
    seed = np.array([_segment_nearest(place[wire], body) for wire in (LEFT, RIGHT)])
    if contact_node is not None:
        seed[LEFT] = contact_node
    low_end, high_end = np.full(2, END_NODES), np.full(2, count - 2 - END_NODES)
    left_out = int(0.5 * (1.0 - treatment.target_share) * (count - 3))
    low_end[RIGHT] += left_out
    high_end[RIGHT] -= left_out
    seed = np.clip(seed, low_end, high_end)
    side = np.array([1, -1])  # of the body, which lies left of the left wire and right of the right one
    panel = Panel(
        size=np.array([hook.height, hook.height]),
        low=np.zeros(2),
        boundary="gripped",
        wire_first=as32(first),
        wire_count=as32([count, count]),
        wire_closed=np.zeros(2, dtype=bool),
        wire_thread=as32([LEFT, RIGHT]),
        wire_length=np.full(2, hook.length),
        wire_clamp=_clamp_numbers(hook, table, set_fraction),
        block_first=as32(first[block_wire] + block_low),
        block_count=as32(block_count),
        block_table=as32(table.start[block_wire] + block_low),
        block_wire=as32(block_wire),
        block_origin=np.zeros((len(block_wire), 2)),
        body_clasp=as32([0]),
        body_rest=body[None],
        body_origin=np.zeros((1, 2)),
        pair_wire=as32([LEFT, RIGHT]),
        pair_seed=as32(first + seed),
        pair_table=as32(table.start + seed),
        pair_shift=np.zeros((2, 2)),
        pair_low=as32(low_end - seed),
        pair_high=as32(high_end - seed),
        pair_side=as32(side),
        held_node=as32(np.concatenate([held, count + held])),
        held_lever=place[:, held].reshape(-1, 2) - np.repeat(reference, 2, axis=0),
        held_clamp=as32(np.repeat(np.arange(4), 2)),
        clamp_position=reference,
        sliding_clamp=as32([LEFT_TOP, RIGHT_TOP]),
    )
    return table, panel, hook.length


def _segment_nearest(place: np.ndarray, body: np.ndarray) -> int:
    """First node of the segment whose middle is nearest to `body` (2,) [m]; `place` (n, 2) [m]."""
    middle = 0.5 * (place[END_NODES : -END_NODES - 1] + place[END_NODES + 1 : -END_NODES])
    return int(np.argmin(np.linalg.norm(middle - body, axis=1))) + END_NODES


def _clamp_numbers(hook: Hook, table: Table, set_fraction: float) -> np.ndarray:
    """[wire, 2, CLAMP_NUMBERS]: clamps stand at nodes, so their hinge turns half as far as one between two segments."""
    numbers = np.zeros((2, 2, clamp.CLAMP_NUMBERS))
    for wire in (LEFT, RIGHT):
        arc = Arc(hook, wire)
        entry = int(table.start[wire]) + END_NODES
        turn = 0.5 * table.rest_turn[entry]
        for end, s in enumerate((0.0, hook.length)):
            of = numbers[wire, end]
            of[[clamp.TANGENT_X, clamp.TANGENT_Y]] = arc.tangent(s)
            of[clamp.LENGTH] = table.rest_length[entry]
            of[[clamp.ANGLE, clamp.NEXT_ANGLE]] = set_fraction * turn, set_fraction * 2.0 * turn
            of[[clamp.HINGE, clamp.NEXT_HINGE]] = 2.0, 1.0
            of[clamp.BOW_WEIGHT] = 3.0
    return numbers


ELASTIC_SLIP = 0.01  # diameters of elastic slip of a body on a plane
PINBALL = 4.0  # reaches behind its target beyond which a contact point is out of contact


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


def choose_treatment(scene: Scene, contact_stiffness: float = math.inf) -> Treatment:
    """Treatment of a scene; contact penalty [N/m]. Before it slips, a plane holds a body no stiffer than the penalty."""
    contact, thickness = scene.contact, scene.wire.thickness
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
