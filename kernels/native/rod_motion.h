// Motion of a wire (kernels/rod_motion.py).
//
// Four numbers a node: x, y, z and spin, each swept by itself. On a GPU the threads of a wire take one stretch of it after the
// other. Each reads one number of a part of the stretch, sweeps it from zero and finds the responses to either node before the
// part. Then it sweeps from what the part before hands on. The nodes of a stretch are updated by neighbouring threads. Full rows
// are zero between `quiet` and the last four nodes.
typedef decltype(torque.data[0] + torque.data[0]) real;
#include "sharing.h"
#ifdef __CUDA_ARCH__
enum { NUMBERS = 1 };
const int own = lane % 4, part = lane / 4, parts = blockDim.x / 4;
#else
enum { NUMBERS = 4 };
const int own = 0, part = 0, parts = 1;
#endif
const int first = wire_first.data[wire], count = wire_count.data[wire], quiet = wire_quiet.data[wire], inside = count - 2;
const real* __restrict factors = (const real*)(mass_factor.data + FACTORS * first) + own;
const real* __restrict borders = (const real*)(mass_border.data + BORDERS * wire_border.data[wire]) + own;
const real* __restrict push = (const real*)(force.data + first - stored_from);
const real* __restrict couple = torque.data + first - stored_from;
real* __restrict swept = (real*)(sweep.data + first - stored_from) + own;
const auto given = [&](int j, int c) -> real { return own + c < 3 ? push[3 * j + own + c] : couple[j]; };
const auto is_full = [&](int j) { return j < quiet || j >= count - 4; };
// what a sweep takes at a node: its source, and the factors of the two nodes before; these two, the nearest first
struct Row { real source[NUMBERS], next[NUMBERS], second[NUMBERS]; };
struct Pair { real near[NUMBERS], far[NUMBERS]; };
const auto go_on = [](const Row& row, Pair& z, bool from_rest) {
    real now[NUMBERS];
    for (int c = 0; c < NUMBERS; ++c) now[c] = from_rest ? real(0) : row.source[c];
    for (int c = 0; c < NUMBERS; ++c) now[c] -= row.second[c] * z.far[c];
    for (int c = 0; c < NUMBERS; ++c) now[c] -= row.next[c] * z.near[c];
    for (int c = 0; c < NUMBERS; ++c) z.far[c] = z.near[c];
    for (int c = 0; c < NUMBERS; ++c) z.near[c] = now[c];
};
// Sweep over all nodes but the last two: `read` the row of a node, and `use` what is found there; `finish` a stretch on a GPU
#ifdef __CUDA_ARCH__
// two nodes behind some others, as a function of the two before: the ends from zero, and the responses
struct Ends { real near, far, near_near, near_far, far_near, far_far; };
const auto behind = [](const Ends& e, real near, real far) {
    return Pair{{e.near + e.near_near * near + e.near_far * far}, {e.far + e.far_near * near + e.far_far * far}};
};
const auto of_part_before = [](const Ends& e, int lanes) {
    const auto shifted = [&](real value) { return __shfl_up_sync(0xffffffffu, value, lanes); };
    return Ends{shifted(e.near),     shifted(e.far),      shifted(e.near_near),
                shifted(e.near_far), shifted(e.far_near), shifted(e.far_far)};
};
__shared__ Ends of_warp[MOTION_LANES / 32][4];
__shared__ real other_sum[MOTION_LANES], last_sum[MOTION_LANES];
const int warp = lane / 32, in_warp = lane % 32;
const auto along = [&](bool is_back, const auto& read, const auto& use, const auto& finish) {
    real near_before = 0, far_before = 0; // of the stretch, which its first part takes up
    for (int from = 0; from < inside; from += PART * parts) {
        const int begin = from + PART * part, left = inside - begin;
        const int start = is_back ? inside - 1 - begin : begin, step = is_back ? -1 : 1;
        Row rows[PART];
#pragma unroll
        for (int k = 0; k < PART; ++k)
            if (k < left) read(start + step * k, rows[k]);
        Pair z = {}, by_near = {{1.0}, {0.0}}, by_far = {{0.0}, {1.0}};
#pragma unroll
        for (int k = 0; k < PART; ++k) {
            if (k >= left) continue;
            go_on(rows[k], z, false);
            go_on(rows[k], by_near, true);
            go_on(rows[k], by_far, true);
        }
        // joined with the parts before in the warp, then warp by warp
        Ends ends = {z.near[0], z.far[0], by_near.near[0], by_far.near[0], by_near.far[0], by_far.far[0]};
        for (int lanes = 4; lanes < 32; lanes *= 2) {
            const Ends before = of_part_before(ends, lanes);
            if (in_warp < lanes) continue;
            const Pair joined = behind(ends, before.near, before.far);
            const Ends own_ends = ends;
            ends.near = joined.near[0];
            ends.far = joined.far[0];
            ends.near_near = own_ends.near_near * before.near_near + own_ends.near_far * before.far_near;
            ends.near_far = own_ends.near_near * before.near_far + own_ends.near_far * before.far_far;
            ends.far_near = own_ends.far_near * before.near_near + own_ends.far_far * before.far_near;
            ends.far_far = own_ends.far_near * before.near_far + own_ends.far_far * before.far_far;
        }
        TOGETHER
        if (in_warp >= 28) of_warp[warp][own] = ends;
        TOGETHER
        for (int w = 0; w < blockDim.x / 32 && part == 0; ++w) {
            Ends& here = of_warp[w][own];
            const Pair next = behind(here, near_before, far_before);
            here.near = near_before;
            here.far = far_before;
            near_before = next.near[0];
            far_before = next.far[0];
        }
        TOGETHER
        const Ends before = of_part_before(ends, 4);
        z = {{of_warp[warp][own].near}, {of_warp[warp][own].far}};
        if (in_warp >= 4) z = behind(before, z.near[0], z.far[0]);
#pragma unroll
        for (int k = 0; k < PART; ++k) {
            if (k >= left) continue;
            go_on(rows[k], z, false);
            use(start + step * k, z.near);
        }
        const int to = from + PART * parts < inside ? from + PART * parts : inside;
        finish(is_back ? inside - to : from, is_back ? inside - from : to);
    }
};
#else
const int* __restrict rests = block_rest.data + node_block.data[first]; // of the blocks of the wire
const auto along = [&](bool is_back, const auto& read, const auto& use, const auto&) {
    Pair z = {};
    for (int from = 0; from < inside;) {
        const int block = (is_back ? inside - 1 - from : from) / ROD_BLOCK, behind = ROD_BLOCK * (block + 1);
        const int to = is_back ? inside - ROD_BLOCK * block : (behind < inside ? behind : inside);
        if (rests[block] != MOVES) z = {};
        for (int k = from; k < to && rests[block] == MOVES; ++k) {
            const int j = is_back ? inside - 1 - k : k;
            Row row;
            read(j, row);
            go_on(row, z, false);
            use(j, z.near);
        }
        from = to;
    }
};
#endif
real other[NUMBERS] = {}, last[NUMBERS] = {};
along(
    false,
    [&](int j, Row& row) {
        const real* __restrict l = factors + 4 * FACTORS * j;
        for (int c = 0; c < NUMBERS; ++c) row.source[c] = given(j, c);
        for (int c = 0; c < NUMBERS; ++c) row.next[c] = l[4 * NEXT + c];
        for (int c = 0; c < NUMBERS; ++c) row.second[c] = l[4 * SECOND + c];
    },
    [&](int j, const real* z) {
        for (int c = 0; c < NUMBERS; ++c) swept[4 * j + c] = z[c];
        if (!is_full(j)) return;
        for (int c = 0; c < NUMBERS; ++c) other[c] += (borders + 4 * BORDERS * j)[4 * OTHER + c] * z[c];
        for (int c = 0; c < NUMBERS; ++c) last[c] += (borders + 4 * BORDERS * j)[4 * LAST + c] * z[c];
    },
    [](int, int) {});
