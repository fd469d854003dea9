// Frames and positions of a block of nodes of rods (kernels/rod_frames.py).
typedef decltype(pending_turn.data[0] + pending_turn.data[0]) real;
#include "rod_block.h"
// The sine and the cosine are series to round-off up to HALF a radian, which a step hardly ever exceeds.
const double fxx = steer[GRADIENT], fxy = steer[GRADIENT + 1], fyx = steer[GRADIENT + 2], fyy = steer[GRADIENT + 3];
const real HALF = 0.5;
const int segments = !closed && first + count == wire_end ? count - 1 : count;
const double* __restrict rest = (const double*)(rest_position.data + first);
const double* __restrict span = (const double*)(rest_edge.data + first + to_row);
const double* __restrict moved = (const double*)displacement.data;
double* __restrict place = (double*)(position.data + first);
real* __restrict t = (real*)(tangent.data + first);
real* __restrict d = (real*)(director.data + first);
real* __restrict turn = pending_turn.data + first;
double* __restrict size = length.data + first;
SHARED double ux[SPAN], uy[SPAN], uz[SPAN];
Own sines, cosines, sx, sy, sz;
EACH(k, 0, count + 1) {
    int i = first + k;
    if (i >= wire_end) i = closed ? wire_begin : wire_end - 1;
    ux[k] = moved[3 * i];
    uy[k] = moved[3 * i + 1];
    uz[k] = moved[3 * i + 2];
}
TOGETHER
int is_wide = 0;
{
    VECTORISED
    EACH(k, 0, segments) {
        const real a = turn[k], z = a * a;
        is_wide |= z > HALF * HALF ? 1 : 0;
        sines[k] = a *
            (1 +
             z *
                 (real(-1.0 / 6) +
                  z *
                      (real(1.0 / 120) +
                       z *
                           (real(-1.0 / 5040) +
                            z * (real(1.0 / 362880) + z * (real(-1.0 / 39916800) + z * real(1.0 / 6227020800)))))));
        cosines[k] = 1 +
            z *
                (real(-1.0 / 2) +
                 z *
                     (real(1.0 / 24) +
                      z *
                          (real(-1.0 / 720) +
                           z *
                               (real(1.0 / 40320) +
                                z * (real(-1.0 / 3628800) + z * (real(1.0 / 479001600) + z * real(-1.0 / 87178291200)))))));
    }
}
if (is_wide) {
    EACH(k, 0, segments) {
        sines[k] = wp::sin(turn[k]);
        cosines[k] = wp::cos(turn[k]);
    }
}
{
    VECTORISED
    EACH(k, 0, count) {
        place[3 * k] = fxx * rest[3 * k] + fxy * rest[3 * k + 1] + ux[k];
        place[3 * k + 1] = fyx * rest[3 * k] + fyy * rest[3 * k + 1] + uy[k];
        place[3 * k + 2] = rest[3 * k + 2] + uz[k];
    }
}
{
    VECTORISED
    EACH(k, 0, segments) {
        const double ex = fxx * span[3 * k] + fxy * span[3 * k + 1] + (ux[k + 1] - ux[k]);
        const double ey = fyx * span[3 * k] + fyy * span[3 * k + 1] + (uy[k + 1] - uy[k]);
        const double ez = span[3 * k + 2] + (uz[k + 1] - uz[k]);
        const double l = sqrt(ex * ex + ey * ey + ez * ez), inverse = 1 / l;
        size[k] = l;
        sx[k] = ex * inverse;
        sy[k] = ey * inverse;
        sz[k] = ez * inverse;
    }
}
{
    VECTORISED
    EACH(k, 0, segments) {
        const real px = t[3 * k], py = t[3 * k + 1], pz = t[3 * k + 2], tx = sx[k], ty = sy[k], tz = sz[k];
        const real vx = d[3 * k], vy = d[3 * k + 1], vz = d[3 * k + 2];
        const real bx = py * tz - pz * ty, by = pz * tx - px * tz, bz = px * ty - py * tx;
        const real c = px * tx + py * ty + pz * tz;
        const real along = (bx * vx + by * vy + bz * vz) / (1 + c);
        real wx = c * vx + by * vz - bz * vy + bx * along;
        real wy = c * vy + bz * vx - bx * vz + by * along;
        real wz = c * vz + bx * vy - by * vx + bz * along;
        const real off = wx * tx + wy * ty + wz * tz;
        wx -= off * tx;
        wy -= off * ty;
        wz -= off * tz;
        const real unit = 1 / sqrt(wx * wx + wy * wy + wz * wz);
        const real co = cosines[k] * unit, si = sines[k] * unit;
        // frames of a state that has not changed stay as they are, however often they are computed
        const bool same = turn[k] == 0 && px == tx && py == ty && pz == tz;
        t[3 * k] = tx;
        t[3 * k + 1] = ty;
        t[3 * k + 2] = tz;
        d[3 * k] = same ? vx : co * wx + si * (ty * wz - tz * wy);
        d[3 * k + 1] = same ? vy : co * wy + si * (tz * wx - tx * wz);
        d[3 * k + 2] = same ? vz : co * wz + si * (tx * wy - ty * wx);
        turn[k] = 0;
    }
}
