"""Contacts that go on from the step before: LANES pairs at a time on a CPU, a pair by QUAD threads on a GPU (lanes.py).

In most steps most pairs that may touch have one closest point, or two with a saddle between them, near those of the step before.
Newton's method follows them, and their forces are found (wire_closest.py, wire_contact_forces.py, for the equations). What needs
more is left to these kernels: friction, a pair without a known place, one whose search is due, whose place is ill-conditioned or
moves far, or that may have another place beyond a saddle.

The result of a pair does not depend on the others of its batch.
"""

from typing import Any

import warp as wp

from warpknit.kernels.control import EVALUATED_GAP, STATUS, STATUS_RUNNING, is_halted
from warpknit.kernels.lanes import NUMBERS, QUAD, QUADS_A_BLOCK
from warpknit.kernels.native import STEERING, constants
from warpknit.kernels.wire_closest import (
    FOLLOWED_FORCE,
    FOLLOWED_PLACE,
    ONE_PLACE,
    PLACES,
    RUNNING_TRAVEL,
    SPLIT_PAIR,
    TWO_PLACES,
)
from warpknit.kernels.wire_curve import CLOSING_RATE, Bump
from warpknit.kernels.wire_curve_by_batch import CURVES, POLYNOMIALS, ROWS
from warpknit.kernels.wire_forces_by_batch import FORCES, LINE_WEIGHT, WEIGHTS
from warpknit.kernels.wire_minima_by_batch import BEYOND, FOLLOW, MINIMA
from warpknit.kernels.wire_pairs import NO_COMMON_WIRE
from warpknit.kernels.wire_prefetch import PREFETCH, first_of_part
from warpknit.kernels.wire_travel import TRAVEL_OF_PAIR

# what steers a step
_STEP = r"""
    const double* steer = control.data;
    const double factor = steer[LENGTH_FACTOR];
    const bool is_running = steer[STATUS] == STATUS_RUNNING, finds_forces = friction == 0;
    const double gap = is_running ? 0.0 : steer[EVALUATED_GAP], more_travel = is_running ? RUNNING : 0.0;
    const double fxx = steer[GRADIENT], fxy = steer[GRADIENT + 1], fyx = steer[GRADIENT + 2], fyy = steer[GRADIENT + 3];
    const double* nodes = (const double*)position.data;
    typedef decltype(tangent.data[0].c[0] + tangent.data[0].c[0]) stored;
    const stored* tangents = (const stored*)tangent.data;
    const stored* directors = (const stored*)director.data;
    const bool lists = touch_is_listed && lane == 0; // what is left to other kernels
"""

# the numbers of pairs, until a batch is full
_GATHER = r"""
    // pairs with one place, and those with two and the saddle between them; the places of a single pair do not matter
    enum { KINDS = LANES > 1 ? 2 : 1 };
    #ifdef __CUDA_ARCH__
    __shared__ real rows[QUADS_A_BLOCK][2][ROWS];
    #endif
    struct batch {
        #ifdef __CUDA_ARCH__
        real (*number)[ROWS];
        #else
        real number[2][ROWS];
        #endif
        real separation, renewal, offset, travel, s[PLACES], t[PLACES];
        int touch[LANES], places, filled;
    };
    batch batches[KINDS];
    for (int kind = 0; kind < KINDS; ++kind) batches[kind].filled = 0;
    #ifdef __CUDA_ARCH__
    batches[0].number = rows[threadIdx.x / 4];
    #endif
    for (int next = begin; next < end || batches[0].filled > 0 || batches[KINDS - 1].filled > 0;) {
        if (next < end) {
            const int touch = touch_awake.data[next];
            next += stride;
            #ifndef __CUDA_ARCH__
            { PREFETCH_A_PAIR }
            #endif
            const int pair = touch_pair.data[touch], found = pair_found.data[pair];
            const int sides[2] = {pair_first.data[pair], pair_second.data[pair]};
            double ends[2][2], radii = 0, reach = 0;
            for (int side = 0; side < 2; ++side) {
                const int i = sides[side];
                ends[side][0] = contact_offset.data[i];
                ends[side][1] = contact_offset.data[following.data[i]];
                reach += ends[side][0] > ends[side][1] ? ends[side][0] : ends[side][1];
                radii += factor * node_radius.data[i];
            }
            const int i = sides[0], j = sides[1];
            TRAVEL_OF_A_PAIR
            touch_followed.data[touch] = 0;
            if (CLOSING_RATE * (pair_wake_travel.data[pair] - travel) > reach + gap) {  // it cannot touch yet
                pair_found.data[pair] = found > 0 ? -found : found;
                touch_loaded.data[touch] = 0;
                touch_followed.data[touch] = FORCE;
            } else if (found != 0 && pair_renewal_travel.data[pair] != SPLIT_PAIR
                       && travel <= pair_renewal_travel.data[pair] + more_travel * (radii + reach)) {
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
                    const double own = length.data[i], length_before = back ? length.data[before] : own;
                    const double length_after = on ? length.data[after] : own;
                    const int b = back ? before : i, a = on ? after : i;
                    keep(v, X, 1.0, nodes + 3 * i);
                    keep(v, EDGE, own, tangents + 3 * i);
                    keep(v, BEFORE, length_before, tangents + 3 * b);
                    keep(v, AFTER, length_after, tangents + 3 * a);
                    keep(v, T, 1.0, tangents + 3 * i);
                    keep(v, D, 1.0, directors + 3 * i);
                    keep(v, T_BEFORE, 1.0, tangents + 3 * b);
                    keep(v, D_BEFORE, 1.0, directors + 3 * b);
                    keep(v, T_AFTER, 1.0, tangents + 3 * a);
                    keep(v, D_AFTER, 1.0, directors + 3 * a);
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
                double* q = (double*)own_batch.number[1] + l;
                add(q, X, fxx * shift[0] + fxy * shift[1], fyx * shift[0] + fyy * shift[1], shift[2]);
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
"""

