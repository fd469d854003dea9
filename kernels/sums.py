"""Sums of a convergence check: one row of partial sums for every block of nodes and of pairs.

The nominal stress of the mesh, its work-conjugate to the deformation gradient, is the sum over

    segments   n (x) E0        n the force of the segment (wire_forces.py), E0 its edge at rest
    pairs      f (x) (X_body - X_node) over their four nodes

over the rest area; planar/diagnostics.py adds the held nodes. It is summed in whole counts of STRESS_UNIT, so that the sum does
not depend on its order. Other sums are by wire or over the mesh.
"""

from typing import Any

import warp as wp

from .control import STATUS, STATUS_RUNNING, STRESS_PART, STRESS_UNIT, is_driven

PAIR_BLOCK = 64

# columns of the rows of wires
STRAIN_MAX = wp.constant(0)  # largest |strain| of an arc
ERROR_MAX = wp.constant(1)  # largest |strain - tension/EA|
ERROR_SUM = wp.constant(2)
ERROR_SQUARE = wp.constant(3)  # summed
TENSION_MAX = wp.constant(4)  # [N]
TURNING_MAX = wp.constant(5)  # [rad]
TENSION_SQUARE = wp.constant(6)  # [N2] summed
TURNING_SQUARE = wp.constant(7)  # [rad2] summed
WIRE_STRESS = wp.constant(8)  # counts of STRESS_UNIT, 4 entries xx, xy, yx, yy
WIRE_COLUMNS = 12

# columns of the rows of pairs
CLOSED = wp.constant(0)  # closed pairs
FORCE_SUM = wp.constant(1)  # [N]
GAP_MAX = wp.constant(2)  # [m] largest |gap| of a closed pair
GAP_SQUARE = wp.constant(3)  # [m2] summed over closed pairs
PAIR_STRESS = wp.constant(4)  # counts of STRESS_UNIT, 4 entries
PAIR_COLUMNS = 8


@wp.kernel
def sum_wires(
    # in: blocks
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    first_block: int,
    control: wp.array(dtype=wp.float64),
    true_stiffness: wp.float64,
    # in: rest data
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    # in: see evaluate_wires in energy.py
    strain: wp.array(dtype=Any),
    tension: wp.array(dtype=Any),
    turning: wp.array(dtype=Any),
    force_x: wp.array(dtype=Any),
    force_y: wp.array(dtype=Any),
    # out
    partial: wp.array2d(dtype=wp.float64),
):
    block = first_block + wp.tid()
    begin = block_first[block]
    strain_max = wp.float64(0.0)
    error_max = wp.float64(0.0)
    error_sum = wp.float64(0.0)
    error_square = wp.float64(0.0)
    tension_max = -wp.float64(1.0e30)
    turning_max = wp.float64(0.0)
    tension_square = wp.float64(0.0)
    turning_square = wp.float64(0.0)
    for k in range(block_count[block]):
        i = begin + k
        pull = wp.float64(tension[i])
        turn = wp.float64(turning[i])
        error = wp.float64(strain[i]) - pull / true_stiffness
        strain_max = wp.max(strain_max, wp.abs(wp.float64(strain[i])))
        error_max = wp.max(error_max, wp.abs(error))
        error_sum += error
        error_square += error * error
        tension_max = wp.max(tension_max, pull)
        turning_max = wp.max(turning_max, wp.abs(turn))
        tension_square += pull * pull
        turning_square += turn * turn
    stress = wp.vec4d()
    for k in range(block_count[block]):
        i = begin + k
        t = block_table[block] + k
        fx = wp.float64(force_x[i])
        fy = wp.float64(force_y[i])
        ax = wp.float64(rest_x[t])
        ay = wp.float64(rest_y[t])
        stress += wp.vec4d(fx * ax, fx * ay, fy * ax, fy * ay)
    partial[block, STRAIN_MAX] = strain_max
    partial[block, ERROR_MAX] = error_max
    partial[block, ERROR_SUM] = error_sum
    partial[block, ERROR_SQUARE] = error_square
    partial[block, TENSION_MAX] = tension_max
    partial[block, TURNING_MAX] = turning_max
    partial[block, TENSION_SQUARE] = tension_square
    partial[block, TURNING_SQUARE] = turning_square
    for k in range(4):
        partial[block, WIRE_STRESS + k] = wp.rint(stress[k] / control[STRESS_UNIT])


