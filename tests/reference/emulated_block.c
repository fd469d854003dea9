// The threads of a CUDA block as fibers of one CPU thread: what Warp's CPU blocks call, with barriers and exchanges of warps.
//
// A fiber runs until it waits. Lanes that wait for all of the block go on when each lane that has not returned waits for them;
// those that wait for a mask of their warp when each lane of it waits for the same mask. Anything else ends the process: it would
// be a deadlock, or undefined, on a GPU.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <ucontext.h>

enum { MOST = 1024, STACK = 256 * 1024, WARP = 32, BLOCK = -1 };
enum { EXCHANGE = -1, BALLOT = -2 };
typedef void (*lane_function)(void* dim, size_t block, int lane, void* args);
struct exchange { uint64_t value, result; unsigned mask; int source; };

static ucontext_t scheduler, fibers[MOST];
static char* stacks;
static int lanes, current = -1, is_done[MOST], backwards;
static int64_t waits_for[MOST]; // 0: it runs; BLOCK, or a mask
static uint64_t posted[MOST];
static lane_function function;
static void *dim_of_launch, *args_of_launch;
static size_t block_of_launch;

static void fail(const char* why)
{
    fprintf(stderr, "emulated block: lane %d of %d: %s\n", current, lanes, why);
    exit(3);
}

void emulated_block_order(int reversed) { backwards = reversed; }

static void wait_for(int64_t whom)
{
    waits_for[current] = whom;
    swapcontext(&fibers[current], &scheduler);
}

static void enter(void)
{
    function(dim_of_launch, block_of_launch, current, args_of_launch);
    is_done[current] = 1;
    swapcontext(&fibers[current], &scheduler);
}

static int release_warp(int first)
{
    int found = 0;
    for (int l = 0; l < WARP && first + l < lanes; ++l) {
        const int64_t mask = waits_for[first + l];
        if (mask <= 0) continue;
        int all = 1;
        for (int k = 0; k < WARP; ++k)
            if (mask >> k & 1) all = all && first + k < lanes && !is_done[first + k] && waits_for[first + k] == mask;
        if (!all) continue;
        for (int k = 0; k < WARP; ++k)
            if (mask >> k & 1) waits_for[first + k] = 0;
        found = 1;
    }
    return found;
}

static int run_block(int block_dim, int active, lane_function kernel, void* dim, size_t block, void* args)
{
    if (block_dim == EXCHANGE || block_dim == BALLOT) {
        struct exchange* one = args;
        const int first = current / WARP * WARP;
        if (!(one->mask >> current % WARP & 1)) fail("not in its own mask");
        posted[current] = one->value;
        wait_for(one->mask);
        one->result = 0;
        if (block_dim == BALLOT) {
            for (int k = 0; k < WARP; ++k)
                if (one->mask >> k & 1) one->result |= (uint64_t)(posted[first + k] != 0) << k;
        } else {
            if (!(one->mask >> one->source & 1)) fail("takes a value from outside of its mask");
            one->result = posted[first + one->source];
        }
        wait_for(one->mask);
        return 1;
    }
    if (current >= 0 || active > MOST) fail("a block within a block, or too large");
    if (!stacks) stacks = malloc((size_t)MOST * STACK);
    lanes = active;
    function = kernel;
    dim_of_launch = dim;
    args_of_launch = args;
    block_of_launch = block;
    for (int l = 0; l < lanes; ++l) {
        is_done[l] = waits_for[l] = 0;
        getcontext(&fibers[l]);
        fibers[l].uc_stack.ss_sp = stacks + (size_t)l * STACK;
        fibers[l].uc_stack.ss_size = STACK;
        makecontext(&fibers[l], enter, 0);
    }
    for (;;) {
        int ran = 0, left = 0, at_barrier = 0;
        for (int k = 0; k < lanes; ++k) {
            const int l = backwards ? lanes - 1 - k : k;
            if (is_done[l] || waits_for[l]) continue;
            current = l;
            swapcontext(&scheduler, &fibers[l]);
            ran = 1;
        }
        for (int l = 0; l < lanes; ++l) {
            left += !is_done[l];
            at_barrier += !is_done[l] && waits_for[l] == BLOCK;
        }
        if (left == 0) break;
        if (at_barrier == left)
            for (int l = 0; l < lanes; ++l) waits_for[l] = 0;
        int released = at_barrier == left;
        for (int first = 0; first < lanes; first += WARP) released |= release_warp(first);
        if (!ran && !released) fail("some lanes wait for others that never come");
    }
    current = -1;
    return 1;
}

static int thread_index(void) { return current < 0 ? 0 : current; }
static int active_count(void)
{
    int count = 0;
    for (int l = 0; l < lanes; ++l) count += !is_done[l];
    return current < 0 ? 1 : count;
}
static int first_active(void) { return 0; }
static void barrier(void)
{
    if (current >= 0) wait_for(BLOCK);
}

struct runtime {
    int (*thread_index)(void);
    int (*active_count)(void);
    int (*first_active)(void);
    void (*barrier)(void);
    int (*run_block)(int, int, lane_function, void*, size_t, void*);
};

const struct runtime* emulated_block_runtime(void)
{
    static const struct runtime found = { thread_index, active_count, first_active, barrier, run_block };
    return &found;
}