# the batches that are full, and at the end the others
_BATCHES = r"""
        for (int kind = 0; kind < KINDS; ++kind) {
            const int places = batches[kind].places, filled = batches[kind].filled;
            if (filled == 0 || (filled < LANES && next < end)) continue;
            batches[kind].filled = 0;
            // lanes that are not filled repeat the first
            double* numbers = (double*)(batches + kind);
            for (int l = filled; l < LANES && LANES > 1; ++l)
                for (int k = 0; k < 2 * ROWS + 4 + 2 * PLACES; ++k) numbers[k * LANES + l] = numbers[k * LANES];
            const batch& here = batches[kind];
            together();
            const real* of_p = here.number[0];
            const real* of_q = here.number[1];
"""

# what the other kernels need of a batch
_KEEP = r"""
            const real wake = here.travel + (nearest - contact_distance + here.offset) * real(1.0 / CLOSING_RATE);
            for (int l = 0; l < LANES && l < filled; ++l) {
                const int touch = here.touch[l], pair = touch_pair.data[touch], minima = places > 1 ? TWO_PLACES : ONE_PLACE;
                if (of_lane(failed, l)) {
                    if (lists) touch_left.data[atomic_add(touch_left_count, 0, 1)] = touch;
                    continue;
                }
                const bool touching = of_lane(is_near, l), loads = of_lane(loaded, l);
                const double wakes = of_lane(wake, l), renewal = of_lane(here.renewal, l);
                touch_followed.data[touch] = finds_forces || !touching ? FORCE : PLACE;
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
                if (!finds_forces) {
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
                    if (is_running) continue; // steps need forces and couples alone
                    touch_normal_force.data[k] = force_here;
                    touch_overlap.data[k] = overlap_here;
                    double* unit = (double*)(touch_normal.data + k);
                    if (counts) put(unit, normal[a], l);
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
"""

_LANES = (
    STEERING
    + "    #ifndef __CUDA_ARCH__\n    if (lane > 0) return;\n    #endif\n"
    + constants(
        STATUS=STATUS,
        STATUS_RUNNING=STATUS_RUNNING,
        EVALUATED_GAP=EVALUATED_GAP,
        PLACE=FOLLOWED_PLACE,
        FORCE=FOLLOWED_FORCE,
        ONE_PLACE=ONE_PLACE,
        TWO_PLACES=TWO_PLACES,
        PLACES=PLACES,
        RUNNING=RUNNING_TRAVEL,
        SPLIT_PAIR=SPLIT_PAIR,
        CLOSING_RATE=CLOSING_RATE,
    )
    + MINIMA
    + WEIGHTS
    + f"    const double NO_COMMON_WIRE = {float(NO_COMMON_WIRE)!r};\n"
    + ROWS
    + NUMBERS
    + _STEP
    + POLYNOMIALS
    + LINE_WEIGHT
    + _GATHER.replace("PREFETCH_A_PAIR", PREFETCH).replace("TRAVEL_OF_A_PAIR", TRAVEL_OF_PAIR)
    + _BATCHES
    + CURVES
    + FOLLOW
    + BEYOND
    + FORCES
    + _KEEP
)


