"""Sliding clamps: fixed in direction and along weft, free along warp.

Such a clamp holds the two nodes at the end of an open wire, in a block of their own. The wire kernel steps them as free nodes.
The clamp is a rigid body with the sum of their masses, so it moves by their mean along warp:

    v' = a v + b (f_1 + f_2)/(2 m)

The forces by which the clamp holds the direction act between the two and drop out of the sum (clamp.py). Across, a
clamp at rest position c holds its nodes as in grip.py. The block's partial sums are recomputed, as reactions of the clamp
are not out of balance.
"""

import warp as wp

from .control import (
    FORCE_FACTOR,
    FORCE_PART,
    GRADIENT,
    KINETIC_PART,
    SPEED_PART,
    STATUS,
    STATUS_RUNNING,
    STRONGEST_PART,
    VELOCITY_FACTOR,
)  # fmt: skip


@wp.kernel
def slide_clamps(
    # in
    control: wp.array(dtype=wp.float64),
    slide_node: wp.array(dtype=wp.int32),
    slide_block: wp.array(dtype=wp.int32),
    slide_lever_x: wp.array2d(dtype=wp.float64),
    slide_lever_y: wp.array2d(dtype=wp.float64),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    inverse_mass: wp.array(dtype=wp.float64),
    wire_mass: wp.array(dtype=wp.float64),
    # state in and out
    slide_vy: wp.array(dtype=wp.float64),
    vy: wp.array(dtype=wp.float64),
    uy: wp.array(dtype=wp.float64),
    # state out
    vx: wp.array(dtype=wp.float64),
    ux: wp.array(dtype=wp.float64),
    # out
    partial: wp.array2d(dtype=wp.float64),
):
    """`slide_lever` is X - c [m] of both nodes; `u` is in metres, displacements from the affinely mapped rest shape."""
    s = wp.tid()
    if control[STATUS] != STATUS_RUNNING:
        return
    half = wp.float64(0.5)
    one = wp.float64(1.0)
    i = slide_node[s]
    block = slide_block[s]
    before = slide_vy[s]
    speed = half * (vy[i] + vy[i + 1])
    place = half * (uy[i] + uy[i + 1])
    slide_vy[s] = speed
    for k in range(2):
        x = slide_lever_x[s, k]
        y = slide_lever_y[s, k]
        vx[i + k] = wp.float64(0.0)
        vy[i + k] = speed
        ux[i + k] = (one - control[GRADIENT]) * x - control[GRADIENT + 1] * y
        uy[i + k] = place
    mass = wp.float64(2.0) * wire_mass[block_wire[block]] / inverse_mass[block_table[block]]
    force = (speed - control[VELOCITY_FACTOR] * before) * mass / control[FORCE_FACTOR]
    partial[block, KINETIC_PART] = mass * speed * speed
    partial[block, SPEED_PART] = speed * speed
    partial[block, STRONGEST_PART] = force * force
    partial[block, FORCE_PART] = force * force