#ifdef __CUDA_ARCH__
TOGETHER
other_sum[lane] = other[0];
last_sum[lane] = last[0];
TOGETHER
other[0] = last[0] = 0;
for (int p = 0; p < parts; ++p) {
    other[0] += other_sum[4 * p + own];
    last[0] += last_sum[4 * p + own];
}
#endif
// the last two nodes, of which every thread finds the accelerations
for (int c = 0; c < NUMBERS; ++c) {
    const real* __restrict l = factors + 4 * FACTORS * (count - 1);
    const real before = given(count - 2, c) - other[c];
    const real at_end = given(count - 1, c) - (last[c] + l[4 * NEXT + c] * before);
    last[c] = l[4 * PIVOT + c] * at_end;
    other[c] = (l - 4 * FACTORS)[4 * PIVOT + c] * before - l[4 * NEXT + c] * last[c];
}
const double* steer = control.data;
const real a = steer[VELOCITY_FACTOR], b = steer[FORCE_FACTOR], dt = steer[TIME_STEP], ahead = steer[LOOK_AHEAD];
const real lever_square = 4 * steer[LEVER] * steer[LEVER]; // sections beside it turn a curve, too
double* __restrict moved = (double*)(displacement.data + first);
real* __restrict speed = (real*)(velocity.data + first);
real* __restrict rate = spin.data + first;
real* __restrict turned = angle.data + first;
real* __restrict turn = pending_turn.data + first;
real* __restrict total = (real*)(force_sum.data + first);
const double* __restrict mass = (const double*)(node_mass.data + first);
const double* __restrict inertia = spin_inertia.data + first;
double kinetic = 0, fastest = 0, strongest = 0, square = 0;
#ifndef __CUDA_ARCH__
// nodes come from the last to the first: the largest square of the speeds in a block, up to its first node
const bool by_block = block_travel.shape[0] > 1; // else travel is that of the fastest node
real fastest_here = 0;
double* __restrict speeds = block_speed.data + node_block.data[first];
double* __restrict travel = block_travel.data + node_block.data[first];
#endif
struct Node {
    double place[NUMBERS], mass[NUMBERS];
    real speed[NUMBERS], push[NUMBERS], total[NUMBERS], pivot;
};
const auto look = [&](int j) {
    Node now;
    for (int c = 0; c < NUMBERS; ++c) {
        const int k = 3 * j + own + c;
        const bool spins = own + c == 3;
        now.place[c] = spins ? turned[j] : moved[k];
        now.mass[c] = spins ? inertia[j] : mass[k];
        now.speed[c] = spins ? rate[j] : speed[k];
        now.push[c] = spins ? real(0) : push[k];
        now.total[c] = spins ? real(0) : total[k];
    }
    now.pivot = factors[4 * FACTORS * j + 4 * PIVOT];
    return now;
};
const auto move = [&](int j, const Node& now, const real* acceleration) {
    real q2 = 0, f2 = 0, e = 0;
    for (int c = 0; c < NUMBERS; ++c) {
        const int k = 3 * j + own + c;
        const real before = now.speed[c], after = a * before + b * real(acceleration[c]);
        e += real(now.mass[c]) * after * after;
        if (own + c == 3) {
            const real angle = dt * (after + ahead * (after - before));
            rate[j] = after;
            turn[j] = angle;
            turned[j] = real(now.place[c]) + angle;
            q2 += lever_square * after * after; // of the curve, which turns with the section
            continue;
        }
        speed[k] = after;
        moved[k] = now.place[c] + dt * (after + ahead * (after - before));
        total[k] = now.total[c] + now.push[c];
        q2 += after * after;
        f2 += now.push[c] * now.push[c];
    }
#ifdef __CUDA_ARCH__
    const unsigned quad = 0xfu << (lane % 32 - own);
    for (int step = 1; step < 4; step *= 2) {
        q2 += __shfl_xor_sync(quad, q2, step);
        f2 += __shfl_xor_sync(quad, f2, step);
    }
#endif
#ifndef __CUDA_ARCH__
    fastest_here = q2 > fastest_here ? q2 : fastest_here;
    if (by_block && j % ROD_BLOCK == 0) {
        speeds[j / ROD_BLOCK] = fastest_here;
        fastest_here = 0;
    }
#endif
    kinetic += e;
    fastest = q2 > fastest ? q2 : fastest;
    // of a quad of threads the first one counts
    if (own == 0 && now.pivot != 0) {
        square += f2;
        strongest = f2 > strongest ? f2 : strongest;
    }
};
if (lane < 4) {
    move(count - 1, look(count - 1), last);
    move(count - 2, look(count - 2), other);
}
along(
    true,
    [&](int j, Row& row) {
        // the last two rows are full: L to them is not zero only there
        const real* __restrict l = factors + 4 * FACTORS * j;
        for (int c = 0; c < NUMBERS; ++c) row.source[c] = l[4 * PIVOT + c] * swept[4 * j + c];
        for (int c = 0; c < NUMBERS; ++c) row.next[c] = (l + 4 * FACTORS)[4 * NEXT + c];
        for (int c = 0; c < NUMBERS; ++c) row.second[c] = (l + 8 * FACTORS)[4 * SECOND + c];
        if (!is_full(j)) return;
        for (int c = 0; c < NUMBERS; ++c) row.source[c] -= (borders + 4 * BORDERS * j)[4 * OTHER + c] * other[c];
        for (int c = 0; c < NUMBERS; ++c) row.source[c] -= (borders + 4 * BORDERS * j)[4 * LAST + c] * last[c];
    },
    [&](int j, const real* acceleration) {
#ifdef __CUDA_ARCH__
        swept[4 * j] = acceleration[0];
#else
        move(j, look(j), acceleration);
#endif
    },
    [&](int from, int to) {
        enum { AT_ONCE = 1 };
        TOGETHER
        for (int j = from + part; j < to; j += AT_ONCE * parts) {
            Node now[AT_ONCE];
            real acceleration[AT_ONCE];
#pragma unroll
            for (int k = 0; k < AT_ONCE; ++k) {
                const int at = j + k * parts;
                if (at >= to) continue;
                now[k] = look(at);
                acceleration[k] = swept[4 * at];
            }
#pragma unroll
            for (int k = 0; k < AT_ONCE; ++k)
                if (j + k * parts < to) move(j + k * parts, now[k], acceleration + k);
        }
    });
#ifndef __CUDA_ARCH__
// the nodes of a segment lie in its block and those beside it
const int blocks = (count + ROD_BLOCK - 1) / ROD_BLOCK, closed = wire_closed.data[wire];
for (int b = 0; b < blocks && by_block; ++b) {
    double largest = speeds[b];
    const int before = b > 0 ? b - 1 : (closed ? blocks - 1 : 0), behind = b < blocks - 1 ? b + 1 : (closed ? 0 : b);
    largest = speeds[before] > largest ? speeds[before] : largest;
    largest = speeds[behind] > largest ? speeds[behind] : largest;
    travel[b] += steer[TIME_STEP] * sqrt(largest);
}
#endif
double stress[4] = {};
double* row = partial.data + PARTIAL_COUNT * wire;
#include "sum_of_lanes.h"
