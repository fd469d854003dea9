// Curves of either side of a batch `here` (kernels/wire_curve.py, for the equations), and the parts of them that rotate with the
// sections.
struct powers { vec c[8]; };
auto at = [&](const powers& p, real s) {
    vec sum = p.c[7];
    for (int k = 6; k >= 0; --k) sum = plus(p.c[k], times(s, sum));
    return sum;
};
auto slope = [&](const powers& p, real s) {
    vec sum = times(real(7.0), p.c[7]);
    for (int k = 6; k >= 1; --k) sum = plus(times(real(double(k)), p.c[k]), times(s, sum));
    return sum;
};
auto bend = [&](const powers& p, real s) {
    vec sum = times(real(42.0), p.c[7]);
    for (int k = 6; k >= 2; --k) sum = plus(times(real(double(k * (k - 1))), p.c[k]), times(s, sum));
    return sum;
};
struct shaped_wire {
    powers curve;
    vec shape_before, shape_one, shape_two, shape_after, bumps[4];
};
// v: rows of one state of a segment; rest: of its rest data; f: its length over that of the rest data
auto wire_of = [&](const real* v, const real* rest, const real f) {
    shaped_wire w;
    const vec own = vector(v, D), across = cross(vector(v, T), own);
    auto turned = [&](int row) { return plus(times(rest[row], own), times(rest[row + 1], across)); };
    const vec d_before = vector(v, D_BEFORE), across_before = cross(vector(v, T_BEFORE), d_before);
    const vec d_after = vector(v, D_AFTER), across_after = cross(vector(v, T_AFTER), d_after);
    w.shape_before = times(f * rest[SLOPE_BEFORE], plus(times(rest[A], d_before), times(rest[A + 1], across_before)));
    w.shape_one = times(f * rest[M + 1] * rest[LENGTH], turned(A));
    w.shape_two = times(f * rest[M + 2] * rest[LENGTH], turned(NEXT_A));
    w.shape_after = times(f * rest[SLOPE_AFTER], plus(times(rest[NEXT_A], d_after), times(rest[NEXT_A + 1], across_after)));
    for (int k = 0; k < 4; ++k) w.bumps[k] = times(f, turned(B + 2 * k));
    const vec edge = vector(v, EDGE);
    const vec m1 = plus(plus(times(rest[M], vector(v, BEFORE)), times(rest[M + 1], edge)), plus(w.shape_before, w.shape_one));
    const vec m2 = plus(plus(times(rest[M + 2], edge), times(rest[M + 3], vector(v, AFTER))), plus(w.shape_two, w.shape_after));
    const vec* b = w.bumps;
    vec* c = w.curve.c;
    c[0] = vector(v, X);
    c[1] = m1;
    c[2] = plus(minus(times(real(3.0), edge), plus(times(real(2.0), m1), m2)), b[0]);
    c[3] = plus(minus(plus(m1, m2), times(real(2.0), plus(edge, b[0]))), b[1]);
    c[4] = plus(minus(b[0], times(real(2.0), b[1])), b[2]);
    c[5] = plus(minus(b[1], times(real(2.0), b[2])), b[3]);
    c[6] = minus(b[2], times(real(2.0), b[3]));
    c[7] = b[3];
    return w;
};
const shaped_wire wires[2] = {wire_of(of_p, of_p, real(factor)), wire_of(of_q, of_q, real(factor))};
