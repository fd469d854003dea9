"""Contacts that go on from the step before, on a CPU: LANES pairs at a time.

In most steps most pairs that may touch have one closest point, or two with a saddle between them, near those of the step before.
Newton's method follows them, and their forces are found (wire_closest.py, wire_contact_forces.py, for the equations) with numbers
of LANES pairs in a vector of the processor. What needs more is left to these kernels: friction, a pair without a known place, one
whose search is due, whose place is ill-conditioned or moves far, or that may have another place beyond a saddle.

The result of a pair does not depend on the others of its batch.
"""

from typing import Any

import warp as wp

from .control import EVALUATED_GAP, STATUS, STATUS_RUNNING, is_halted
from .lanes import LANES, NUMBERS
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
"""

# the weight of a contact that is bounded by the end of a segment (line_weight of wire_weights.py)
_LINE_WEIGHT = r"""
    auto line_weight = [&](const real* p, const real* q, real x, real y, vec r, vec dp, vec dq, real contact_distance) {
        real curved[2], spacing[2];
        for (int side = 0; side < 2; ++side) {
            const real* v = side ? q : p;
            const real place = side ? y : x;
            const vec before = {v[BEFORE], v[BEFORE + 1], v[BEFORE + 2]}, after = {v[AFTER], v[AFTER + 1], v[AFTER + 2]};
            const vec edge = {v[EDGE], v[EDGE + 1], v[EDGE + 2]};
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
    // pairs with one place, and those with two and the saddle between them
    struct batch {
        real number[2][ROWS], separation, renewal, offset, travel, s[PLACES], t[PLACES];
        int touch[LANES], filled;
    };
    batch batches[2];
    batches[0].filled = batches[1].filled = 0;
    for (int touch = begin; touch < end || batches[0].filled > 0 || batches[1].filled > 0;) {
        if (touch < end) {
            { PREFETCH_A_PAIR }
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
            const int now = touch++;
            touch_followed.data[now] = 0;
            if (CLOSING_RATE * (pair_wake_travel.data[pair] - travel) > reach + gap) {  // it cannot touch yet
                pair_found.data[pair] = found > 0 ? -found : found;
                touch_loaded.data[now] = 0;
                touch_followed.data[now] = FORCE;
            } else if (found != 0 && pair_renewal_travel.data[pair] != SPLIT_PAIR
                       && travel <= pair_renewal_travel.data[pair] + more_travel * (radii + reach)) {
                const int places = found == ONE_PLACE || found == -ONE_PLACE ? 1 : PLACES;
                batch& own_batch = batches[places > 1];
                const int l = own_batch.filled++;
                own_batch.touch[l] = now;
                for (int side = 0; side < 2; ++side) {
                    const int i = sides[side], before = previous.data[i], after = following.data[i];
                    const bool back = before >= 0, on = following.data[after] >= 0;
                    double* v = (double*)own_batch.number[side] + l;
                    const int row = rest_row.data[i];
                    const double own = length.data[i], length_before = back ? length.data[before] : own;
                    const double length_after = on ? length.data[after] : own;
                    const int b = back ? before : i, a = on ? after : i;
                    for (int k = 0; k < 3; ++k) {
                        v[(X + k) * LANES] = nodes[3 * i + k];
                        v[(EDGE + k) * LANES] = own * tangents[3 * i + k];
                        v[(BEFORE + k) * LANES] = length_before * tangents[3 * b + k];
                        v[(AFTER + k) * LANES] = length_after * tangents[3 * a + k];
                        v[(T + k) * LANES] = tangents[3 * i + k];
                        v[(D + k) * LANES] = directors[3 * i + k];
                        v[(T_BEFORE + k) * LANES] = tangents[3 * b + k];
                        v[(D_BEFORE + k) * LANES] = directors[3 * b + k];
                        v[(T_AFTER + k) * LANES] = tangents[3 * a + k];
                        v[(D_AFTER + k) * LANES] = directors[3 * a + k];
                    }
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
                q[X * LANES] += fxx * shift[0] + fxy * shift[1];
                q[(X + 1) * LANES] += fyx * shift[0] + fyy * shift[1];
                q[(X + 2) * LANES] += shift[2];
                for (int a = 0; a < places; ++a) {
                    const double* place = (const double*)(pair_place.data + 3 * pair + a);
                    own_batch.s[a][l] = place[0];
                    own_batch.t[a][l] = place[1];
                }
                own_batch.separation[l] = pair_arc_separation.data[pair];
                own_batch.renewal[l] = pair_renewal_travel.data[pair];
                own_batch.offset[l] = reach;
                own_batch.travel[l] = travel;
            }
        }
"""

# the batches that are full, and at the end the others
_BATCHES = r"""
        for (int kind = 0; kind < 2; ++kind) {
            const int places = kind ? PLACES : 1, filled = batches[kind].filled;
            if (filled == 0 || (filled < LANES && touch < end)) continue;
            batches[kind].filled = 0;
            // lanes that are not filled repeat the first
            double* numbers = (double*)(batches + kind);
            for (int l = filled; l < LANES; ++l)
                for (int k = 0; k < 2 * ROWS + 4 + 2 * PLACES; ++k) numbers[k * LANES + l] = numbers[k * LANES];
            const batch& here = batches[kind];
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
            for (int a = 0; a < places; ++a) {
                const bool is_saddle = a == 2;
                real x = here.s[a], y = here.t[a], nearest = 1e300, step_size = zero;
                mask searching = ~failed;
                for (int step = 0; step < STEPS && any(searching & ~failed); ++step) {
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
                        failed |= searching & (~curved | (least(x, y) <= zero) | (most(x, y) >= one));
                        last = most(ds, -ds) + most(dt, -dt) < ACCURACY;
                    } else {
                        mask x_stays = ((x <= zero) & (gs > zero)) | ((x >= one) & (gs < zero));
                        mask y_stays = ((y <= zero) & (gt > zero)) | ((y >= one) & (gt < zero));
                        searching &= ~(x_stays & y_stays);
                        const mask inside = ~x_stays & ~y_stays;
                        failed |= searching & inside & ~curved;
                        const mask x_leaves = inside & (((x <= zero) & (ds < zero)) | ((x >= one) & (ds > zero)));
                        x_stays |= x_leaves;
                        y_stays |= inside & ~x_leaves & (((y <= zero) & (dt < zero)) | ((y >= one) & (dt > zero)));
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
                    searching &= ~last;
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
            mask is_alone = ~nowhere;
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
            for (int side = 0; side < 2 && any(touches & is_alone & ~failed); ++side) {
                const powers& p = curve[side];
                const powers& q = curve[1 - side];
                const real own = side ? nearest_t : nearest_s;
                const mask at_end = (own <= zero) | (own >= one);
                const real near = own >= real(0.5) ? one : zero, to = at_end ? one - own : near;
                const vec there = at(p, to), along = slope(p, to);
                const real outwards = real(2.0) * to - one, rise_of = size(dot(along, along));
                real place = side ? nearest_s : nearest_t;
                mask open = touches & is_alone & ~failed & (to != (side ? other_t : other_s));
                for (int step = 0; step < END_STEPS && any(open); ++step) {
                    const vec gap = minus(there, at(q, place));
                    const vec d = slope(q, place);
                    const real square = dot(d, d);
                    const real curvature = most(square - dot(gap, bend(q, place)), END_CURVATURE * square);
                    const real next = least(most(place + dot(gap, d) / curvature, zero), one);
                    const real moved = most(next - place, place - next);
                    const real rise = outwards * dot(gap, along);
                    open &= ~(rise > real(2.0) * moved * rise_of * size(square));
                    place = open ? next : place;
                    const mask ends = open & (moved < ACCURACY);
                    if (any(ends)) {
                        failed |= ends & (outwards * dot(minus(there, at(q, place)), along) < zero);
                        open &= ~ends;
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
            const vec nothing = {zero, zero, zero};
            for (int k = 0; k < 8; ++k) force[k] = nothing;
            for (int k = 0; k < 6; ++k) couple[k] = nothing;
            mask loaded = nowhere;
            for (int a = 0; a < places && finds_forces && any(is_near & ~failed); ++a) {
                const vec r = apart[a];
                const real x = s[a], y = t[a], gs = dot(r, along_p[a]), gt = -dot(r, along_q[a]);
                const mask x_goes_on = ((x <= zero) & (gs > zero) & back_p) | ((x >= one) & (gs < zero) & on_p);
                const mask y_goes_on = ((y <= zero) & (gt > zero) & back_q) | ((y >= one) & (gt < zero) & on_q);
                const real arc = here.separation + y * of_q[LENGTH] - x * of_p[LENGTH];
                const mask is_own = (here.separation != NO_COMMON_WIRE) & (most(arc, -arc) < min_arc_separation * of_p[RADIUS]);
                const mask none = is_own | (x_goes_on & y_goes_on)
                    | ((x >= one) & on_p & ~x_goes_on) | ((y >= one) & on_q & ~y_goes_on);
                weight[a] = none ? zero : one;
                if (any(~none & (x_goes_on | y_goes_on))) {
                    const real along = line_weight(of_p, of_q, x, y, r, along_p[a], along_q[a], cold_distance);
                    weight[a] = ~none & (x_goes_on | y_goes_on) ? along : weight[a];
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
                for (int side = 0; side < 2 && any(pushes & ~failed); ++side) {
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
            for (int l = 0; l < filled; ++l) {
                if (failed[l]) continue;
                const int now = here.touch[l], pair = touch_pair.data[now], minima = kind ? TWO_PLACES : ONE_PLACE;
                touch_followed.data[now] = finds_forces || !is_near[l] ? FORCE : PLACE;
                touch_loaded.data[now] = loaded[l] ? 1 : 0;
                pair_wake_travel.data[pair] = wake[l] < here.renewal[l] ? wake[l] : here.renewal[l];
                pair_found.data[pair] = is_near[l] ? minima : -minima;
                double* place = (double*)(pair_place.data + 3 * pair);
                for (int a = 0; a < places; ++a) {
                    place[2 * a] = s[a][l];
                    place[2 * a + 1] = t[a][l];
                }
                if (!kind) {
                    place[2] = s[0][l];
                    place[3] = t[0][l];
                }
                if (!is_near[l] || !finds_forces) continue;
                for (int a = 0; a < PLACES; ++a) {
                    const int k = 3 * now + a;
                    const bool counts = a < places && weight[a][l] != 0;
                    if (counts && a < 2 && normal_force[a][l] != 0 && overlap[a][l] > max_penetration.data[0])
                        max_penetration.data[0] = overlap[a][l];
                    if (is_running) continue; // steps need forces and couples alone
                    touch_normal_force.data[k] = counts ? normal_force[a][l] : 0.0;
                    touch_overlap.data[k] = counts ? overlap[a][l] : -NO_COMMON_WIRE;
                    if (!counts) continue;
                    double* n = (double*)(touch_normal.data + k);
                    n[0] = normal[a].x[l];
                    n[1] = normal[a].y[l];
                    n[2] = normal[a].z[l];
                }
                if (!loaded[l]) continue;
                stored* f = (stored*)(touch_force.data + 8 * now);
                for (int k = 0; k < 8; ++k) {
                    f[3 * k] = force[k].x[l];
                    f[3 * k + 1] = force[k].y[l];
                    f[3 * k + 2] = force[k].z[l];
                }
                stored* c = (stored*)(touch_couple.data + 6 * now);
                for (int k = 0; k < 6; ++k) {
                    c[3 * k] = couple[k].x[l];
                    c[3 * k + 1] = couple[k].y[l];
                    c[3 * k + 2] = couple[k].z[l];
                }
            }
        }
    }
    }
"""

_LANES = (
    STEERING
    + constants(
        LANES=LANES,
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
    begin: int,
    end: int,
    # in: the pairs that may touch, and all pairs
    touch_pair: wp.array(dtype=wp.int32),
    touch_count: wp.array(dtype=wp.int32),
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


@wp.kernel
def find_followed_contacts(
    # in: the pairs that may touch, and all pairs
    part: int,
    parts: int,
    touch_pair: wp.array(dtype=wp.int32),
    touch_count: wp.array(dtype=wp.int32),
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
    """One thread: the pairs of a part. Other kernels skip what `touch_followed` says is found, with friction the places."""
    if not is_halted(control):
        follow_contacts(
            first_of_part(touch_count, part, parts),
            first_of_part(touch_count, part + 1, parts),
            touch_pair,
            touch_count,
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
            touch_followed,
            touch_overlap,
            touch_normal_force,
            touch_normal,
            touch_loaded,
            touch_force,
            touch_couple,
            max_penetration,
        )
