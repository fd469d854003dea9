"""Kinematics of rods: edges, tangents, and the directors of the sections.

A rod is a chain of nodes in space with a section on each segment. One director a segment, normal to the tangent, gives the
rotation of the section. When a segment tilts from tangent t to t', its director is transported without rotation about the tangent
(parallel transport in time; Bergou, Audoly, Vouga, Wardetzky and Grinspun 2010, "Discrete viscous threads"),

    d' = c d + b x d + b (b . d)/(1 + c)        b = t x t',  c = t . t'

and then rotated by the spin of the segment. The director stores the twist, so no angle is measured against a frame that could
jump.

Positions are x = F X + u; F acts in the plane of the mesh only. A node without a following segment has -1 in
`following`.
"""

import warp as wp

from .control import GRADIENT


@wp.func
def affine_map(vector: wp.vec3d, control: wp.array(dtype=wp.float64)) -> wp.vec3d:
    """F times a rest vector; the deformation gradient F acts in the plane."""
    return wp.vec3d(
        control[GRADIENT] * vector[0] + control[GRADIENT + 1] * vector[1],
        control[GRADIENT + 2] * vector[0] + control[GRADIENT + 3] * vector[1],
        vector[2],
    )


@wp.func
def transported(vector: wp.vec3d, before: wp.vec3d, now: wp.vec3d) -> wp.vec3d:
    """Parallel transport of `vector` from unit tangent `before` to `now`, which must not be opposite."""
    axis = wp.cross(before, now)
    cosine = wp.dot(before, now)
    return cosine * vector + wp.cross(axis, vector) + axis * (wp.dot(axis, vector) / (wp.float64(1.0) + cosine))


@wp.kernel
def update_frames(
    # in: wires
    following: wp.array(dtype=wp.int32),
    rest_position: wp.array(dtype=wp.vec3d),
    rest_edge: wp.array(dtype=wp.vec3d),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    # state in
    displacement: wp.array(dtype=wp.vec3d),
    # in and out: the pending rotation [rad] is applied and set to zero
    pending_turn: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    director: wp.array(dtype=wp.vec3d),
    # out
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    # out: set to zero for contact to add to
    contact_couple: wp.array(dtype=wp.vec3d),
):
    """One thread a node and the segment behind it. `rest_edge` may cross the border of a periodic tile."""
    i = wp.tid()
    contact_couple[i] = wp.vec3d()
    position[i] = affine_map(rest_position[i], control) + displacement[i]
    j = following[i]
    if j < 0:
        return
    edge = affine_map(rest_edge[i], control) + (displacement[j] - displacement[i])
    size = wp.length(edge)
    t = edge / size
    section_vector = transported(director[i], tangent[i], t)
    section_vector = wp.normalize(section_vector - wp.dot(section_vector, t) * t)
    angle = pending_turn[i]
    pending_turn[i] = wp.float64(0.0)
    length[i] = size
    tangent[i] = t
    director[i] = wp.cos(angle) * section_vector + wp.sin(angle) * wp.cross(t, section_vector)
