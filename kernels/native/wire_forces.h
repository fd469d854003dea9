// Forces of planar wires (kernels/wire_forces.py, for the equations); KEEPS: whether edges, angles and turnings are wanted
// beside them.
//
// Local indices: node k is global node first - HALO + k, segment k joins nodes k and k + 1, angle k sits at node k between
// segments k - 1 and k.
#include "sharing.h"
typedef decltype(unit) real;
typedef decltype(ux_in.data[0] + ux_in.data[0]) coordinate;
// loops run over whole vectors: PAD places behind the last node hold numbers that nothing uses
#ifdef __CUDA_ARCH__
enum { LANES = 1, PAD = 2 };
#else
enum { LANES = 16, PAD = BLOCK_PAD };
#endif
enum { HALO = 3, SPAN = BLOCK_SIZE + 2 * HALO + PAD };
static_assert(LANES > 1 || WIRE_LANES + 0 >= SPAN + 0, "a thread of a GPU has one place");
const int first = block_first.data[block], table = block_table.data[block], count = block_count.data[block];
const int wire = block_wire.data[block];
const int wire_begin = wire_first.data[wire], wire_nodes = wire_count.data[wire], closed = wire_closed.data[wire];
const double* steer = control.data;
const real fxx = real(steer[GRADIENT]), fxy = real(steer[GRADIENT + 1]);
const real fyx = real(steer[GRADIENT + 2]), fyy = real(steer[GRADIENT + 3]);
const real length_factor = real(steer[LENGTH_FACTOR]), hinge_factor = real(1.0 / steer[LENGTH_FACTOR]);
const real bow_moment = real(steer[BOW_MOMENT] * steer[LENGTH_FACTOR]), slope_factor = real(steer[SLOPE_FACTOR]);
const real axial_stiffness = wire_axial.data[wire];
const int nodes = count + 2 * HALO, segments = nodes - 1;
const int whole = (segments + LANES) / LANES * LANES;
const int offset_of_block = first - HALO;
const int wire_end = wire_begin + wire_nodes;
const int begin = wire_begin - offset_of_block, end = wire_end - offset_of_block;
const bool has_end = !closed && (begin >= -1 || end <= segments + 2); // of the wire, or of what a clamp changes
SHARED coordinate cx[SPAN], cy[SPAN];
SHARED real shift[SPAN];
// a node of the wire, counted beyond its ends: around a closed one, else the end itself
const auto on_wire = [&](int i) {
    if (!closed) return i < wire_begin ? wire_begin : (i >= wire_end ? wire_end - 1 : i);
    while (i < wire_begin) i += wire_nodes;
    while (i >= wire_end) i -= wire_nodes;
    return i;
};
#ifdef __CUDA_ARCH__
EACH(k, 0, whole + 1) {
    const int i = on_wire(offset_of_block + (k < nodes ? k : nodes - 1));
    cx[k] = ux_in.data[i];
    cy[k] = uy_in.data[i];
    shift[k] = tension_offset.data[i];
}
#else
EACH(k, HALO, count + HALO) {
    cx[k] = ux_in.data[offset_of_block + k];
    cy[k] = uy_in.data[offset_of_block + k];
    shift[k] = tension_offset.data[offset_of_block + k];
}
EACH(q, 0, 2 * HALO) {
    // nodes of the wire before the block and behind it
    const int k = q < HALO ? q : count + q;
    const int i = on_wire(offset_of_block + k);
    cx[k] = ux_in.data[i];
    cy[k] = uy_in.data[i];
    shift[k] = tension_offset.data[i];
}
EACH(k, nodes, whole + 1) {
    cx[k] = cx[nodes - 1];
    cy[k] = cy[nodes - 1];
    shift[k] = real(0);
}
#endif
const real* __restrict rx = rest_x.data + table - HALO;
const real* __restrict ry = rest_y.data + table - HALO;
const real* __restrict rl = rest_length.data + table - HALO;
const real* __restrict ri = inverse_length.data + table - HALO;
const real* __restrict ra = rest_angle.data + table - HALO;
const real* __restrict rb = hinge_stiffness.data + table - HALO;
TOGETHER
// stretch: edges, unit tangents and tensions
const real axial_by_factor = axial_stiffness * hinge_factor;
SHARED real tx[SPAN], ty[SPAN], il[SPAN], tension[SPAN], bend[SPAN], moment[SPAN], unbending[SPAN], share[SPAN], rise[SPAN];
SHARED real chord_x[KEEPS ? SPAN : 1], chord_y[KEEPS ? SPAN : 1], angles[KEEPS ? SPAN : 1], turn[KEEPS ? SPAN : 1];
{
    VECTORISED
    EACH(k, 0, whole) {
        const real ex = fxx * rx[k] + fxy * ry[k] + unit * real(cx[k + 1] - cx[k]);
        const real ey = fyx * rx[k] + fyy * ry[k] + unit * real(cy[k + 1] - cy[k]);
        const real length = sqrt(ex * ex + ey * ey);
        const real inverse = real(1) / length;
        tx[k] = ex * inverse;
        ty[k] = ey * inverse;
        il[k] = inverse;
        tension[k] = shift[k] + axial_by_factor * (length - rl[k] * length_factor) * ri[k];
        if (KEEPS) {
            chord_x[k] = ex;
            chord_y[k] = ey;
        }
    }
}
const real* __restrict clamps = wire_clamp.data + 2 * CLAMP_NUMBERS * wire;
if (gripped && has_end) {
    TOGETHER
    for (int far = 0; far < 2; ++far) {
        const real* clamp = clamps + far * CLAMP_NUMBERS;
        const int rigid = far ? end - 2 : begin, k = far ? end - 3 : begin + 1;
        if (rigid >= 0 && rigid < segments)
            EACH(j, rigid, rigid + 1) {
                tx[j] = clamp[TANGENT_X];
                ty[j] = clamp[TANGENT_Y];
                tension[j] = real(0);
                if (KEEPS) {
                    chord_x[j] = tx[j];
                    chord_y[j] = ty[j];
                    il[j] = real(1);
                }
            }
        if (k >= 0 && k < segments)
            EACH(j, k, k + 1) {
                const real ex = tx[j] / il[j] + clamp[LEVER_X], ey = ty[j] / il[j] + clamp[LEVER_Y];
                const real length = sqrt(ex * ex + ey * ey);
                tx[j] = ex / length;
                ty[j] = ey / length;
                il[j] = real(1) / length;
                tension[j] = shift[j] + axial_by_factor * (length - clamp[LENGTH] * length_factor) / clamp[LENGTH];
                if (KEEPS) {
                    chord_x[j] = ex;
                    chord_y[j] = ey;
                }
            }
    }
}
// bending: turning angles, moments of the turns, and what the tension of arcs adds
if (lane == 0) {
    tx[whole] = ty[whole] = tension[whole] = bend[0] = moment[0] = unbending[0] = real(0);
    share[0] = real(1);
}
TOGETHER
{
    VECTORISED
    EACH(j, 0, whole) {
        const real sine = tx[j] * ty[j + 1] - ty[j] * tx[j + 1];
        const real cosine = tx[j] * tx[j + 1] + ty[j] * ty[j + 1];
        // angle = 2 atan(sine / (1 + cosine)), the quotient folded into [-tan(pi/8), tan(pi/8)] before the one division
        const real over = sine, under = real(1) + cosine;
#include "arctangent.h"
        const real angle = real(2) * (sine < real(0) ? -folded : folded);
        bend[j + 1] = hinge_factor * rb[j + 1] * (angle - ra[j + 1]);
        share[j + 1] = real(1);
        unbending[j + 1] = bow_moment * angle * (tension[j] * rl[j] + tension[j + 1] * rl[j + 1]);
        if (KEEPS) {
            angles[j + 1] = angle;
            turn[j + 1] = angle - ra[j + 1];
        }
    }
}
if (gripped && has_end) {
    TOGETHER
    for (int far = 0; far < 2; ++far) {
        const real* clamp = clamps + far * CLAMP_NUMBERS;
        for (int next = 0; next < 2; ++next) {
            const int at = far ? end - 2 - next : begin + 1 + next;
            if (at < 1 || at >= segments) continue;
            EACH(k, at, at + 1) {
                // segment from the clamp, and the one beyond the first free node
                const int own = far == next ? k : k - 1, other = far ? k - 1 : k;
                const real angle = bend[k] / (hinge_factor * rb[k]) + ra[k];
                const real counts_own = real(1) + clamp[BOW_WEIGHT + next], counts_other = real(1) + clamp[BEYOND_BOW_WEIGHT];
                const real pull = counts_own * tension[own] * clamp[LENGTH];
                unbending[k] = bow_moment * angle * (pull + (next ? counts_other * tension[other] * rl[other] : real(0)));
                share[k] = clamp[HINGE + next];
                bend[k] = share[k] * hinge_factor * rb[k] * (angle - clamp[ANGLE + next]);
                if (KEEPS) turn[k] = angles[k] - clamp[ANGLE + next];
            }
        }
    }
}
// what yields: beyond the yield moment on either side of back_turn, a wire keeps the share kept_stiffness
if (yield_moment > real(0)) {
    TOGETHER
    EACH(j, 1, segments) {
        const int beyond_ends = offset_of_block + j, i = on_wire(beyond_ends);
        if (!closed && i != beyond_ends) continue;
        const real stiffness = share[j] * hinge_factor * rb[j];
        const real trial = bend[j] / stiffness - plastic_turn.data[i], beyond = trial - back_turn.data[i];
        const real over = (beyond < real(0) ? -beyond : beyond) - yield_moment / stiffness;
        const real off = over > real(0) ? over * (real(1) - kept_stiffness) : real(0);
        bend[j] = stiffness * (trial - (beyond < real(0) ? -off : off));
    }
}
if (has_end) {
    // beyond the ends of an open wire there is nothing
    TOGETHER
    EACH(k, 0, begin + 1) { bend[k] = unbending[k] = share[k] = real(0); }
    EACH(k, 0, begin) { tension[k] = real(0); }
    EACH(k, end - 1, segments + 1) { tension[k] = bend[k] = unbending[k] = share[k] = real(0); }
}
TOGETHER
// what the slope of the moment along the segments adds
{
    VECTORISED
    EACH(k, 0, whole) { rise[k] = rl[k] * (bend[k + 1] - bend[k]); }
}
if (has_end) {
    TOGETHER
    EACH(k, 0, begin) { rise[k] = real(0); }
    EACH(k, end - 1, segments) { rise[k] = real(0); }
}
if (gripped && has_end) {
    for (int far = 0; far < 2; ++far) {
        const int rigid = far ? end - 2 : begin, k = far ? end - 3 : begin + 1;
        if (rigid >= 0 && rigid < segments)
            EACH(j, rigid, rigid + 1) rise[j] = real(0);
        if (k >= 0 && k < segments) {
            const real length = clamps[far * CLAMP_NUMBERS + LENGTH];
            EACH(j, k, k + 1) rise[j] = length * (bend[j + 1] - bend[j]);
        }
    }
}
if (lane == 0) rise[whole] = moment[0] = real(0);
TOGETHER
{
    VECTORISED
    EACH(k, 0, whole) { moment[k + 1] = bend[k + 1] + slope_factor * share[k + 1] * rb[k + 1] * (rise[k] - rise[k + 1]); }
}
TOGETHER
// forces of the segments
SHARED real nx[SPAN], ny[SPAN];
{
    VECTORISED
    EACH(k, 0, whole) {
        const real shear = (moment[k] - moment[k + 1] + unbending[k] - unbending[k + 1]) * il[k];
        nx[k] = tension[k] * tx[k] - shear * ty[k];
        ny[k] = tension[k] * ty[k] + shear * tx[k];
    }
}
