"""Barrier of the threads of a step on the CPU.

Warp runs a CPU launch on one thread. Several Python threads that replay graphs of launches at a time (warpknit/planar/step.py)
each do a part of a step; between the parts each launches `wait_for_all`.
"""

import warp as wp


@wp.func_native(r"""
    int* arrived = state.data;
    int* round = state.data + 32;  // on a cache line of its own
    const int now = __atomic_load_n(round, __ATOMIC_ACQUIRE);
    if (__atomic_add_fetch(arrived, 1, __ATOMIC_ACQ_REL) == threads) {
        __atomic_store_n(arrived, 0, __ATOMIC_RELAXED);
        __atomic_store_n(round, now + 1, __ATOMIC_RELEASE);
    } else {
        for (int turn = 1; __atomic_load_n(round, __ATOMIC_ACQUIRE) == now; ++turn) {
#if defined(__x86_64__)
            __builtin_ia32_pause();
#endif
            if (yield_address && turn % 32 == 0) { typedef int yield_function(void); ((yield_function*)yield_address)(); }
        }
    }
""")
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

    `yield_address` is that of a C function without arguments that lets another thread have the core, 0 where there is none.
    """
    arrive_and_wait(threads, yield_address, state)
