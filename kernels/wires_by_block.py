"""One explicit step of all wires on the CPU: one thread a block of nodes (see wires.py for the equations).

The work is written as loops over short arrays that the CPU compiler vectorises, and every segment and every angle is
computed once a block. It is C++ because loops of a Warp kernel do not vectorise on the CPU. A block holds at most
BLOCK_SIZE consecutive nodes of one wire; the rest data of its first node stand at `block_table` of the table of one
repeat, whose entries unroll in step with the nodes.
"""

from typing import Any

import warp as wp

from .control import STATUS, STATUS_RUNNING, STEP
from .native import STEERING, constants
from .wires import rounding_phase

BLOCK_SIZE = 128
BLOCK_PAD = 32  # table entries behind a block that may be read

# Local indices: node k is global node first - HALO + k, segment k joins nodes k and k + 1, angle k sits at node k between
# segments k - 1 and k.
_BLOCK_STEP = r"""
    typedef decltype(unit) real;
    typedef decltype(ux_in.data[0] + ux_in.data[0]) coordinate;
    // counts are whole numbers, rounded by the phase of the step; metres are taken as they are
    const bool counted = coordinate(0.5) == coordinate(0);
    // loops run over whole vectors: PAD places behind the last node hold numbers that nothing uses
    enum { LANES = 16, PAD = BLOCK_PAD, HALO = 3, SPAN = BLOCK_SIZE + 2 * HALO + PAD };
    const int first = block_first.data[block], count = block_count.data[block], table = block_table.data[block];
    const int wire = block_wire.data[block];
    const int wire_begin = wire_first.data[wire], wire_nodes = wire_count.data[wire], closed = wire_closed.data[wire];
    const int pair_begin = block_pair_start.data[block], pair_end = block_pair_start.data[block + 1];
    const int held_begin = block_held_start.data[block], held_end = block_held_start.data[block + 1];
    const double* steer = control.data;
    const real fxx = real(steer[GRADIENT]), fxy = real(steer[GRADIENT + 1]);
    const real fyx = real(steer[GRADIENT + 2]), fyy = real(steer[GRADIENT + 3]);
    const real length_factor = real(steer[LENGTH_FACTOR]), hinge_factor = real(1.0 / steer[LENGTH_FACTOR]);
    const real bow_moment = real(steer[BOW_MOMENT] * steer[LENGTH_FACTOR]), slope_factor = real(steer[SLOPE_FACTOR]);
    const real velocity_factor = real(steer[VELOCITY_FACTOR]), force_factor = real(steer[FORCE_FACTOR]);
    const real time_step = real(steer[TIME_STEP]), look_ahead = real(steer[LOOK_AHEAD]);
    const real axial_stiffness = wire_axial.data[wire], mass_factor = real(1) / wire_mass.data[wire];
    const int nodes = count + 2 * HALO, segments = nodes - 1;
    const int whole = (segments + LANES) / LANES * LANES;
    const int lanes = (count + LANES - 1) / LANES * LANES;
    const int offset_of_block = first - HALO;
    const int wire_end = wire_begin + wire_nodes;
    for (int q = pair_begin; q < pair_end; ++q) {
        // needed below, from far apart
        const int p = block_pair.data[q];
        __builtin_prefetch(pair_force.data + p);
        __builtin_prefetch(pair_node.data + p);
        __builtin_prefetch(pair_nodal_x.data + 4 * p);
        __builtin_prefetch(pair_nodal_y.data + 4 * p);
    }
    coordinate cx[SPAN], cy[SPAN];
    real shift[SPAN];
    for (int k = HALO; k < count + HALO; ++k) {
        cx[k] = ux_in.data[offset_of_block + k];
        cy[k] = uy_in.data[offset_of_block + k];
        shift[k] = tension_offset.data[offset_of_block + k];
    }
    for (int q = 0; q < 2 * HALO; ++q) {
        // nodes of the wire before the block and behind it
        const int k = q < HALO ? q : count + q;
        int i = offset_of_block + k;
        if (closed) {
            while (i < wire_begin) i += wire_nodes;
            while (i >= wire_end) i -= wire_nodes;
        } else {
            i = i < wire_begin ? wire_begin : (i >= wire_end ? wire_end - 1 : i);
        }
        cx[k] = ux_in.data[i];
        cy[k] = uy_in.data[i];
        shift[k] = tension_offset.data[i];
    }
    for (int k = nodes; k <= whole; ++k) {
        cx[k] = cx[nodes - 1];
        cy[k] = cy[nodes - 1];
        shift[k] = real(0);
    }
    const real* __restrict rx = rest_x.data + table - HALO;
    const real* __restrict ry = rest_y.data + table - HALO;
    const real* __restrict rl = rest_length.data + table - HALO;
    const real* __restrict ri = inverse_length.data + table - HALO;
    const real* __restrict ra = rest_angle.data + table - HALO;
    const real* __restrict rb = hinge_stiffness.data + table - HALO;
    const real* __restrict ri_m = inverse_mass.data + table - HALO;
    const real* __restrict rm = node_mass.data + table - HALO;

    const real axial_by_factor = axial_stiffness * hinge_factor;
    real tx[SPAN], ty[SPAN], il[SPAN], tension[SPAN], bend[SPAN], moment[SPAN], unbending[SPAN], share[SPAN], rise[SPAN];
    {
    #pragma clang fp reassociate(on) contract(fast)
    #pragma clang loop vectorize(enable)
    for (int k = 0; k < whole; ++k) {
        const real ex = fxx * rx[k] + fxy * ry[k] + unit * real(cx[k + 1] - cx[k]);
        const real ey = fyx * rx[k] + fyy * ry[k] + unit * real(cy[k + 1] - cy[k]);
        const real length = sqrt(ex * ex + ey * ey);
        const real inverse = real(1) / length;
        tx[k] = ex * inverse;
        ty[k] = ey * inverse;
        il[k] = inverse;
        tension[k] = shift[k] + axial_by_factor * (length - rl[k] * length_factor) * ri[k];
    }
    }
    const int begin = wire_begin - offset_of_block, end = wire_end - offset_of_block;
    // the numbers of a clamp: see clamp.py
    enum { LEVER_X, LEVER_Y, TANGENT_X, TANGENT_Y, LENGTH, ANGLE, NEXT_ANGLE, HINGE, NEXT_HINGE };
    enum { BOW_WEIGHT = 11, NEXT_BOW_WEIGHT, BEYOND_BOW_WEIGHT, CLAMP_NUMBERS };
    const real* __restrict clamps = wire_clamp.data + 2 * CLAMP_NUMBERS * wire;
    if (gripped) {
        for (int far = 0; far < 2; ++far) {
            const real* clamp = clamps + far * CLAMP_NUMBERS;
            const int rigid = far ? end - 2 : begin, k = far ? end - 3 : begin + 1;
            if (rigid >= 0 && rigid < segments) {
                tx[rigid] = clamp[TANGENT_X];
                ty[rigid] = clamp[TANGENT_Y];
                tension[rigid] = real(0);
            }
            if (k >= 0 && k < segments) {
                const real ex = tx[k] / il[k] + clamp[LEVER_X], ey = ty[k] / il[k] + clamp[LEVER_Y];
                const real length = sqrt(ex * ex + ey * ey);
                tx[k] = ex / length;
                ty[k] = ey / length;
                il[k] = real(1) / length;
                tension[k] = shift[k] + axial_by_factor * (length - clamp[LENGTH] * length_factor) / clamp[LENGTH];
            }
        }
    }
    tx[whole] = ty[whole] = tension[whole] = bend[0] = moment[0] = unbending[0] = real(0);
    share[0] = real(1);
    {
    #pragma clang fp reassociate(on) contract(fast)
    #pragma clang loop vectorize(enable)
    for (int j = 0; j < whole; ++j) {
        const real sine = tx[j] * ty[j + 1] - ty[j] * tx[j + 1];
        const real cosine = tx[j] * tx[j + 1] + ty[j] * ty[j + 1];
        // angle = 2 atan(sine / (1 + cosine)), the quotient folded into [-tan(pi/8), tan(pi/8)] before the one division
        const real below = real(1) + cosine;
        const real a = sine < real(0) ? -sine : sine;
        const real steep = a > real(2.414213562373095) * below ? real(1) : real(0);
        const real middle = (a > real(0.4142135623730951) * below ? real(1) : real(0)) - steep;
        const real top = steep > real(0) ? -below : (middle > real(0) ? a - below : a);
        const real bottom = steep > real(0) ? a : (middle > real(0) ? a + below : below);
        const real x = top / (bottom > real(1e-12) ? bottom : real(1e-12));
        const real z = x * x;
        real series;
        if (sizeof(real) == 4) {
            series = ATAN_SINGLE;
        } else {
            series = ATAN_DOUBLE;
        }
        const real folded = x * series + middle * real(0.7853981633974483) + steep * real(1.5707963267948966);
        const real angle = real(2) * (sine < real(0) ? -folded : folded);
        bend[j + 1] = hinge_factor * rb[j + 1] * (angle - ra[j + 1]);
        share[j + 1] = real(1);
        unbending[j + 1] = bow_moment * angle * (tension[j] * rl[j] + tension[j + 1] * rl[j + 1]);
    }
    }
    if (gripped) {
        for (int far = 0; far < 2; ++far) {
            const real* clamp = clamps + far * CLAMP_NUMBERS;
            for (int next = 0; next < 2; ++next) {
                const int k = far ? end - 2 - next : begin + 1 + next;
                if (k < 1 || k >= segments) continue;
                // segment from the clamp, and the one beyond the first free node
                const int own = far ? end - 3 : begin + 1, other = far ? k - 1 : k;
                const real angle = bend[k] / (hinge_factor * rb[k]) + ra[k];
                const real counts_own = real(1) + clamp[BOW_WEIGHT + next], counts_other = real(1) + clamp[BEYOND_BOW_WEIGHT];
                const real pull = counts_own * tension[own] * clamp[LENGTH];
                unbending[k] = bow_moment * angle * (pull + (next ? counts_other * tension[other] * rl[other] : real(0)));
                share[k] = clamp[HINGE + next];
                bend[k] = share[k] * hinge_factor * rb[k] * (angle - clamp[ANGLE + next]);
            }
        }
    }
    if (yield_moment > real(0)) {
        // see elastic_turning in bend.py
        for (int j = 1; j < segments; ++j) {
            int i = offset_of_block + j;
            if (closed) {
                while (i < wire_begin) i += wire_nodes;
                while (i >= wire_end) i -= wire_nodes;
            } else if (i < wire_begin || i >= wire_end) {
                continue;
            }
            const real stiffness = share[j] * hinge_factor * rb[j];
            const real trial = bend[j] / stiffness - plastic_turn.data[i], beyond = trial - back_turn.data[i];
            const real over = (beyond < real(0) ? -beyond : beyond) - yield_moment / stiffness;
            const real off = over > real(0) ? over * (real(1) - kept_stiffness) : real(0);
            bend[j] = stiffness * (trial - (beyond < real(0) ? -off : off));
        }
    }
    if (!closed) {
        // beyond the ends of an open wire there is nothing
        for (int k = 0; k <= begin; ++k) { bend[k] = unbending[k] = share[k] = real(0); }
        for (int k = 0; k < begin; ++k) { tension[k] = real(0); }
        for (int k = end - 1; k <= segments; ++k) { tension[k] = bend[k] = unbending[k] = share[k] = real(0); }
    }
    // what the slope of the moment along the segments adds: see bend.py
    {
    #pragma clang fp reassociate(on) contract(fast)
    #pragma clang loop vectorize(enable)
    for (int k = 0; k < whole; ++k) {
        rise[k] = rl[k] * (bend[k + 1] - bend[k]);
    }
    }
    if (!closed) {
        for (int k = 0; k < begin; ++k) { rise[k] = real(0); }
        for (int k = end - 1; k < segments; ++k) { rise[k] = real(0); }
    }
    if (gripped) {
        for (int far = 0; far < 2; ++far) {
            const int rigid = far ? end - 2 : begin, k = far ? end - 3 : begin + 1;
            if (rigid >= 0 && rigid < segments) rise[rigid] = real(0);
            if (k >= 0 && k < segments) rise[k] = clamps[far * CLAMP_NUMBERS + LENGTH] * (bend[k + 1] - bend[k]);
        }
    }
    rise[whole] = moment[0] = moment[whole] = real(0);
    {
    #pragma clang fp reassociate(on) contract(fast)
    #pragma clang loop vectorize(enable)
    for (int k = 0; k < whole; ++k) {
        moment[k + 1] = bend[k + 1] + slope_factor * share[k + 1] * rb[k + 1] * (rise[k] - rise[k + 1]);
    }
    }
    real nx[SPAN], ny[SPAN], fx[SPAN], fy[SPAN];
    {
    #pragma clang fp reassociate(on) contract(fast)
    #pragma clang loop vectorize(enable)
    for (int k = 0; k < whole; ++k) {
        const real shear = (moment[k] - moment[k + 1] + unbending[k] - unbending[k + 1]) * il[k];
        nx[k] = tension[k] * tx[k] - shear * ty[k];
        ny[k] = tension[k] * ty[k] + shear * tx[k];
    }
    #pragma clang loop vectorize(enable)
    for (int j = 0; j < lanes; ++j) {
        fx[j + HALO] = nx[j + HALO] - nx[j + HALO - 1];
        fy[j + HALO] = ny[j + HALO] - ny[j + HALO - 1];
    }
    }
    for (int q = pair_begin; q < pair_end; ++q) {
        const int p = block_pair.data[q];
        if (pair_force.data[p] == real(0)) continue;
        const int reached = pair_node.data[p] - 1 - offset_of_block;
        if (reached >= HALO && reached + 3 < count + HALO) {
            for (int c = 0; c < 4; ++c) {
                fx[reached + c] += pair_nodal_x.data[4 * p + c];
                fy[reached + c] += pair_nodal_y.data[4 * p + c];
            }
            continue;
        }
        for (int c = 0; c < 4; ++c) {
            int i = pair_node.data[p] - 1 + c;
            if (closed) {
                if (i < wire_begin) i += wire_nodes;
                if (i >= wire_end) i -= wire_nodes;
            }
            const int k = i - offset_of_block;
            if (k >= HALO && k < count + HALO) {
                fx[k] += pair_nodal_x.data[4 * p + c];
                fy[k] += pair_nodal_y.data[4 * p + c];
            }
        }
    }
    for (int q = held_begin; q < held_end; ++q) {
        const int k = held_node.data[q] - offset_of_block;
        fx[k] = real(0);
        fy[k] = real(0);
    }
    real* __restrict speed_x = vx.data + offset_of_block;
    real* __restrict speed_y = vy.data + offset_of_block;
    coordinate* __restrict moved_x = ux_out.data + offset_of_block;
    coordinate* __restrict moved_y = uy_out.data + offset_of_block;
    real qq[SPAN], ff[SPAN];
    real kinetic = 0, square = 0;
    const real counts = time_step / unit;
    const real still = sizeof(real) == 4 ? real(1e-18) : real(1e-150);
    {
    #pragma clang fp reassociate(on) contract(fast)
    #pragma clang loop vectorize(enable)
    for (int k = HALO; k < count + HALO; ++k) {
        const real im = ri_m[k] * mass_factor;
        const real px = speed_x[k], py = speed_y[k];
        const real f2 = fx[k] * fx[k] + fy[k] * fy[k];
        real qx = velocity_factor * px + force_factor * im * fx[k];
        real qy = velocity_factor * py + force_factor * im * fy[k];
        // what dies out stops before its square is a denormal number, which is slow
        qx = (qx < still && qx > -still) ? real(0) : qx;
        qy = (qy < still && qy > -still) ? real(0) : qy;
        const real q2 = qx * qx + qy * qy;
        kinetic += q2 * rm[k];
        square += f2;
        speed_x[k] = qx;
        speed_y[k] = qy;
        const real move_x = (qx + look_ahead * (qx - px)) * counts;
        moved_x[k] = cx[k] + (counted ? coordinate(floor(move_x + phase)) : coordinate(move_x));
        const real move_y = (qy + look_ahead * (qy - py)) * counts;
        moved_y[k] = cy[k] + (counted ? coordinate(floor(move_y + phase)) : coordinate(move_y));
        ff[k] = f2;
        qq[k] = q2;
    }
    }
    // largest squares, lane by lane: a plain maximum does not vectorise
    for (int l = 0; l < LANES; ++l) {
        ff[count + HALO + l] = real(0);
        qq[count + HALO + l] = real(0);
    }
    real strong[LANES] = {0}, fast[LANES] = {0};
    for (int k = HALO; k < count + HALO; k += LANES) {
        for (int l = 0; l < LANES; ++l) {
            strong[l] = ff[k + l] > strong[l] ? ff[k + l] : strong[l];
            fast[l] = qq[k + l] > fast[l] ? qq[k + l] : fast[l];
        }
    }
    real strongest = 0, fastest = 0;
    for (int l = 0; l < LANES; ++l) {
        strongest = strong[l] > strongest ? strong[l] : strongest;
        fastest = fast[l] > fastest ? fast[l] : fastest;
    }
    double* partial_row = partial.data + PARTIAL_COUNT * block;
    partial_row[KINETIC_PART] = kinetic / mass_factor;
    partial_row[SPEED_PART] = fastest;
    partial_row[STRONGEST_PART] = strongest;
    partial_row[FORCE_PART] = square;
"""