@wp.func
def pair_stress(
    p: int,
    unit: Any,
    pair_table: wp.array(dtype=wp.int32),
    pair_rest_x: wp.array(dtype=Any),
    pair_rest_y: wp.array(dtype=Any),
    table_x: wp.array(dtype=Any),
    table_y: wp.array(dtype=Any),
    pair_slide: wp.array(dtype=wp.int32),
    pair_nodal_x: wp.array(dtype=Any),
    pair_nodal_y: wp.array(dtype=Any),
    stress_unit: wp.float64,
) -> wp.vec4d:
    """[counts] of a pair that carries force: xx, xy, yx, yy."""
    total = wp.vec4d()
    for k in range(4):
        t = pair_table[p] + pair_slide[p] - 1 + k
        ax = wp.float64(unit * type(unit)(pair_rest_x[p] - table_x[t]))
        ay = wp.float64(unit * type(unit)(pair_rest_y[p] - table_y[t]))
        fx = wp.float64(pair_nodal_x[4 * p + k])
        fy = wp.float64(pair_nodal_y[4 * p + k])
        total += wp.vec4d(fx * ax, fx * ay, fy * ax, fy * ay) / stress_unit
    return wp.vec4d(wp.rint(total[0]), wp.rint(total[1]), wp.rint(total[2]), wp.rint(total[3]))


@wp.kernel
def sum_pairs(
    # in: pairs
    first_block: int,
    pair_block: int,
    control: wp.array(dtype=wp.float64),
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
    block = first_block + wp.tid()
    zero = type(unit)(0.0)
    closed = wp.float64(0.0)
    force = wp.float64(0.0)
    gap_max = zero
    gap_square = wp.float64(0.0)
    stress = wp.vec4d()
    for p in range(block * pair_block, wp.min((block + 1) * pair_block, pair_force.shape[0])):
        if pair_force[p] > zero and pair_wire[p] >= 0:
            closed += wp.float64(1.0)
            force += wp.float64(pair_force[p])
            gap_max = wp.max(gap_max, wp.abs(pair_gap[p]))
            gap_square += wp.float64(pair_gap[p]) * wp.float64(pair_gap[p])
            stress += pair_stress(p, unit, pair_table, pair_rest_x, pair_rest_y, table_x, table_y, pair_slide, pair_nodal_x,
                                  pair_nodal_y, control[STRESS_UNIT])  # fmt: skip
    partial[block, CLOSED] = closed
    partial[block, FORCE_SUM] = force
    partial[block, GAP_MAX] = wp.float64(gap_max)
    partial[block, GAP_SQUARE] = gap_square
    for k in range(4):
        partial[block, PAIR_STRESS + k] = stress[k]


@wp.func
def count_pair_stress(
    begin: int,
    end: int,
    control: wp.array(dtype=wp.float64),
    unit: Any,
    pair_wire: wp.array(dtype=wp.int32),
    pair_table: wp.array(dtype=wp.int32),
    pair_rest_x: wp.array(dtype=Any),
    pair_rest_y: wp.array(dtype=Any),
    table_x: wp.array(dtype=Any),
    table_y: wp.array(dtype=Any),
    pair_slide: wp.array(dtype=wp.int32),
    pair_force: wp.array(dtype=Any),
    pair_nodal_x: wp.array(dtype=Any),
    pair_nodal_y: wp.array(dtype=Any),
    row: int,
    body_partial: wp.array2d(dtype=wp.float64),
):
    """Store the stress of pairs in a row of sums, in counts of STRESS_UNIT."""
    total = wp.vec4d()
    for p in range(begin, end):
        if pair_force[p] > type(unit)(0.0) and pair_wire[p] >= 0:
            total += pair_stress(p, unit, pair_table, pair_rest_x, pair_rest_y, table_x, table_y, pair_slide, pair_nodal_x,
                                 pair_nodal_y, control[STRESS_UNIT])  # fmt: skip
    for k in range(4):
        body_partial[row, STRESS_PART + k] = total[k]


@wp.kernel
def count_stress_of_pairs(
    # in: rows of the sums of bodies, and pairs of each
    first_row: int,
    row_pairs: int,
    control: wp.array(dtype=wp.float64),
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
    pair_nodal_x: wp.array(dtype=Any),
    pair_nodal_y: wp.array(dtype=Any),
    # out
    body_partial: wp.array2d(dtype=wp.float64),
):
    """Stress of pairs in a step with tension-driven directions, a thread a row."""
    if control[STATUS] == STATUS_RUNNING and is_driven(control):
        row = first_row + wp.tid()
        end = wp.min((row + 1) * row_pairs, pair_force.shape[0])
        count_pair_stress(row * row_pairs, end, control, unit, pair_wire, pair_table, pair_rest_x, pair_rest_y, table_x, table_y,
                          pair_slide, pair_force, pair_nodal_x, pair_nodal_y, row, body_partial)  # fmt: skip


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
