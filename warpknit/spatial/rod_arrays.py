"""Rods on the device, in double precision: rest data (`RodArrays`) and state (`RodState`)."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import warp as wp

from ..kernels import control as c
from ..kernels.banded_mass import factor_masses, find_accelerations
from ..kernels.rod_bend import bend_rods
from ..kernels.rod_frames import update_frames
from ..kernels.rod_motion import NODE_BLOCK, move_rods, sum_rod_forces
from ..launch import Launch, bind
from .rods import Rods


@dataclass(frozen=True)
class RodArrays:
    """Rest data; all arrays [node] unless noted, segment data included."""

    wire_first: wp.array  # [wire] int
    wire_count: wp.array  # [wire]
    previous: wp.array  # int
    following: wp.array
    held: wp.array
    rest_position: wp.array  # vec3d [m]
    rest_edge: wp.array  # vec3d [m]
    natural_length: wp.array  # [m]
    node_length: wp.array  # [m]
    natural_curvature: wp.array  # vec2d [rad]
    natural_twist: wp.array  # [rad]


@dataclass(frozen=True)
class RodState:
    """Unknowns of the dynamics and what each step computes from them; [node]."""

    displacement: wp.array  # vec3d [m] from the affine map of the rest shape
    velocity: wp.array  # vec3d [m/s]
    pending_turn: wp.array  # [rad] rotation of a section not yet applied to its director
    spin: wp.array  # [rad/s] of a section about its tangent
    angle: wp.array  # [rad] rotation of a section since the start
    tangent: wp.array  # vec3d
    director: wp.array  # vec3d
    tension_offset: wp.array  # [N] augmented Lagrangian multiplier of a segment
    stretch_stiffness: wp.array  # [N] of the dynamics
    # fictitious masses couple neighbours along the wire (kernels/banded_mass.py)
    node_mass: wp.array  # vec3d [kg] along x, y and z
    next_mass: wp.array  # [kg] coupling with the next node
    second_mass: wp.array  # [kg] coupling with the next but one
    spin_inertia: wp.array  # [kg m2] of a segment
    next_inertia: wp.array  # [kg m2] coupling with the next segment
    mass_pivot: wp.array  # factors of both
    mass_lower: wp.array
    mass_border: wp.array
    spin_pivot: wp.array
    spin_lower: wp.array
    spin_border: wp.array
    load_force: wp.array  # vec3d [N] dead load
    load_torque: wp.array  # [N m] about the segment
    position: wp.array  # vec3d [m]
    length: wp.array  # [m]
    curvature: wp.array  # vec2d [rad] turning vector at a node, along the section directors
    twist: wp.array  # [rad]
    plastic_turn: wp.array  # vec2d [rad] plastic part of the turning vector at the last equilibrium
    edge_gradient_before: wp.array  # vec3d [N] gradient of bending and twist energy by the edge before the node
    edge_gradient_after: wp.array  # vec3d [N]
    angle_gradient_before: wp.array  # [N m] gradient by the angle of the segment before the node
    angle_gradient_after: wp.array  # [N m]
    contact_penalty: wp.array  # [N/m] of the contacts at a node
    contact_offset: wp.array  # [m] augmented Lagrangian multiplier of the contacts at a node, over their penalty
    contact_force: wp.array  # vec3d [N]
    contact_couple: wp.array  # vec3d [N m] contact couple on the section of a segment
    force: wp.array  # vec3d [N]
    torque: wp.array  # [N m]
    force_sum: wp.array  # vec3d [N] of all steps since the last convergence check
    acceleration: wp.array  # vec3d [m/s2]
    spin_acceleration: wp.array  # [1/s2]
    control: wp.array  # [CONTROL_COUNT], see kernels/control.py
    partial: wp.array  # [block, PARTIAL_COUNT]
    no_bodies: wp.array  # [1, PARTIAL_COUNT] zeros: the body rows of a planar model

    def arrays(self) -> dict[str, np.ndarray]:
        """Copies of all arrays on the host, by name."""
        return {field.name: getattr(self, field.name).numpy().copy() for field in fields(self)}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Restore what `arrays` returned."""
        for name, value in arrays.items():
            getattr(self, name).assign(value)

    def write_control(self, values: dict[int, float]) -> None:
        """Set entries of the control array."""
        host = self.control.numpy()
        for index, value in values.items():
            host[int(index)] = value
        if not wp.get_device(self.control.device).is_cpu:
            self.control.assign(host)

    def read_control(self) -> np.ndarray:
        """The control array on the host: a view on the CPU, a copy from a GPU."""
        return self.control.numpy()

    @property
    def gradient(self) -> np.ndarray:
        """(2, 2) deformation gradient of the boundary, a copy."""
        return self.read_control()[int(c.GRADIENT) : int(c.GRADIENT) + 4].reshape(2, 2).copy()