def _polynomial(coefficients: tuple[float, ...], variable: str) -> str:
    """Horner form in C++."""
    text = f"real({coefficients[-1]!r})"
    for c in reversed(coefficients[:-1]):
        text = f"(real({c!r}) + {variable} * {text})"
    return text


# atan(x)/x in powers of x^2 on |x| <= tan(pi/8): interpolation at Chebyshev nodes; errors 6e-10 and below 1e-16.
ATAN_SINGLE = (
    0.9999999993712282,
    -0.33333306893048514,
    0.19998183041083206,
    -0.14239532669648974,
    0.10569828806414448,
    -0.06026305227658459,
)
ATAN_DOUBLE = (
    1.0,
    -0.3333333333333312,
    0.19999999999940893,
    -0.14285714279250245,
    0.11111110744919658,
    -0.09090896809064027,
    0.07692045330902225,
    -0.06662951813629191,
    0.05846878297330872,
    -0.05035102456601552,
    0.03796525745386593,
    -0.017805397205419446,
)


_CONSTANTS = STEERING + constants(BLOCK_SIZE=BLOCK_SIZE, BLOCK_PAD=BLOCK_PAD)

_SNIPPET = _CONSTANTS + _BLOCK_STEP.replace("ATAN_SINGLE", _polynomial(ATAN_SINGLE, "z")).replace(
    "ATAN_DOUBLE", _polynomial(ATAN_DOUBLE, "z")
)


