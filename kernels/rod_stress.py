"""The nominal stress of a mesh of rods, work-conjugate to the deformation gradient: the sum over

    segments   n (x) E0           n the force of the segment on its first node, E0 its edge at rest
    contacts   - f (x) (X - Y)    f on the first wire; X, Y rest places of the contact on either wire

    clamps     f (x) lever    f on a held node, `lever` its rest place less its clamp's

times the rest area, in components xx, xy, yx, yy. A convergence check sums rows of blocks, and the host adds the clamps. A step
adds counts of STRESS_UNIT, whose sum is the same in any order.
"""

from typing import Any

import warp as wp

from .control import STATUS, STATUS_RUNNING, STRESS_UNIT, is_driven
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


@wp.func
def segment_stress_of(
    begin: int,
    end: int,
    rest_row: wp.array(dtype=wp.int32),
    rest_edge: wp.array(dtype=wp.vec3d),
    edge_force: wp.array(dtype=wp.vec3d),
) -> wp.vec4d:
    """[N m] of the segments of some nodes."""
    total = wp.vec4d()
    for i in range(begin, end):
        total = add_product(total, edge_force[i], rest_edge[rest_row[i]])
    return total


@wp.func
def contact_stress_of(
    begin: int,
    end: int,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    rest_position: wp.array(dtype=wp.vec3d),
    rest_edge: wp.array(dtype=wp.vec3d),
    slope_weight: wp.array(dtype=wp.vec4d),
    touch_pair: wp.array(dtype=wp.int32),
    touch_loaded: wp.array(dtype=wp.int32),
    touch_normal_force: wp.array(dtype=wp.float64),
    touch_normal: wp.array(dtype=wp.vec3d),
    touch_friction: wp.array(dtype=wp.vec3d),
    has_friction: int,
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
) -> wp.vec4d:
    """[N m] of some touches."""
    total = wp.vec4d()
    for touch in range(begin, end):
        pair = touch_pair[touch]
        places = wp.where(pair_found[pair] == ONE_PLACE, 1, PLACES)
        if touch_loaded[touch] == 0 or pair_found[pair] <= NOT_NEAR:
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
    return total


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
    segment_stress[block] = segment_stress_of(begin, begin + block_count[block], rest_row, rest_edge, edge_force)


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
    touch_loaded: wp.array(dtype=wp.int32),
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
    node = block_first[block]
    contact_stress[block] = contact_stress_of(
        touch_first_start[node], touch_first_start[node + block_count[block]], previous, following, rest_row, rest_position,
        rest_edge, slope_weight, touch_pair, touch_loaded, touch_normal_force, touch_normal, touch_friction, has_friction,
        pair_first, pair_second, pair_shift, pair_found, pair_place,
    )  # fmt: skip


@wp.func
def count_stress(stress: wp.vec4d, unit: wp.float64, row: int, stress_count: wp.array2d(dtype=wp.int64)):
    """Add a stress [N m] to a row of counts."""
    for k in range(4):
        wp.atomic_add(stress_count, row, k, wp.int64(wp.rint(stress[k] / unit)))


@wp.kernel
def count_segment_stress(
    # in: blocks of nodes
    first_block: int,
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    # in
    rest_row: wp.array(dtype=wp.int32),
    rest_edge: wp.array(dtype=wp.vec3d),
    edge_force: wp.array(dtype=wp.vec3d),
    # in: what steers the step; row of the counts, or with a row a world, -1
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    own_row: int,
    # in and out
    stress_count: wp.array2d(dtype=wp.int64),
):
    """Stress of segments in a step with tension-driven directions, a thread a block."""
    block = first_block + wp.tid()
    begin = block_first[block]
    world = begin / world_nodes
    own = control[world]
    if own[STATUS] == STATUS_RUNNING and is_driven(own):
        stress = segment_stress_of(begin, begin + block_count[block], rest_row, rest_edge, edge_force)
        count_stress(stress, own[STRESS_UNIT], wp.where(own_row < 0, world, own_row), stress_count)


@wp.kernel
def count_contact_stress(
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
    touch_loaded: wp.array(dtype=wp.int32),
    touch_normal_force: wp.array(dtype=wp.float64),
    touch_normal: wp.array(dtype=wp.vec3d),
    touch_friction: wp.array(dtype=wp.vec3d),
    has_friction: int,
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    # in: what steers the step; row of the counts, or with a row a world, -1
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    own_row: int,
    # in and out
    stress_count: wp.array2d(dtype=wp.int64),
):
    """The same for the touches whose first segments are in a block."""
    block = first_block + wp.tid()
    node = block_first[block]
    world = node / world_nodes
    own = control[world]
    if own[STATUS] == STATUS_RUNNING and is_driven(own):
        stress = contact_stress_of(
            touch_first_start[node], touch_first_start[node + block_count[block]], previous, following, rest_row, rest_position,
            rest_edge, slope_weight, touch_pair, touch_loaded, touch_normal_force, touch_normal, touch_friction, has_friction,
            pair_first, pair_second, pair_shift, pair_found, pair_place,
        )  # fmt: skip
        count_stress(stress, own[STRESS_UNIT], wp.where(own_row < 0, world, own_row), stress_count)


@wp.kernel
def count_clamp_stress(
    # in: held nodes
    first_held: int,
    held_node: wp.array(dtype=wp.int32),
    held_lever: wp.array(dtype=wp.vec2d),
    # in: sums of the step, from this node on
    stored_from: wp.int32,
    force: wp.array(dtype=Any),
    # in: what steers the step; row of the counts, or with a row a world, -1
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    own_row: int,
    # in and out
    stress_count: wp.array2d(dtype=wp.int64),
):
    """The same of the clamps, a thread a held node."""
    held = first_held + wp.tid()
    i = held_node[held]
    world = i / world_nodes
    own = control[world]
    if own[STATUS] == STATUS_RUNNING and is_driven(own):
        lever = held_lever[held]
        push = wp.vec3d(force[i - stored_from])
        stress = add_product(wp.vec4d(), push, wp.vec3d(lever[0], lever[1], wp.float64(0.0)))
        count_stress(stress, own[STRESS_UNIT], wp.where(own_row < 0, world, own_row), stress_count)
