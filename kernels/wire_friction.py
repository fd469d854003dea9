"""Motion of wires that touch: elastic slip of friction, places at the equilibrium before, velocities of the curves.

Elastic slip is passed on from step to step, between neighbouring segments, and from one pair list to the next. In a relaxation it
is that left at the equilibrium before: no step changes it, and it outlasts an opening of the contact.

A contact of step n writes n + 1, its place and its elastic slip into the half of the arrays that step n + 1 reads. There a
contact takes the slip of the nearest entry, in its own pair or in a neighbouring one. In real time the entry is of the step
before, in a relaxation of any step since the equilibrium before, after which both halves have the same entries. The two halves
alternate, so no entry is read while it is written. Pairs of the same segments differ in the periodic shift of the second; where a
wire continues at its first node, the shift of a neighbouring pair differs by its period.
"""

from typing import Any

import warp as wp

from .control import LENGTH_FACTOR, LOAD_STEP, STEP, TIME_STEP
from .wire_curve import Bump, Nodes, curve_through, point_at, rest_shape, row, stencil, weighted_sum
from .wire_near import old_pair
from .wire_pairs import NOT_SEARCHED, affine_inverse

MAX_HANDOVER = wp.constant(wp.float64(0.5))  # segments, largest motion of a contact in one step


@wp.func
def neighbour(i: int, offset: int, previous: wp.array(dtype=wp.int32), following: wp.array(dtype=wp.int32)) -> int:
    """The segment that is `offset` (-1, 0, 1) on from segment i; -1 where there is none."""
    if offset < 0:
        return previous[i]
    if offset == 0:
        return i
    after = following[i]
    if following[after] < 0:
        return -1
    return after


@wp.func
def period_between(
    i: int,
    other: int,
    offset: int,
    node_wire: wp.array(dtype=wp.int32),
    wire_period: wp.array(dtype=wp.vec3d),
) -> wp.vec3d:
    """Shift [m] at rest from segment i to `other`, where a wire continues; other = i + offset."""
    period = wire_period[node_wire[i]]
    if offset > 0 and other < i:
        return period
    if offset < 0 and other > i:
        return -period
    return wp.vec3d()


@wp.func
def pair_of(
    i: int,
    j: int,
    shift: wp.vec3d,
    start: wp.array(dtype=wp.int32),
    count: wp.array(dtype=wp.int32),
    second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    node_radius: wp.array(dtype=wp.float64),
) -> int:
    """Pair of segments i <= j in the list, j moved by `shift`; else -1."""
    for k in range(start[i], start[i] + count[i]):
        if second[k] == j and wp.length(pair_shift[k] - shift) < node_radius[i]:
            return k
    return -1


@wp.func
def previous_slip(
    pair: int,
    i: int,
    j: int,
    place: wp.vec2d,
    half: int,
    oldest: int,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    node_wire: wp.array(dtype=wp.int32),
    node_radius: wp.array(dtype=wp.float64),
    wire_period: wp.array(dtype=wp.vec3d),
    pair_start: wp.array(dtype=wp.int32),
    pair_count_of: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    slip_step: wp.array2d(dtype=wp.int32),
    slip_place: wp.array2d(dtype=wp.vec2),
    elastic_slip: wp.array2d(dtype=wp.vec3),
) -> wp.vec3d:
    """Elastic slip [m] of the first wire over the second, at places on them.

    half: of the arrays, to read; oldest: step of the oldest entry that counts.
    """
    slip = wp.vec3d()
    nearest = wp.float64(3.0)
    for k in range(2 * pair, 2 * pair + 2):
        if slip_step[half, k] >= oldest:
            own_place = wp.vec2d(slip_place[half, k])
            distance = wp.abs(own_place[0] - place[0]) + wp.abs(own_place[1] - place[1])
            if distance < nearest:
                nearest = distance
                slip = wp.vec3d(elastic_slip[half, k])
    if nearest < wp.float64(3.0):
        return slip
    nearest = MAX_HANDOVER
    for candidate in range(9):
        first_offset = candidate / 3 - 1
        second_offset = candidate % 3 - 1
        first = neighbour(i, first_offset, previous, following)
        second = neighbour(j, second_offset, previous, following)
        if candidate != 4 and first >= 0 and second >= 0:
            shift = pair_shift[pair] + period_between(j, second, second_offset, node_wire, wire_period)
            shift = shift - period_between(i, first, first_offset, node_wire, wire_period)
            is_swapped = first > second
            other = pair_of(wp.min(first, second), wp.max(first, second), wp.where(is_swapped, -shift, shift),
                            pair_start, pair_count_of, pair_second, pair_shift, node_radius)  # fmt: skip
            if first == second and other < 0:
                is_swapped = True
                other = pair_of(first, second, -shift, pair_start, pair_count_of, pair_second, pair_shift, node_radius)
            if other >= 0:
                for k in range(2 * other, 2 * other + 2):
                    if slip_step[half, k] >= oldest:
                        place_there = wp.vec2d(slip_place[half, k])
                        slip_there = wp.vec3d(elastic_slip[half, k])
                        if is_swapped:
                            place_there = wp.vec2d(place_there[1], place_there[0])
                            slip_there = -slip_there
                        distance_first = wp.abs(place_there[0] + wp.float64(first_offset) - place[0])
                        distance = distance_first + wp.abs(place_there[1] + wp.float64(second_offset) - place[1])
                        if distance < nearest:
                            nearest = distance
                            slip = slip_there
    return slip


