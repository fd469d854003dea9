"""Contacts that go on from the step before: LANES pairs at a time on a CPU, a pair by QUAD threads on a GPU (lanes.py).

In most steps most pairs that may touch have one closest point, or two with a saddle between them, near those of the step before.
Newton's method follows them, and their forces are found (wire_closest.py, wire_contact_forces.py, for the equations). What needs
more is left to these kernels: friction, a pair without a known place, one whose search is due, whose place is ill-conditioned or
moves far, or that may have another place beyond a saddle.

The result of a pair does not depend on the others of its batch.
"""

from typing import Any

import warp as wp

from .control import EVALUATED_GAP, STATUS, STATUS_RUNNING, is_halted
from .lanes import NUMBERS, QUAD, QUADS_A_BLOCK
from .native import STEERING, constants
from .wire_closest import (
    FOLLOWED_FORCE,
    FOLLOWED_PLACE,
    MIN_BARRIER,
    ONE_PLACE,
    PLACES,
    RUNNING_TRAVEL,
    SPLIT,
    SPLIT_PAIR,
    TWO_PLACES,
)
from .wire_curve import CLOSING_RATE, Bump
from .wire_curve_by_batch import CURVES, POLYNOMIALS, ROWS
from .wire_minima import (
    END_CURVATURE,
    END_STEPS,
    MAX_STEP,
    MIN_CURVATURE,
    NEWTON_ACCURACY,
    SAME_PLACE,
    SINGLE_STEP,
    WELL_CURVED,
)
from .wire_pairs import NO_COMMON_WIRE
from .wire_prefetch import PREFETCH, first_of_part
from .wire_travel import TRAVEL_OF_PAIR
from .wire_weights import LINE_FRACTION, POINT_FRACTION, SADDLE_RANGE

FOLLOWING_STEPS = 4  # of Newton's method, before a pair is left to the other kernels

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

