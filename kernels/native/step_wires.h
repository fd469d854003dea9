// A step of the nodes of a block (kernels/wires.py).
enum { KEEPS = 0 };
#ifndef __CUDA_ARCH__
#include "prefetch.h"
for (int q = block_pair_start.data[block]; q < block_pair_start.data[block + 1] && lane == 0; ++q) {
    // needed below, from far apart
    const int p = block_pair.data[q];
    fetch(pair_force.data + p, pair_node.data + p, pair_nodal_x.data + 4 * p, pair_nodal_y.data + 4 * p);
}
#endif
#include "wire_forces.h"
const int pair_begin = block_pair_start.data[block], pair_end = block_pair_start.data[block + 1];
const int held_begin = block_held_start.data[block], held_end = block_held_start.data[block + 1];
const int padded = (count + LANES - 1) / LANES * LANES;
SHARED real fx[SPAN], fy[SPAN];
TOGETHER
{
    VECTORISED
    EACH(k, HALO, padded + HALO) {
        fx[k] = nx[k] - nx[k - 1];
        fy[k] = ny[k] - ny[k - 1];
    }
}
#ifdef __CUDA_ARCH__
// some pairs at a time in shared memory: a warp looks at those that reach one of its nodes, a thread takes what acts on one
enum { STAGED = 32 };
__shared__ int reached[STAGED];
__shared__ real staged_x[4 * STAGED], staged_y[4 * STAGED];
for (int from = pair_begin; from < pair_end; from += STAGED) {
    const int number = min(pair_end - from, (int)STAGED);
    TOGETHER
    EACH(q, 0, number) {
        const int p = block_pair.data[from + q];
        reached[q] = pair_force.data[p] == real(0) ? -0x40000000 : pair_node.data[p] - 1 - offset_of_block;
    }
    EACH(e, 0, 4 * number) {
        const int p = block_pair.data[from + e / 4];
        staged_x[e] = pair_nodal_x.data[4 * p + e % 4];
        staged_y[e] = pair_nodal_y.data[4 * p + e % 4];
    }
    TOGETHER
    const int own = lane % 32, nodes_of_warp = lane - own;
    bool reaches = false;
    for (int c = 0; c < 4 && own < number; ++c) {
        const int k = reached[own] + c - nodes_of_warp, before = k + wire_nodes, behind = k - wire_nodes;
        reaches = reaches || (k >= 0 && k < 32) || (closed && ((before >= 0 && before < 32) || (behind >= 0 && behind < 32)));
    }
    for (unsigned left = __ballot_sync(0xffffffffu, reaches); left != 0; left &= left - 1) {
        const int q = __ffs(left) - 1;
        EACH(k, HALO, count + HALO) {
            int c = k - reached[q];
            if (closed && c < 0) c += wire_nodes;
            if (closed && c >= wire_nodes) c -= wire_nodes;
            if (c < 0 || c > 3) continue;
            fx[k] += staged_x[4 * q + c];
            fy[k] += staged_y[4 * q + c];
        }
    }
}
#else
for (int q = pair_begin; q < pair_end; ++q) {
    const int p = block_pair.data[q];
    if (pair_force.data[p] == real(0)) continue;
    const int reached = pair_node.data[p] - 1 - offset_of_block;
    if (reached >= HALO && reached + 3 < count + HALO) {
        for (int c = 0; c < 4; ++c) {
            fx[reached + c] += pair_nodal_x.data[4 * p + c];
            fy[reached + c] += pair_nodal_y.data[4 * p + c];
        }
        continue;
    }
    for (int c = 0; c < 4; ++c) {
        int i = pair_node.data[p] - 1 + c;
        if (closed) {
            if (i < wire_begin) i += wire_nodes;
            if (i >= wire_end) i -= wire_nodes;
        }
        const int k = i - offset_of_block;
        if (k >= HALO && k < count + HALO) {
            fx[k] += pair_nodal_x.data[4 * p + c];
            fy[k] += pair_nodal_y.data[4 * p + c];
        }
    }
}
#endif
double stress[4] = {};
const bool is_driven = steer[IS_DRIVEN] != 0 || steer[IS_DRIVEN + 1] != 0;
if (held_end > held_begin) {
    TOGETHER
    EACH(q, 0, held_end - held_begin) {
        const int k = held_node.data[held_begin + q] - offset_of_block;
        const double lever_x = held_lever_x.data[held_begin + q], lever_y = held_lever_y.data[held_begin + q];
        stress[0] += fx[k] * lever_x;
        stress[1] += fx[k] * lever_y;
        stress[2] += fy[k] * lever_x;
        stress[3] += fy[k] * lever_y;
        fx[k] = real(0);
        fy[k] = real(0);
    }
    TOGETHER
}
if (is_driven) {
    EACH(k, HALO, count + HALO) {
        stress[0] += nx[k] * rx[k];
        stress[1] += nx[k] * ry[k];
        stress[2] += ny[k] * rx[k];
        stress[3] += ny[k] * ry[k];
    }
    for (int c = 0; c < 4; ++c) stress[c] = rint(stress[c] / steer[STRESS_UNIT]);
} else {
    for (int c = 0; c < 4; ++c) stress[c] = 0;
}
// counts are whole numbers, rounded by the phase of the step; metres are taken as they are
const bool counted = coordinate(0.5) == coordinate(0);
const real velocity_factor = real(steer[VELOCITY_FACTOR]), force_factor = real(steer[FORCE_FACTOR]);
const real time_step = real(steer[TIME_STEP]), look_ahead = real(steer[LOOK_AHEAD]);
const real mass_factor = real(1) / wire_mass.data[wire];
const real* __restrict ri_m = inverse_mass.data + table - HALO;
const real* __restrict rm = node_mass.data + table - HALO;
real* __restrict speed_x = vx.data + offset_of_block;
real* __restrict speed_y = vy.data + offset_of_block;
coordinate* __restrict moved_x = ux_out.data + offset_of_block;
coordinate* __restrict moved_y = uy_out.data + offset_of_block;
SHARED real qq[SPAN], ff[SPAN];
real sum_of_energies = 0, square = 0;
const real counts = time_step / unit;
const real still = sizeof(real) == 4 ? real(1e-18) : real(1e-150);
{
    VECTORISED
    EACH(k, HALO, count + HALO) {
        const real im = ri_m[k] * mass_factor;
        const real px = speed_x[k], py = speed_y[k];
        const real f2 = fx[k] * fx[k] + fy[k] * fy[k];
        real qx = velocity_factor * px + force_factor * im * fx[k];
        real qy = velocity_factor * py + force_factor * im * fy[k];
        // what dies out stops before its square is a denormal number, which is slow
        qx = (qx < still && qx > -still) ? real(0) : qx;
        qy = (qy < still && qy > -still) ? real(0) : qy;
        const real q2 = qx * qx + qy * qy;
        sum_of_energies += q2 * rm[k];
        square += f2;
        speed_x[k] = qx;
        speed_y[k] = qy;
        const real move_x = (qx + look_ahead * (qx - px)) * counts;
        moved_x[k] = cx[k] + (counted ? coordinate(floor(move_x + phase)) : coordinate(move_x));
        const real move_y = (qy + look_ahead * (qy - py)) * counts;
        moved_y[k] = cy[k] + (counted ? coordinate(floor(move_y + phase)) : coordinate(move_y));
        ff[k] = f2;
        qq[k] = q2;
    }
}
// largest squares, lane by lane: a plain maximum does not vectorise
real strongest = 0, fastest = 0;
#ifdef __CUDA_ARCH__
EACH(k, HALO, count + HALO) {
    strongest = ff[k];
    fastest = qq[k];
}
#else
for (int l = 0; l < LANES; ++l) {
    ff[count + HALO + l] = real(0);
    qq[count + HALO + l] = real(0);
}
real strong[LANES] = {0}, fast[LANES] = {0};
for (int k = HALO; k < count + HALO; k += LANES) {
    for (int l = 0; l < LANES; ++l) {
        strong[l] = ff[k + l] > strong[l] ? ff[k + l] : strong[l];
        fast[l] = qq[k + l] > fast[l] ? qq[k + l] : fast[l];
    }
}
for (int l = 0; l < LANES; ++l) {
    strongest = strong[l] > strongest ? strong[l] : strongest;
    fastest = fast[l] > fastest ? fast[l] : fastest;
}
#endif
const double kinetic = sum_of_energies / mass_factor;
double* row = partial.data + PARTIAL_COUNT * (size_t)block;
#include "sum_of_lanes.h"
