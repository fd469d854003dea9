"""Held nodes: a clamp moves with the boundary and keeps its direction.

A clamp at rest position c holds nodes at rest positions X; they move as F c + q + (X - c), which is a displacement of
q + (I - F)(X - c) from the affinely mapped rest shape. The clamp's own displacement q goes from one place to another with the
load ramp.
"""

from typing import Any

import warp as wp

from .control import GRADIENT, RAMP_SHARE, STATUS, STATUS_RUNNING


@wp.func
def held_move(control: wp.array(dtype=wp.float64), lever: wp.vec2d):
    """Displacement [m] of a held node at `lever` from its clamp."""
    one = wp.float64(1.0)
    return wp.vec2d(
        (one - control[GRADIENT]) * lever[0] - control[GRADIENT + 1] * lever[1],
        (one - control[GRADIENT + 3]) * lever[1] - control[GRADIENT + 2] * lever[0],
    )


@wp.kernel
def move_held_nodes(
    # in
    control: wp.array(dtype=wp.float64),
    unit: Any,
    held_node: wp.array(dtype=wp.int32),
    held_lever_x: wp.array(dtype=wp.float64),
    held_lever_y: wp.array(dtype=wp.float64),
    held_clamp: wp.array(dtype=wp.int32),
    clamp_from: wp.array(dtype=wp.vec2d),
    clamp_to: wp.array(dtype=wp.vec2d),
    # out
    ux: wp.array(dtype=Any),
    uy: wp.array(dtype=Any),
):
    """`held_lever` is X - c [m]; `clamp_from` and `clamp_to` are q [m]."""
    h = wp.tid()
    if control[STATUS] != STATUS_RUNNING:
        return
    move = held_move(control, wp.vec2d(held_lever_x[h], held_lever_y[h]))
    clamp = held_clamp[h]
    q = clamp_from[clamp] + control[RAMP_SHARE] * (clamp_to[clamp] - clamp_from[clamp])
    i = held_node[h]
    ux[i] = count_of(move[0] + q[0], unit)
    uy[i] = count_of(move[1] + q[1], unit)


@wp.func
def count_of(x: wp.float64, unit: wp.float32) -> wp.int32:
    """A length [m] in counts of the unit."""
    return wp.int32(wp.rint(x / wp.float64(unit)))


@wp.func
def count_of(x: wp.float64, unit: wp.float64) -> wp.float64:
    return x / unit