# the weight of a contact that is bounded by the end of a segment (line_weight of wire_weights.py)
_LINE_WEIGHT = r"""
    auto line_weight = [&](const real* p, const real* q, real x, real y, vec r, vec dp, vec dq, real contact_distance) {
        real curved[2], spacing[2];
        UNROLLED
        for (int side = 0; side < 2; ++side) {
            const real* v = side ? q : p;
            const real place = side ? y : x;
            const vec before = vector(v, BEFORE), after = vector(v, AFTER), edge = vector(v, EDGE);
            const real l_before = size(dot(before, before)), l = size(dot(edge, edge)), l_after = size(dot(after, after));
            const vec own = times(one / l, edge);
            const vec first = times(real(2.0) / (l + l_before), minus(own, times(one / l_before, before)));
            const vec second = times(real(2.0) / (l + l_after), minus(times(one / l_after, after), own));
            curved[side] = dot(r, plus(first, times(place, minus(second, first))));
            spacing[side] = real(0.5) * (l + l_before + place * (l_after - l_before));
        }
        const real cosine = dot(dp, dq), square = cosine * cosine / (dot(dp, dp) * dot(dq, dq));
        const real determinant = (one + curved[0]) * (one - curved[1]) - square;
        const real sine = size(most(determinant, -determinant));
        const real fraction = sine * most(most(spacing[0], spacing[1]) / contact_distance, one);
        return least(most((POINT_FRACTION - fraction) / (POINT_FRACTION - LINE_FRACTION), zero), one);
    };
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

# Newton's method from the places of the step before: minima, then the saddle between two
_FOLLOW = r"""
            const real cold_distance = real(factor) * (of_p[RADIUS] + of_q[RADIUS]);
            const real contact_distance = cold_distance + here.offset;
            real s[PLACES], t[PLACES], distance[PLACES];
            vec apart[PLACES], along_p[PLACES], along_q[PLACES];
            mask failed = nowhere;
            UNROLLED
            for (int a = 0; a < PLACES; ++a) {
                if (a >= places) continue;
                const bool is_saddle = a == 2;
                real x = here.s[a], y = here.t[a], nearest = 1e300, step_size = zero;
                mask searching = no(failed);
                for (int step = 0; step < STEPS && any(searching & no(failed)); ++step) {
                    const vec r = minus(at(curve[0], x), at(curve[1], y));
                    const vec dp = slope(curve[0], x), dq = slope(curve[1], y);
                    const real square = dot(r, r);
                    if (!is_saddle) failed |= searching & (square > nearest) & (step_size > ACCURACY);
                    nearest = square;
                    const real gs = dot(r, dp), gt = -dot(r, dq), pp = dot(dp, dp), qq = dot(dq, dq), st = -dot(dp, dq);
                    const real ss = pp + dot(r, bend(curve[0], x)), tt = qq - dot(r, bend(curve[1], y));
                    const real determinant = ss * tt - st * st;
                    const mask curved = is_saddle ? determinant < zero
                        : (determinant > WELL_CURVED * (ss + tt) * (ss + tt)) & (ss + tt > zero);
                    const real inverse = one / (curved ? determinant : one);
                    real ds = (gt * st - gs * tt) * inverse, dt = (gs * st - gt * ss) * inverse;
                    mask last;
                    if (is_saddle) {
                        x += searching ? ds : zero;
                        y += searching ? dt : zero;
                        failed |= searching & (no(curved) | (least(x, y) <= zero) | (most(x, y) >= one));
                        last = most(ds, -ds) + most(dt, -dt) < ACCURACY;
                    } else {
                        mask x_stays = ((x <= zero) & (gs > zero)) | ((x >= one) & (gs < zero));
                        mask y_stays = ((y <= zero) & (gt > zero)) | ((y >= one) & (gt < zero));
                        searching &= no(x_stays & y_stays);
                        const mask inside = no(x_stays) & no(y_stays);
                        failed |= searching & inside & no(curved);
                        const mask x_leaves = inside & (((x <= zero) & (ds < zero)) | ((x >= one) & (ds > zero)));
                        x_stays |= x_leaves;
                        y_stays |= inside & no(x_leaves) & (((y <= zero) & (dt < zero)) | ((y >= one) & (dt > zero)));
                        failed |= searching & ((x_stays & (tt <= MIN_CURVATURE * pp)) | (y_stays & (ss <= MIN_CURVATURE * qq)));
                        ds = x_stays ? zero : (y_stays ? -gs / (y_stays ? ss : one) : ds);
                        dt = x_stays ? -gt / (x_stays ? tt : one) : (y_stays ? zero : dt);
                        failed |= searching & ((most(ds, -ds) > MAX_STEP) | (most(dt, -dt) > MAX_STEP));
                        // within the segments
                        real room = one;
                        room = x + ds > one ? least(room, (one - x) / ds) : (x + ds < zero ? least(room, -x / ds) : room);
                        room = y + dt > one ? least(room, (one - y) / dt) : (y + dt < zero ? least(room, -y / dt) : room);
                        const real next_x = least(most(x + room * ds, zero), one), next_y = least(most(y + room * dt, zero), one);
                        step_size = most(next_x - x, x - next_x) + most(next_y - y, y - next_y);
                        x = searching ? next_x : x;
                        y = searching ? next_y : y;
                        last = (room >= one) & ((step_size < ACCURACY) | ((step_size < SINGLE_STEP) & curved));
                    }
                    searching &= no(last);
                }
                failed |= searching;
                s[a] = x;
                t[a] = y;
                apart[a] = minus(at(curve[0], x), at(curve[1], y));
                along_p[a] = slope(curve[0], x);
                along_q[a] = slope(curve[1], y);
                distance[a] = size(dot(apart[a], apart[a]));
            }
            real nearest = distance[0], farther = nearest, nearest_s = s[0], nearest_t = t[0], other_s = s[0], other_t = t[0];
            mask is_alone = no(nowhere);
            if (places == 1) {
                // it has not gone over into another
                failed |= most(s[0] - here.s[0], here.s[0] - s[0]) + most(t[0] - here.t[0], here.t[0] - t[0]) > SPLIT;
            } else {
                failed |= most(s[0] - s[1], s[1] - s[0]) + most(t[0] - t[1], t[1] - t[0]) < SAME_PLACE;
                const mask second = distance[1] < nearest;
                nearest_s = second ? s[1] : nearest_s;
                nearest_t = second ? t[1] : nearest_t;
                other_s = second ? other_s : s[1];
                other_t = second ? other_t : t[1];
                nearest = least(distance[0], distance[1]);
                farther = most(distance[0], distance[1]);
                failed |= distance[2] <= farther + MIN_BARRIER * contact_distance;
                is_alone = farther >= contact_distance;
            }
            const mask touches = nearest < contact_distance, is_near = nearest < contact_distance + gap;
