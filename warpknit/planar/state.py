"""The state: all time-dependent data of a mesh, as device arrays.

Positions are x = F X + u: the displacement u from the affinely mapped rest shape is stored (in counts, see
kernels/__init__.py), never x itself. Two copies of the node displacements alternate: `node_ux[parity]` is current.
Worlds have the world as the first axis of every array; a `State` is one of them, or all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
import warp as wp

from ..base.text import short_repr
from ..compute.arrays import array, names_of, new_arrays
from ..compute.host import fetch, is_in_place, zeros
from ..compute.steering import Steering
from ..kernels import contact_by_batch as b
from ..kernels.bend import BOW, SLOPE_SHARE
from ..kernels.contact_friction import LOOSE
from ..kernels.control import CONTROL_COUNT, PARTIAL_COUNT
from ..mechanics.driven_strain import COUNTS
from ..mechanics.numerics import FIRST_DAMPING, LOOK_AHEAD, MASS_MARGIN, SPEED_SHARE
from .model import Model, body_blocks, contact_batches

STEP_LIMIT = 0.1  # course spacings: a larger displacement in a step, if above a node spacing, is a divergence
ASLEEP = 1e30  # [m] travel before a foreign pair is evaluated: never


@dataclass
class State:
    """Arrays on the device of the model."""

    __repr__ = short_repr

    node_ux: wp.array  # [2, node] [counts]
    node_uy: wp.array
    node_vx: wp.array = array("real")  # [m/s]
    node_vy: wp.array = array("real")
    tension_offset: wp.array = array("real")  # [N] augmented Lagrangian multiplier of the segment to the next node
    wire_axial: wp.array = array("real", "wire")  # [N] axial stiffness of the dynamics: EA over the softening
    wire_mass: wp.array = array("real", "wire")  # node masses over the rest table
    slide_vy: wp.array = array(wp.float64, "sliding clamp")  # [m/s]
    body_ux: wp.array = array("coordinate", "body")  # [counts]
    body_uy: wp.array = array("coordinate", "body")
    body_vx: wp.array = array("real", "body")  # [m/s]
    body_vy: wp.array = array("real", "body")
    anchor_x: wp.array = array(wp.float64, "anchor")  # [m] on the ground, from the body at rest (kernels/anchored_bodies.py)
    anchor_y: wp.array = array(wp.float64, "anchor")
    pair_slide: wp.array = array(wp.int32, "pair")  # current segment, counted from the seed
    pair_u: wp.array = array("real", "pair")  # coordinate on the segment, 0 .. 1
    pair_wake: wp.array = array("real", "pair")  # [m] travel since the last neighbour search up to which the pair sleeps
    pair_offset: wp.array = array("real", "pair")  # [N] augmented Lagrangian multiplier
    pair_node: wp.array = array(wp.int32, "pair")  # first node of the current segment
    pair_gap: wp.array = array("real", "pair")  # [m]; valid where near
    pair_force: wp.array = array("real", "pair")  # [N]
    pair_body_x: wp.array = array("real", "pair")  # [N] force on the body; stale where pair_force is 0
    pair_body_y: wp.array = array("real", "pair")
    pair_nodal_x: wp.array = array("real", "pair node")  # [N] forces on the four nodes; stale where pair_force is 0
    pair_nodal_y: wp.array = array("real", "pair node")
    clamp_from: wp.array = array(wp.vec2d, "clamp")  # [m] displacement from the affinely mapped outline, at the start of the ramp
    clamp_to: wp.array = array(wp.vec2d, "clamp")  # [m] the same at its end
    pair_stuck: wp.array = array(wp.float64, "stuck")  # where it sticks to its wire, with friction (kernels/contact_friction.py)
    plastic_turn: wp.array = array("real", "turn")  # [rad] plastic turning of the nodes; one without yield (kernels/bend.py)
    back_turn: wp.array = array("real", "turn")  # [rad] back turning of kinematic hardening
    wire_thermal_strain: wp.array = array(wp.vec2d, "wire")  # relative excess of the length factor at its first node, its growth
    cached_slide: wp.array = array(wp.int32, "batched")  # cache of kernels/contact_by_batch.py; follows from the other arrays
    cached_node: wp.array = array(wp.int32, "batched node")
    cached_number: wp.array = array("real", "batched number")
    control: wp.array = array(wp.float64, "control")  # see kernels/control.py
    wire_partial: wp.array = array(wp.float64, "block", PARTIAL_COUNT)
    body_partial: wp.array = array(wp.float64, "body block", PARTIAL_COUNT)
    parity: int = 0

    def world(self, index: int) -> State:
        """One of the worlds of `initial_worlds`: its arrays are rows of the common ones."""
        return self._with(lambda array: array[index], lambda shape: shape[1:])

    def alone(self) -> State:
        """This state as the only one of worlds, with the same memory."""
        return self._with(lambda array: array.reshape((1, *array.shape)), lambda shape: (1, *shape))

    def _with(self, view: Callable[[wp.array], wp.array], reshaped: Callable[[tuple[int, ...]], tuple[int, ...]]) -> State:
        """The same with views of all arrays; Warp makes none of an empty one."""
        arrays = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "parity"}
        for name, one in arrays.items():
            arrays[name] = view(one) if one.size else wp.empty(reshaped(one.shape), dtype=one.dtype, device=one.device)
        return State(**arrays, parity=self.parity)

    def arrays(self, *, copied: bool = True) -> dict[str, np.ndarray]:
        """All arrays on the host, by name; not `copied`: on a CPU valid until the next step."""
        named = {name: fetch(getattr(self, name)) for name in KEPT}
        named |= {"node_ux": fetch(self.node_ux)[self.parity], "node_uy": fetch(self.node_uy)[self.parity]}
        return {name: values.copy() for name, values in named.items()} if copied else named

    def restore(self, kept: dict[str, np.ndarray]) -> None:
        """Restore what `arrays` returned."""
        for name in KEPT:
            getattr(self, name).assign(kept[name])
        self.node_ux[self.parity].assign(kept["node_ux"])
        self.node_uy[self.parity].assign(kept["node_uy"])

    @property
    def steering(self) -> Steering:
        """The control array by name."""
        return Steering(self.control)

    @property
    def gradient(self) -> np.ndarray:
        """Deformation gradient (2, 2) of the boundary, a copy."""
        return np.asarray(self.steering.gradient)

    @property
    def clamp_shift(self) -> np.ndarray:
        """Displacement (clamp, 2) [m] of the clamps from the affinely mapped outline."""
        start, share = self.clamp_from.numpy(), self.steering.ramp_share
        return start + share * (self.clamp_to.numpy() - start)

    def move_clamps(self, start: np.ndarray, end: np.ndarray) -> None:
        """Set displacements (clamp, 2) [m] of clamps at start and end of the next ramp."""
        self.clamp_from.assign(np.ascontiguousarray(start))
        self.clamp_to.assign(np.ascontiguousarray(end))

    def stiffen_contact(self, penalty: float) -> None:
        """Set the contact penalty [N/m] and the fictitious mass of the bodies; friction forces do not change."""
        if len(self.pair_stuck):
            stuck, place = self.pair_stuck.numpy(), self.pair_slide.numpy() + self.pair_u.numpy().astype(np.float64)
            share = self.steering.contact_stiffness / penalty
            self.pair_stuck.assign(np.where(stuck > float(LOOSE), place - share * (place - stuck), stuck))
        self.steering.set(contact_stiffness=penalty, body_inverse_mass=1.0 / (MASS_MARGIN * penalty))


KEPT = names_of(
    State, "node", "wire", "sliding clamp", "body", "anchor", "pair", "pair node", "clamp", "turn", "stuck", "control"
)


def initial_state(model: Model) -> State:
    """The initial state: knitted shape, no velocity, no load."""
    return initial_worlds(model, 1).world(0)


def initial_worlds(model: Model, count: int) -> State:
    """`count` initial states: the world is the first axis of every array."""
    panel, precision, device = model.panel, model.precision, model.device
    nodes, bodies, pairs = panel.node_count, panel.body_count, model.pair_count
    batched = contact_batches(model) * int(b.PAIR_BATCH) if is_in_place(device) else 0
    counts = {
        "node": nodes, "wire": len(panel.wire_first), "sliding clamp": len(panel.sliding_clamp), "body": bodies,
        "anchor": bodies if model.treatment.anchored else 0, "pair": pairs, "pair node": 4 * pairs,
        "clamp": len(panel.clamp_position), "turn": nodes if model.yield_moment else 1,
        "stuck": pairs if model.scene.contact.friction else 0, "batched": batched, "batched node": b.CACHED_NODES * batched,
        "batched number": b.CACHED_NUMBERS * batched, "control": CONTROL_COUNT, "block": len(panel.block_first),
        "body block": body_blocks(model),
    }  # fmt: skip
    place = {name: zeros((count, 2, nodes), precision.coordinate, device) for name in ("node_ux", "node_uy")}
    state = new_arrays(State, device, counts, place, precision, worlds=(count,))
    filled = ((state.wire_axial, model.axial_stiffness / model.softening), (state.wire_mass, 1.0), (state.pair_u, 0.5))
    for values, value in (*filled, (state.pair_stuck, LOOSE), (state.cached_slide, b.UNCACHED)):
        values.fill_(value)
    state.pair_wake.assign(np.tile(np.where(panel.pair_wire < 0, ASLEEP, 0.0), (count, 1)))
    spacing = float(model.table.spacing.min())
    relax, as_knitted = model.scene.solver.drive == "relax", (1.0, 0.0, 0.0, 1.0, 1.0)
    state.steering.set(
        load=as_knitted,
        ramp_from=as_knitted,
        ramp_to=as_knitted,
        ramp_share=1.0,
        contact_stiffness=model.contact_stiffness,
        body_inverse_mass=1.0 / model.body_mass,
        drive=0.0 if relax else 1.0,
        time_step=model.time_step,
        damping=FIRST_DAMPING if relax else model.damping,
        bow_moment=2.0 * BOW if relax and model.scene.solver.multipliers else 0.0,
        slope_factor=SLOPE_SHARE / model.bending_stiffness,
        look_ahead=LOOK_AHEAD if relax else 0.0,
        force_factor=model.time_step,
        velocity_factor=1.0,
        speed_limit=SPEED_SHARE * spacing,
        stress_unit=model.axial_stiffness * float(model.global_model.panel.wire_length.sum()) / COUNTS,
        step_limit=max(spacing, STEP_LIMIT * model.scene.knit.course_spacing),
    )
    return state
