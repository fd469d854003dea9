/* The step of kernels/rod_frames.py, rod_forces.py and rod_motion.py for rods with diagonal masses, as a plain C loop: the
   reference that tools/benchmarks/spatial.py measures beside.

   Structure of arrays, chunks of 128 nodes. Stretch, bending and twist of discrete elastic rods, directors transported from step
   to step, central differences with damping. One closed wire of n nodes; arrays of vectors hold x, y and z one after the other.
   Contact is that of straight round segments: closest points of each pair of segments in a list of
   neighbours, which a grid of square cells in the plane finds once a call, and a force proportional to the overlap.

   gcc -O3 -march=native -ffast-math -fopenmp -shared -fPIC -DREAL=double rod_loop.c
*/
#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#ifndef REAL
#define REAL double
#endif
enum { CHUNK = 128, HALO = 2, SPAN = CHUNK + 2 * HALO };

/* atan(x), by a polynomial on tan(pi/8) */
static inline REAL arctangent(REAL over, REAL under) {
    const REAL a = over < 0 ? -over : over;
    const REAL steep = a > (REAL)2.414213562373095 * under ? 1 : 0;
    const REAL middle = (a > (REAL)0.4142135623730951 * under ? 1 : 0) - steep;
    const REAL top = a - middle * under - steep * (a + under), bottom = under + middle * a + steep * (a - under);
    const REAL x = top / (bottom > (REAL)1e-12 ? bottom : (REAL)1e-12), z = x * x;
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
    const REAL folded = x * series + middle * (REAL)0.7853981633974483 + steep * (REAL)1.5707963267948966;
    return over < 0 ? -folded : folded;
}

static REAL image(REAL x, REAL size) { return x - size * (REAL)rint(x / size); }
static REAL within(REAL s) { return s < 0 ? 0 : (s > 1 ? 1 : s); }

/* Vector from segment j to the nearest image of segment i at their closest points; *s is the place on segment i, from 0 to 1.
   x: (3, n) nodes, edge: (3, n), size: periods of the tile along x and y. */
static inline void find_gap(int i, int j, int n, const REAL *x, const REAL *edge, const REAL *size, REAL *s, REAL *gap) {
    const REAL ax = edge[i], ay = edge[n + i], az = edge[2 * n + i], aa = ax * ax + ay * ay + az * az;
    const REAL bx = edge[j], by = edge[n + j], bz = edge[2 * n + j], bb = bx * bx + by * by + bz * bz;
    const REAL midx = (ax - bx) / 2, midy = (ay - by) / 2;
    const REAL rx = image(x[i] - x[j] + midx, size[0]) - midx, ry = image(x[n + i] - x[n + j] + midy, size[1]) - midy;
    const REAL rz = x[2 * n + i] - x[2 * n + j];
    const REAL ab = ax * bx + ay * by + az * bz, ar = ax * rx + ay * ry + az * rz, br = bx * rx + by * ry + bz * rz;
    const REAL under = aa * bb - ab * ab;
    const REAL first = under > (REAL)1e-8 * aa * bb ? within((ab * br - ar * bb) / under) : (REAL)0.5;
    const REAL t = within((ab * first + br) / bb);
    *s = within((ab * t - ar) / aa);
    gap[0] = rx + *s * ax - t * bx, gap[1] = ry + *s * ay - t * by, gap[2] = rz + *s * az - t * bz;
}

/* Neighbours of segments: those of segment i are other[start[i]] to other[start[i + 1] - 1], each pair twice. longest: segment,
   reach: gap of closest points up to which segments are neighbours, own: segments along the wire that are none. */
typedef struct { int *start, *other, room; } List;

static void find_neighbours(List *list, int n, const REAL *x, const REAL *edge, const REAL *size, REAL longest, REAL reach, int own) {
    const REAL wide = longest + reach;
    const int columns = size[0] > 3 * wide ? (int)(size[0] / wide) : 1, rows = size[1] > 3 * wide ? (int)(size[1] / wide) : 1;
    int *first = calloc(columns * rows + 2, sizeof(int)), *sorted = malloc(n * sizeof(int)), *cell = malloc(n * sizeof(int));
    for (int i = 0; i < n; ++i) {
        const REAL a = (x[i] + edge[i] / 2) / size[0], b = (x[n + i] + edge[n + i] / 2) / size[1];
        cell[i] = (int)((a - floor(a)) * columns) % columns + columns * ((int)((b - floor(b)) * rows) % rows);
        ++first[cell[i] + 2];
    }
    for (int q = 1; q <= columns * rows; ++q) first[q + 1] += first[q];
    for (int i = 0; i < n; ++i) sorted[first[cell[i] + 1]++] = i; /* cell q is now sorted[first[q]] to sorted[first[q + 1] - 1] */
    int count = 0;
    for (int i = 0; i < n; ++i) {
        list->start[i] = count;
        const int column = cell[i] % columns, row = cell[i] / columns, left = -(columns > 1), down = -(rows > 1);
        for (int across = left; across <= -left; ++across) {
            for (int up = down; up <= -down; ++up) {
                const int q = (column + across + columns) % columns + columns * ((row + up + rows) % rows);
                for (int p = first[q]; p < first[q + 1]; ++p) {
                    const int j = sorted[p], apart = j > i ? j - i : i - j;
                    if (apart < own || n - apart < own) continue;
                    REAL s, gap[3];
                    find_gap(i, j, n, x, edge, size, &s, gap);
                    if (gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2] >= reach * reach) continue;
                    if (count == list->room) list->other = realloc(list->other, (list->room *= 2) * sizeof(int));
                    list->other[count++] = j;
                }
            }
        }
    }
    list->start[n] = count;
    free(first), free(sorted), free(cell);
}

