"""Clamps that move while a load comes on, and clamps that slide, of rods.

A clamp holds two nodes and keeps their direction. One at rest position c moves as F c, so that a node of it at rest position X
has the displacement (f - F)(X - c) from where the load carries X, f being the length factor of the wires. Where a clamp slides
along the warp, one rigid body of both
nodes has the sum of their masses and feels the sum of their forces there,

    v' = a v + b (f_1 + f_2)/(m_1 + m_2)        u' = u + dt (v' + g (v' - v))

with the factors of control.py. What it takes up is not out of balance; across, and out of the plane, it is held.
"""

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
)
from .rod_step import NODE_BLOCK


@wp.kernel
def move_clamps(
    # in: clamps
    clamp_node: wp.array2d(dtype=wp.int32),
    clamp_lever: wp.array2d(dtype=wp.vec2d),
    clamp_slides: wp.array(dtype=wp.int32),
    node_mass: wp.array(dtype=wp.float64),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    # in: the sums without holding
    force: wp.array(dtype=wp.vec3d),
    # state in and out
    clamp_velocity: wp.array(dtype=wp.float64),
    displacement: wp.array(dtype=wp.vec3d),
    # out
    partial: wp.array2d(dtype=wp.float64),
):
    """One thread a clamp, behind `step_rods`. `clamp_lever` is X - c [m] of both nodes, `clamp_velocity` [m/s] along the warp."""
    s = wp.tid()
    if control[STATUS] != STATUS_RUNNING:
        return
    grown = control[LENGTH_FACTOR]
    dt = control[TIME_STEP]
    a = clamp_node[s, 0]
    b = clamp_node[s, 1]
    slide = wp.float64(0.0)
    speed_square = wp.float64(0.0)
    row = a / NODE_BLOCK
    if clamp_slides[s] != 0:
        mass = node_mass[a] + node_mass[b]
        push = force[a][1] + force[b][1]
        before = clamp_velocity[s]
        after = control[VELOCITY_FACTOR] * before + control[FORCE_FACTOR] * push / mass
        clamp_velocity[s] = after
        slide = dt * (after + control[LOOK_AHEAD] * (after - before))
        speed_square = after * after
        wp.atomic_add(partial, row, KINETIC_PART, mass * speed_square)
        wp.atomic_max(partial, row, STRONGEST_PART, push * push)
        wp.atomic_add(partial, row, FORCE_PART, push * push)
    for k in range(2):
        i = clamp_node[s, k]
        lever = clamp_lever[s, k]
        was = displacement[i]
        x = (grown - control[GRADIENT]) * lever[0] - control[GRADIENT + 1] * lever[1]
        y = (grown - control[GRADIENT + 3]) * lever[1] - control[GRADIENT + 2] * lever[0]
        if clamp_slides[s] != 0:
            y = was[1] + slide
        displacement[i] = wp.vec3d(x, y, was[2])
        step = wp.vec2d(x - was[0], y - was[1]) / dt
        speed_square = wp.max(speed_square, wp.dot(step, step))
    wp.atomic_max(partial, row, SPEED_PART, speed_square)