@wp.func
def section_weights(
    i: int, place: wp.float64, previous: wp.array(dtype=wp.int32), following: wp.array(dtype=wp.int32)
) -> wp.vec3d:
    """Of the sections before, of and after segment i at a place on it: what turns with them is continuous from one to the next.

    Linear from the middle of a segment to the middle of the next one.
    """
    half = wp.float64(0.5)
    before = wp.where(previous[i] >= 0, wp.max(half - place, wp.float64(0.0)), wp.float64(0.0))
    after = wp.where(following[following[i]] >= 0, wp.max(place - half, wp.float64(0.0)), wp.float64(0.0))
    return wp.vec3d(before, wp.float64(1.0) - before - after, after)


@wp.func
def turned_back(
    segment: int,
    lever: wp.vec3d,
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    before_tangent: wp.array(dtype=Any),
    before_director: wp.array(dtype=Any),
) -> wp.vec3d:
    """A vector turned with the section of a segment, as at the previous equilibrium."""
    t = wp.vec3d(tangent[segment])
    d = wp.vec3d(director[segment])
    before_t = wp.vec3d(before_tangent[segment])
    before_d = wp.vec3d(before_director[segment])
    turned = wp.dot(lever, d) * before_d + wp.dot(lever, t) * before_t
    return turned + wp.dot(lever, wp.cross(t, d)) * wp.cross(before_t, before_d)


@wp.func
def section_turn(
    segment: int,
    n: wp.vec3d,
    tangent: wp.array(dtype=Any),
    before_tangent: wp.array(dtype=Any),
) -> wp.vec2d:
    """Cosine and sine of a tangent's turn about n since the previous equilibrium, scaled."""
    t = wp.vec3d(tangent[segment])
    before = wp.vec3d(before_tangent[segment])
    return wp.vec2d(wp.dot(before, t) - wp.dot(before, n) * wp.dot(n, t), wp.dot(n, wp.cross(before, t)))


@wp.func
def surface_turn(
    i: int,
    place: wp.float64,
    n: wp.vec3d,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    tangent: wp.array(dtype=Any),
    before_tangent: wp.array(dtype=Any),
) -> wp.vec2d:
    """`section_turn` of the wire at a place on segment i."""
    weights = section_weights(i, place, previous, following)
    turn = weights[1] * section_turn(i, n, tangent, before_tangent)
    if weights[0] > wp.float64(0.0):
        turn += weights[0] * section_turn(previous[i], n, tangent, before_tangent)
    if weights[2] > wp.float64(0.0):
        turn += weights[2] * section_turn(following[i], n, tangent, before_tangent)
    return turn


@wp.func
def surface_before(
    i: int,
    place: wp.float64,
    lever: wp.vec3d,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    rest_row: wp.array(dtype=wp.int32),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=Bump),
    slope_weight: wp.array(dtype=wp.vec4d),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    before_position: wp.array(dtype=wp.vec3d),
    before_length: wp.array(dtype=wp.float64),
    before_tangent: wp.array(dtype=Any),
    before_director: wp.array(dtype=Any),
    before_control: wp.array(dtype=wp.float64),
) -> wp.vec3d:
    """[m] where a point of the surface was at the equilibrium before; now it is `lever` away from a place on segment i."""
    nodes = stencil(i, previous, following, before_position, before_length, before_tangent)
    shape = rest_shape(i, previous, following, natural_length, rest_row, rest_slope, rest_bump, slope_weight,
                       before_tangent, before_director)  # fmt: skip
    curve = curve_through(nodes, before_control[LENGTH_FACTOR] * shape, slope_weight[rest_row[i]])
    weights = section_weights(i, place, previous, following)
    turned = weights[1] * turned_back(i, lever, tangent, director, before_tangent, before_director)
    if weights[0] > wp.float64(0.0):
        turned += weights[0] * turned_back(previous[i], lever, tangent, director, before_tangent, before_director)
    if weights[2] > wp.float64(0.0):
        turned += weights[2] * turned_back(following[i], lever, tangent, director, before_tangent, before_director)
    return point_at(curve, place) + turned


