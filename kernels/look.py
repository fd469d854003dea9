"""What a look at the whole state sums up, a row of partial sums for every block of nodes and of pairs.

The nominal stress of the mesh, its work-conjugate to the deformation gradient, is the sum over

    segments   n (x) E0        n the force of the segment (wires.py), E0 its edge at rest
    pairs      f (x) (X_body - X_node) over their four nodes

over the rest area; held nodes are added by measure/whole.py. The rest goes by wire or over all.
"""

from typing import Any

import warp as wp

from .bend import elastic_turning, slope_moment
from .clamp import bow_weights_at_clamp, hinge_at_clamp, length_at_clamp
from .control import BOW_MOMENT, LENGTH_FACTOR, SLOPE_FACTOR
from .wires import node_at

PAIR_BLOCK = 64

# columns of the rows of wires
STRAIN_MAX = wp.constant(0)  # largest |strain| of an arc
ERROR_MAX = wp.constant(1)  # largest |strain - tension/EA|
ERROR_SUM = wp.constant(2)
TENSION_MAX = wp.constant(3)  # [N]
TURNING_MAX = wp.constant(4)  # [rad]
TENSION_SQUARE = wp.constant(5)  # [N2] summed
TURNING_SQUARE = wp.constant(6)  # [rad2] summed
WIRE_STRESS = wp.constant(7)  # [N m] 4 entries xx, xy, yx, yy
WIRE_COLUMNS = 11

# columns of the rows of pairs
CLOSED = wp.constant(0)  # closed pairs
FORCE_SUM = wp.constant(1)  # [N]
GAP_MAX = wp.constant(2)  # [m] largest |gap| of a closed pair
PAIR_STRESS = wp.constant(3)  # [N m] 4 entries
PAIR_COLUMNS = 7


@wp.func
def pull_of(tension: Any, natural: Any, local: int, count: int, gripped: int, wire: int, wire_clamp: wp.array2d(dtype=Any)):
    """Tension times natural length of a segment [N m]."""
    return tension * length_at_clamp(natural, local, count, gripped, wire, wire_clamp)


@wp.func
def bend_at(
    # which node, counted beyond the ends of its wire, and its table entry
    node: int,
    entry: int,
    # its wire
    first: int,
    count: int,
    closed: int,
    gripped: int,
    wire: int,
    wire_clamp: wp.array2d(dtype=Any),
    # rest data and state
    length_factor: Any,
    rest_angle: wp.array(dtype=Any),
    hinge_stiffness: wp.array(dtype=Any),
    turning: wp.array(dtype=Any),
    yield_moment: Any,
    kept_stiffness: Any,
    plastic_turn: wp.array(dtype=Any),
    back_turn: wp.array(dtype=Any),
):
    """Stiffness at the rest length and moment of the turn at a node [N m]; 0 where an open wire has no hinge."""
    local = node - first
    stiffness = type(length_factor)(0.0)
    moment = type(length_factor)(0.0)
    if closed != 0 or (local > 0 and local < count - 1):
        i = node_at(node, first, count, closed)
        _, share = hinge_at_clamp(rest_angle[entry], local, count, gripped, wire, wire_clamp)
        stiffness = share * hinge_stiffness[entry]
        elastic = turning[i]
        if yield_moment > type(length_factor)(0.0):
            yield_turn = yield_moment * length_factor / stiffness
            elastic = elastic_turning(elastic, plastic_turn[i], back_turn[i], yield_turn, kept_stiffness)
        moment = stiffness * elastic / length_factor
    return stiffness, moment