@wp.func_native(_SNIPPET)
def block_step(
    # in: what steers the step
    block: wp.int32,
    control: wp.array(dtype=wp.float64),
    phase: Any,
    unit: Any,
    gripped: wp.int32,
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    block_pair_start: wp.array(dtype=wp.int32),
    block_held_start: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    wire_clamp: wp.array2d(dtype=Any),
    wire_axial: wp.array(dtype=Any),
    wire_mass: wp.array(dtype=Any),
    # in: rest data
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    rest_length: wp.array(dtype=Any),
    inverse_length: wp.array(dtype=Any),
    rest_angle: wp.array(dtype=Any),
    hinge_stiffness: wp.array(dtype=Any),
    inverse_mass: wp.array(dtype=Any),
    node_mass: wp.array(dtype=Any),
    tension_offset: wp.array(dtype=Any),
    yield_moment: Any,
    kept_stiffness: Any,
    plastic_turn: wp.array(dtype=Any),
    back_turn: wp.array(dtype=Any),
    # in: contact and grips
    block_pair: wp.array(dtype=wp.int32),
    pair_node: wp.array(dtype=wp.int32),
    pair_force: wp.array(dtype=Any),
    pair_nodal_x: wp.array(dtype=Any),
    pair_nodal_y: wp.array(dtype=Any),
    held_node: wp.array(dtype=wp.int32),
    # state in
    ux_in: wp.array(dtype=Any),
    uy_in: wp.array(dtype=Any),
    # state in and out
    vx: wp.array(dtype=Any),
    vy: wp.array(dtype=Any),
    # out
    ux_out: wp.array(dtype=Any),
    uy_out: wp.array(dtype=Any),
    partial: wp.array2d(dtype=wp.float64),
): ...


