// Forces of a block of nodes of rods (kernels/rod_forces.py, for the equations).
typedef decltype(tangent.data[0].c[0] + tangent.data[0].c[0]) real;
#include "rod_block.h"
#include "rod_around.h"
// what the slopes of a moment (x, y) along both segments add at their node: by_x, by_y
#define SLOPES_OF(x, y) \
    const real from_x = x[k] - cos_r[k - 1] * x[k - 1] - sin_r[k - 1] * y[k - 1]; \
    const real from_y = y[k] + sin_r[k - 1] * x[k - 1] - cos_r[k - 1] * y[k - 1]; \
    const real to_x = cos_r[k] * x[k + 1] - sin_r[k] * y[k + 1] - x[k]; \
    const real to_y = sin_r[k] * x[k + 1] + cos_r[k] * y[k + 1] - y[k]; \
    const real by_x = (sixth[k - 1] * from_x - sixth[k] * to_x) * softness; \
    const real by_y = (sixth[k - 1] * from_y - sixth[k] * to_y) * softness;
const bool steps = steer[STATUS] == STATUS_RUNNING;
const int* start_of_first = touch_first_start.data;
const int* start_of_second = touch_second_start.data;
#ifndef __CUDA_ARCH__
#include "prefetch.h"
const auto fetch_near = [](const auto*... addresses) { (__builtin_prefetch(addresses, 0, 2), ...); };
// forces of contacts are needed below, from far apart
for (int side = 0; side < 2; ++side) {
    const int* start = side ? start_of_second : start_of_first;
    for (int q = start[first]; q < start[first + count]; ++q) {
        const int touch = side ? touch_of_second.data[q] : q;
        const char* push = (const char*)(touch_force.data + 8 * touch + 4 * side);
        const char* couple = (const char*)(touch_couple.data + 6 * touch + 3 * side);
        fetch(touch_loaded.data + touch);
        fetch_near(push, push + 4 * sizeof(touch_force.data[0]) - 1, couple, couple + 3 * sizeof(touch_couple.data[0]) - 1);
    }
}
#endif
const double bending_stiffness = wire_bending.data[wire], yield_curvature = wire_yield.data[wire];
const bool any_yields = yield_curvature > 0 && hardening < 1;
// on a CPU compiled for elastic wires and for those that yield
struct elastic {
    static constexpr bool yields() { return false; }
};
struct plastic {
    static constexpr bool yields() { return true; }
};
auto find = [&](auto kind) {
#ifdef __CUDA_ARCH__
    const bool yields = any_yields;
#else
    const bool yields = decltype(kind)::yields();
#endif
    const double length_factor = steer[LENGTH_FACTOR];
    const real factor = length_factor, bow_moment = steer[BOW_MOMENT];
    const real yield = yield_curvature, not_kept = 1 - hardening;
    const real small = 1e-4; // |k| below which two terms of the series are exact to round-off
    SHARED real tx[SPAN], ty[SPAN], tz[SPAN], dx[SPAN], dy[SPAN], dz[SPAN], il[SPAN], sixth[SPAN], cos_r[SPAN];
    SHARED real sin_r[SPAN];
    Own pull, spread, own_x, own_y, own_m, flow_x, flow_y;
    SHARED real s11[SPAN], s12[SPAN], s22[SPAN], s13[SPAN], s23[SPAN], s33[SPAN], arc_pull[SPAN];
    {
        const double* turned_by = (const double*)moment_turn.data;
        const real* t = (const real*)tangent.data;
        const real* d = (const real*)director.data;
        const double* bent = (const double*)natural_curvature.data;
        const double* flow = (const double*)plastic_turn.data;
        const auto load = [&](int k, int i) {
            tx[k] = t[3 * i];
            ty[k] = t[3 * i + 1];
            tz[k] = t[3 * i + 2];
            dx[k] = d[3 * i];
            dy[k] = d[3 * i + 1];
            dz[k] = d[3 * i + 2];
            const int row = i + to_row;
            // the elongation is a small difference
            const double arc = natural_length.data[i] * length_factor;
            const real rest = arc, longer = length.data[i] - arc, offset = tension_offset.data[i];
            il[k] = 1 / real(length.data[i]);
            pull[k] = has[k] * (offset + real(stretch_stiffness.data[i]) * longer / rest);
            spread[k] = inner[k] / real(node_length.data[row] * length_factor);
            own_x[k] = bent[2 * row];
            own_y[k] = bent[2 * row + 1];
            own_m[k] = natural_twist.data[row];
            flow_x[k] = yields ? flow[2 * i] : real(0.0);
            flow_y[k] = yields ? flow[2 * i + 1] : real(0.0);
            sixth[k] = has[k] * real(slope_length.data[row]) * factor / 6;
            arc_pull[k] = 36 * sixth[k] * sixth[k] * rest * pull[k];
            const double* __restrict stiff = node_stiffness.data + 6 * row;
            const real share = inner[k] / factor;
            s11[k] = share * real(stiff[0]);
            s12[k] = share * real(stiff[1]);
            s22[k] = share * real(stiff[2]);
            s13[k] = share * real(stiff[3]);
            s23[k] = share * real(stiff[4]);
            s33[k] = share * real(stiff[5]);
            cos_r[k] = turned_by[2 * row];
            sin_r[k] = turned_by[2 * row + 1];
        };
        if (inside) {
            EACH(k, 0, whole) load(k, first - HALO + k);
        } else {
            EACH(k, 0, whole) load(k, at[k]);
        }
    }
    TOGETHER
    // turning vector and twist at a node, and the moment of the turn
    SHARED real kx[SPAN], ky[SPAN], size_part[SPAN], size_slope[SPAN], bow_x[SPAN], bow_y[SPAN], twist_moment[SPAN];
    SHARED real nbx[SPAN], nby[SPAN], nbz[SPAN], shared[SPAN], mx[SPAN], my[SPAN];
    Own turn_x, turn_y, turned, softer, elastic_x, elastic_y, back_x, back_y;
    const real back = yields ? hardening / (1 - hardening) : real(0.0), softness = 1 / bending_stiffness;
    const auto yield_turn = [&](int k) { return spread[k] > 0 ? yield / (spread[k] > 0 ? spread[k] : real(1.0)) : real(0.0); };
    if (lane == 0) mx[0] = my[0] = mx[whole] = my[whole] = 0;
    {
        VECTORISED
        EACH(k, 1, whole) {
            const real ex = tx[k - 1], ey = ty[k - 1], ez = tz[k - 1], fx = tx[k], fy = ty[k], fz = tz[k];
            const real ax = dx[k - 1], ay = dy[k - 1], az = dz[k - 1], cx = dx[k], cy = dy[k], cz = dz[k];
            const real bx = ey * az - ez * ay, by = ez * ax - ex * az, bz = ex * ay - ey * ax;
            const real hx = fy * cz - fz * cy, hy = fz * cx - fx * cz, hz = fx * cy - fy * cx;
            const real dot = ex * fx + ey * fy + ez * fz, share = 1 / (1 + dot);
            const real vx = ey * fz - ez * fy, vy = ez * fx - ex * fz, vz = ex * fy - ey * fx;
            const real nx = 2 * share * vx, ny = 2 * share * vy, nz = 2 * share * vz;
            const real k1 = real(0.5) * ((bx + hx) * nx + (by + hy) * ny + (bz + hz) * nz);
            const real k2 = real(-0.5) * ((ax + cx) * nx + (ay + cy) * ny + (az + cz) * nz);
            // twist: the angle from the director before, transported, to the one after
            const real lean_on = share * (vx * ax + vy * ay + vz * az);
            const real px = dot * ax + vy * az - vz * ay + vx * lean_on;
            const real py = dot * ay + vz * ax - vx * az + vy * lean_on;
            const real pz = dot * az + vx * ay - vy * ax + vz * lean_on;
            const real sine = (py * cz - pz * cy) * fx + (pz * cx - px * cz) * fy + (px * cy - py * cx) * fz;
            const real cosine = px * cx + py * cy + pz * cz;
            real m;
            {
                const real over = sine, under = 1 + cosine;
#include "arctangent.h"
                m = 2 * (over < 0 ? -folded : folded);
            }
            // share of the turning vector and its slope: 2 atan(x/2)/x
            const real square = k1 * k1 + k2 * k2, size = sqrt(square), half = real(0.5) * size;
            real part;
            {
                const real over = half, under = 1;
#include "arctangent.h"
                part = half > real(1e-8) ? folded / (half > real(1e-8) ? half : real(1.0)) : real(1.0);
            }
            const real steep_slope = (1 / (1 + real(0.25) * square) - part) / (size > small ? square : real(1.0));
            const real angle_x = part * k1, angle_y = part * k2;
            const real trial_x = angle_x - own_x[k] - flow_x[k], trial_y = angle_y - own_y[k] - flow_y[k];
            const real beyond_x = trial_x - back * flow_x[k], beyond_y = trial_y - back * flow_y[k];
            const real reach = sqrt(beyond_x * beyond_x + beyond_y * beyond_y);
            const real most = yield_turn(k);
            const bool over_most = yields && reach > most;
            const real inverse = over_most ? 1 / (reach > most ? reach : real(1.0)) : real(0.0);
            const real off = over_most ? not_kept * (1 - most * inverse) : real(0.0);
            const real change_x = trial_x - off * beyond_x, change_y = trial_y - off * beyond_y, change = m - own_m[k];
            const real bow = bow_moment * spread[k] * spread[k] * (arc_pull[k - 1] + arc_pull[k]);
            kx[k] = k1;
            ky[k] = k2;
            size_part[k] = part;
            size_slope[k] = size > small ? steep_slope : real(-1.0 / 6);
            nbx[k] = nx;
            nby[k] = ny;
            nbz[k] = nz;
            shared[k] = share;
            mx[k] = s11[k] * change_x + s12[k] * change_y + s13[k] * change;
            my[k] = s12[k] * change_x + s22[k] * change_y + s23[k] * change;
            twist_moment[k] = s13[k] * change_x + s23[k] * change_y + s33[k] * change;
            bow_x[k] = bow * angle_x;
            bow_y[k] = bow * angle_y;
            softer[k] = off;
            elastic_x[k] = change_x;
            elastic_y[k] = change_y;
            back_x[k] = back * (flow_x[k] + off * beyond_x);
            back_y[k] = back * (flow_y[k] + off * beyond_y);
            turn_x[k] = inner[k] * angle_x;
            turn_y[k] = inner[k] * angle_y;
            turned[k] = inner[k] * m;
        }
    }
    TOGETHER
    // moments with the first correction by their slopes along both segments
    SHARED real uy[SPAN];
    SHARED_AGAIN(ux, arc_pull)
    if (lane == 0) ux[0] = uy[0] = ux[whole] = uy[whole] = 0;
    {
        VECTORISED
        EACH(k, 1, whole) {
            SLOPES_OF(mx, my)
            ux[k] = mx[k] + s11[k] * by_x + s12[k] * by_y;
            uy[k] = my[k] + s12[k] * by_x + s22[k] * by_y;
        }
    }
    TOGETHER
    // gradients of bending and twist by the edges before and after a node, and by the angles of both segments
    SHARED_AGAIN(gbx, nbx)
    SHARED_AGAIN(gby, nby)
    SHARED_AGAIN(gbz, nbz)
    SHARED_AGAIN(gax, kx)
    SHARED_AGAIN(gay, ky)
    SHARED_AGAIN(gaz, size_part)
    SHARED_AGAIN(gb, shared)
    SHARED_AGAIN(ga, size_slope)
    Own acting_x, acting_y, acting_m;
    {
        VECTORISED
        EACH(k, 1, whole) {
            const real ex = tx[k - 1], ey = ty[k - 1], ez = tz[k - 1], fx = tx[k], fy = ty[k], fz = tz[k];
            const real ax = dx[k - 1], ay = dy[k - 1], az = dz[k - 1], cx = dx[k], cy = dy[k], cz = dz[k];
            const real bx = ey * az - ez * ay, by = ez * ax - ex * az, bz = ex * ay - ey * ax;
            const real hx = fy * cz - fz * cy, hy = fz * cx - fx * cz, hz = fx * cy - fy * cx;
            const real nx = nbx[k], ny = nby[k], nz = nbz[k], share = shared[k], k1 = kx[k], k2 = ky[k];
            // what the slopes of the moments add
            SLOPES_OF(ux, uy)
            const real add_x = s11[k] * by_x + s12[k] * by_y, add_y = s12[k] * by_x + s22[k] * by_y;
            real moment_x = mx[k] + add_x + bow_x[k], moment_y = my[k] + add_y + bow_y[k];
            real g = twist_moment[k] + s13[k] * by_x + s23[k] * by_y;
            if (yields) { // where this leads beyond the yield surface, the wire gives way
                const real out_x = elastic_x[k] + by_x - back_x[k], out_y = elastic_y[k] + by_y - back_y[k];
                const real reach = sqrt(out_x * out_x + out_y * out_y);
                const real most = yield_turn(k);
                const bool over_most = reach > most;
                const real gives = over_most ? not_kept * (1 - most / (over_most ? reach : real(1.0))) : real(0.0);
                moment_x -= gives * (s11[k] * out_x + s12[k] * out_y);
                moment_y -= gives * (s12[k] * out_x + s22[k] * out_y);
                g -= gives * (s13[k] * out_x + s23[k] * out_y);
            }
            acting_x[k] = inner[k] * moment_x;
            acting_y[k] = inner[k] * moment_y;
            const real both = size_slope[k] * (k1 * moment_x + k2 * moment_y);
            const real g1 = size_part[k] * moment_x + both * k1, g2 = size_part[k] * moment_y + both * k2;
            acting_m[k] = inner[k] * g;
            const real lean = -(g1 * k1 + g2 * k2) * share;
            const real qx = share * (g1 * (bx + hx) - g2 * (ax + cx));
            const real qy = share * (g1 * (by + hy) - g2 * (ay + cy));
            const real qz = share * (g1 * (bz + hz) - g2 * (az + cz));
            const real sx = lean * (ex + fx) + real(0.5) * g * nx, sy = lean * (ey + fy) + real(0.5) * g * ny;
            const real sz = lean * (ez + fz) + real(0.5) * g * nz;
            gbx[k] = il[k - 1] * (sx + fy * qz - fz * qy);
            gby[k] = il[k - 1] * (sy + fz * qx - fx * qz);
            gbz[k] = il[k - 1] * (sz + fx * qy - fy * qx);
            gax[k] = il[k] * (sx - ey * qz + ez * qy);
            gay[k] = il[k] * (sy - ez * qx + ex * qz);
            gaz[k] = il[k] * (sz - ex * qy + ey * qx);
            gb[k] = real(-0.5) * ((g1 * ax + g2 * bx) * nx + (g1 * ay + g2 * by) * ny + (g1 * az + g2 * bz) * nz) - g;
            ga[k] = real(-0.5) * ((g1 * cx + g2 * hx) * nx + (g1 * cy + g2 * hy) * ny + (g1 * cz + g2 * hz) * nz) + g;
        }
    }
    // contact: forces on four nodes and couples on three sections from each contact of a segment
    SHARED real cfz[SPAN], ccx[SPAN], ccy[SPAN], ccz[SPAN];
    SHARED_AGAIN(cfx, bow_x)
    SHARED_AGAIN(cfy, bow_y)
    EACH(k, 0, whole) cfx[k] = cfy[k] = cfz[k] = ccx[k] = ccy[k] = ccz[k] = 0;
// on a GPU a node at a time of each segment, so that no two threads add to the same one
#ifdef __CUDA_ARCH__
    enum { TURNS = 4 };
#else
    enum { TURNS = 1 };
#endif
    for (int now = 0; now < TURNS; ++now) {
        TOGETHER
        EACH(k, HALO - 2, HALO + count + 1) {
            if (has[k] == 0) continue;
            for (int side = 0; side < 2; ++side) {
                const int* start = (side ? start_of_second : start_of_first) + at[k];
                for (int q = start[0]; q < start[1]; ++q) {
                    const int touch = side ? touch_of_second.data[q] : q;
                    if (!touch_loaded.data[touch]) continue;
                    const real* push = (const real*)(touch_force.data + 8 * touch + 4 * side);
                    const real* couple = (const real*)(touch_couple.data + 6 * touch + 3 * side);
                    for (int a = now; a < 4; a += TURNS) {
                        cfx[k - 1 + a] += push[3 * a];
                        cfy[k - 1 + a] += push[3 * a + 1];
                        cfz[k - 1 + a] += push[3 * a + 2];
                    }
                    for (int a = now; a < 3; a += TURNS) {
                        ccx[k - 1 + a] += couple[3 * a];
                        ccy[k - 1 + a] += couple[3 * a + 1];
                        ccz[k - 1 + a] += couple[3 * a + 2];
                    }
                }
            }
        }
    }
    TOGETHER
    if (steer[DEAD_LOAD] != 0) {
        const double* given = (const double*)(load_force.data + first - HALO);
        EACH(k, HALO, HALO + count) {
            cfx[k] += given[3 * k];
            cfy[k] += given[3 * k + 1];
            cfz[k] += given[3 * k + 2];
        }
    }
    // forces of the segments, and their sums
    SHARED_AGAIN(nx, dx)
    SHARED_AGAIN(ny, dy)
    SHARED_AGAIN(nz, dz)
    {
        VECTORISED
        EACH(k, HALO - 1, HALO + count) {
            const real x = ty[k] * ccz[k] - tz[k] * ccy[k], y = tz[k] * ccx[k] - tx[k] * ccz[k];
            const real z = tx[k] * ccy[k] - ty[k] * ccx[k];
            nx[k] = has[k] * (pull[k] * tx[k] + gax[k] + gbx[k + 1] + il[k] * x);
            ny[k] = has[k] * (pull[k] * ty[k] + gay[k] + gby[k + 1] + il[k] * y);
            nz[k] = has[k] * (pull[k] * tz[k] + gaz[k] + gbz[k + 1] + il[k] * z);
        }
    }
    TOGETHER
    real* __restrict sum = (real*)(force.data + first - HALO - stored_from);
    double* __restrict edge = (double*)(edge_force.data + first - HALO);
    double* __restrict turning = (double*)(curvature.data + first - HALO);
    double* __restrict acting = (double*)(moment.data + first - HALO);
    EACH(k, HALO, HALO + count) {
        sum[3 * k] = cfx[k] + (nx[k] - nx[k - 1]);
        sum[3 * k + 1] = cfy[k] + (ny[k] - ny[k - 1]);
        sum[3 * k + 2] = cfz[k] + (nz[k] - nz[k - 1]);
        const real about = ccx[k] * tx[k] + ccy[k] * ty[k] + ccz[k] * tz[k];
        torque.data[first - HALO + k - stored_from] = has[k] * (about - ga[k] - gb[k + 1]);
    }
    if (steps && steer[IS_DRIVEN] == 0 && steer[IS_DRIVEN + 1] == 0) return;
    EACH(k, HALO, HALO + count) {
        edge[3 * k] = nx[k];
        edge[3 * k + 1] = ny[k];
        edge[3 * k + 2] = nz[k];
    }
    if (steps) return;
    EACH(k, HALO, HALO + count) {
        turning[2 * k] = turn_x[k];
        turning[2 * k + 1] = turn_y[k];
        acting[3 * k] = acting_x[k];
        acting[3 * k + 1] = acting_y[k];
        acting[3 * k + 2] = acting_m[k];
        twist.data[first - HALO + k] = turned[k];
        // energies of the elastic turn and the twist, of the slope along the segment behind, and q . S q/2
        const real trial_x = turn_x[k] - own_x[k] - flow_x[k], trial_y = turn_y[k] - own_y[k] - flow_y[k];
        const real change_x = trial_x - softer[k] * (trial_x - back * flow_x[k]);
        const real change_y = trial_y - softer[k] * (trial_y - back * flow_y[k]), change = turned[k] - own_m[k];
        SLOPES_OF(mx, my)
        const real at_node = change_x * mx[k] + change_y * my[k] + change * twist_moment[k];
        const real along = sixth[k] * softness * (to_x * to_x + to_y * to_y);
        const real again = s11[k] * by_x * by_x + 2 * s12[k] * by_x * by_y + s22[k] * by_y * by_y;
        bend_energy.data[first - HALO + k] = real(0.5) * (at_node + along + again);
    }
};
#ifndef __CUDA_ARCH__
if (!any_yields) {
    find(elastic());
    return;
}
#endif
find(plastic());