@wp.func_native(_LANES)
def follow_contacts(
    lane: wp.int32,
    begin: int,
    end: int,
    stride: int,
    # in: the pairs that may touch, those of them to look at, and all pairs
    touch_pair: wp.array(dtype=wp.int32),
    touch_count: wp.array(dtype=wp.int32),
    touch_awake: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    pair_arc_separation: wp.array(dtype=wp.float64),
    pair_renewal_travel: wp.array(dtype=wp.float64),
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    node_radius: wp.array(dtype=wp.float64),
    rest_row: wp.array(dtype=wp.int32),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=Bump),
    slope_weight: wp.array(dtype=wp.vec4d),
    contact_penalty: wp.array(dtype=wp.float64),
    contact_offset: wp.array(dtype=wp.float64),
    node_block: wp.array(dtype=wp.int32),
    # in: what steers the step; [m] travel of blocks
    control: wp.array(dtype=wp.float64),
    block_travel: wp.array(dtype=wp.float64),
    min_arc_separation: wp.float64,
    friction: wp.float64,
    # state in
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    # in and out: see find_closest_places
    pair_wake_travel: wp.array(dtype=wp.float64),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    # out: pairs of which the places, or the forces alone, are left to other kernels, in any order, where they are listed
    touch_is_listed: int,
    touch_left: wp.array(dtype=wp.int32),
    touch_left_count: wp.array(dtype=wp.int32),
    touch_found: wp.array(dtype=wp.int32),
    touch_found_count: wp.array(dtype=wp.int32),
    # out: what is done of a pair; the rest as in find_contact_forces
    touch_followed: wp.array(dtype=wp.int32),
    touch_overlap: wp.array(dtype=wp.float64),
    touch_normal_force: wp.array(dtype=wp.float64),
    touch_normal: wp.array(dtype=wp.vec3d),
    touch_loaded: wp.array(dtype=wp.int32),
    touch_force: wp.array(dtype=Any),
    touch_couple: wp.array(dtype=Any),
    # in and out: [m] largest overlap of a thread
    max_penetration: wp.array(dtype=wp.float64),
): ...


@wp.kernel(launch_bounds=(QUAD * QUADS_A_BLOCK, 3))
def find_followed_contacts(
    # in: the pairs that may touch, those of them to look at, and all pairs
    part: int,
    parts: int,
    threads: int,
    threads_a_block: int,
    touch_pair: wp.array(dtype=wp.int32),
    touch_count: wp.array(dtype=wp.int32),
    touch_awake: wp.array(dtype=wp.int32),
    touch_awake_count: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    pair_arc_separation: wp.array(dtype=wp.float64),
    pair_renewal_travel: wp.array(dtype=wp.float64),
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    node_radius: wp.array(dtype=wp.float64),
    rest_row: wp.array(dtype=wp.int32),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=Bump),
    slope_weight: wp.array(dtype=wp.vec4d),
    contact_penalty: wp.array(dtype=wp.float64),
    contact_offset: wp.array(dtype=wp.float64),
    node_block: wp.array(dtype=wp.int32),
    # in: what steers the step; [m] travel of blocks
    control: wp.array(dtype=wp.float64),
    block_travel: wp.array(dtype=wp.float64),
    min_arc_separation: wp.float64,
    friction: wp.float64,
    # state in
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    # in and out: see find_closest_places
    pair_wake_travel: wp.array(dtype=wp.float64),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    # out: pairs of which the places, or the forces alone, are left to other kernels, in any order, where they are listed
    touch_is_listed: int,
    touch_left: wp.array(dtype=wp.int32),
    touch_left_count: wp.array(dtype=wp.int32),
    touch_found: wp.array(dtype=wp.int32),
    touch_found_count: wp.array(dtype=wp.int32),
    # out: what is done of a pair; the rest as in find_contact_forces
    touch_followed: wp.array(dtype=wp.int32),
    touch_overlap: wp.array(dtype=wp.float64),
    touch_normal_force: wp.array(dtype=wp.float64),
    touch_normal: wp.array(dtype=wp.vec3d),
    touch_loaded: wp.array(dtype=wp.int32),
    touch_force: wp.array(dtype=Any),
    touch_couple: wp.array(dtype=Any),
    # in and out: [m] largest overlap of a thread
    max_penetration: wp.array(dtype=wp.float64),
):
    """The pairs of a part, a thread a pair, or QUAD of `threads_a_block` threads on a GPU. Other kernels skip what
    `touch_followed` says is found, with friction the places."""
    a_pair = wp.min(threads_a_block, QUAD)
    if not is_halted(control):
        follow_contacts(
            wp.tid() % a_pair,
            first_of_part(touch_awake_count, part, parts) + wp.tid() / a_pair,
            first_of_part(touch_awake_count, part + 1, parts),
            threads / a_pair,
            touch_pair,
            touch_count,
            touch_awake,
            pair_first,
            pair_second,
            pair_shift,
            pair_arc_separation,
            pair_renewal_travel,
            previous,
            following,
            natural_length,
            node_radius,
            rest_row,
            rest_slope,
            rest_bump,
            slope_weight,
            contact_penalty,
            contact_offset,
            node_block,
            control,
            block_travel,
            min_arc_separation,
            friction,
            position,
            length,
            tangent,
            director,
            pair_wake_travel,
            pair_found,
            pair_place,
            touch_is_listed,
            touch_left,
            touch_left_count,
            touch_found,
            touch_found_count,
            touch_followed,
            touch_overlap,
            touch_normal_force,
            touch_normal,
            touch_loaded,
            touch_force,
            touch_couple,
            max_penetration,
        )
