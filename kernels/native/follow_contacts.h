// Contacts that go on from the step before (kernels/wire_contact_by_batch.py).
#ifndef __CUDA_ARCH__
if (lane > 0) return;
#include "prefetch.h"
#endif
{
#ifndef __CUDA_ARCH__
#pragma clang fp reassociate(on) contract(fast)
#endif
#include "lanes.h"
    // rows of the numbers of a segment: nodes and sections of a segment and of those beside it, and its rest data
    enum { X = 0, EDGE = 3, BEFORE = 6, AFTER = 9, T = 12, D = 15, T_BEFORE = 18, D_BEFORE = 21, T_AFTER = 24, D_AFTER = 27 };
    enum {
        STATE_ROWS = 30,
        M = STATE_ROWS,
        A = 34,
        NEXT_A = 36,
        B = 38,
        LENGTH = 46,
        SLOPE_BEFORE,
        SLOPE_AFTER,
        RADIUS,
        OFFSET,
        NEXT_OFFSET
    };
    enum { PENALTY = NEXT_OFFSET + 1, NEXT_PENALTY, GOES_BACK, GOES_ON, ROWS };
    // what steers a step
    const double* steer = control.data;
    const double factor = steer[LENGTH_FACTOR];
    const bool is_running = steer[STATUS] == STATUS_RUNNING;
    // friction of a relaxation; the other kernels accept slips
    const bool rubs = LANES > 1 && steer[FRICTION] > 0 && steer[DRIVE] == 0 && steer[STATUS] != STATUS_ACCEPTING;
    const bool finds_forces = steer[FRICTION] == 0 || rubs;
    const bool is_driven_now = steer[IS_DRIVEN] != 0 || steer[IS_DRIVEN + 1] != 0;
    const double gap = is_running ? 0.0 : steer[EVALUATED_GAP], more_travel = is_running ? RUNNING_TRAVEL : 0.0;
    typedef decltype(tangent.data[0].c[0] + tangent.data[0].c[0]) stored;
    const double* nodes = (const double*)position.data;
    const stored* tangents = (const stored*)tangent.data;
    const stored* directors = (const stored*)director.data;
    const double* nodes_before = (const double*)before_position.data;
    const double* lengths_before = before_length.data;
    const stored* tangents_before = (const stored*)before_tangent.data;
    const stored* directors_before = (const stored*)before_director.data;
    // a segment i and those before and after it, or itself at an end, in one state of the wires
    auto keep_state = [&](double* v, int i, int b, int a, const double* x, const double* l, const stored* t, const stored* d) {
        keep(v, X, 1.0, x + 3 * i);
        keep(v, EDGE, l[i], t + 3 * i);
        keep(v, BEFORE, l[b], t + 3 * b);
        keep(v, AFTER, l[a], t + 3 * a);
        keep(v, T, 1.0, t + 3 * i);
        keep(v, D, 1.0, d + 3 * i);
        keep(v, T_BEFORE, 1.0, t + 3 * b);
        keep(v, D_BEFORE, 1.0, d + 3 * b);
        keep(v, T_AFTER, 1.0, t + 3 * a);
        keep(v, D_AFTER, 1.0, d + 3 * a);
    };
    auto add_shift = [&](double* v, const double* f, const double* shift) {
        add(v, X, f[GRADIENT] * shift[0] + f[GRADIENT + 1] * shift[1], f[GRADIENT + 2] * shift[0] + f[GRADIENT + 3] * shift[1],
            shift[2]);
    };
    const bool lists = touch_is_listed && lane == 0; // what is left to other kernels
    // halves of the elastic slips that this step reads and writes
    const int step_number = (int)steer[STEP], slips = slip_step.shape[1];
    const int this_half = step_number % 2 * slips, next_half = (step_number + 1) % 2 * slips;
    const auto rests = [&](int i) { return block_rest.data[node_block.data[i]] == RESTS; };
    // pairs with one place, and those with two and the saddle between them; the places of a single pair do not matter
    enum { KINDS = LANES > 1 ? 2 : 1 };
#ifdef __CUDA_ARCH__
    __shared__ real rows[QUADS_A_BLOCK][2][ROWS];
#endif
    struct batch {
#ifdef __CUDA_ARCH__
        real (*number)[ROWS], (*earlier)[ROWS];
#else
        real number[2][ROWS];
#endif
        real separation, renewal, offset, travel, s[PLACES], t[PLACES];
#ifndef __CUDA_ARCH__
        real earlier[2][STATE_ROWS]; // at the equilibrium before
#endif
        int touch[LANES], places, filled;
    };
    batch batches[KINDS];
    for (int kind = 0; kind < KINDS; ++kind) batches[kind].filled = 0;
#ifdef __CUDA_ARCH__
    batches[0].number = rows[threadIdx.x / 4];
#endif
    // the numbers of pairs, until a batch is full; then the batches that are full, and at the end the others
    for (int next = begin; next < end || batches[0].filled > 0 || batches[KINDS - 1].filled > 0;) {
        if (next < end) {
            const int touch = touch_awake.data[next];
            next += stride;
            const int pair = touch_pair.data[touch], found = pair_found.data[pair];
            const int sides[2] = {pair_first.data[pair], pair_second.data[pair]};
#ifndef __CUDA_ARCH__
            if (is_running && rests(sides[0]) && rests(sides[1])) {
                touch_followed.data[touch] = FOLLOWED_FORCE;
                continue;
            }
            {
#include "prefetch_pairs.h"
            }
#endif
            double ends[2][2], radii = 0, reach = 0;
            for (int side = 0; side < 2; ++side) {
                const int i = sides[side];
                ends[side][0] = contact_offset.data[i];
                ends[side][1] = contact_offset.data[following.data[i]];
                reach += ends[side][0] > ends[side][1] ? ends[side][0] : ends[side][1];
                radii += factor * node_radius.data[i];
            }
            const int i = sides[0], j = sides[1];
#include "travel_of_pair.h"
            touch_followed.data[touch] = 0;
            if (CLOSING_RATE * (pair_wake_travel.data[pair] - travel) > reach + gap) { // it cannot touch yet
                pair_found.data[pair] = found > 0 ? -found : found;
                touch_loaded.data[touch] = 0;
                touch_followed.data[touch] = FOLLOWED_FORCE;
            } else if (found != 0 && pair_renewal_travel.data[pair] != SPLIT_PAIR &&
                       travel <= pair_renewal_travel.data[pair] + more_travel * (radii + reach)) {
                const int places = found == ONE_PLACE || found == -ONE_PLACE ? 1 : PLACES;
                batch& own_batch = batches[places > 1 ? KINDS - 1 : 0];
                const int l = own_batch.filled++ % LANES;
                own_batch.touch[l] = touch;
                own_batch.places = places;
                together();
                UNROLLED
                for (int side = 0; side < 2; ++side) {
                    const int i = sides[side], before = previous.data[i], after = following.data[i];
                    const bool back = before >= 0, on = following.data[after] >= 0;
                    double* v = (double*)own_batch.number[side] + l;
                    const int row = rest_row.data[i];
                    const int b = back ? before : i, a = on ? after : i;
                    keep_state(v, i, b, a, nodes, length.data, tangents, directors);
                    if (rubs)
                        keep_state((double*)own_batch.earlier[side] + l, i, b, a, nodes_before, lengths_before, tangents_before,
                                   directors_before);
                    const double* m = (const double*)(slope_weight.data + row);
                    const double* bump = (const double*)(rest_bump.data + row);
                    const double* own_slope = (const double*)(rest_slope.data + row);
                    const double* next_slope = (const double*)(rest_slope.data + rest_row.data[after]);
                    for (int k = 0; k < 4; ++k) v[(M + k) * LANES] = m[k];
                    for (int k = 0; k < 2; ++k) v[(A + k) * LANES] = own_slope[k];
                    for (int k = 0; k < 2; ++k) v[(NEXT_A + k) * LANES] = next_slope[k];
                    for (int k = 0; k < 8; ++k) v[(B + k) * LANES] = bump[k];
                    v[LENGTH * LANES] = natural_length.data[i];
                    v[SLOPE_BEFORE * LANES] = back ? m[0] * natural_length.data[before] : 0.0;
                    v[SLOPE_AFTER * LANES] = on ? m[3] * natural_length.data[after] : 0.0;
                    v[RADIUS * LANES] = node_radius.data[i];
                    v[OFFSET * LANES] = ends[side][0];
                    v[NEXT_OFFSET * LANES] = ends[side][1];
                    v[PENALTY * LANES] = contact_penalty.data[i];
                    v[NEXT_PENALTY * LANES] = contact_penalty.data[after];
                    v[GOES_BACK * LANES] = back ? 1.0 : 0.0;
                    v[GOES_ON * LANES] = on ? 1.0 : 0.0;
                }
                const double* shift = (const double*)(pair_shift.data + pair);
                add_shift((double*)own_batch.number[1] + l, steer, shift);
                if (rubs) add_shift((double*)own_batch.earlier[1] + l, before_control.data, shift);
                UNROLLED
                for (int a = 0; a < PLACES; ++a) {
                    if (a >= places) continue;
                    const double* place = (const double*)(pair_place.data + 3 * pair + a);
                    set(own_batch.s[a], l, place[0]);
                    set(own_batch.t[a], l, place[1]);
                }
                set(own_batch.separation, l, pair_arc_separation.data[pair]);
                set(own_batch.renewal, l, pair_renewal_travel.data[pair]);
                set(own_batch.offset, l, reach);
                set(own_batch.travel, l, travel);
            } else if (lists) {
                touch_left.data[atomic_add(touch_left_count, 0, 1)] = touch;
            }
        }
        for (int kind = 0; kind < KINDS; ++kind) {
            const int places = batches[kind].places, filled = batches[kind].filled;
            if (filled == 0 || (filled < LANES && next < end)) continue;
            batches[kind].filled = 0;
            // lanes that are not filled repeat the first
            double* numbers = (double*)(batches + kind);
            for (int l = filled; l < LANES && LANES > 1; ++l)
                for (int k = 0; k < 2 * ROWS + 4 + 2 * PLACES + (rubs ? 2 * STATE_ROWS : 0); ++k)
                    numbers[k * LANES + l] = numbers[k * LANES];
            const batch& here = batches[kind];
            together();
            const real* of_p = here.number[0];
            const real* of_q = here.number[1];
#include "pair_curves.h"
#include "pair_minima.h"
#include "pair_forces.h"
            // what the other kernels need of a batch
            const real wake = here.travel + (nearest - contact_distance + here.offset) * real(1.0 / CLOSING_RATE);
            for (int l = 0; l < LANES && l < filled; ++l) {
                const int touch = here.touch[l], pair = touch_pair.data[touch], minima = places > 1 ? TWO_PLACES : ONE_PLACE;
                if (of_lane(failed, l)) {
                    if (lists) touch_left.data[atomic_add(touch_left_count, 0, 1)] = touch;
                    continue;
                }
                const bool touching = of_lane(is_near, l), loads = of_lane(loaded, l);
                const double wakes = of_lane(wake, l), renewal = of_lane(here.renewal, l);
                const bool has_force = finds_forces && !of_lane(is_new, l);
                touch_followed.data[touch] = has_force || !touching ? FOLLOWED_FORCE : FOLLOWED_PLACE;
                touch_loaded.data[touch] = loads ? 1 : 0;
                pair_wake_travel.data[pair] = wakes < renewal ? wakes : renewal;
                pair_found.data[pair] = touching ? minima : -minima;
                double* place = (double*)(pair_place.data + 3 * pair);
                UNROLLED
                for (int a = 0; a < PLACES; ++a) {
                    if (a >= (places > 1 ? PLACES : 2)) continue;
                    place[2 * a] = of_lane(s[places > 1 ? a : 0], l);
                    place[2 * a + 1] = of_lane(t[places > 1 ? a : 0], l);
                }
                if (!touching) continue;
                if (!has_force) {
                    if (lists) touch_found.data[atomic_add(touch_found_count, 0, 1)] = touch;
                    continue;
                }
                UNROLLED
                for (int a = 0; a < PLACES; ++a) {
                    const int k = 3 * touch + a;
                    const bool counts = a < places && of_lane(weight[a], l) != 0;
                    const double force_here = counts ? of_lane(normal_force[a], l) : 0.0;
                    const double overlap_here = counts ? of_lane(overlap[a], l) : -NO_COMMON_WIRE;
                    if (a < 2 && force_here != 0 && overlap_here > max_penetration.data[0])
                        atomic_max(max_penetration, 0, overlap_here);
                    if (rubs && is_running && a < 2 && counts && force_here != 0) {
                        const int there = next_half + 2 * pair + a;
                        slip_step.data[there] = step_number + 1;
                        float* at_place = (float*)(slip_place.data + there);
                        at_place[0] = place[2 * a];
                        at_place[1] = place[2 * a + 1];
                        float* slip = (float*)(elastic_slip.data + there);
                        put(slip, elastic[a], l);
                    }
                    if (is_running && !is_driven_now) continue; // other steps need forces and couples alone
                    touch_normal_force.data[k] = force_here;
                    touch_overlap.data[k] = overlap_here;
                    double* unit = (double*)(touch_normal.data + k);
                    if (counts) put(unit, normal[a], l);
                    if (!counts || touch_friction.shape[0] <= 1) continue;
                    double* rub = (double*)(touch_friction.data + k);
                    put(rub, a < 2 ? friction[a] : nothing, l);
                }
                if (!loads) continue;
                stored* f = (stored*)(touch_force.data + 8 * touch);
                stored* c = (stored*)(touch_couple.data + 6 * touch);
                UNROLLED
                for (int k = 0; k < 8; ++k) put(f + 3 * k, force[k], l);
                UNROLLED
                for (int k = 0; k < 6; ++k) put(c + 3 * k, couple[k], l);
            }
        }
    }
}
