"""Turns of sections about their segments, beside the tilt of t0 into t.

That rotation carries the rest director d0 to

    p = c d0 + b x d0 + b (b . d0)/(1 + c)        b = t0 x t,  c = t0 . t        turn = angle from p to the director about t
"""

from typing import Any

import warp as wp

from .rod_frames import affine_map

LEAST_COSINE = wp.constant(wp.float64(1.0e-9))  # of 1 + c


@wp.func
def tilted(rest_edge: wp.vec3d, rest_director: wp.vec3d, tangent: wp.vec3d) -> wp.vec3d:
    """The rest director, tilted with its segment to a tangent."""
    rest = wp.normalize(rest_edge)
    axis = wp.cross(rest, tangent)
    cosine = wp.dot(rest, tangent)
    along = wp.dot(axis, rest_director) / wp.max(wp.float64(1.0) + cosine, LEAST_COSINE)
    found = cosine * rest_director + wp.cross(axis, rest_director) + along * axis
    return wp.normalize(found - wp.dot(found, tangent) * tangent)


@wp.kernel
def find_turns(
    # in
    following: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    rest_edge: wp.array(dtype=wp.vec3d),
    rest_director: wp.array(dtype=wp.vec3d),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    # out: [rad], 0 where there is no segment
    turn: wp.array(dtype=wp.float64),
):
    node = wp.tid()
    turn[node] = wp.float64(0.0)
    if following[node] >= 0:
        row = rest_row[node]
        t = wp.vec3d(tangent[node])
        d = wp.vec3d(director[node])
        p = tilted(rest_edge[row], rest_director[row], t)
        turn[node] = wp.atan2(wp.dot(wp.cross(p, d), t), wp.dot(p, d))


@wp.kernel
def turn_sections(
    # in
    following: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    rest_edge: wp.array(dtype=wp.vec3d),
    rest_director: wp.array(dtype=wp.vec3d),
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    displacement: wp.array(dtype=wp.vec3d),
    # in: [rad]
    turn: wp.array(dtype=wp.float64),
    # out
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
):
    """Tangents by the displacements, and directors by the turns."""
    node = wp.tid()
    after = following[node]
    if after >= 0:
        row = rest_row[node]
        t = wp.normalize(affine_map(rest_edge[row], control[node / world_nodes]) + displacement[after] - displacement[node])
        p = tilted(rest_edge[row], rest_director[row], t)
        tangent[node] = tangent.dtype(t)
        director[node] = director.dtype(wp.cos(turn[node]) * p + wp.sin(turn[node]) * wp.cross(t, p))
