"""The nominal stress of a mesh of rods, work-conjugate to the deformation gradient: the sum over

    segments   n (x) E0           n the force of the segment on its first node, E0 its edge at rest
    contacts   - f (x) (X - Y)    f on the first wire; X, Y rest places of the contact on either wire

times the rest area, in rows xx, xy, yx, yy of blocks. Clamps come on top (spatial/observables.py).
"""

import warp as wp

from .wire_closest import NOT_NEAR, ONE_PLACE, PLACES
from .wire_curve import hermite_10, hermite_11


@wp.func
def add_product(sums: wp.vec4d, a: wp.vec3d, b: wp.vec3d) -> wp.vec4d:
    return sums + wp.vec4d(a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1])


@wp.func
def rest_place(
    i: int,
    s: wp.float64,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    rest_position: wp.array(dtype=wp.vec3d),
    rest_edge: wp.array(dtype=wp.vec3d),
    slope_weight: wp.array(dtype=wp.vec4d),
) -> wp.vec3d:
    """[m] a place on segment i at rest, by the weights of wire_curve.py."""
    m = slope_weight[rest_row[i]]
    here = rest_edge[rest_row[i]]
    before = here
    if previous[i] >= 0:
        before = rest_edge[rest_row[previous[i]]]
    behind = here
    after = following[i]
    if following[after] >= 0:
        behind = rest_edge[rest_row[after]]
    begin = m[0] * before + m[1] * here
    end = m[2] * here + m[3] * behind
    h01 = s * s * (wp.float64(3.0) - wp.float64(2.0) * s)
    return rest_position[i] + hermite_10(s) * begin + h01 * here + hermite_11(s) * end


@wp.kernel
def sum_segment_stress(
    # in: blocks of nodes
    first_block: int,
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    # in
    rest_row: wp.array(dtype=wp.int32),
    rest_edge: wp.array(dtype=wp.vec3d),
    edge_force: wp.array(dtype=wp.vec3d),
    # out: [N m]
    segment_stress: wp.array(dtype=wp.vec4d),
):
    """A thread a block."""
    block = first_block + wp.tid()
    begin = block_first[block]
    total = wp.vec4d()
    for i in range(begin, begin + block_count[block]):
        total = add_product(total, edge_force[i], rest_edge[rest_row[i]])
    segment_stress[block] = total


@wp.kernel
def sum_contact_stress(
    # in: blocks of nodes, and wires
    first_block: int,
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    rest_position: wp.array(dtype=wp.vec3d),
    rest_edge: wp.array(dtype=wp.vec3d),
    slope_weight: wp.array(dtype=wp.vec4d),
    # in: contacts with a force
    touch_first_start: wp.array(dtype=wp.int32),
    touch_pair: wp.array(dtype=wp.int32),
    touch_normal_force: wp.array(dtype=wp.float64),
    touch_normal: wp.array(dtype=wp.vec3d),
    touch_friction: wp.array(dtype=wp.vec3d),
    has_friction: int,
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    # out: [N m]
    contact_stress: wp.array(dtype=wp.vec4d),
):
    """A thread for the touches whose first segments are in a block."""
    block = first_block + wp.tid()
    begin = block_first[block]
    total = wp.vec4d()
    for touch in range(touch_first_start[begin], touch_first_start[begin + block_count[block]]):
        pair = touch_pair[touch]
        places = wp.where(pair_found[pair] == ONE_PLACE, 1, PLACES)
        if pair_found[pair] <= NOT_NEAR:
            places = 0
        for a in range(places):
            k = PLACES * touch + a
            if touch_normal_force[k] != wp.float64(0.0):
                place = pair_place[PLACES * pair + a]
                lever = rest_place(pair_first[pair], place[0], previous, following, rest_row, rest_position, rest_edge,
                                   slope_weight)  # fmt: skip
                lever -= rest_place(pair_second[pair], place[1], previous, following, rest_row, rest_position, rest_edge,
                                    slope_weight)  # fmt: skip
                push = touch_normal_force[k] * touch_normal[k]
                if has_friction != 0:
                    push += touch_friction[k]
                total = add_product(total, -push, lever - pair_shift[pair])
    contact_stress[block] = total
