"""Moving and sliding clamps of rods.

A clamp holds two nodes and keeps their direction. A clamp at rest position c moves to F c, so its node at rest position X has the
displacement (f - F)(X - c) from the affine position F X, with the length factor f of the wires. A clamp that slides along the
warp moves its two nodes as one rigid body, with the sum of their masses and forces,

    v' = a v + b (f_1 + f_2)/(m_1 + m_2)        u' = u + dt (v' + g (v' - v))

with the factors of control.py. Along the weft and out of the plane it is held.
"""

from typing import Any

import warp as wp

from .control import (
    FORCE_FACTOR,
    FORCE_PART,
    GRADIENT,
    KINETIC_PART,
    LENGTH_FACTOR,
    LOOK_AHEAD,
    SPEED_PART,
    STATUS,
    STATUS_RUNNING,
    STRONGEST_PART,
    TIME_STEP,
    VELOCITY_FACTOR,
)  # fmt: skip
from .wire_travel import add_travel


@wp.kernel
def move_clamps(
    # in: clamps
    first_clamp: int,
    clamp_node: wp.array2d(dtype=wp.int32),
    clamp_lever: wp.array2d(dtype=wp.vec2d),
    clamp_slides: wp.array(dtype=wp.int32),
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    node_wire: wp.array(dtype=wp.int32),
    node_block: wp.array(dtype=wp.int32),
    node_mass: wp.array(dtype=wp.vec3d),
    # in: what steers the step
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    # in: the sums without holding
    force: wp.array(dtype=Any),
    # state in and out
    clamp_velocity: wp.array(dtype=wp.float64),
    displacement: wp.array(dtype=wp.vec3d),
    # out
    partial: wp.array2d(dtype=wp.float64),
    # out, added to: [m]
    block_travel: wp.array(dtype=wp.float64),
):
    """One thread a clamp, behind `move_rods`. `clamp_lever` is X - c [m] of both nodes, `clamp_velocity` [m/s] along the warp."""
    s = first_clamp + wp.tid()
    a = clamp_node[s, 0]
    own = control[a / world_nodes]
    if own[STATUS] != STATUS_RUNNING:
        return
    length_factor = own[LENGTH_FACTOR]
    dt = own[TIME_STEP]
    b = clamp_node[s, 1]
    slide = wp.float64(0.0)
    speed_square = wp.float64(0.0)
    row = node_wire[a]
    if clamp_slides[s] != 0:
        mass = node_mass[a][1] + node_mass[b][1]
        push = wp.float64(force[a][1]) + wp.float64(force[b][1])
        before = clamp_velocity[s]
        after = own[VELOCITY_FACTOR] * before + own[FORCE_FACTOR] * push / mass
        clamp_velocity[s] = after
        slide = dt * (after + own[LOOK_AHEAD] * (after - before))
        speed_square = after * after
        wp.atomic_add(partial, row, KINETIC_PART, mass * speed_square)
        wp.atomic_max(partial, row, STRONGEST_PART, push * push)
        wp.atomic_add(partial, row, FORCE_PART, push * push)
    for k in range(2):
        i = clamp_node[s, k]
        lever = clamp_lever[s, k]
        old = displacement[i]
        x = (length_factor - own[GRADIENT]) * lever[0] - own[GRADIENT + 1] * lever[1]
        y = (length_factor - own[GRADIENT + 3]) * lever[1] - own[GRADIENT + 2] * lever[0]
        if clamp_slides[s] != 0:
            y = old[1] + slide
        displacement[i] = wp.vec3d(x, y, old[2])
        step = wp.vec2d(x - old[0], y - old[1]) / dt
        speed_square = wp.max(speed_square, wp.dot(step, step))
        add_travel(i, dt * wp.length(step), previous, following, node_block, block_travel)
    wp.atomic_max(partial, row, SPEED_PART, speed_square)
