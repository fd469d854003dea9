"""One explicit step of the contact bodies, which feel nothing but their two pairs.

A thread steps BODY_BLOCK consecutive bodies and leaves one row of partial sums. `pair_body_x, _y` are the forces [N] of
pairs 2b and 2b + 1 on body b. The update is that of control.py. Where masses are fictitious, a body that no wire touches stays
where it was let go (`rest_when_free`): a flight would be as fictitious, and could carry it out of its lens.
"""

from typing import Any

import warp as wp

from .control import (
    BODY_INVERSE_MASS,
    FORCE_FACTOR,
    LOOK_AHEAD,
    STATUS,
    STATUS_RUNNING,
    STEP,
    TIME_STEP,
    VELOCITY_FACTOR,
)
from .wires import round_count, rounding_phase, without_denormals

BODY_BLOCK = 32


@wp.kernel
def step_bodies(
    # what steers the step
    control: wp.array(dtype=wp.float64),
    unit: Any,
    body_block: int,
    first_block: int,
    rest_when_free: int,
    # contact
    pair_force: wp.array(dtype=Any),
    pair_body_x: wp.array(dtype=Any),
    pair_body_y: wp.array(dtype=Any),
    # state in and out
    ux: wp.array(dtype=Any),
    uy: wp.array(dtype=Any),
    vx: wp.array(dtype=Any),
    vy: wp.array(dtype=Any),
    # out
    partial: wp.array2d(dtype=wp.float64),
):
    block = first_block + wp.tid()
    if control[STATUS] != STATUS_RUNNING:
        return
    zero = type(unit)(0.0)
    im = type(unit)(control[BODY_INVERSE_MASS])
    a = type(unit)(control[VELOCITY_FACTOR])
    b = type(unit)(control[FORCE_FACTOR]) * im
    counts = type(unit)(control[TIME_STEP]) / unit
    ahead = type(unit)(control[LOOK_AHEAD])
    phase = type(unit)(rounding_phase(control[STEP]))
    power = wp.float64(0.0)
    square = wp.float64(0.0)
    speed = wp.float64(0.0)
    fastest = wp.float64(0.0)
    strongest = wp.float64(0.0)
    for i in range(block * body_block, wp.min((block + 1) * body_block, ux.shape[0])):
        fx = zero
        fy = zero
        for p in range(2 * i, 2 * i + 2):
            if pair_force[p] != zero:
                fx += pair_body_x[p]
                fy += pair_body_y[p]
        px = vx[i]
        py = vy[i]
        qx = without_denormals(a * px + b * fx)
        qy = without_denormals(a * py + b * fy)
        if rest_when_free != 0 and pair_force[2 * i] == zero and pair_force[2 * i + 1] == zero:
            qx = zero
            qy = zero
            px = zero
            py = zero
        vx[i] = qx
        vy[i] = qy
        ux[i] = ux[i] + round_count((qx + ahead * (qx - px)) * counts, phase, ux[i])
        uy[i] = uy[i] + round_count((qy + ahead * (qy - py)) * counts, phase, uy[i])
        force_square = wp.float64(fx * fx + fy * fy)
        speed_square = wp.float64(qx * qx + qy * qy)
        power += wp.float64(fx * px + fy * py)
        square += force_square
        speed += speed_square
        fastest = wp.max(fastest, speed_square)
        strongest = wp.max(strongest, force_square)
    mass = wp.float64(1.0) / wp.float64(im)
    partial[block, 0] = power
    partial[block, 1] = square / mass
    partial[block, 2] = speed * mass
    partial[block, 3] = fastest
    partial[block, 4] = strongest
    partial[block, 5] = square
