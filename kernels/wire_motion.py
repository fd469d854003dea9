"""Velocities of the curves of wires: of nodes, the load's own motion included, of sections, and of points between the nodes."""

from typing import Any

import warp as wp

from .control import LOAD_STEP, TIME_STEP
from .wire_curve import Nodes, row, weighted_sum
from .wire_pairs import affine_inverse


@wp.func
def load_velocity(place: wp.vec3d, control: wp.array(dtype=wp.float64)) -> wp.vec3d:
    """[m/s] affine velocity of the load at a place x [m] in the last step: dF F^-1 x/dt."""
    if control[TIME_STEP] <= wp.float64(0.0):
        return wp.vec3d()
    rest = affine_inverse(place, control)
    x = control[LOAD_STEP] * rest[0] + control[LOAD_STEP + 1] * rest[1]
    y = control[LOAD_STEP + 2] * rest[0] + control[LOAD_STEP + 3] * rest[1]
    return wp.vec3d(x, y, wp.float64(0.0)) / control[TIME_STEP]


@wp.func
def node_velocities(
    i: int,
    nodes: Nodes,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    control: wp.array(dtype=wp.float64),
    displacement: wp.array(dtype=wp.vec3d),
    velocity: wp.array(dtype=Any),
) -> Nodes:
    """Velocities [m/s] of the four nodes of segment i as rows, the affine velocity of the load included."""
    one = wp.vec3d(velocity[i]) + load_velocity(row(nodes, 1) - displacement[i], control)
    after = following[i]
    two = wp.vec3d(velocity[after]) + load_velocity(row(nodes, 2) - displacement[after], control)
    zero = wp.float64(2.0) * one - two
    before = previous[i]
    if before >= 0:
        zero = wp.vec3d(velocity[before]) + load_velocity(row(nodes, 0) - displacement[before], control)
    three = wp.float64(2.0) * two - one
    third = following[after]
    if third >= 0:
        three = wp.vec3d(velocity[third]) + load_velocity(row(nodes, 3) - displacement[third], control)
    return wp.matrix_from_rows(zero, one, two, three)


@wp.func
def section_rate(
    segment: int,
    relative_velocity: wp.vec3d,
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    spin: wp.array(dtype=Any),
) -> wp.vec3d:
    """[1/s] angular velocity of a section: tilt of its segment and spin about it.

    relative_velocity [m/s]: that of the second node less that of the first.
    """
    return wp.cross(wp.vec3d(tangent[segment]), relative_velocity) / length[segment] + wp.float64(spin[segment]) * wp.vec3d(
        tangent[segment]
    )


@wp.func
def point_velocity(
    i: int,
    w: wp.vec4d,
    nodes: Nodes,
    levers: wp.types.matrix(shape=(3, 3), dtype=wp.float64),
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    spin: wp.array(dtype=Any),
) -> wp.vec3d:
    """[m/s] of a point of the curve of segment i; `nodes` are velocities."""
    speed = weighted_sum(w, nodes)
    before = previous[i]
    if before >= 0:
        rate = section_rate(before, row(nodes, 1) - row(nodes, 0), length, tangent, spin)
        speed += wp.cross(rate, row(levers, 0))
    speed += wp.cross(section_rate(i, row(nodes, 2) - row(nodes, 1), length, tangent, spin), row(levers, 1))
    after = following[i]
    if following[after] >= 0:
        rate = section_rate(after, row(nodes, 3) - row(nodes, 2), length, tangent, spin)
        speed += wp.cross(rate, row(levers, 2))
    return speed
