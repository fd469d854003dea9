// A step of BODY_BLOCK bodies (kernels/bodies.py).
#include "sharing.h"
typedef decltype(unit) real;
typedef decltype(ux.data[0] + ux.data[0]) coordinate;
const bool counted = coordinate(0.5) == coordinate(0); // see wires.py
const double* steer = control.data;
const real inverse_mass = real(steer[BODY_INVERSE_MASS]), velocity_factor = real(steer[VELOCITY_FACTOR]);
const real force_factor = real(steer[FORCE_FACTOR]) * inverse_mass, look_ahead = real(steer[LOOK_AHEAD]);
const real zero = 0, counts = real(steer[TIME_STEP]) / unit;
const int begin = BODY_BLOCK * block, left = ux.shape[0] - begin, count = left < BODY_BLOCK ? left : BODY_BLOCK;
const real still = sizeof(real) == 4 ? real(1e-18) : real(1e-150);
const real* __restrict force = pair_force.data + 2 * begin;
const real* __restrict on_x = pair_body_x.data + 2 * begin;
const real* __restrict on_y = pair_body_y.data + 2 * begin;
coordinate* __restrict moved_x = ux.data + begin;
coordinate* __restrict moved_y = uy.data + begin;
real* __restrict speed_x = vx.data + begin;
real* __restrict speed_y = vy.data + begin;
real square = 0, speed = 0;
SHARED real ff[BODY_BLOCK], qq[BODY_BLOCK];
{
    VECTORISED
    EACH(i, 0, count) {
        const real first = force[2 * i], second = force[2 * i + 1];
        const real fx = (first != zero ? on_x[2 * i] : zero) + (second != zero ? on_x[2 * i + 1] : zero);
        const real fy = (first != zero ? on_y[2 * i] : zero) + (second != zero ? on_y[2 * i + 1] : zero);
        const real kept = slow_when_free && first == zero && second == zero ? real(FREE_FLIGHT) : real(1);
        const real px = kept * speed_x[i], py = kept * speed_y[i];
        real qx = velocity_factor * px + force_factor * fx;
        real qy = velocity_factor * py + force_factor * fy;
        // what dies out stops before its square is a denormal number, which is slow
        qx = (qx < still && qx > -still) ? zero : qx;
        qy = (qy < still && qy > -still) ? zero : qy;
        speed_x[i] = qx;
        speed_y[i] = qy;
        const real move_x = (qx + look_ahead * (qx - px)) * counts;
        moved_x[i] += counted ? coordinate(floor(move_x + phase)) : coordinate(move_x);
        const real move_y = (qy + look_ahead * (qy - py)) * counts;
        moved_y[i] += counted ? coordinate(floor(move_y + phase)) : coordinate(move_y);
        const real f2 = fx * fx + fy * fy, q2 = qx * qx + qy * qy;
        square += f2;
        speed += q2;
        // a body that one wire drags along is on its way, not out of balance
        ff[i] = first != zero && second != zero ? f2 : zero;
        qq[i] = q2;
    }
}
real strongest = 0, fastest = 0;
EACH(i, 0, count) {
    strongest = ff[i] > strongest ? ff[i] : strongest;
    fastest = qq[i] > fastest ? qq[i] : fastest;
}
const double kinetic = double(speed) / inverse_mass;
double stress[4] = {};
double* row = partial.data + PARTIAL_COUNT * block;
#include "sum_of_lanes.h"