@wp.kernel
def transfer_elastic_slip(
    # in: what steers the step
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    # in: [segment] see `mark_searched`; pairs of others stand in the order before
    searched: wp.array(dtype=wp.int32),
    # in: the pairs before
    old_start: wp.array(dtype=wp.int32),
    old_count_of: wp.array(dtype=wp.int32),
    old_second: wp.array(dtype=wp.int32),
    old_shift: wp.array(dtype=wp.vec3d),
    old_slip_step: wp.array2d(dtype=wp.int32),
    old_slip_place: wp.array2d(dtype=wp.vec2),
    old_elastic_slip: wp.array2d(dtype=wp.vec3),
    # in: the pairs now
    pair_start: wp.array(dtype=wp.int32),
    pair_count_of: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    # out: in the half that the next step writes, so that the list before may have the same arrays
    slip_step: wp.array2d(dtype=wp.int32),
    slip_place: wp.array2d(dtype=wp.vec2),
    elastic_slip: wp.array2d(dtype=wp.vec3),
):
    """Copy elastic slips of the pairs before to the present ones; a thread a segment. A pair has two contacts."""
    i = wp.tid()
    half = int(control[i / world_nodes, STEP]) % 2
    for pair in range(pair_start[i], pair_start[i] + pair_count_of[i]):
        for k in range(2 * pair, 2 * pair + 2):
            slip_step[1 - half, k] = -1
        old = old_start[i] + pair - pair_start[i]
        if searched[i] != NOT_SEARCHED:
            old = old_pair(i, pair_second[pair], pair_shift[pair], old_start, old_count_of, old_second, old_shift)
        if old >= 0:
            for a in range(2):
                slip_step[1 - half, 2 * pair + a] = old_slip_step[half, 2 * old + a]
                slip_place[1 - half, 2 * pair + a] = old_slip_place[half, 2 * old + a]
                elastic_slip[1 - half, 2 * pair + a] = old_elastic_slip[half, 2 * old + a]


@wp.kernel
def take_elastic_slip(
    # in
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    pair_start: wp.array(dtype=wp.int32),
    pair_count_of: wp.array(dtype=wp.int32),
    # in and out
    slip_step: wp.array2d(dtype=wp.int32),
    slip_place: wp.array2d(dtype=wp.vec2),
    elastic_slip: wp.array2d(dtype=wp.vec3),
):
    """Copy what `transfer_elastic_slip` has found to the half that the next step reads; a thread a segment."""
    i = wp.tid()
    half = int(control[i / world_nodes, STEP]) % 2
    for k in range(2 * pair_start[i], 2 * (pair_start[i] + pair_count_of[i])):
        slip_step[half, k] = slip_step[1 - half, k]
        slip_place[half, k] = slip_place[1 - half, k]
        elastic_slip[half, k] = elastic_slip[1 - half, k]


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
    """Velocities [m/s] of segment i's four nodes as rows, including the load's affine velocity."""
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

    relative_velocity [m/s]: the second node's less the first's.
    """
    return wp.cross(wp.vec3d(tangent[segment]), relative_velocity) / length[segment] + wp.float64(spin[segment]) * wp.vec3d(
        tangent[segment]
    )


@wp.func
def surface_rate(
    i: int,
    place: wp.float64,
    velocity: Nodes,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    spin: wp.array(dtype=Any),
) -> wp.vec3d:
    """Angular velocity [1/s] of the surface at a place on segment i; velocity: of its four nodes, as rows."""
    weights = section_weights(i, place, previous, following)
    rate = weights[1] * section_rate(i, row(velocity, 2) - row(velocity, 1), length, tangent, spin)
    if weights[0] > wp.float64(0.0):
        rate += weights[0] * section_rate(previous[i], row(velocity, 1) - row(velocity, 0), length, tangent, spin)
    if weights[2] > wp.float64(0.0):
        rate += weights[2] * section_rate(following[i], row(velocity, 3) - row(velocity, 2), length, tangent, spin)
    return rate


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