@wp.kernel
def sum_wires(
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    first_block: int,
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    wire_clamp: wp.array2d(dtype=Any),
    gripped: int,
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    unit: Any,
    true_stiffness: wp.float64,
    # in: rest data
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    rest_length: wp.array(dtype=Any),
    rest_angle: wp.array(dtype=Any),
    hinge_stiffness: wp.array(dtype=Any),
    # in: see evaluate_wires in energy.py
    strain: wp.array(dtype=Any),
    tension: wp.array(dtype=Any),
    turning: wp.array(dtype=Any),
    yield_moment: Any,
    kept_stiffness: Any,
    plastic_turn: wp.array(dtype=Any),
    back_turn: wp.array(dtype=Any),
    # in and out: edges [m], then forces of the segments [N]
    force_x: wp.array(dtype=Any),
    force_y: wp.array(dtype=Any),
    # out
    partial: wp.array2d(dtype=wp.float64),
):
    block = first_block + wp.tid()
    zero = type(unit)(0.0)
    wire = block_wire[block]
    first = wire_first[wire]
    count = wire_count[wire]
    closed = wire_closed[wire]
    length_factor = type(unit)(control[LENGTH_FACTOR])
    bow_moment = type(unit)(control[BOW_MOMENT] * control[LENGTH_FACTOR])
    begin = block_first[block]
    strain_max = zero
    error_max = wp.float64(0.0)
    error_sum = wp.float64(0.0)
    tension_max = -type(unit)(1.0e30)
    turning_max = zero
    tension_square = wp.float64(0.0)
    turning_square = wp.float64(0.0)
    xx = wp.float64(0.0)
    xy = wp.float64(0.0)
    yx = wp.float64(0.0)
    yy = wp.float64(0.0)
    slope_factor = type(unit)(control[SLOPE_FACTOR])
    # moment at the node before the one reached, moments of the turns there and one on, and pull of the segment between them
    moment = zero
    before = node_at(begin - 1, first, count, closed)
    t = block_table[block]
    _, bend_before = bend_at(
        begin - 1, t - 1, first, count, closed, gripped, wire, wire_clamp, length_factor, rest_angle, hinge_stiffness, turning,
        yield_moment, kept_stiffness, plastic_turn, back_turn,
    )  # fmt: skip
    stiffness, bend = bend_at(
        begin, t, first, count, closed, gripped, wire, wire_clamp, length_factor, rest_angle, hinge_stiffness, turning,
        yield_moment, kept_stiffness, plastic_turn, back_turn,
    )  # fmt: skip
    length_before = length_at_clamp(rest_length[t - 1], begin - 1 - first, count, gripped, wire, wire_clamp)
    pull_before = pull_of(tension[before], rest_length[t - 1], before - first, count, gripped, wire, wire_clamp)
    for k in range(block_count[block] + 1):
        i = node_at(begin + k, first, count, closed)
        local = begin + k - first
        pull = pull_of(tension[i], rest_length[t + k], i - first, count, gripped, wire, wire_clamp)
        length = length_at_clamp(rest_length[t + k], local, count, gripped, wire, wire_clamp)
        stiffness_after, bend_after = bend_at(
            begin + k + 1, t + k + 1, first, count, closed, gripped, wire, wire_clamp, length_factor, rest_angle, hinge_stiffness,
            turning, yield_moment, kept_stiffness, plastic_turn, back_turn,
        )  # fmt: skip
        next_moment = zero
        if closed != 0 or (local > 0 and local < count - 1):
            natural_angle, _ = hinge_at_clamp(rest_angle[t + k], local, count, gripped, wire, wire_clamp)
            first_length = length_before
            last_length = length
            if gripped != 0 and local == 1:
                first_length = zero
            if gripped != 0 and local == count - 2:
                last_length = zero
            next_moment = bend + slope_moment(bend_before, bend, bend_after, first_length, last_length, stiffness, slope_factor)
            before_weight, after_weight = bow_weights_at_clamp(zero, local, count, gripped, wire, wire_clamp)
            next_moment += bow_moment * (turning[i] + natural_angle) * (before_weight * pull_before + after_weight * pull)
        if k > 0:
            # the segment between the node before and this one
            j = begin + k - 1
            ex = force_x[j]
            ey = force_y[j]
            chord = wp.sqrt(ex * ex + ey * ey)
            fx = zero
            fy = zero
            if chord > zero:
                inverse = type(unit)(1.0) / chord
                shear = (moment - next_moment) * inverse
                fx = (tension[j] * ex - shear * ey) * inverse
                fy = (tension[j] * ey + shear * ex) * inverse
            force_x[j] = fx
            force_y[j] = fy
            ax = wp.float64(rest_x[t + k - 1])
            ay = wp.float64(rest_y[t + k - 1])
            xx += wp.float64(fx) * ax
            xy += wp.float64(fx) * ay
            yx += wp.float64(fy) * ax
            yy += wp.float64(fy) * ay
            error = wp.float64(strain[j]) - wp.float64(tension[j]) / true_stiffness
            strain_max = wp.max(strain_max, wp.abs(strain[j]))
            error_max = wp.max(error_max, wp.abs(error))
            error_sum += error
            tension_max = wp.max(tension_max, tension[j])
            turning_max = wp.max(turning_max, wp.abs(turning[j]))
            tension_square += wp.float64(tension[j]) * wp.float64(tension[j])
            turning_square += wp.float64(turning[j]) * wp.float64(turning[j])
        moment = next_moment
        bend_before = bend
        bend = bend_after
        stiffness = stiffness_after
        length_before = length
        pull_before = pull
    partial[block, STRAIN_MAX] = wp.float64(strain_max)
    partial[block, ERROR_MAX] = error_max
    partial[block, ERROR_SUM] = error_sum
    partial[block, TENSION_MAX] = wp.float64(tension_max)
    partial[block, TURNING_MAX] = wp.float64(turning_max)
    partial[block, TENSION_SQUARE] = tension_square
    partial[block, TURNING_SQUARE] = turning_square
    partial[block, WIRE_STRESS] = xx
    partial[block, WIRE_STRESS + 1] = xy
    partial[block, WIRE_STRESS + 2] = yx
    partial[block, WIRE_STRESS + 3] = yy


