// `curve` of either side of a batch `here` (kernels/wire_curve.py, for the equations), and the parts of it that rotate with the
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
powers curve[2];
vec shape_before[2], shape_one[2], shape_two[2], shape_after[2], bumps[2][4];
UNROLLED
for (int side = 0; side < 2; ++side) {
    const real* v = here.number[side];
    const vec own = vector(v, D), across = cross(vector(v, T), own);
    auto turned = [&](int row) { return plus(times(v[row], own), times(v[row + 1], across)); };
    const vec d_before = vector(v, D_BEFORE), across_before = cross(vector(v, T_BEFORE), d_before);
    const vec d_after = vector(v, D_AFTER), across_after = cross(vector(v, T_AFTER), d_after);
    const real f = factor;
    shape_before[side] = times(f * v[SLOPE_BEFORE], plus(times(v[A], d_before), times(v[A + 1], across_before)));
    shape_one[side] = times(f * v[M + 1] * v[LENGTH], turned(A));
    shape_two[side] = times(f * v[M + 2] * v[LENGTH], turned(NEXT_A));
    const vec turned_after = plus(times(v[NEXT_A], d_after), times(v[NEXT_A + 1], across_after));
    shape_after[side] = times(f * v[SLOPE_AFTER], turned_after);
    for (int k = 0; k < 4; ++k) bumps[side][k] = times(f, turned(B + 2 * k));
    const vec edge = vector(v, EDGE);
    const vec m1 = plus(plus(times(v[M], vector(v, BEFORE)), times(v[M + 1], edge)), plus(shape_before[side], shape_one[side]));
    const vec m2 = plus(plus(times(v[M + 2], edge), times(v[M + 3], vector(v, AFTER))), plus(shape_two[side], shape_after[side]));
    const vec* b = bumps[side];
    vec* c = curve[side].c;
    c[0] = vector(v, X);
    c[1] = m1;
    c[2] = plus(minus(times(real(3.0), edge), plus(times(real(2.0), m1), m2)), b[0]);
    c[3] = plus(minus(plus(m1, m2), times(real(2.0), plus(edge, b[0]))), b[1]);
    c[4] = plus(minus(b[0], times(real(2.0), b[1])), b[2]);
    c[5] = plus(minus(b[1], times(real(2.0), b[2])), b[3]);
    c[6] = minus(b[2], times(real(2.0), b[3]));
    c[7] = b[3];
}