/* push[0..2], push[3..5]: (n) forces on the first and the second node of each segment, by all its neighbours */
static void find_contact(const List *list, int n, int threads, const REAL *x, const REAL *edge, const REAL *size, REAL thickness,
                         REAL stiffness, REAL *push) {
#pragma omp parallel for num_threads(threads) schedule(static)
    for (int i = 0; i < n; ++i) {
        REAL sum[6] = {0, 0, 0, 0, 0, 0};
        for (int q = list->start[i]; q < list->start[i + 1]; ++q) {
            REAL s, gap[3];
            find_gap(i, list->other[q], n, x, edge, size, &s, gap);
            const REAL square = gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2];
            if (square >= thickness * thickness) continue;
            const REAL apart = (REAL)sqrt(square), f = stiffness * (thickness - apart) / apart;
            for (int c = 0; c < 3; ++c) sum[c] += (1 - s) * f * gap[c], sum[3 + c] += s * f * gap[c];
        }
        for (int c = 0; c < 6; ++c) push[c * n + i] = sum[c];
    }
}

/* u displacements, v velocities, t tangents, d directors, edge at rest, f forces: (3, n); w spins, c torques, length, rest:
   natural length, bent: (2, n) natural turns, twisted: natural twists, mass, inertia: [n]. For contact, where thickness > 0:
   place: (3, n) nodes at rest, size: periods of the tile, own: segments along the wire that never touch. Returns the number of
   segments in contact in the last step. */