"""

# a nearer place beyond a saddle, unless it is the other one known: of either segment, the end nearer to this one
_BEYOND = r"""
            UNROLLED
            for (int side = 0; side < 2; ++side) {
                if (!any(touches & is_alone & no(failed))) continue;
                const powers& p = curve[side];
                const powers& q = curve[1 - side];
                const real own = side ? nearest_t : nearest_s;
                const mask at_end = (own <= zero) | (own >= one);
                const real near = own >= real(0.5) ? one : zero, to = at_end ? one - own : near;
                const vec there = at(p, to), along = slope(p, to);
                const real outwards = real(2.0) * to - one, rise_of = size(dot(along, along));
                real place = side ? nearest_s : nearest_t;
                mask open = touches & is_alone & no(failed) & (to != (side ? other_t : other_s));
                for (int step = 0; step < END_STEPS && any(open); ++step) {
                    const vec gap = minus(there, at(q, place));
                    const vec d = slope(q, place);
                    const real square = dot(d, d);
                    const real curvature = most(square - dot(gap, bend(q, place)), END_CURVATURE * square);
                    const real next = least(most(place + dot(gap, d) / curvature, zero), one);
                    const real moved = most(next - place, place - next);
                    const real rise = outwards * dot(gap, along);
                    open &= no(rise > real(2.0) * moved * rise_of * size(square));
                    place = open ? next : place;
                    const mask ends = open & (moved < ACCURACY);
                    if (any(ends)) {
                        failed |= ends & (outwards * dot(minus(there, at(q, place)), along) < zero);
                        open &= no(ends);
                    }
                }
                failed |= open;
            }
