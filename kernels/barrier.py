"""Barrier of the threads of a step on the CPU.

Warp runs a CPU launch on one thread. Several Python threads that replay graphs of launches at a time (warpknit/planar/step.py)
each do a part of a step; between the parts each launches `wait_for_all`.
"""

import warp as wp

from .native_text import native_text


@wp.func_native(native_text("arrive_and_wait"))
def arrive_and_wait(
    # in
    threads: wp.int32,
    yield_address: wp.uint64,
    # in and out
    state: wp.array(dtype=wp.int32),
): ...


@wp.kernel
def wait_for_all(
    # in
    threads: wp.int32,
    yield_address: wp.uint64,
    # in and out: 64 entries, zero at the start
    state: wp.array(dtype=wp.int32),
):
    """Return when `threads` launches have arrived.

    `yield_address`: of a C function without arguments that yields the core to another thread, or 0.
    """
    arrive_and_wait(threads, yield_address, state)
