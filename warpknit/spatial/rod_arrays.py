"""Rods on the device, in double precision: rest data (`RodArrays`) and state (`RodState`)."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import warp as wp

from ..kernels import control as c
from ..kernels.rod_bend import bend_rods
from ..kernels.rod_frames import update_frames
from ..kernels.rod_motion import NODE_BLOCK, step_rods
from ..launch import Launch, bind
from .rods import Rods


@dataclass(frozen=True)
class RodArrays:
    """Rest data; all arrays [node], segment data included."""

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
    node_mass: wp.array  # [kg]
    spin_inertia: wp.array  # [kg m2] of a segment
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
    contact_force: wp.array  # vec3d [N]
    contact_couple: wp.array  # vec3d [N m] contact couple on the section of a segment
    force: wp.array  # vec3d [N]
    torque: wp.array  # [N m]
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
        node_mass=reals(section.linear_density * rods.node_length),
        spin_inertia=reals(section.rotary_inertia * rods.natural_length),
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
        contact_force=vectors(),
        contact_couple=vectors(),
        force=vectors(),
        torque=reals(),
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


def step_launch(arrays: RodArrays, state: RodState) -> Launch:
    """Launch of `step_rods`: stretch, sums and the update."""
    return bind(step_rods, len(state.displacement), arrays, state)
