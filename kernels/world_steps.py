"""Many explicit steps of worlds on the CPU, a world a thread.

Worlds are independent states of one mesh: every array has the world as its first axis, and each world has its own control row
(control.py). Wires are elastic and contacts frictionless. A thread takes all steps of its world in sequence, so that a small mesh
stays in the L1 cache; it stops when the world is frozen. Each step follows contact_by_batch.py, wires.py, bodies.py, grip.py and
control.py, in this order.
"""

from typing import Any

import warp as wp

from .bodies import step_block_of_bodies
from .contact_by_batch import contact_of_batch
from .control import STATUS, STATUS_RUNNING, STEP, all_rows, is_driven, renew_control
from .grip import count_of, held_move
from .sums import count_pair_stress
from .wires import block_step, rounding_phase


@wp.kernel
def step_worlds(
    # in: which worlds, and up to which step [world]
    worlds: wp.array(dtype=wp.int32),
    last_step: wp.array(dtype=wp.float64),
    # how
    unit: Any,
    gripped: int,
    slow_when_free: int,
    batches: int,
    body_blocks: int,
    reach_at_rest: Any,
    # in: rest data of one repeat
    table_x: wp.array(dtype=Any),
    table_y: wp.array(dtype=Any),
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    rest_length: wp.array(dtype=Any),
    inverse_length: wp.array(dtype=Any),
    rest_angle: wp.array(dtype=Any),
    hinge_stiffness: wp.array(dtype=Any),
    inverse_mass: wp.array(dtype=Any),
    node_mass: wp.array(dtype=Any),
    curve: wp.array2d(dtype=Any),
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    block_pair_start: wp.array(dtype=wp.int32),
    block_pair: wp.array(dtype=wp.int32),
    block_held_start: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    wire_clamp: wp.array2d(dtype=Any),
    # in: pairs
    pair_wire: wp.array(dtype=wp.int32),
    pair_seed: wp.array(dtype=wp.int32),
    pair_table: wp.array(dtype=wp.int32),
    pair_low: wp.array(dtype=wp.int32),
    pair_high: wp.array(dtype=wp.int32),
    pair_side: wp.array(dtype=wp.int32),
    pair_rest_x: wp.array(dtype=Any),
    pair_rest_y: wp.array(dtype=Any),
    # in: grips
    held_node: wp.array(dtype=wp.int32),
    held_lever_x: wp.array(dtype=wp.float64),
    held_lever_y: wp.array(dtype=wp.float64),
    # state in: [world, ...]
    pair_wake: wp.array2d(dtype=Any),
    pair_offset: wp.array2d(dtype=Any),
    tension_offset: wp.array2d(dtype=Any),
    plastic_turn: wp.array2d(dtype=Any),
    back_turn: wp.array2d(dtype=Any),
    wire_axial: wp.array2d(dtype=Any),
    wire_mass: wp.array2d(dtype=Any),
    # state in and out: which of the two buffers of displacements is current [world], both buffers [world, 2, node] ...
    parity: wp.array(dtype=wp.int32),
    node_ux: wp.array3d(dtype=Any),
    node_uy: wp.array3d(dtype=Any),
    # in and out: the rest [world, ...]
    node_vx: wp.array2d(dtype=Any),
    node_vy: wp.array2d(dtype=Any),
    body_ux: wp.array2d(dtype=Any),
    body_uy: wp.array2d(dtype=Any),
    body_vx: wp.array2d(dtype=Any),
    body_vy: wp.array2d(dtype=Any),
    pair_slide: wp.array2d(dtype=wp.int32),
    pair_u: wp.array2d(dtype=Any),
    cached_slide: wp.array2d(dtype=wp.int32),
    cached_node: wp.array2d(dtype=wp.int32),
    cached_number: wp.array2d(dtype=Any),
    control: wp.array2d(dtype=wp.float64),
    # in and out: what a step leaves for its next part [world, ...]
    pair_node: wp.array2d(dtype=wp.int32),
    pair_force: wp.array2d(dtype=Any),
    pair_body_x: wp.array2d(dtype=Any),
    pair_body_y: wp.array2d(dtype=Any),
    pair_nodal_x: wp.array2d(dtype=Any),
    pair_nodal_y: wp.array2d(dtype=Any),
    wire_partial: wp.array3d(dtype=wp.float64),
    body_partial: wp.array3d(dtype=wp.float64),
    # out
    pair_gap: wp.array2d(dtype=Any),
):
    w = worlds[wp.tid()]
    while control[w, STATUS] == STATUS_RUNNING and control[w, STEP] < last_step[w]:
        now = parity[w]
        then = 1 - now
        phase = type(unit)(rounding_phase(control[w, STEP]))
        for batch in range(batches):
            contact_of_batch(
                batch, control[w], unit, reach_at_rest, table_x, table_y, rest_x, rest_y, curve, pair_wire, pair_seed, pair_table,
                pair_low, pair_high, pair_side, pair_rest_x, pair_rest_y, pair_wake[w], pair_offset[w], wire_first, wire_count,
                wire_closed, node_ux[w, now], node_uy[w, now], body_ux[w], body_uy[w], pair_slide[w], pair_u[w], cached_slide[w],
                cached_node[w], cached_number[w], pair_node[w], pair_gap[w], pair_force[w], pair_body_x[w], pair_body_y[w],
                pair_nodal_x[w], pair_nodal_y[w],
            )  # fmt: skip
        for block in range(block_first.shape[0]):
            block_step(
                block, wp.int32(0), control[w], phase, unit, gripped, block_first, block_count, block_table, block_wire,
                block_pair_start, block_held_start, wire_first, wire_count, wire_closed, wire_clamp, wire_axial[w], wire_mass[w],
                rest_x, rest_y, rest_length, inverse_length, rest_angle, hinge_stiffness, inverse_mass, node_mass,
                tension_offset[w], type(unit)(0.0), type(unit)(0.0), plastic_turn[w], back_turn[w], block_pair, pair_node[w],
                pair_force[w], pair_nodal_x[w], pair_nodal_y[w], held_node, held_lever_x, held_lever_y, node_ux[w, now],
                node_uy[w, now], node_vx[w], node_vy[w], node_ux[w, then], node_uy[w, then], wire_partial[w],
            )  # fmt: skip
        for block in range(body_blocks):
            step_block_of_bodies(
                block, wp.int32(0), control[w], phase, unit, slow_when_free, pair_force[w], pair_body_x[w], pair_body_y[w],
                body_ux[w], body_uy[w], body_vx[w], body_vy[w], body_partial[w],
            )  # fmt: skip
        if is_driven(control[w]):
            count_pair_stress(0, pair_wire.shape[0], control[w], unit, pair_wire, pair_table, pair_rest_x, pair_rest_y, table_x,
                              table_y, pair_slide[w], pair_force[w], pair_nodal_x[w], pair_nodal_y[w], wp.int32(0),
                              body_partial[w])  # fmt: skip
        for h in range(held_node.shape[0]):
            move = held_move(control[w], wp.vec2d(held_lever_x[h], held_lever_y[h]))
            node_ux[w, then, held_node[h]] = count_of(move[0], unit)
            node_uy[w, then, held_node[h]] = count_of(move[1], unit)
        renew_control(all_rows(wire_partial[w], body_partial[w], is_driven(control[w])), control[w])
        parity[w] = then