@wp.kernel
def sum_pairs(
    # in: pairs
    pair_block: int,
    unit: Any,
    pair_wire: wp.array(dtype=wp.int32),
    pair_table: wp.array(dtype=wp.int32),
    pair_rest_x: wp.array(dtype=Any),
    pair_rest_y: wp.array(dtype=Any),
    table_x: wp.array(dtype=Any),
    table_y: wp.array(dtype=Any),
    # state in
    pair_slide: wp.array(dtype=wp.int32),
    pair_force: wp.array(dtype=Any),
    pair_gap: wp.array(dtype=Any),
    pair_nodal_x: wp.array(dtype=Any),
    pair_nodal_y: wp.array(dtype=Any),
    # out
    partial: wp.array2d(dtype=wp.float64),
):
    block = wp.tid()
    zero = type(unit)(0.0)
    closed = wp.float64(0.0)
    force = wp.float64(0.0)
    gap_max = zero
    xx = wp.float64(0.0)
    xy = wp.float64(0.0)
    yx = wp.float64(0.0)
    yy = wp.float64(0.0)
    for p in range(block * pair_block, wp.min((block + 1) * pair_block, pair_force.shape[0])):
        if pair_force[p] > zero and pair_wire[p] >= 0:
            closed += wp.float64(1.0)
            force += wp.float64(pair_force[p])
            gap_max = wp.max(gap_max, wp.abs(pair_gap[p]))
            for k in range(4):
                t = pair_table[p] + pair_slide[p] - 1 + k
                ax = wp.float64(unit * type(unit)(pair_rest_x[p] - table_x[t]))
                ay = wp.float64(unit * type(unit)(pair_rest_y[p] - table_y[t]))
                fx = wp.float64(pair_nodal_x[4 * p + k])
                fy = wp.float64(pair_nodal_y[4 * p + k])
                xx += fx * ax
                xy += fx * ay
                yx += fy * ax
                yy += fy * ay
    partial[block, CLOSED] = closed
    partial[block, FORCE_SUM] = force
    partial[block, GAP_MAX] = wp.float64(gap_max)
    partial[block, PAIR_STRESS] = xx
    partial[block, PAIR_STRESS + 1] = xy
    partial[block, PAIR_STRESS + 2] = yx
    partial[block, PAIR_STRESS + 3] = yy


@wp.kernel
def sum_distances_from_chords(
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    block_origin_x: wp.array(dtype=wp.float64),
    block_origin_y: wp.array(dtype=wp.float64),
    place_x: wp.array(dtype=wp.float64),
    place_y: wp.array(dtype=wp.float64),
    # in: start of a wire at rest [m], its displacement [counts], unit normal of its chord, deformation gradient
    start: wp.array(dtype=wp.vec2d),
    wire_first: wp.array(dtype=wp.int32),
    normal: wp.array(dtype=wp.vec2d),
    gradient: wp.mat22d,
    unit: Any,
    ux: wp.array(dtype=Any),
    uy: wp.array(dtype=Any),
    # out: [m2] summed over the nodes of the block
    square: wp.array(dtype=wp.float64),
):
    block = wp.tid()
    wire = block_wire[block]
    first = wire_first[wire]
    sum_ = wp.float64(0.0)
    for lane in range(block_count[block]):
        i = block_first[block] + lane
        t = block_table[block] + lane
        rest = wp.vec2d(place_x[t] + block_origin_x[block], place_y[t] + block_origin_y[block]) - start[wire]
        moved = wp.float64(unit) * wp.vec2d(wp.float64(ux[i] - ux[first]), wp.float64(uy[i] - uy[first]))
        off = wp.dot(normal[wire], gradient * rest + moved)
        sum_ += off * off
    square[block] = sum_
