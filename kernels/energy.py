"""Strains, tensions and moments of the wires, from wire_forces.py; evaluated between steps.

    strain = ((|e| - L)/L - w)/(1 + w) + bow - bow at rest

of the curved segment, with w the local thermal strain relative to the mesh; bow: see bend.py.
"""

from typing import Any

import warp as wp

from . import bend, clamp, wire_forces
from .native_text import native_text


@wp.func_native(native_text("evaluate_wires", vars(wire_forces), vars(clamp), vars(bend)))
def evaluate_block(
    # in: what steers the step
    block: wp.int32,
    lane: wp.int32,
    control: wp.array(dtype=wp.float64),
    unit: Any,
    gripped: wp.int32,
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    wire_clamp: wp.array2d(dtype=Any),
    wire_axial: wp.array(dtype=Any),
    wire_thermal_strain: wp.array(dtype=wp.vec2d),
    # in: rest data
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    rest_length: wp.array(dtype=Any),
    inverse_length: wp.array(dtype=Any),
    rest_angle: wp.array(dtype=Any),
    rest_bow: wp.array(dtype=Any),
    hinge_stiffness: wp.array(dtype=Any),
    tension_offset: wp.array(dtype=Any),
    yield_moment: Any,
    kept_stiffness: Any,
    plastic_turn: wp.array(dtype=Any),
    back_turn: wp.array(dtype=Any),
    # state in
    ux_in: wp.array(dtype=Any),
    uy_in: wp.array(dtype=Any),
    # out: see evaluate_wires
    tension_out: wp.array(dtype=Any),
    turning_out: wp.array(dtype=Any),
    force_x_out: wp.array(dtype=Any),
    force_y_out: wp.array(dtype=Any),
    strain_out: wp.array(dtype=Any),
    edge_x_out: wp.array(dtype=Any),
    edge_y_out: wp.array(dtype=Any),
    elastic_out: wp.array(dtype=Any),
    moment_out: wp.array(dtype=Any),
    bow_moment_out: wp.array(dtype=Any),
): ...


@wp.kernel
def evaluate_wires(
    # in: what steers the step
    first_block: int,
    threads_a_block: int,
    control: wp.array(dtype=wp.float64),
    unit: Any,
    gripped: int,
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    wire_clamp: wp.array2d(dtype=Any),
    wire_axial: wp.array(dtype=Any),
    wire_thermal_strain: wp.array(dtype=wp.vec2d),
    # in: rest data
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    rest_length: wp.array(dtype=Any),
    inverse_length: wp.array(dtype=Any),
    rest_angle: wp.array(dtype=Any),
    rest_bow: wp.array(dtype=Any),
    hinge_stiffness: wp.array(dtype=Any),
    tension_offset: wp.array(dtype=Any),
    yield_moment: Any,
    kept_stiffness: Any,
    plastic_turn: wp.array(dtype=Any),
    back_turn: wp.array(dtype=Any),
    # state in
    ux: wp.array(dtype=Any),
    uy: wp.array(dtype=Any),
    # out: of the segment that starts at the node: tension [N], force [N] that pulls at the node; zero behind the last node of an
    # open wire. A segment that a clamp holds rigid has no tension
    tension: wp.array(dtype=Any),
    force_x: wp.array(dtype=Any),
    force_y: wp.array(dtype=Any),
    # out: at the node: theta - theta0 [rad]; zero at the ends of an open wire
    turning: wp.array(dtype=Any),
    # out, where wanted: strain of the curved segment [-]
    strain: wp.array(dtype=Any),
    # out, where wanted: edge [m], elastic part of the turning [rad], moments [N m] with slope terms, and of bows
    edge_x: wp.array(dtype=Any),
    edge_y: wp.array(dtype=Any),
    elastic: wp.array(dtype=Any),
    moment: wp.array(dtype=Any),
    bow_moment: wp.array(dtype=Any),
):
    """`threads_a_block` threads a block: one, or WIRE_LANES on a GPU.

    What is wanted has room for all nodes, what is not has none.
    """
    thread = wp.tid()
    block = first_block + thread / threads_a_block
    evaluate_block(
        block, thread % threads_a_block, control, unit, gripped, block_first, block_count, block_table, block_wire, wire_first,
        wire_count, wire_closed, wire_clamp, wire_axial, wire_thermal_strain, rest_x, rest_y, rest_length, inverse_length,
        rest_angle, rest_bow, hinge_stiffness, tension_offset, yield_moment, kept_stiffness, plastic_turn, back_turn, ux, uy,
        tension, turning, force_x, force_y, strain, edge_x, edge_y, elastic, moment, bow_moment,
    )  # fmt: skip
