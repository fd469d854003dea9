// Contact of PAIR_BATCH pairs (kernels/contact_by_batch.py).
#include "prefetch.h"
typedef decltype(unit) real;
typedef decltype(ux.data[0] + ux.data[0]) coordinate;
enum { LANES = PAIR_BATCH, AHEAD = 2, ITERATIONS = CLOSEST_POINT_ITERATIONS };
const real zero = 0, one = 1, half = 0.5, two = 2, three = 3, four = 4, six = 6;
const real open_square = real(9) * reach_at_rest * reach_at_rest;
const real tolerance = sizeof(real) == 8 ? CLOSEST_POINT_DOUBLE : CLOSEST_POINT_SINGLE;
const int begin = LANES * batch, pairs = pair_wire.shape[0];
const double* steer = control.data;
const double travel = steer[TRAVEL];
const real fxx = real(steer[GRADIENT]), fxy = real(steer[GRADIENT + 1]);
const real fyx = real(steer[GRADIENT + 2]), fyy = real(steer[GRADIENT + 3]);
const real reach = reach_at_rest * real(steer[LENGTH_FACTOR]), stiffness = real(steer[CONTACT_STIFFNESS]);
const int count = pairs - begin < LANES ? pairs - begin : LANES;
#pragma clang diagnostic ignored "-Wpass-failed" // loops that stay scalar are no news to a user
// a loop over the pairs of the batch; of a whole one their number is known to the compiler
const auto for_each = [count](const auto& of_pair) {
    if (count == LANES) {
#pragma clang loop vectorize(enable)
        for (int l = 0; l < LANES; ++l) of_pair(l);
    } else {
        for (int l = 0; l < count; ++l) of_pair(l);
    }
};
int awake[LANES] = {}, any = 0;
const real* __restrict wake = pair_wake.data + begin;
for_each([&](int l) { awake[l] = travel >= double(wake[l]); });
for (int l = 0; l < LANES; ++l) any |= awake[l];
if (!any) {
    for_each([&](int l) { pair_force.data[begin + l] = zero; });
    return;
}
// what a later batch will gather is fetched by now, and of a mesh beyond the cache all that it reads and writes
if (begin + (AHEAD + 1) * LANES <= pairs) {
    const int next = begin + AHEAD * LANES;
    const int* later = cached_node.data + CACHED_NODES * next + LANES;
    for (int l = 0; l < LANES; ++l) fetch(ux.data + later[l], uy.data + later[l]);
    enum { LINE = 64 / sizeof(real) };
    for (int k = 0; pairs > UNCACHED_PAIRS && k < LANES; k += LINE) {
        const int p = next + k;
        fetch(body_ux.data + p / 2, body_uy.data + p / 2, pair_wake.data + p, pair_low.data + p, pair_high.data + p);
        fetch(pair_side.data + p, pair_offset.data + p, cached_slide.data + p);
        fetch_to_write(pair_slide.data + p, pair_u.data + p, pair_node.data + p, pair_gap.data + p);
        fetch_to_write(pair_force.data + p, pair_body_x.data + p, pair_body_y.data + p);
        for (int n = 0; n < CACHED_NUMBERS; ++n) fetch(cached_number.data + CACHED_NUMBERS * next + n * LANES + k);
        for (int n = 0; n < 4; ++n) {
            fetch(cached_node.data + CACHED_NODES * (next + AHEAD * LANES) + n * LANES + k);
            fetch_to_write(pair_nodal_x.data + 4 * next + n * LANES + k, pair_nodal_y.data + 4 * next + n * LANES + k);
        }
    }
}
int* __restrict at = cached_node.data + CACHED_NODES * begin;
real* __restrict cached = cached_number.data + CACHED_NUMBERS * begin;
int slide[LANES], next_slide[LANES], searching[LANES], low[LANES], high[LANES];
real u[LANES], next_u[LANES], side[LANES], offset[LANES];
real dx0[LANES], dx1[LANES], dx2[LANES], dy0[LANES], dy1[LANES], dy2[LANES], bx[LANES], by[LANES];
real e0x[LANES], e0y[LANES], m0x[LANES], m0y[LANES], m1x[LANES], m1y[LANES], gx[LANES], gy[LANES];
real dx[LANES], dy[LANES], ox[LANES], oy[LANES], bend_t[LANES], bend_n[LANES], move[LANES], apart[LANES];
int* __restrict slides = pair_slide.data + begin;
real* __restrict us = pair_u.data + begin;
const int* __restrict lows = pair_low.data + begin;
const int* __restrict highs = pair_high.data + begin;
const int* __restrict sides = pair_side.data + begin;
const real* __restrict offsets = pair_offset.data + begin;
if (count < LANES) {
    for (int l = 0; l < LANES; ++l) {
        next_slide[l] = slide[l] = low[l] = high[l] = 0;
        next_u[l] = u[l] = side[l] = offset[l] = zero;
    }
}
for_each([&](int l) {
    next_slide[l] = slide[l] = slides[l];
    next_u[l] = u[l] = us[l];
    low[l] = lows[l];
    high[l] = highs[l];
    side[l] = real(sides[l]);
    offset[l] = offsets[l];
});
for (int l = 0; l < LANES; ++l) searching[l] = awake[l];
// two pairs have a body
coordinate place_x[LANES] = {}, place_y[LANES] = {};
for_each([&](int l) {
    place_x[l] = body_ux.data[begin / 2 + l / 2];
    place_y[l] = body_uy.data[begin / 2 + l / 2];
});
for (int iteration = 0; iteration < ITERATIONS; ++iteration) {
    int stale = iteration == 0;
    for (int l = 0; l < count; ++l) {
        if (!searching[l]) continue;
        u[l] = next_u[l];
        slide[l] = next_slide[l];
        const int p = begin + l;
        if (cached_slide.data[p] == slide[l]) continue;
        stale = 1;
        cached_slide.data[p] = slide[l];
        const int wire = pair_wire.data[p], first = wire_first.data[wire], nodes = wire_count.data[wire];
        for (int k = 0; k < CACHED_NODES; ++k) {
            int j = pair_seed.data[p] + slide[l] - 1 + k - first;
            if (wire_closed.data[wire])
                j = ((j % nodes) + nodes) % nodes;
            else
                j = j < 0 ? 0 : (j >= nodes ? nodes - 1 : j);
            at[k * LANES + l] = first + j;
        }
        const int t = pair_table.data[p] + slide[l];
        for (int k = 0; k < 3; ++k) {
            cached[k * LANES + l] = rest_x.data[t - 1 + k];
            cached[(3 + k) * LANES + l] = rest_y.data[t - 1 + k];
        }
        cached[6 * LANES + l] = unit * real(pair_rest_x.data[p] - table_x.data[t]);
        cached[7 * LANES + l] = unit * real(pair_rest_y.data[p] - table_y.data[t]);
        for (int k = 0; k < 12; ++k) cached[(8 + k) * LANES + l] = curve.data[CURVE_COEFFICIENTS * t + k];
    }
    const real* __restrict c = cached + 8 * LANES;
    if (stale) {
        // what is not kept yet, or no pair, reads node 0
        const coordinate* __restrict x = ux.data;
        const coordinate* __restrict y = uy.data;
#pragma clang loop vectorize(enable)
        for (int l = 0; l < LANES; ++l) {
            const int a = at[l], b = at[LANES + l], d = at[2 * LANES + l], e = at[3 * LANES + l];
            dx0[l] = real(x[b] - x[a]);
            dx1[l] = real(x[d] - x[b]);
            dx2[l] = real(x[e] - x[d]);
            dy0[l] = real(y[b] - y[a]);
            dy1[l] = real(y[d] - y[b]);
            dy2[l] = real(y[e] - y[d]);
            bx[l] = real(place_x[l] - x[b]);
            by[l] = real(place_y[l] - y[b]);
        }
        {
#pragma clang fp contract(fast)
#pragma clang loop vectorize(enable)
            for (int l = 0; l < LANES; ++l) {
                const real* r = cached + l;
                const real ex = fxx * r[LANES] + fxy * r[4 * LANES] + unit * dx1[l];
                const real ey = fyx * r[LANES] + fyy * r[4 * LANES] + unit * dy1[l];
                const real ax = half * (ex + fxx * r[0] + fxy * r[3 * LANES] + unit * dx0[l]);
                const real ay = half * (ey + fyx * r[0] + fyy * r[3 * LANES] + unit * dy0[l]);
                const real zx = half * (ex + fxx * r[2 * LANES] + fxy * r[5 * LANES] + unit * dx2[l]);
                const real zy = half * (ey + fyx * r[2 * LANES] + fyy * r[5 * LANES] + unit * dy2[l]);
                e0x[l] = ex;
                e0y[l] = ey;
                const real p0 = one + c[l], q0 = c[LANES + l], p1 = one + c[10 * LANES + l], q1 = c[11 * LANES + l];
                m0x[l] = p0 * ax - q0 * ay;
                m0y[l] = p0 * ay + q0 * ax;
                m1x[l] = p1 * zx - q1 * zy;
                m1y[l] = p1 * zy + q1 * zx;
                gx[l] = fxx * r[6 * LANES] + fxy * r[7 * LANES] + unit * bx[l];
                gy[l] = fyx * r[6 * LANES] + fyy * r[7 * LANES] + unit * by[l];
            }
        }
    }
    int going = 0;
    {
// point, slope and curvature of the curve, and the Newton step towards the closest point
#pragma clang fp contract(fast)
#pragma clang loop vectorize(enable)
        for (int l = 0; l < LANES; ++l) {
            const real v = u[l], w = one - v;
            const real h10 = v * w * w, h01 = v * v * (three - two * v), h11 = -v * v * w;
            const real d10 = w * (one - three * v), d01 = six * v * w, d11 = v * (three * v - two);
            const real c10 = six * v - four, c01 = six - six * two * v, c11 = six * v - two;
            const real rise = v * w, bump = rise * rise, bump_slope = two * rise * (one - two * v);
            const real t0 = c[2 * LANES + l], t1 = c[3 * LANES + l], t2 = c[4 * LANES + l], t3 = c[5 * LANES + l];
            const real n0 = c[6 * LANES + l], n1 = c[7 * LANES + l], n2 = c[8 * LANES + l], n3 = c[9 * LANES + l];
            const real along = t0 + v * (t1 + v * (t2 + v * t3)), across = n0 + v * (n1 + v * (n2 + v * n3));
            const real along_slope = t1 + v * (two * t2 + three * t3 * v);
            const real across_slope = n1 + v * (two * n2 + three * n3 * v);
            const real bt = h01 + bump * along, bn = bump * across;
            const real st = d01 + bump_slope * along + bump * along_slope;
            const real sn = bump_slope * across + bump * across_slope;
            const real px = h10 * m0x[l] + bt * e0x[l] - bn * e0y[l] + h11 * m1x[l];
            const real py = h10 * m0y[l] + bt * e0y[l] + bn * e0x[l] + h11 * m1y[l];
            const real sx = d10 * m0x[l] + st * e0x[l] - sn * e0y[l] + d11 * m1x[l];
            const real sy = d10 * m0y[l] + st * e0y[l] + sn * e0x[l] + d11 * m1y[l];
            const real ax = c10 * m0x[l] + c01 * e0x[l] + c11 * m1x[l];
            const real ay = c10 * m0y[l] + c01 * e0y[l] + c11 * m1y[l];
            const real qx = gx[l] - px, qy = gy[l] - py;
            const real square = sx * sx + sy * sy;
            const real bent = square - (qx * ax + qy * ay), least = real(0.25) * square;
            const real step = (qx * sx + qy * sy) / (bent > least ? bent : least);
            move[l] = v + (step > one ? one : (step < -one ? -one : step));
            const real away = side[l] * (sx * qy - sy * qx);
            apart[l] = away > zero ? away * away - open_square * square : -one;
            dx[l] = sx;
            dy[l] = sy;
            ox[l] = qx;
            oy[l] = qy;
            bend_t[l] = bt;
            bend_n[l] = bn;
        }
#pragma clang loop vectorize(enable)
        for (int l = 0; l < LANES; ++l) {
            const int down = move[l] < zero && slide[l] > low[l], up = move[l] > one && slide[l] < high[l];
            const real there = down ? move[l] + one : (up ? move[l] - one : move[l]);
            const real target = there < zero ? zero : (there > one ? one : there);
            const real change = target - u[l];
            const int done = !down & !up & (change < tolerance) & (change > -tolerance);
            const int wants = searching[l] & !done;
            next_u[l] = wants ? target : next_u[l];
            next_slide[l] = wants ? slide[l] - down + up : next_slide[l];
            // a pair well open here, across the wire, moves its point once a step; only near contact must it be exact
            searching[l] = wants & !(apart[l] > zero);
            going |= searching[l];
        }
    }
    if (!going) break;
}
real fx[LANES], fy[LANES], force[LANES], gap[LANES];
real x0[LANES], y0[LANES], x1[LANES], y1[LANES], x2[LANES], y2[LANES], x3[LANES], y3[LANES];
{
#pragma clang fp contract(fast)
    const real* __restrict c = cached + 8 * LANES;
#pragma clang loop vectorize(enable)
    for (int l = 0; l < LANES; ++l) {
        const real speed = one / sqrt(dx[l] * dx[l] + dy[l] * dy[l]);
        const real nx = -side[l] * dy[l] * speed, ny = side[l] * dx[l] * speed;
        gap[l] = nx * ox[l] + ny * oy[l] - reach;
        const real push = offset[l] - stiffness * gap[l];
        force[l] = awake[l] && push > zero ? push : zero;
        const real x = force[l] > zero ? force[l] * nx : zero, y = force[l] > zero ? force[l] * ny : zero;
        fx[l] = x;
        fy[l] = y;
        // transposed weights of the chord and of the two tangents
        const real v = u[l], w = one - v;
        const real h10 = half * v * w * w, h11 = -half * v * v * w;
        const real cx = bend_t[l] * x + bend_n[l] * y, cy = bend_t[l] * y - bend_n[l] * x;
        const real p0 = h10 * (one + c[l]), q0 = -h10 * c[LANES + l];
        const real p1 = h11 * (one + c[10 * LANES + l]), q1 = -h11 * c[11 * LANES + l];
        const real before_x = p0 * x - q0 * y, before_y = p0 * y + q0 * x;
        const real after_x = p1 * x - q1 * y, after_y = p1 * y + q1 * x;
        x0[l] = before_x;
        y0[l] = before_y;
        x1[l] = cx + after_x - x;
        y1[l] = cy + after_y - y;
        x2[l] = -(cx + before_x);
        y2[l] = -(cy + before_y);
        x3[l] = -after_x;
        y3[l] = -after_y;
    }
}
real* __restrict out_x = pair_nodal_x.data + 4 * begin;
real* __restrict out_y = pair_nodal_y.data + 4 * begin;
int* __restrict node = pair_node.data + begin;
real* __restrict gaps = pair_gap.data + begin;
real* __restrict forces = pair_force.data + begin;
real* __restrict body_x = pair_body_x.data + begin;
real* __restrict body_y = pair_body_y.data + begin;
for_each([&](int l) {
    slides[l] = next_slide[l];
    us[l] = next_u[l];
    forces[l] = force[l];
    node[l] = awake[l] ? at[LANES + l] : node[l];
    gaps[l] = awake[l] ? gap[l] : gaps[l];
    body_x[l] = fx[l];
    body_y[l] = fy[l];
});
for_each([&](int l) {
    out_x[4 * l] = x0[l];
    out_x[4 * l + 1] = x1[l];
    out_x[4 * l + 2] = x2[l];
    out_x[4 * l + 3] = x3[l];
});
for_each([&](int l) {
    out_y[4 * l] = y0[l];
    out_y[4 * l + 1] = y1[l];
    out_y[4 * l + 2] = y2[l];
    out_y[4 * l + 3] = y3[l];
});
