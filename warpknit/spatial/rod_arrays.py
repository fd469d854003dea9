"""Rods on the device: what does not move (`RodArrays`) and what does (`RodState`); double precision."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import warp as wp

from ..kernels import control as c
from ..kernels.rod_bend import bend_rods
from ..kernels.rod_frames import follow_rods
from ..kernels.rod_step import NODE_BLOCK, step_rods
from ..launch import Launch, bind
from .rods import Rods


@dataclass(frozen=True)
class RodArrays:
    """Rest data and stiffnesses; [node], those of segments too."""

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
    """What moves, and what follows from it step by step; [node]."""

    displacement: wp.array  # vec3d [m] from the affinely carried rest shape
    velocity: wp.array  # vec3d [m/s]
    turn: wp.array  # [rad] that a section has still to turn by
    spin: wp.array  # [rad/s] of a section about its tangent
    angle: wp.array  # [rad] that a section has turned by since the start
    tangent: wp.array  # vec3d
    director: wp.array  # vec3d
    tension_offset: wp.array  # [N] running multiplier of a segment
    stretch_stiffness: wp.array  # [N] of the dynamics
    node_mass: wp.array  # [kg]
    spin_inertia: wp.array  # [kg m2] of a segment
    load_force: wp.array  # vec3d [N] dead load
    load_torque: wp.array  # [N m] about the segment
    position: wp.array  # vec3d [m]
    length: wp.array  # [m]
    curvature: wp.array  # vec2d [rad] turning vector at a node, in the directions of the section
    twist: wp.array  # [rad]
    plastic_turn: wp.array  # vec2d [rad] of the turning vector, what stayed as of the last state at rest
    pull_before: wp.array  # vec3d [N]
    pull_after: wp.array  # vec3d [N]
    torque_before: wp.array  # [N m]
    torque_after: wp.array  # [N m]
    contact_force: wp.array  # vec3d [N]
    contact_couple: wp.array  # vec3d [N m] on the section of a segment
    force: wp.array  # vec3d [N]
    torque: wp.array  # [N m]
    control: wp.array  # [CONTROL_COUNT], see kernels/control.py
    partial: wp.array  # [block, PARTIAL_COUNT]
    no_bodies: wp.array  # the rows that a planar model has beside `partial`

    def arrays(self) -> dict[str, np.ndarray]:
        """Copies of all arrays on the host, by name."""
        return {field.name: getattr(self, field.name).numpy().copy() for field in fields(self)}

    def restore(self, arrays: dict[str, np.ndarray]) -> None:
        """Put back what `arrays` returned."""
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
    """Rest data on the device; natural curvature and twist are those at rest, times the set fraction, where none are given."""
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
    follow_launch(arrays, at_rest).run(device)
    bend_launch(rods, arrays, at_rest).run(device)
    curvature, twist = rods.set_fraction * at_rest.curvature.numpy(), rods.set_fraction * at_rest.twist.numpy()
    arrays.natural_curvature.assign(curvature if rods.natural_curvature is None else rods.natural_curvature)
    arrays.natural_twist.assign(twist if rods.natural_twist is None else rods.natural_twist)
    return arrays


def rest_state(rods: Rods, device: str) -> RodState:
    """The state at rest; masses and stiffnesses of the dynamics are the true ones."""
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
        turn=reals(),
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
        pull_before=vectors(),
        pull_after=vectors(),
        torque_before=reals(),
        torque_after=reals(),
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


def follow_launch(arrays: RodArrays, state: RodState) -> Launch:
    """Edges and directors of displaced nodes."""
    return bind(follow_rods, len(state.displacement), arrays, state)


def bend_launch(rods: Rods, arrays: RodArrays, state: RodState) -> Launch:
    """Bending and twist at the nodes."""
    section = rods.section
    return bind(
        bend_rods, rods.node_count, arrays, state,
        bending_stiffness=wp.float64(section.bending_stiffness), twist_stiffness=wp.float64(section.twist_stiffness),
        yield_curvature=wp.float64(section.yield_curvature), hardening=wp.float64(section.hardening),
    )  # fmt: skip


def step_launch(arrays: RodArrays, state: RodState) -> Launch:
    """Stretch, sums, and the update."""
    return bind(step_rods, len(state.displacement), arrays, state)
