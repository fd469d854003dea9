"""One explicit step of all wires: forces (wire_forces.py), contact gathered from the pairs, update.

    f_i = n_i - n_(i-1) + contact

Nodes of a wire are consecutive; block b holds nodes `block_first[b]` and on. Displacements are read from `*_in` and written to
`*_out`, so that a node never reads updated neighbours. The update is in control.py.
"""

from typing import Any

import warp as wp

from . import clamp, wire_forces
from .control import STATUS, STATUS_RUNNING, STEP
from .native_text import native_text


@wp.func
def rounding_phase(step: wp.float64) -> wp.float64:
    """Rounding phase of a step in [0, 1): multiples of the golden ratio, which cover it evenly.

    A step adds floor(x + phase) counts, so that n equal steps add n x to a count or two, however small x is.
    """
    turns = step * wp.float64(0.6180339887498949)
    return turns - wp.floor(turns)


@wp.func
def node_at(i: int, wire_first: int, wire_count: int, closed: int) -> int:
    """Index of a node counted beyond the ends of its wire: wrapped if closed, else held at the end."""
    j = i - wire_first
    if closed != 0:
        j = ((j % wire_count) + wire_count) % wire_count
    else:
        j = wp.clamp(j, 0, wire_count - 1)
    return wire_first + j


@wp.func_native(native_text("step_wires", vars(wire_forces), vars(clamp)))
def block_step(
    # in: what steers the step
    block: wp.int32,
    lane: wp.int32,
    control: wp.array(dtype=wp.float64),
    phase: Any,
    unit: Any,
    gripped: wp.int32,
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    block_pair_start: wp.array(dtype=wp.int32),
    block_held_start: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    wire_clamp: wp.array2d(dtype=Any),
    wire_axial: wp.array(dtype=Any),
    wire_mass: wp.array(dtype=Any),
    # in: rest data
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    rest_length: wp.array(dtype=Any),
    inverse_length: wp.array(dtype=Any),
    rest_angle: wp.array(dtype=Any),
    hinge_stiffness: wp.array(dtype=Any),
    inverse_mass: wp.array(dtype=Any),
    node_mass: wp.array(dtype=Any),
    tension_offset: wp.array(dtype=Any),
    yield_moment: Any,
    kept_stiffness: Any,
    plastic_turn: wp.array(dtype=Any),
    back_turn: wp.array(dtype=Any),
    # in: contact and grips
    block_pair: wp.array(dtype=wp.int32),
    pair_node: wp.array(dtype=wp.int32),
    pair_force: wp.array(dtype=Any),
    pair_nodal_x: wp.array(dtype=Any),
    pair_nodal_y: wp.array(dtype=Any),
    held_node: wp.array(dtype=wp.int32),
    held_lever_x: wp.array(dtype=wp.float64),
    held_lever_y: wp.array(dtype=wp.float64),
    # state in
    ux_in: wp.array(dtype=Any),
    uy_in: wp.array(dtype=Any),
    # state in and out
    vx: wp.array(dtype=Any),
    vy: wp.array(dtype=Any),
    # out
    ux_out: wp.array(dtype=Any),
    uy_out: wp.array(dtype=Any),
    partial: wp.array2d(dtype=wp.float64),
): ...


@wp.kernel
def step_wires(
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    block_pair_start: wp.array(dtype=wp.int32),
    block_held_start: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    wire_clamp: wp.array2d(dtype=Any),
    wire_axial: wp.array(dtype=Any),
    wire_mass: wp.array(dtype=Any),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    unit: Any,
    first_block: int,
    threads_a_block: int,
    gripped: int,
    # in: rest data
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    rest_length: wp.array(dtype=Any),
    inverse_length: wp.array(dtype=Any),
    rest_angle: wp.array(dtype=Any),
    hinge_stiffness: wp.array(dtype=Any),
    inverse_mass: wp.array(dtype=Any),
    node_mass: wp.array(dtype=Any),
    tension_offset: wp.array(dtype=Any),
    yield_moment: Any,
    kept_stiffness: Any,
    plastic_turn: wp.array(dtype=Any),
    back_turn: wp.array(dtype=Any),
    # in: contact and grips
    block_pair: wp.array(dtype=wp.int32),
    pair_node: wp.array(dtype=wp.int32),
    pair_force: wp.array(dtype=Any),
    pair_nodal_x: wp.array(dtype=Any),
    pair_nodal_y: wp.array(dtype=Any),
    held_node: wp.array(dtype=wp.int32),
    held_lever_x: wp.array(dtype=wp.float64),
    held_lever_y: wp.array(dtype=wp.float64),
    # state in
    ux_in: wp.array(dtype=Any),
    uy_in: wp.array(dtype=Any),
    # state in and out
    vx: wp.array(dtype=Any),
    vy: wp.array(dtype=Any),
    # out
    ux_out: wp.array(dtype=Any),
    uy_out: wp.array(dtype=Any),
    partial: wp.array2d(dtype=wp.float64),
):
    """`threads_a_block` threads a block: one, or WIRE_LANES on a GPU."""
    thread = wp.tid()
    block = first_block + thread / threads_a_block
    lane = thread % threads_a_block
    if control[STATUS] != STATUS_RUNNING:
        # the state is frozen: hand it on unchanged
        for k in range(lane, block_count[block], threads_a_block):
            i = block_first[block] + k
            ux_out[i] = ux_in[i]
            uy_out[i] = uy_in[i]
        return
    block_step(
        block, lane, control, type(unit)(rounding_phase(control[STEP])), unit, gripped, block_first, block_count, block_table,
        block_wire, block_pair_start, block_held_start, wire_first, wire_count, wire_closed, wire_clamp, wire_axial, wire_mass,
        rest_x, rest_y, rest_length, inverse_length, rest_angle, hinge_stiffness, inverse_mass, node_mass, tension_offset,
        yield_moment, kept_stiffness, plastic_turn, back_turn, block_pair, pair_node, pair_force, pair_nodal_x, pair_nodal_y,
        held_node, held_lever_x, held_lever_y, ux_in, uy_in, vx, vy, ux_out, uy_out, partial,
    )  # fmt: skip
