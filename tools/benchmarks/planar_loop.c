/* The planar step of kernels/wires.py for free wires, as a plain C loop: the reference that tools/benchmarks/planar.py measures beside.

   Structure of arrays, chunks of 512 nodes, rest data of one repeat read over and over. Stretch, exact discrete bending by
   the angle between edges, central differences with damping; displacements u, velocities v. One closed wire of n nodes.

   gcc -O3 -march=native -ffast-math -fopenmp -shared -fPIC -DREAL=float planar_loop.c
*/
#include <math.h>
#include <stdint.h>

#ifndef REAL
#define REAL float
#endif
enum { CHUNK = 512, HALO = 2, SPAN = CHUNK + 2 * HALO };

/* angle from edge a to edge b of unit length, by tan(angle / 2) folded once; see wire_forces.py for the polynomial */
static inline REAL turning(REAL sine, REAL cosine) {
    const REAL below = 1 + cosine;
    const REAL a = sine < 0 ? -sine : sine;
    const int steep = a > (REAL)2.414213562373095 * below;
    const int middle = !steep && a > (REAL)0.4142135623730951 * below;
    const REAL top = steep ? -below : (middle ? a - below : a);
    const REAL bottom = steep ? a : (middle ? a + below : below);
    const REAL x = top / (bottom > (REAL)1e-12 ? bottom : (REAL)1e-12);
    const REAL z = x * x;
    REAL series;
    if (sizeof(REAL) == 4) {
        series = (REAL)0.9999999993712282 + z * ((REAL)-0.33333306893048514 + z * ((REAL)0.19998183041083206
               + z * ((REAL)-0.14239532669648974 + z * ((REAL)0.10569828806414448 + z * (REAL)-0.06026305227658459))));
    } else {
        series = (REAL)-0.017805397205419446;
        series = (REAL)0.03796525745386593 + z * series;
        series = (REAL)-0.05035102456601552 + z * series;
        series = (REAL)0.05846878297330872 + z * series;
        series = (REAL)-0.06662951813629191 + z * series;
        series = (REAL)0.07692045330902225 + z * series;
        series = (REAL)-0.09090896809064027 + z * series;
        series = (REAL)0.11111110744919658 + z * series;
        series = (REAL)-0.14285714279250245 + z * series;
        series = (REAL)0.19999999999940893 + z * series;
        series = (REAL)-0.3333333333333312 + z * series;
        series = 1 + z * series;
    }
    const REAL folded = x * series + (middle ? (REAL)0.7853981633974483 : 0) + (steep ? (REAL)1.5707963267948966 : 0);
    return 2 * (sine < 0 ? -folded : folded);
}

/* Steps `steps` times from (ux, uy) to (wx, wy) and back: an even number. Rest data have `period` entries and 2 * CHUNK behind
   them that go on periodically. gradient: xx, xy, yx, yy. */
void take_steps(int64_t n, int64_t period, int steps, int threads, REAL *ux, REAL *uy, REAL *wx, REAL *wy, REAL *vx, REAL *vy,
                const REAL *rest_x, const REAL *rest_y, const REAL *rest_length, const REAL *rest_angle, const REAL *hinge,
                const REAL *inverse_mass, const REAL *gradient, REAL axial, REAL velocity_factor, REAL force_factor, REAL dt) {
    const REAL xx = gradient[0], xy = gradient[1], yx = gradient[2], yy = gradient[3];
    const int64_t chunks = (n + CHUNK - 1) / CHUNK;
    for (int s = 0; s < steps; ++s) {
        const REAL *ix = s % 2 ? wx : ux, *iy = s % 2 ? wy : uy;
        REAL *ox = s % 2 ? ux : wx, *oy = s % 2 ? uy : wy;
#pragma omp parallel for num_threads(threads) schedule(static)
        for (int64_t c = 0; c < chunks; ++c) {
            const int64_t first = c * CHUNK;
            const int count = n - first < CHUNK ? (int)(n - first) : CHUNK;
            const int64_t t = (first + period - HALO) % period;
            const REAL *rx = rest_x + t, *ry = rest_y + t, *rl = rest_length + t, *ra = rest_angle + t, *rb = hinge + t;
            const REAL *im = inverse_mass + t;
            REAL cx[SPAN], cy[SPAN], tx[SPAN], ty[SPAN], il[SPAN], tension[SPAN], moment[SPAN], nx[SPAN], ny[SPAN];
            for (int k = 0; k < count + 2 * HALO; ++k) {
                int64_t i = first - HALO + k;
                if (i < 0) i += n;
                if (i >= n) i -= n;
                cx[k] = ix[i];
                cy[k] = iy[i];
            }
            for (int k = 0; k < count + 3; ++k) {
                const REAL ex = xx * rx[k] + xy * ry[k] + cx[k + 1] - cx[k];
                const REAL ey = yx * rx[k] + yy * ry[k] + cy[k + 1] - cy[k];
                const REAL inverse = 1 / (REAL)sqrt(ex * ex + ey * ey);
                tx[k] = ex * inverse;
                ty[k] = ey * inverse;
                il[k] = inverse;
                tension[k] = axial * ((ex * ex + ey * ey) * inverse - rl[k]) / rl[k];
            }
            for (int k = 1; k < count + 3; ++k) {
                moment[k] = rb[k] * (turning(tx[k - 1] * ty[k] - ty[k - 1] * tx[k], tx[k - 1] * tx[k] + ty[k - 1] * ty[k]) - ra[k]);
            }
            for (int k = 1; k < count + 2; ++k) {
                const REAL shear = (moment[k] - moment[k + 1]) * il[k];
                nx[k] = tension[k] * tx[k] - shear * ty[k];
                ny[k] = tension[k] * ty[k] + shear * tx[k];
            }
            for (int k = 2; k < count + 2; ++k) {
                const int64_t i = first - HALO + k;
                const REAL qx = velocity_factor * vx[i] + force_factor * im[k] * (nx[k] - nx[k - 1]);
                const REAL qy = velocity_factor * vy[i] + force_factor * im[k] * (ny[k] - ny[k - 1]);
                vx[i] = qx;
                vy[i] = qy;
                ox[i] = cx[k] + dt * qx;
                oy[i] = cy[k] + dt * qy;
            }
        }
    }
}

/* a = b + s c, the triad: 24 bytes an element of doubles */
void triad(int64_t n, int rounds, int threads, double *a, const double *b, const double *c, double s) {
    for (int r = 0; r < rounds; ++r) {
#pragma omp parallel for num_threads(threads) schedule(static)
        for (int64_t i = 0; i < n; ++i) a[i] = b[i] + s * c[i];
    }
}