int64_t take_steps(int64_t n, int steps, int threads, REAL *u, REAL *v, REAL *t, REAL *d, const REAL *edge, REAL *f, REAL *w, REAL *c,
                   REAL *length, const REAL *rest, const REAL *bent, const REAL *twisted, const REAL *mass, const REAL *inertia,
                   const REAL *gradient, const REAL *place, const REAL *size, int own, REAL thickness, REAL stiffness, REAL axial,
                   REAL bending, REAL twisting, REAL a, REAL b, REAL dt) {
    const REAL xx = gradient[0], xy = gradient[1], yx = gradient[2], yy = gradient[3];
    const int64_t chunks = (n + CHUNK - 1) / CHUNK;
    const int touching = thickness > 0;
    REAL *x = NULL, *now = NULL, *push = NULL, longest = 0;
    List list = {NULL, NULL, 1};
    if (touching) {
        x = malloc(3 * n * sizeof(REAL)), now = malloc(3 * n * sizeof(REAL)), push = malloc(6 * n * sizeof(REAL));
        list.start = malloc((n + 1) * sizeof(int)), list.other = malloc(sizeof(int));
        for (int64_t i = 0; i < n; ++i) longest = rest[i] > longest ? rest[i] : longest;
    }
    for (int s = 0; s < steps; ++s) {
        if (touching) {
#pragma omp parallel for simd num_threads(threads) schedule(static)
            for (int64_t i = 0; i < n; ++i) {
                const int64_t j = i + 1 < n ? i + 1 : 0;
                x[i] = xx * place[i] + xy * place[n + i] + u[i];
                x[n + i] = yx * place[i] + yy * place[n + i] + u[n + i];
                x[2 * n + i] = place[2 * n + i] + u[2 * n + i];
                now[i] = xx * edge[i] + xy * edge[n + i] + u[j] - u[i];
                now[n + i] = yx * edge[i] + yy * edge[n + i] + u[n + j] - u[n + i];
                now[2 * n + i] = edge[2 * n + i] + u[2 * n + j] - u[2 * n + i];
            }
            /* what lies within 0.2 thicknesses of a contact is a neighbour */
            if (s == 0) find_neighbours(&list, (int)n, x, now, size, longest, (REAL)1.2 * thickness, own);
            find_contact(&list, (int)n, threads, x, now, size, thickness, stiffness, push);
        }
#pragma omp parallel for num_threads(threads) schedule(static)
        for (int64_t q = 0; q < chunks; ++q) {
            const int64_t first = q * CHUNK, last = first + CHUNK < n ? first + CHUNK : n;
            REAL ux[CHUNK + 1], uy[CHUNK + 1], uz[CHUNK + 1];
            for (int64_t i = first; i <= last; ++i) {
                const int64_t j = i < n ? i : 0;
                ux[i - first] = u[j], uy[i - first] = u[n + j], uz[i - first] = u[2 * n + j];
            }
#pragma GCC ivdep
            for (int64_t i = first; i < last; ++i) {
                const int64_t k = i - first;
                const REAL ex = xx * edge[i] + xy * edge[n + i] + ux[k + 1] - ux[k];
                const REAL ey = yx * edge[i] + yy * edge[n + i] + uy[k + 1] - uy[k];
                const REAL ez = edge[2 * n + i] + uz[k + 1] - uz[k];
                const REAL l = (REAL)sqrt(ex * ex + ey * ey + ez * ez), il = 1 / l;
                const REAL tx = ex * il, ty = ey * il, tz = ez * il;
                const REAL px = t[i], py = t[n + i], pz = t[2 * n + i], dx = d[i], dy = d[n + i], dz = d[2 * n + i];
                const REAL bx = py * tz - pz * ty, by = pz * tx - px * tz, bz = px * ty - py * tx;
                const REAL co = px * tx + py * ty + pz * tz, along = (bx * dx + by * dy + bz * dz) / (1 + co);
                REAL gx = co * dx + by * dz - bz * dy + bx * along;
                REAL gy = co * dy + bz * dx - bx * dz + by * along;
                REAL gz = co * dz + bx * dy - by * dx + bz * along;
                const REAL off = gx * tx + gy * ty + gz * tz;
                gx -= off * tx, gy -= off * ty, gz -= off * tz;
                const REAL unit = 1 / (REAL)sqrt(gx * gx + gy * gy + gz * gz);
                const REAL turn = dt * w[i], z = turn * turn;
                const REAL si = unit * turn * (1 - z / 6 * (1 - z / 20 * (1 - z / 42)));
                const REAL ci = unit * (1 - z / 2 * (1 - z / 12 * (1 - z / 30)));
                length[i] = l;
                t[i] = tx, t[n + i] = ty, t[2 * n + i] = tz;
                d[i] = ci * gx + si * (ty * gz - tz * gy);
                d[n + i] = ci * gy + si * (tz * gx - tx * gz);
                d[2 * n + i] = ci * gz + si * (tx * gy - ty * gx);
            }
        }
#pragma omp parallel for num_threads(threads) schedule(static)
        for (int64_t q = 0; q < chunks; ++q) {
            const int64_t first = q * CHUNK;
            const int count = n - first < CHUNK ? (int)(n - first) : CHUNK;
            REAL tx[SPAN], ty[SPAN], tz[SPAN], dx[SPAN], dy[SPAN], dz[SPAN], il[SPAN], pull[SPAN], hinge[SPAN], k0[SPAN], k1[SPAN];
            REAL m0[SPAN], before[3][SPAN], after[3][SPAN], about_before[SPAN], about_after[SPAN], nx[SPAN], ny[SPAN], nz[SPAN];
            for (int k = 0; k < count + 2 * HALO; ++k) {
                int64_t i = first - HALO + k;
                i = i < 0 ? i + n : (i >= n ? i - n : i);
                tx[k] = t[i], ty[k] = t[n + i], tz[k] = t[2 * n + i];
                dx[k] = d[i], dy[k] = d[n + i], dz[k] = d[2 * n + i];
                il[k] = 1 / length[i];
                pull[k] = axial * (length[i] - rest[i]) / rest[i];
                hinge[k] = 1 / rest[i];
                k0[k] = bent[i], k1[k] = bent[n + i], m0[k] = twisted[i];
            }
#pragma GCC ivdep
            for (int k = 1; k < count + 2 * HALO; ++k) {
                const REAL ex = tx[k - 1], ey = ty[k - 1], ez = tz[k - 1], fx = tx[k], fy = ty[k], fz = tz[k];
                const REAL ax = dx[k - 1], ay = dy[k - 1], az = dz[k - 1], cx = dx[k], cy = dy[k], cz = dz[k];
                const REAL bx = ey * az - ez * ay, by = ez * ax - ex * az, bz = ex * ay - ey * ax;
                const REAL hx = fy * cz - fz * cy, hy = fz * cx - fx * cz, hz = fx * cy - fy * cx;
                const REAL dot = ex * fx + ey * fy + ez * fz, share = 1 / (1 + dot);
                const REAL vx = ey * fz - ez * fy, vy = ez * fx - ex * fz, vz = ex * fy - ey * fx;
                const REAL ox = 2 * share * vx, oy = 2 * share * vy, oz = 2 * share * vz;
                const REAL one = ((bx + hx) * ox + (by + hy) * oy + (bz + hz) * oz) / 2;
                const REAL two = -((ax + cx) * ox + (ay + cy) * oy + (az + cz) * oz) / 2;
                const REAL lean_on = share * (vx * ax + vy * ay + vz * az);
                const REAL mx = dot * ax + vy * az - vz * ay + vx * lean_on, my = dot * ay + vz * ax - vx * az + vy * lean_on;
                const REAL mz = dot * az + vx * ay - vy * ax + vz * lean_on;
                const REAL sine = (my * cz - mz * cy) * fx + (mz * cx - mx * cz) * fy + (mx * cy - my * cx) * fz;
                const REAL m = 2 * arctangent(sine, 1 + mx * cx + my * cy + mz * cz);
                const REAL square = one * one + two * two, size = (REAL)sqrt(square);
                const REAL share_of_turn = 2 * arctangent(size / 2, 1) / (size > (REAL)1e-8 ? size : 1);
                const REAL part = size > (REAL)1e-8 ? share_of_turn : 1;
                const REAL steep_slope = (1 / (1 + square / 4) - part) / (size > (REAL)1e-4 ? square : 1);
                const REAL slope = size > (REAL)1e-4 ? steep_slope : -(REAL)1 / 6;
                const REAL p = bending * hinge[k] * (part * one - k0[k]), r = bending * hinge[k] * (part * two - k1[k]);
                const REAL both = slope * (one * p + two * r), g1 = part * p + both * one, g2 = part * r + both * two;
                const REAL g = twisting * hinge[k] * (m - m0[k]), lean = -(g1 * one + g2 * two) * share;
                const REAL qx = share * (g1 * (bx + hx) - g2 * (ax + cx)), qy = share * (g1 * (by + hy) - g2 * (ay + cy));
                const REAL qz = share * (g1 * (bz + hz) - g2 * (az + cz));
                const REAL sx = lean * (ex + fx) + g * ox / 2, sy = lean * (ey + fy) + g * oy / 2, sz = lean * (ez + fz) + g * oz / 2;
                before[0][k] = il[k - 1] * (sx + fy * qz - fz * qy);
                before[1][k] = il[k - 1] * (sy + fz * qx - fx * qz);
                before[2][k] = il[k - 1] * (sz + fx * qy - fy * qx);
                after[0][k] = il[k] * (sx - ey * qz + ez * qy);
                after[1][k] = il[k] * (sy - ez * qx + ex * qz);
                after[2][k] = il[k] * (sz - ex * qy + ey * qx);
                about_before[k] = -((g1 * ax + g2 * bx) * ox + (g1 * ay + g2 * by) * oy + (g1 * az + g2 * bz) * oz) / 2 - g;
                about_after[k] = -((g1 * cx + g2 * hx) * ox + (g1 * cy + g2 * hy) * oy + (g1 * cz + g2 * hz) * oz) / 2 + g;
            }
            for (int k = 1; k < count + HALO; ++k) {
                nx[k] = pull[k] * tx[k] + after[0][k] + before[0][k + 1];
                ny[k] = pull[k] * ty[k] + after[1][k] + before[1][k + 1];
                nz[k] = pull[k] * tz[k] + after[2][k] + before[2][k + 1];
            }
#pragma GCC ivdep
            for (int k = HALO; k < count + HALO; ++k) {
                const int64_t i = first - HALO + k;
                f[i] = nx[k] - nx[k - 1], f[n + i] = ny[k] - ny[k - 1], f[2 * n + i] = nz[k] - nz[k - 1];
                c[i] = -about_after[k] - about_before[k + 1];
            }
            for (int64_t i = first; touching && i < first + count; ++i) {
                for (int k = 0; k < 3; ++k) f[k * n + i] += push[k * n + i] + push[(k + 3) * n + (i > 0 ? i : n) - 1];
            }
        }
#pragma omp parallel for simd num_threads(threads) schedule(static)
        for (int64_t i = 0; i < n; ++i) {
            for (int k = 0; k < 3; ++k) {
                const int64_t at = k * n + i;
                v[at] = a * v[at] + b * f[at] / mass[i];
                u[at] += dt * v[at];
            }
            w[i] = a * w[i] + b * c[i] / inertia[i];
        }
    }
    int64_t contacts = 0;
    for (int64_t i = 0; touching && i < n; ++i) contacts += push[i] != 0 || push[3 * n + i] != 0;
    free(x), free(now), free(push), free(list.start), free(list.other);
    return contacts;
}
