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
from ..compute.host import fetch, is_in_place
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
WIRE_STATE = ("node_vx", "node_vy", "tension_offset", "wire_axial", "wire_mass", "slide_vy")
BODY_STATE = ("body_ux", "body_uy", "body_vx", "body_vy", "anchor_x", "anchor_y")
CLAMP_STATE = ("clamp_from", "clamp_to", "wire_thermal_strain")
PATH_STATE = ("pair_stuck", "plastic_turn", "back_turn")
PAIR_STATE = ("pair_slide", "pair_u", "pair_wake", "pair_offset", "pair_force", "pair_gap", "pair_node")
FORCE_STATE = ("pair_body_x", "pair_body_y", "pair_nodal_x", "pair_nodal_y")  # of the last step: stress before the next one
ARRAYS = WIRE_STATE + BODY_STATE + PAIR_STATE + CLAMP_STATE + PATH_STATE + FORCE_STATE


@dataclass
class State:
    """Arrays on the device of the model."""

    __repr__ = short_repr

    node_ux: wp.array  # [2, node] [counts]
    node_uy: wp.array
    node_vx: wp.array  # [node] [m/s]
    node_vy: wp.array
    tension_offset: wp.array  # [node] [N] augmented Lagrangian multiplier of the segment to the next node
    wire_axial: wp.array  # [wire] [N] axial stiffness of the dynamics: EA over the softening
    wire_mass: wp.array  # [wire] node masses over the rest table
    slide_vy: wp.array  # [sliding clamp] [m/s]
    body_ux: wp.array  # [body] [counts]
    body_uy: wp.array
    body_vx: wp.array  # [body] [m/s]
    body_vy: wp.array
    anchor_x: wp.array  # [body] [m] anchor on the ground, from the rest position of the body (kernels/anchored_bodies.py)
    anchor_y: wp.array
    pair_slide: wp.array  # [pair] current segment, counted from the seed
    pair_u: wp.array  # [pair] coordinate on the segment, 0 .. 1
    pair_wake: wp.array  # [pair] [m] travel since the last neighbour search up to which the pair sleeps
    pair_offset: wp.array  # [pair] [N] augmented Lagrangian multiplier
    pair_node: wp.array  # [pair] first node of the current segment
    pair_gap: wp.array  # [pair] [m]; valid where near
    pair_force: wp.array  # [pair] [N]
    pair_body_x: wp.array  # [pair] [N] force on the body; stale where pair_force is 0
    pair_body_y: wp.array
    pair_nodal_x: wp.array  # [4 pair] [N] forces on the four nodes; stale where pair_force is 0
    pair_nodal_y: wp.array
    clamp_from: wp.array  # [clamp] vec2d [m] displacement from the affinely mapped outline at the start of the ramp
    clamp_to: wp.array  # [clamp] vec2d [m] the same at its end
    pair_stuck: wp.array  # [pair, or none without friction] where a contact sticks to its wire (kernels/contact_friction.py)
    plastic_turn: wp.array  # [node, or one without yield] [rad] plastic turning (kernels/bend.py)
    back_turn: wp.array  # [node, or one] [rad] back turning of kinematic hardening
    wire_thermal_strain: wp.array  # [wire] vec2d: excess of the length factor at its first node, relative, and its growth
    cached_slide: wp.array  # cache of kernels/contact_by_batch.py; follows from the other arrays
    cached_node: wp.array
    cached_number: wp.array
    control: wp.array  # [CONTROL_COUNT] float64, see kernels/control.py
    wire_partial: wp.array  # [block, PARTIAL_COUNT]
    body_partial: wp.array  # [body block, PARTIAL_COUNT]
    parity: int = 0

    def world(self, index: int) -> State:
        """One of the worlds of `initial_worlds`: its arrays are rows of the common ones."""
        return self._with(lambda array: array[index] if array.size else _empty(array.shape[1:], array))

    def alone(self) -> State:
        """This state as the only one of worlds, with the same memory."""
        return self._with(lambda array: array.reshape((1, *array.shape)) if array.size else _empty((1, *array.shape), array))

    def _with(self, change: Callable[[wp.array], wp.array]) -> State:
        """The same with all arrays changed."""
        return State(**{f.name: change(getattr(self, f.name)) for f in fields(self) if f.name != "parity"}, parity=self.parity)

    def arrays(self, *, copied: bool = True) -> dict[str, np.ndarray]:
        """All arrays on the host, by name; not `copied`: on a CPU valid until the next step."""
        named = {name: fetch(getattr(self, name)) for name in (*ARRAYS, "control")}
        named |= {"node_ux": fetch(self.node_ux)[self.parity], "node_uy": fetch(self.node_uy)[self.parity]}
        return {name: values.copy() for name, values in named.items()} if copied else named

    def restore(self, kept: dict[str, np.ndarray]) -> None:
        """Restore what `arrays` returned."""
        for name in (*ARRAYS, "control"):
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


