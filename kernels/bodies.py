"""One explicit step of the contact bodies under the forces of their two pairs.

A thread, or on a GPU BODY_BLOCK of them, steps BODY_BLOCK consecutive bodies and stores one row of partial sums; the loop is C++,
which the CPU compiler vectorises. `pair_body_x, _y` are the forces [N] of pairs 2b and 2b + 1 on body b. The update is in
control.py. With fictitious masses a free body is slowed down (`slow_when_free`), because its flight has no physical meaning and
could carry it out of its lens. It is not stopped at once: between two moving wires it would be hit and stopped again and again,
which would keep the wires from converging.
"""

from typing import Any

import warp as wp

from .control import STATUS, STATUS_RUNNING, STEP
from .native_text import native_text
from .wires import rounding_phase

BODY_BLOCK = 32
FREE_FLIGHT = 0.9  # velocity factor of a free body a step; its total path is nine steps


@wp.func_native(native_text("step_bodies", globals()))
def step_block_of_bodies(
    # in: what steers the step
    block: wp.int32,
    lane: wp.int32,
    control: wp.array(dtype=wp.float64),
    phase: Any,
    unit: Any,
    slow_when_free: wp.int32,
    # in: contact
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
): ...


@wp.kernel
def step_bodies(
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    unit: Any,
    first_block: int,
    threads_a_block: int,
    slow_when_free: int,
    # in: contact
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
    """`threads_a_block` threads a block: one, or BODY_BLOCK on a GPU."""
    thread = wp.tid()
    if control[STATUS] != STATUS_RUNNING:
        return
    step_block_of_bodies(
        first_block + thread / threads_a_block, thread % threads_a_block, control, type(unit)(rounding_phase(control[STEP])),
        unit, slow_when_free, pair_force, pair_body_x, pair_body_y, ux, uy, vx, vy, partial,
    )  # fmt: skip
