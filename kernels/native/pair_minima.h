// Minima of the distance of the pairs of a batch that are near those of the step before (kernels/wire_minima.py, for the
// equations). Newton's method from the places of the step before: minima, then the saddle between two.
enum { MOST_STEPS = 4 }; // before a pair is left to the other kernels
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
    for (int step = 0; step < MOST_STEPS && any(searching & no(failed)); ++step) {
        const vec r = minus(at(wires[0].curve, x), at(wires[1].curve, y));
        const vec dp = slope(wires[0].curve, x), dq = slope(wires[1].curve, y);
        const real square = dot(r, r);
        if (!is_saddle) failed |= searching & (square > nearest) & (step_size > NEWTON_ACCURACY);
        nearest = square;
        const real gs = dot(r, dp), gt = -dot(r, dq), pp = dot(dp, dp), qq = dot(dq, dq), st = -dot(dp, dq);
        const real ss = pp + dot(r, bend(wires[0].curve, x)), tt = qq - dot(r, bend(wires[1].curve, y));
        const real determinant = ss * tt - st * st;
        const mask curved =
            is_saddle ? determinant < zero : (determinant > WELL_CURVED * (ss + tt) * (ss + tt)) & (ss + tt > zero);
        const real inverse = one / (curved ? determinant : one);
        real ds = (gt * st - gs * tt) * inverse, dt = (gs * st - gt * ss) * inverse;
        mask last;
        if (is_saddle) {
            x += searching ? ds : zero;
            y += searching ? dt : zero;
            failed |= searching & (no(curved) | (least(x, y) <= zero) | (most(x, y) >= one));
            last = most(ds, -ds) + most(dt, -dt) < NEWTON_ACCURACY;
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
            last = (room >= one) & ((step_size < NEWTON_ACCURACY) | ((step_size < SINGLE_STEP) & curved));
        }
        searching &= no(last);
    }
    failed |= searching;
    s[a] = x;
    t[a] = y;
    apart[a] = minus(at(wires[0].curve, x), at(wires[1].curve, y));
    along_p[a] = slope(wires[0].curve, x);
    along_q[a] = slope(wires[1].curve, y);
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
// a nearer place beyond a saddle, unless it is the other one known: of either segment, the end nearer to this one
UNROLLED
for (int side = 0; side < 2; ++side) {
    if (!any(touches & is_alone & no(failed))) continue;
    const powers& p = wires[side].curve;
    const powers& q = wires[1 - side].curve;
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
        const mask ends = open & (moved < NEWTON_ACCURACY);
        if (any(ends)) {
            failed |= ends & (outwards * dot(minus(there, at(q, place)), along) < zero);
            open &= no(ends);
        }
    }
    failed |= open;
}