"""

# weights of the contacts (wire_weights.py), forces and couples
_FORCES = r"""
            const mask back_p = of_p[GOES_BACK] > zero, back_q = of_q[GOES_BACK] > zero;
            const mask on_p = of_p[GOES_ON] > zero, on_q = of_q[GOES_ON] > zero;
            real overlap[PLACES], normal_force[PLACES], weight[PLACES], without_saddle = one;
            vec normal[PLACES], force[8], couple[6];
            const vec nothing = vec{};
            for (int k = 0; k < 8; ++k) force[k] = nothing;
            for (int k = 0; k < 6; ++k) couple[k] = nothing;
            mask loaded = nowhere;
            UNROLLED
            for (int a = 0; a < PLACES; ++a) {
                if (a >= places || !finds_forces || !any(is_near & no(failed))) continue;
                const vec r = apart[a];
                const real x = s[a], y = t[a], gs = dot(r, along_p[a]), gt = -dot(r, along_q[a]);
                const mask x_goes_on = ((x <= zero) & (gs > zero) & back_p) | ((x >= one) & (gs < zero) & on_p);
                const mask y_goes_on = ((y <= zero) & (gt > zero) & back_q) | ((y >= one) & (gt < zero) & on_q);
                const real arc = here.separation + y * of_q[LENGTH] - x * of_p[LENGTH];
                const mask is_own = (here.separation != NO_COMMON_WIRE) & (most(arc, -arc) < min_arc_separation * of_p[RADIUS]);
                const mask none = is_own | (x_goes_on & y_goes_on)
                    | ((x >= one) & on_p & no(x_goes_on)) | ((y >= one) & on_q & no(y_goes_on));
                weight[a] = none ? zero : one;
                if (any(no(none) & (x_goes_on | y_goes_on))) {
                    const real along = line_weight(of_p, of_q, x, y, r, along_p[a], along_q[a], cold_distance);
                    weight[a] = no(none) & (x_goes_on | y_goes_on) ? along : weight[a];
                }
                if (places > 1 && a < 2) {
                    const real off = most(most(x - s[2], s[2] - x), most(y - t[2], t[2] - y)) / SADDLE_RANGE;
                    const real near = most(one - off * off * off * off, zero);
                    without_saddle *= is_own ? one : one - near * near;
                }
                if (a == 2) weight[a] *= without_saddle - one;
                const real offset_p = of_p[OFFSET] + x * (of_p[NEXT_OFFSET] - of_p[OFFSET]);
                const real offset_q = of_q[OFFSET] + y * (of_q[NEXT_OFFSET] - of_q[OFFSET]);
                overlap[a] = cold_distance - distance[a];
                const real pushed = overlap[a] + offset_p + offset_q;
                const mask pushes = touches & (weight[a] != zero) & (pushed > zero);
                const real penalty_p = of_p[PENALTY] + x * (of_p[NEXT_PENALTY] - of_p[PENALTY]);
                const real penalty_q = of_q[PENALTY] + y * (of_q[NEXT_PENALTY] - of_q[PENALTY]);
                normal_force[a] = pushes ? weight[a] * (real(0.5) * (penalty_p + penalty_q)) * pushed : zero;
                normal[a] = times(one / distance[a], r);
                loaded |= pushes;
                UNROLLED
                for (int side = 0; side < 2; ++side) {
                    if (!any(pushes & no(failed))) continue;
                    const real* v = here.number[side];
                    const real z = side ? y : x, h10 = z * (one - z) * (one - z), h11 = z * z * (z - one);
                    const real h01 = z * z * (real(3.0) - real(2.0) * z), both = z * (one - z);
                    const mask back = v[GOES_BACK] > zero, on = v[GOES_ON] > zero;
                    const real w0 = -v[M] * h10, w3 = v[M + 3] * h11;
                    real w1 = one - h01 + (v[M] - v[M + 1]) * h10 - v[M + 2] * h11;
                    real w2 = h01 + v[M + 1] * h10 + (v[M + 2] - v[M + 3]) * h11;
                    // beyond its end a wire is straight
                    w1 += (back ? zero : real(2.0) * w0) - (on ? zero : w3);
                    w2 += (on ? zero : real(2.0) * w3) - (back ? zero : w0);
                    const vec push = times(side ? -normal_force[a] : normal_force[a], normal[a]);
                    vec* f = force + 4 * side;
                    vec* c = couple + 3 * side;
                    f[0] = plus(f[0], times(back ? w0 : zero, push));
                    f[1] = plus(f[1], times(w1, push));
                    f[2] = plus(f[2], times(w2, push));
                    f[3] = plus(f[3], times(on ? w3 : zero, push));
                    const vec* b = bumps[side];
                    const vec bump = plus(b[0], times(z, plus(b[1], times(z, plus(b[2], times(z, b[3]))))));
                    const vec ends = plus(times(h10, shape_one[side]), times(h11, shape_two[side]));
                    const vec lever = plus(ends, times(both * both, bump));
                    c[0] = plus(c[0], cross(times(back ? h10 : zero, shape_before[side]), push));
                    c[1] = plus(c[1], cross(lever, push));
                    c[2] = plus(c[2], cross(times(on ? h11 : zero, shape_after[side]), push));
                }
            }
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
        STEPS=FOLLOWING_STEPS,
        STATUS=STATUS,
        STATUS_RUNNING=STATUS_RUNNING,
        EVALUATED_GAP=EVALUATED_GAP,
        PLACE=FOLLOWED_PLACE,
        FORCE=FOLLOWED_FORCE,
        ONE_PLACE=ONE_PLACE,
        TWO_PLACES=TWO_PLACES,
        PLACES=PLACES,
        MIN_BARRIER=MIN_BARRIER,
        LINE_FRACTION=LINE_FRACTION,
        POINT_FRACTION=POINT_FRACTION,
        SADDLE_RANGE=SADDLE_RANGE,
        SAME_PLACE=SAME_PLACE,
        RUNNING=RUNNING_TRAVEL,
        SPLIT=SPLIT,
        SPLIT_PAIR=SPLIT_PAIR,
        CLOSING_RATE=CLOSING_RATE,
        END_CURVATURE=END_CURVATURE,
        END_STEPS=END_STEPS,
        MAX_STEP=MAX_STEP,
        MIN_CURVATURE=MIN_CURVATURE,
        ACCURACY=NEWTON_ACCURACY,
        SINGLE_STEP=SINGLE_STEP,
        WELL_CURVED=WELL_CURVED,
    )
    + f"    const double NO_COMMON_WIRE = {float(NO_COMMON_WIRE)!r};\n"
    + ROWS
    + NUMBERS
    + _STEP
    + POLYNOMIALS
    + _LINE_WEIGHT
    + _GATHER.replace("PREFETCH_A_PAIR", PREFETCH).replace("TRAVEL_OF_A_PAIR", TRAVEL_OF_PAIR)
    + _BATCHES
    + CURVES
    + _FOLLOW
    + _BEYOND
    + _FORCES
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
