// Barrier of threads of a CPU (kernels/barrier.py).
int* arrived = state.data;
int* round = state.data + 32; // on a cache line of its own
const int now = __atomic_load_n(round, __ATOMIC_ACQUIRE);
if (__atomic_add_fetch(arrived, 1, __ATOMIC_ACQ_REL) == threads) {
    __atomic_store_n(arrived, 0, __ATOMIC_RELAXED);
    __atomic_store_n(round, now + 1, __ATOMIC_RELEASE);
} else {
    for (int turn = 1; __atomic_load_n(round, __ATOMIC_ACQUIRE) == now; ++turn) {
#if defined(__x86_64__)
        __builtin_ia32_pause();
#endif
        if (yield_address && turn % 32 == 0) {
            typedef int yield_function(void);
            ((yield_function*)yield_address)();
        }
    }
}
