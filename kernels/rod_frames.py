"""Where a rod is: edges, tangents, and the director that its section carries along.

A rod is a chain of nodes in space with a section on each segment. The section is round, so one director a segment, across
the tangent, says how far it has turned. When a segment tilts from tangent t to t', its director goes along without turning
about it (parallel transport in time; Bergou, Audoly, Vouga, Wardetzky and Grinspun 2010, "Discrete viscous threads"),

    d' = c d + b x d + b (b . d)/(1 + c)        b = t x t',  c = t . t'

and then by the angle that the spin of the segment has turned it. So the director holds the twist, and no angle is ever
measured against a frame that could jump.

Positions are x = F X + u, F acting in the plane of the mesh and z as it is. A node without a following segment has -1 in
`following`.
"""

import warp as wp

from .control import GRADIENT


@wp.func
def carried(vector: wp.vec3d, control: wp.array(dtype=wp.float64)) -> wp.vec3d:
    """A rest vector as the load carries it: the deformation gradient acts in the plane."""
    return wp.vec3d(
        control[GRADIENT] * vector[0] + control[GRADIENT + 1] * vector[1],
        control[GRADIENT + 2] * vector[0] + control[GRADIENT + 3] * vector[1],
        vector[2],
    )


@wp.func
def transported(vector: wp.vec3d, before: wp.vec3d, now: wp.vec3d) -> wp.vec3d:
    """`vector` after the least rotation that takes the unit tangent `before` to `now`; they must not be opposite."""
    axis = wp.cross(before, now)
    cosine = wp.dot(before, now)
    return cosine * vector + wp.cross(axis, vector) + axis * (wp.dot(axis, vector) / (wp.float64(1.0) + cosine))


@wp.kernel
def follow_rods(
    # in: wires
    following: wp.array(dtype=wp.int32),
    rest_position: wp.array(dtype=wp.vec3d),
    rest_edge: wp.array(dtype=wp.vec3d),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    # state in
    displacement: wp.array(dtype=wp.vec3d),
    # in and out: the angle to turn by is used up
    turn: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    director: wp.array(dtype=wp.vec3d),
    # out
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    # out: zero, for contact to add to
    contact_couple: wp.array(dtype=wp.vec3d),
):
    """One thread a node and the segment behind it. `rest_edge` reaches over the border of a periodic tile."""
    i = wp.tid()
    contact_couple[i] = wp.vec3d()
    position[i] = carried(rest_position[i], control) + displacement[i]
    j = following[i]
    if j < 0:
        return
    edge = carried(rest_edge[i], control) + (displacement[j] - displacement[i])
    size = wp.length(edge)
    t = edge / size
    across = transported(director[i], tangent[i], t)
    across = wp.normalize(across - wp.dot(across, t) * t)
    angle = turn[i]
    turn[i] = wp.float64(0.0)
    length[i] = size
    tangent[i] = t
    director[i] = wp.cos(angle) * across + wp.sin(angle) * wp.cross(t, across)
