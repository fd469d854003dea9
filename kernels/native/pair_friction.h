// Coulomb friction of the contacts of a batch in a relaxation (kernels/wire_contact_forces.py and wire_friction.py, for the
// equations). If a pair has no slip of its own, the other kernels search the pairs beside it.
vec friction[2] = {nothing, nothing}, elastic[2] = {nothing, nothing}, turn[2][2]; // [place]; couples [place][side]
real share[2][2][3];                                                               // weights of sections [place][side][section]
if (rubs && any(loaded & no(failed))) {
    const float* known_slip = (const float*)elastic_slip.data;
    const float* known_place = (const float*)slip_place.data;
    const real then = real(before_control.data[LENGTH_FACTOR]);
    const powers earlier[2] = {wire_of(here.earlier[0], of_p, then).curve, wire_of(here.earlier[1], of_q, then).curve};
    UNROLLED
    for (int a = 0; a < 2; ++a) {
        if (a >= places || !any(pushes[a] & no(failed))) continue;
        real slips_before[3] = {zero, zero, zero}, known = zero;
        for (int l = 0; l < LANES && l < filled; ++l) {
            const int pair = touch_pair.data[here.touch[l]];
            double nearest = 3;
            for (int k = this_half + 2 * pair; k < this_half + 2 * pair + 2; ++k) {
                if (slip_step.data[k] < (int)before_control.data[STEP]) continue; // of an increment before
                const double x = known_place[2 * k] - of_lane(s[a], l), y = known_place[2 * k + 1] - of_lane(t[a], l);
                const double far = (x < 0 ? -x : x) + (y < 0 ? -y : y);
                if (far >= nearest) continue;
                nearest = far;
                set(known, l, 1.0);
                for (int c = 0; c < 3; ++c) set(slips_before[c], l, known_slip[3 * k + c]);
            }
        }
        is_new |= pushes[a] & (known == zero);
        elastic[a] = vector(slips_before, 0);
        vec slip = elastic[a], lever[2];
        real cosine = zero, sine = zero; // of the turn about the normal
        UNROLLED
        for (int side = 0; side < 2; ++side) {
            const real* now = here.number[side];
            const real* before = here.earlier[side];
            const real z = side ? t[a] : s[a];
            lever[side] = times(real(side ? factor : -factor) * now[RADIUS] / cold_distance, apart[a]);
            auto turned_back = [&](int tangents, int directors) {
                const vec t = vector(now, tangents), d = vector(now, directors);
                const vec t_before = vector(before, tangents), d_before = vector(before, directors);
                const vec in_plane = plus(times(dot(lever[side], d), d_before), times(dot(lever[side], t), t_before));
                return plus(in_plane, times(dot(lever[side], cross(t, d)), cross(t_before, d_before)));
            };
            real* of_section = share[a][side];
            of_section[0] = now[GOES_BACK] > zero ? most(real(0.5) - z, zero) : zero;
            of_section[2] = now[GOES_ON] > zero ? most(z - real(0.5), zero) : zero;
            of_section[1] = one - of_section[0] - of_section[2];
            vec surface = plus(at(earlier[side], z), times(of_section[1], turned_back(T, D)));
            surface = plus(surface, times(of_section[0], turned_back(T_BEFORE, D_BEFORE)));
            surface = plus(surface, times(of_section[2], turned_back(T_AFTER, D_AFTER)));
            slip = side ? plus(slip, surface) : minus(slip, surface);
            for (int k = 0; k < 3; ++k) {
                const int tangents = k == 0 ? T_BEFORE : k == 1 ? T : T_AFTER;
                const vec now_t = vector(now, tangents), t_before = vector(before, tangents);
                const real along = dot(t_before, now_t) - dot(t_before, normal[a]) * dot(normal[a], now_t);
                cosine += of_section[k] * along;
                sine += of_section[k] * dot(normal[a], cross(t_before, now_t));
            }
        }
        slip = minus(slip, times(dot(slip, normal[a]), normal[a]));
        const real turned = size(cosine * cosine + sine * sine);
        slip = times(one / (pushes[a] ? turned : one), plus(times(cosine, slip), times(sine, cross(normal[a], slip))));
        real own = weight[a];
        if (places > 1) {
            const real saddle = -weight[2] * pushed[2];
            const real above = most(pushed[a] - saddle, zero), beyond = most(pushed[1 - a] - saddle, zero);
            const real both = above + beyond;
            const real of_other = both > zero ? beyond / (both > zero ? both : one) : real(0.5);
            const real joint = one - weight[1 - a] * (one - of_other);
            own *= saddle > zero ? most(one - joint * least(saddle / (pushes[a] ? pushed[a] : one), one), zero) : one;
        }
        const real sticking = real(stick_share * steer[CONTACT_STIFFNESS]) * own;
        const real limit = real(steer[FRICTION]) * own * normal_force[a] / (pushes[a] ? weight[a] : one);
        const real stuck = sticking * size(dot(slip, slip));
        const real loses = stuck > limit ? limit / (stuck > limit ? stuck : one) : one;
        friction[a] = times(pushes[a] ? -sticking * loses : zero, slip);
        turn[a][0] = cross(lever[0], friction[a]);
        turn[a][1] = cross(friction[a], lever[1]);
    }
}