@wp.kernel
def step_wires_by_block(
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    block_pair_start: wp.array(dtype=wp.int32),
    block_held_start: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    wire_clamp: wp.array2d(dtype=Any),
    wire_axial: wp.array(dtype=Any),
    wire_mass: wp.array(dtype=Any),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    unit: Any,
    first_block: int,
    gripped: int,
    # in: rest data
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    rest_length: wp.array(dtype=Any),
    inverse_length: wp.array(dtype=Any),
    rest_angle: wp.array(dtype=Any),
    hinge_stiffness: wp.array(dtype=Any),
    inverse_mass: wp.array(dtype=Any),
    node_mass: wp.array(dtype=Any),
    tension_offset: wp.array(dtype=Any),
    yield_moment: Any,
    kept_stiffness: Any,
    plastic_turn: wp.array(dtype=Any),
    back_turn: wp.array(dtype=Any),
    # in: contact and grips
    block_pair: wp.array(dtype=wp.int32),
    pair_node: wp.array(dtype=wp.int32),
    pair_force: wp.array(dtype=Any),
    pair_nodal_x: wp.array(dtype=Any),
    pair_nodal_y: wp.array(dtype=Any),
    held_node: wp.array(dtype=wp.int32),
    # state in
    ux_in: wp.array(dtype=Any),
    uy_in: wp.array(dtype=Any),
    # state in and out
    vx: wp.array(dtype=Any),
    vy: wp.array(dtype=Any),
    # out
    ux_out: wp.array(dtype=Any),
    uy_out: wp.array(dtype=Any),
    partial: wp.array2d(dtype=wp.float64),
):
    block = first_block + wp.tid()
    if control[STATUS] != STATUS_RUNNING:
        # the state is frozen: hand it on unchanged
        for i in range(block_first[block], block_first[block] + block_count[block]):
            ux_out[i] = ux_in[i]
            uy_out[i] = uy_in[i]
        return
    block_step(
        block,
        control,
        type(unit)(rounding_phase(control[STEP])),
        unit,
        gripped,
        block_first,
        block_count,
        block_table,
        block_wire,
        block_pair_start,
        block_held_start,
        wire_first,
        wire_count,
        wire_closed,
        wire_clamp,
        wire_axial,
        wire_mass,
        rest_x,
        rest_y,
        rest_length,
        inverse_length,
        rest_angle,
        hinge_stiffness,
        inverse_mass,
        node_mass,
        tension_offset,
        yield_moment,
        kept_stiffness,
        plastic_turn,
        back_turn,
        block_pair,
        pair_node,
        pair_force,
        pair_nodal_x,
        pair_nodal_y,
        held_node,
        ux_in,
        uy_in,
        vx,
        vy,
        ux_out,
        uy_out,
        partial,
    )