def upload_rods(rods: Rods, device: str) -> RodArrays:
    """Rest data on the device; natural curvature and twist default to the rest values times the set fraction."""
    nodes = rods.node_count
    arrays = RodArrays(
        wire_first=wp.array(rods.wire_first, dtype=wp.int32, device=device),
        wire_count=wp.array(rods.wire_count, dtype=wp.int32, device=device),
        previous=wp.array(rods.previous, dtype=wp.int32, device=device),
        following=wp.array(rods.following, dtype=wp.int32, device=device),
        held=wp.array(rods.held, dtype=wp.int32, device=device),
        rest_position=wp.array(rods.position, dtype=wp.vec3d, device=device),
        rest_edge=wp.array(rods.rest_edge, dtype=wp.vec3d, device=device),
        natural_length=wp.array(rods.natural_length, dtype=wp.float64, device=device),
        node_length=wp.array(rods.node_length, dtype=wp.float64, device=device),
        natural_curvature=wp.zeros(nodes, dtype=wp.vec2d, device=device),
        natural_twist=wp.zeros(nodes, dtype=wp.float64, device=device),
    )
    at_rest = rest_state(rods, device)
    frames_launch(arrays, at_rest).run(device)
    bend_launch(rods, arrays, at_rest).run(device)
    curvature, twist = rods.set_fraction * at_rest.curvature.numpy(), rods.set_fraction * at_rest.twist.numpy()
    arrays.natural_curvature.assign(curvature if rods.natural_curvature is None else rods.natural_curvature)
    arrays.natural_twist.assign(twist if rods.natural_twist is None else rods.natural_twist)
    return arrays


def rest_state(rods: Rods, device: str) -> RodState:
    """The rest state, with true masses and stiffnesses."""
    nodes = rods.node_count
    edge = rods.rest_edge
    section = rods.section

    def reals(values: np.ndarray | float = 0.0) -> wp.array:
        return wp.array(np.broadcast_to(values, nodes), dtype=wp.float64, device=device)

    def vectors(values: np.ndarray | None = None) -> wp.array:
        return wp.array(np.zeros((nodes, 3)) if values is None else values, dtype=wp.vec3d, device=device)

    state = RodState(
        displacement=vectors(),
        velocity=vectors(),
        pending_turn=reals(),
        spin=reals(),
        angle=reals(),
        tangent=vectors(edge / np.linalg.norm(edge, axis=1)[:, None]),
        director=vectors(rods.director),
        tension_offset=reals(),
        stretch_stiffness=reals(section.axial_stiffness),
        node_mass=vectors(np.repeat((section.linear_density * rods.node_length)[:, None], 3, axis=1)),
        next_mass=reals(),
        second_mass=reals(),
        spin_inertia=reals(section.rotary_inertia * rods.natural_length),
        next_inertia=reals(),
        mass_pivot=vectors(),
        mass_lower=wp.zeros((2, nodes), dtype=wp.vec3d, device=device),
        mass_border=wp.zeros((2, nodes), dtype=wp.vec3d, device=device),
        spin_pivot=reals(),
        spin_lower=reals(),
        spin_border=reals(),
        load_force=vectors(),
        load_torque=reals(),
        position=vectors(rods.position),
        length=reals(np.linalg.norm(edge, axis=1)),
        curvature=wp.zeros(nodes, dtype=wp.vec2d, device=device),
        twist=reals(),
        plastic_turn=wp.zeros(nodes, dtype=wp.vec2d, device=device),
        edge_gradient_before=vectors(),
        edge_gradient_after=vectors(),
        angle_gradient_before=reals(),
        angle_gradient_after=reals(),
        contact_penalty=reals(),
        contact_offset=reals(),
        contact_force=vectors(),
        contact_couple=vectors(),
        force=vectors(),
        torque=reals(),
        force_sum=vectors(),
        acceleration=vectors(),
        spin_acceleration=reals(),
        control=wp.zeros(c.CONTROL_COUNT, dtype=wp.float64, device=device),
        partial=wp.zeros((-(-nodes // NODE_BLOCK), c.PARTIAL_COUNT), dtype=wp.float64, device=device),
        no_bodies=wp.zeros((1, c.PARTIAL_COUNT), dtype=wp.float64, device=device),
    )
    state.write_control(
        {
            c.GRADIENT: 1.0,
            c.GRADIENT + 3: 1.0,
            c.LENGTH_FACTOR: 1.0,
            c.VELOCITY_FACTOR: 1.0,
            c.DRIVE: 1.0,
            c.STEP_LIMIT: np.inf,
            c.SPEED_LIMIT: np.inf,
            c.TRAVEL_LIMIT: np.inf,
        }
    )
    return state


def frames_launch(arrays: RodArrays, state: RodState) -> Launch:
    """Launch of `update_frames`: edges and directors."""
    return bind(update_frames, len(state.displacement), arrays, state)


def bend_launch(rods: Rods, arrays: RodArrays, state: RodState) -> Launch:
    """Launch of `bend_rods`: bending and twist at the nodes."""
    section = rods.section
    return bind(
        bend_rods, rods.node_count, arrays, state,
        bending_stiffness=wp.float64(section.bending_stiffness), twist_stiffness=wp.float64(section.twist_stiffness),
        yield_curvature=wp.float64(section.yield_curvature), hardening=wp.float64(section.hardening),
    )  # fmt: skip


def factor_launch(arrays: RodArrays, state: RodState) -> Launch:
    """Launch of `factor_masses`, after the masses have changed."""
    return bind(factor_masses, len(arrays.wire_first), arrays, state)


def motion_launches(arrays: RodArrays, state: RodState) -> list[Launch]:
    """Launches of the accelerations and of the update."""
    return [
        bind(find_accelerations, len(arrays.wire_first), arrays, state),
        bind(move_rods, len(state.displacement), arrays, state),
    ]


def force_launch(arrays: RodArrays, state: RodState) -> Launch:
    """Launch of `sum_rod_forces`: stretch, and the sum of all forces."""
    return bind(sum_rod_forces, len(state.displacement), arrays, state)
