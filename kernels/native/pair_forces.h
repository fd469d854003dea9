// Contact forces of the pairs of a batch (kernels/wire_contact_forces.py and wire_weights.py, for the equations).
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
const mask back_p = of_p[GOES_BACK] > zero, back_q = of_q[GOES_BACK] > zero;
const mask on_p = of_p[GOES_ON] > zero, on_q = of_q[GOES_ON] > zero;
real overlap[PLACES], pushed[PLACES], normal_force[PLACES], weight[PLACES], without_saddle = one;
vec normal[PLACES], force[8], couple[6];
mask pushes[PLACES];
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
    const mask none =
        is_own | (x_goes_on & y_goes_on) | ((x >= one) & on_p & no(x_goes_on)) | ((y >= one) & on_q & no(y_goes_on));
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
    pushed[a] = overlap[a] + offset_p + offset_q;
    pushes[a] = touches & (weight[a] != zero) & (pushed[a] > zero);
    const real penalty_p = of_p[PENALTY] + x * (of_p[NEXT_PENALTY] - of_p[PENALTY]);
    const real penalty_q = of_q[PENALTY] + y * (of_q[NEXT_PENALTY] - of_q[PENALTY]);
    normal_force[a] = pushes[a] ? weight[a] * (real(0.5) * (penalty_p + penalty_q)) * pushed[a] : zero;
    normal[a] = times(one / distance[a], r);
    loaded |= pushes[a];
}
mask is_new = nowhere;
#include "pair_friction.h"
UNROLLED
for (int a = 0; a < PLACES; ++a) {
    if (a >= places || !finds_forces || !any(is_near & no(failed))) continue;
    UNROLLED
    for (int side = 0; side < 2; ++side) {
        if (!any(pushes[a] & no(failed))) continue;
        const real* v = here.number[side];
        const real z = side ? t[a] : s[a], h10 = z * (one - z) * (one - z), h11 = z * z * (z - one);
        const real h01 = z * z * (real(3.0) - real(2.0) * z), both = z * (one - z);
        const mask back = v[GOES_BACK] > zero, on = v[GOES_ON] > zero;
        const real w0 = -v[M] * h10, w3 = v[M + 3] * h11;
        real w1 = one - h01 + (v[M] - v[M + 1]) * h10 - v[M + 2] * h11;
        real w2 = h01 + v[M + 1] * h10 + (v[M + 2] - v[M + 3]) * h11;
        // beyond its end a wire is straight
        w1 += (back ? zero : real(2.0) * w0) - (on ? zero : w3);
        w2 += (on ? zero : real(2.0) * w3) - (back ? zero : w0);
        vec push = times(side ? -normal_force[a] : normal_force[a], normal[a]);
        if (rubs && a < 2) push = side ? minus(push, friction[a]) : plus(push, friction[a]);
        vec* f = force + 4 * side;
        vec* c = couple + 3 * side;
        f[0] = plus(f[0], times(back ? w0 : zero, push));
        f[1] = plus(f[1], times(w1, push));
        f[2] = plus(f[2], times(w2, push));
        f[3] = plus(f[3], times(on ? w3 : zero, push));
        const shaped_wire& w = wires[side];
        const vec* b = w.bumps;
        const vec bump = plus(b[0], times(z, plus(b[1], times(z, plus(b[2], times(z, b[3]))))));
        const vec ends = plus(times(h10, w.shape_one), times(h11, w.shape_two));
        const vec lever = plus(ends, times(both * both, bump));
        c[0] = plus(c[0], cross(times(back ? h10 : zero, w.shape_before), push));
        c[1] = plus(c[1], cross(lever, push));
        c[2] = plus(c[2], cross(times(on ? h11 : zero, w.shape_after), push));
        if (rubs && a < 2)
            for (int k = 0; k < 3; ++k) c[k] = plus(c[k], times(share[a][side][k], turn[a][side]));
    }
}
