"""Fictitious masses of rods, banded along the wire, for the state last evaluated: the bound of spatial/fictitious_masses.py.

With lengths a, c of the segments before and behind a node and p, m its turning angle and moment, per node and per segment

    bend = (1 + e) (B/l + bow)      turned = [(1 + 1/e) B + GJ] p^2/(2 l) + |m|      edge = (turned at both ends)/L^2 + (K + T)/L

A node and its neighbours have the masses of (dx_b/c - dx_a/a)^2 bend + (dx)^2 edge; sections likewise with twist and bent.
"""

from typing import Any

import warp as wp

from . import banded_mass, bend, rod_blocks
from .control import STATUS, STATUS_WAITING
from .native_text import native_text

TURNED = 2.0  # e of the bound
MORE_TURN = 0.15  # [rad] allowance for turns sharpened until the next update
MORE_TENSION = 1.2  # the same for tensions


@wp.func_native(native_text("rod_masses", globals(), vars(banded_mass), vars(bend), vars(rod_blocks)))
def masses_of_block(
    # in: blocks and wires
    block: wp.int32,
    lane: wp.int32,
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    # in: rest data; whether a clamp moves the node
    held: wp.array(dtype=wp.int32),
    is_sliding: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    node_length: wp.array(dtype=wp.float64),
    natural_curvature: wp.array(dtype=wp.vec2d),
    bow_weight: wp.array(dtype=wp.vec2d),
    wire_bending: wp.array(dtype=wp.float64),
    wire_twist: wp.array(dtype=wp.float64),
    wire_yield: wp.array(dtype=wp.float64),
    slope_factor: wp.float64,
    hardening: wp.float64,
    keeps_arc_length: wp.int32,
    # in: shares of the bound; of the slowest waves 1/length^2 and its square, and the distance of nodes
    share: wp.float64,
    spin_share: wp.float64,
    wave_square: wp.float64,
    wave_fourth: wp.float64,
    spacing: wp.float64,
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    # state in
    stretch_stiffness: wp.array(dtype=wp.float64),
    tension_offset: wp.array(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
    curvature: wp.array(dtype=wp.vec2d),
    plastic_turn: wp.array(dtype=wp.vec2d),
    # in: bounds on the stiffness of contacts, of nodes [N/m] and of sections [N m], where wires may touch
    may_touch: wp.int32,
    sweep: wp.array(dtype=Any),
    # out: see banded_mass.py
    node_mass: wp.array(dtype=wp.vec3d),
    next_mass: wp.array(dtype=wp.float64),
    second_mass: wp.array(dtype=wp.float64),
    spin_inertia: wp.array(dtype=wp.float64),
    next_inertia: wp.array(dtype=wp.float64),
): ...


@wp.kernel
def find_masses(
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    first_block: int,
    threads_a_block: int,
    # in: rest data; whether a clamp moves the node
    held: wp.array(dtype=wp.int32),
    is_sliding: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    node_length: wp.array(dtype=wp.float64),
    natural_curvature: wp.array(dtype=wp.vec2d),
    bow_weight: wp.array(dtype=wp.vec2d),
    wire_bending: wp.array(dtype=wp.float64),
    wire_twist: wp.array(dtype=wp.float64),
    wire_yield: wp.array(dtype=wp.float64),
    slope_factor: wp.float64,
    hardening: wp.float64,
    keeps_arc_length: wp.int32,
    # in: shares of the bound; of the slowest waves 1/length^2 and its square, and the distance of nodes
    share: wp.float64,
    spin_share: wp.float64,
    wave_square: wp.float64,
    wave_fourth: wp.float64,
    spacing: wp.float64,
    # in: what steers the step
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    # state in
    stretch_stiffness: wp.array(dtype=wp.float64),
    tension_offset: wp.array(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
    curvature: wp.array(dtype=wp.vec2d),
    plastic_turn: wp.array(dtype=wp.vec2d),
    # in: bounds on the stiffness of contacts, of nodes [N/m] and of sections [N m], where wires may touch
    may_touch: wp.int32,
    sweep: wp.array(dtype=Any),
    # out: see banded_mass.py
    node_mass: wp.array(dtype=wp.vec3d),
    next_mass: wp.array(dtype=wp.float64),
    second_mass: wp.array(dtype=wp.float64),
    spin_inertia: wp.array(dtype=wp.float64),
    next_inertia: wp.array(dtype=wp.float64),
):
    """`threads_a_block` threads a block: one, or ROD_LANES on a GPU."""
    thread = wp.tid()
    block = first_block + thread / threads_a_block
    own = control[block_first[block] / world_nodes]
    if own[STATUS] == STATUS_WAITING:
        return
    masses_of_block(
        block, thread % threads_a_block, block_first, block_count, block_wire, wire_first, wire_count, wire_closed, rest_row,
        held, is_sliding, natural_length, node_length, natural_curvature, bow_weight, wire_bending, wire_twist, wire_yield,
        slope_factor, hardening, keeps_arc_length, share, spin_share, wave_square, wave_fourth, spacing, own, stretch_stiffness,
        tension_offset, length, curvature, plastic_turn, may_touch, sweep, node_mass, next_mass, second_mass, spin_inertia,
        next_inertia,
    )  # fmt: skip