def _empty(shape: tuple[int, ...], like: wp.array) -> wp.array:
    """An empty array that is not a view (Warp makes none of it)."""
    return wp.empty(shape, dtype=like.dtype, device=like.device)


def initial_state(model: Model) -> State:
    """The initial state: knitted shape, no velocity, no load."""
    return initial_worlds(model, 1).world(0)


def initial_worlds(model: Model, count: int) -> State:
    """`count` initial states: the world is the first axis of every array."""
    real, coordinate, device = model.precision.real, model.precision.coordinate, model.device
    nodes, bodies, pairs = model.panel.node_count, model.panel.body_count, model.pair_count
    wires = len(model.panel.wire_first)
    anchored = bodies if model.treatment.anchored else 0
    batched = contact_batches(model) * int(b.PAIR_BATCH) if is_in_place(device) else 0

    asleep = np.where(model.panel.pair_wire < 0, ASLEEP, 0.0)

    def zeros(size: int, dtype: type) -> wp.array:
        return wp.zeros((count, size), dtype=dtype, device=device)

    def full(size: int, value: float, dtype: type) -> wp.array:
        return wp.full((count, size), value, dtype=dtype, device=device)

    def rows(size: int) -> wp.array:
        return wp.zeros((count, size, PARTIAL_COUNT), dtype=wp.float64, device=device)

    state = State(
        node_ux=wp.zeros((count, 2, nodes), dtype=coordinate, device=device),
        node_uy=wp.zeros((count, 2, nodes), dtype=coordinate, device=device),
        node_vx=zeros(nodes, real),
        node_vy=zeros(nodes, real),
        tension_offset=zeros(nodes, real),
        wire_axial=full(wires, model.axial_stiffness / model.softening, real),
        wire_mass=full(wires, 1.0, real),
        slide_vy=zeros(len(model.panel.sliding_clamp), wp.float64),
        body_ux=zeros(bodies, coordinate),
        body_uy=zeros(bodies, coordinate),
        body_vx=zeros(bodies, real),
        body_vy=zeros(bodies, real),
        anchor_x=zeros(anchored, wp.float64),
        anchor_y=zeros(anchored, wp.float64),
        pair_slide=zeros(pairs, wp.int32),
        pair_u=full(pairs, 0.5, real),
        pair_wake=wp.array(np.broadcast_to(asleep, (count, pairs)), dtype=real, device=device),
        pair_offset=zeros(pairs, real),
        pair_node=zeros(pairs, wp.int32),
        pair_gap=zeros(pairs, real),
        pair_force=zeros(pairs, real),
        pair_body_x=zeros(pairs, real),
        pair_body_y=zeros(pairs, real),
        pair_nodal_x=zeros(4 * pairs, real),
        pair_nodal_y=zeros(4 * pairs, real),
        clamp_from=zeros(len(model.panel.clamp_position), wp.vec2d),
        clamp_to=zeros(len(model.panel.clamp_position), wp.vec2d),
        wire_thermal_strain=zeros(wires, wp.vec2d),
        plastic_turn=zeros(nodes if model.yield_moment else 1, real),
        back_turn=zeros(nodes if model.yield_moment else 1, real),
        pair_stuck=full(pairs if model.scene.contact.friction else 0, LOOSE, wp.float64),
        cached_slide=full(batched, b.UNCACHED, wp.int32),
        cached_node=zeros(b.CACHED_NODES * batched, wp.int32),
        cached_number=zeros(b.CACHED_NUMBERS * batched, real),
        control=zeros(CONTROL_COUNT, wp.float64),
        wire_partial=rows(len(model.panel.block_first)),
        body_partial=rows(body_blocks(model)),
    )
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
