"""Rayleigh quotient of the slowest active mode, from changes between convergence checks.

    lambda = - sum m du . d(f/m) / sum m du . du          c = 2 sqrt(lambda)

du and d(f/m) are the changes of displacement and acceleration between two checks, many steps apart, which averages out
stiff modes and round-off. c is the critical damping of that mode
(dynamic relaxation, Papadrakakis 1981, with the quotient taken over many steps).
"""

from typing import Any

import warp as wp


@wp.kernel
def sum_rayleigh(
    # in: blocks
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    first_block: int,
    wire_mass: wp.array(dtype=Any),
    inverse_mass: wp.array(dtype=Any),
    unit: Any,
    # state in
    ux: wp.array(dtype=Any),
    uy: wp.array(dtype=Any),
    acceleration_x: wp.array(dtype=Any),
    acceleration_y: wp.array(dtype=Any),
    # in and out: of the last check, then of this one
    last_ux: wp.array(dtype=Any),
    last_uy: wp.array(dtype=Any),
    last_acceleration_x: wp.array(dtype=Any),
    last_acceleration_y: wp.array(dtype=Any),
    # out
    partial: wp.array2d(dtype=wp.float64),
):
    """One row of partial sums a block: - sum m du . d(f/m), sum m du . du."""
    block = first_block + wp.tid()
    force = wp.float64(0.0)
    moved = wp.float64(0.0)
    scale = wp.float64(unit)
    for lane in range(block_count[block]):
        i = block_first[block] + lane
        mass = wp.float64(wire_mass[block_wire[block]]) / wp.float64(inverse_mass[block_table[block] + lane])
        dx = scale * wp.float64(ux[i] - last_ux[i])
        dy = scale * wp.float64(uy[i] - last_uy[i])
        ax = wp.float64(acceleration_x[i]) - wp.float64(last_acceleration_x[i])
        ay = wp.float64(acceleration_y[i]) - wp.float64(last_acceleration_y[i])
        force -= mass * (dx * ax + dy * ay)
        moved += mass * (dx * dx + dy * dy)
        last_ux[i] = ux[i]
        last_uy[i] = uy[i]
        last_acceleration_x[i] = acceleration_x[i]
        last_acceleration_y[i] = acceleration_y[i]
    partial[block, 0] = force
    partial[block, 1] = moved
