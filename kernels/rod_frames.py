"""Kinematics of rods: edges, tangents, and the directors of the sections.

A rod is a chain of nodes in space with a section on each segment. One director a segment, normal to the tangent, gives the
rotation of the section. When a segment tilts from tangent t to t', its director is transported without rotation about the tangent
(parallel transport in time; Bergou, Audoly, Vouga, Wardetzky and Grinspun 2010, "Discrete viscous threads"),

    d' = c d + b x d + b (b . d)/(1 + c)        b = t x t',  c = t . t'

and then rotated by the spin of the segment. The director stores the twist, so no angle is measured against a frame that could
jump.

Positions are x = F X + u; F acts in the plane of the mesh only. The last node of an open wire has no segment.
"""

from typing import Any

import warp as wp

from warpknit.kernels.control import FRAMES_AHEAD, GRADIENT, is_at_rest, is_halted
from warpknit.kernels.native import with_shared
from warpknit.kernels.rod_blocks import BLOCK

# when the frames are computed: always; before a step, unless the step before has done so; behind a step, for the next one, where
# nothing else moves nodes until then
ALWAYS = wp.constant(0)
UNLESS_AHEAD = wp.constant(1)
AHEAD = wp.constant(2)

# The sine and the cosine are series to round-off up to HALF a radian, which a step hardly ever exceeds.
_FRAMES = (
    "typedef decltype(pending_turn.data[0] + pending_turn.data[0]) real;\n"
    + BLOCK
    + r"""
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
    #pragma clang fp reassociate(on) contract(fast)
    #pragma clang loop vectorize(enable)
    EACH(k, 0, segments) {
        const real a = turn[k], z = a * a;
        is_wide |= z > HALF * HALF ? 1 : 0;
        sines[k] = a * (1 + z * (real(-1.0 / 6) + z * (real(1.0 / 120) + z * (real(-1.0 / 5040) + z * (real(1.0 / 362880)
            + z * (real(-1.0 / 39916800) + z * real(1.0 / 6227020800)))))));
        cosines[k] = 1 + z * (real(-1.0 / 2) + z * (real(1.0 / 24) + z * (real(-1.0 / 720) + z * (real(1.0 / 40320)
            + z * (real(-1.0 / 3628800) + z * (real(1.0 / 479001600) + z * real(-1.0 / 87178291200)))))));
    }
    }
    if (is_wide) {
        EACH(k, 0, segments) {
            sines[k] = wp::sin(turn[k]);
            cosines[k] = wp::cos(turn[k]);
        }
    }
    {
    #pragma clang fp reassociate(on) contract(fast)
    #pragma clang loop vectorize(enable)
    EACH(k, 0, count) {
        place[3 * k] = fxx * rest[3 * k] + fxy * rest[3 * k + 1] + ux[k];
        place[3 * k + 1] = fyx * rest[3 * k] + fyy * rest[3 * k + 1] + uy[k];
        place[3 * k + 2] = rest[3 * k + 2] + uz[k];
    }
    }
    {
    #pragma clang fp reassociate(on) contract(fast)
    #pragma clang loop vectorize(enable)
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
    #pragma clang fp reassociate(on) contract(fast)
    #pragma clang loop vectorize(enable)
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
        t[3 * k] = tx;
        t[3 * k + 1] = ty;
        t[3 * k + 2] = tz;
        d[3 * k] = co * wx + si * (ty * wz - tz * wy);
        d[3 * k + 1] = co * wy + si * (tz * wx - tx * wz);
        d[3 * k + 2] = co * wz + si * (tx * wy - ty * wx);
        turn[k] = 0;
    }
    }
"""
)


@wp.func
def affine_map(vector: wp.vec3d, control: wp.array(dtype=wp.float64)) -> wp.vec3d:
    """F times a rest vector; the deformation gradient F acts in the plane."""
    return wp.vec3d(
        control[GRADIENT] * vector[0] + control[GRADIENT + 1] * vector[1],
        control[GRADIENT + 2] * vector[0] + control[GRADIENT + 3] * vector[1],
        vector[2],
    )


@wp.func_native(with_shared(_FRAMES))
def frames_of_block(
    # in: blocks and wires
    block: wp.int32,
    lane: wp.int32,
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    rest_position: wp.array(dtype=wp.vec3d),
    rest_edge: wp.array(dtype=wp.vec3d),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    # state in
    displacement: wp.array(dtype=wp.vec3d),
    # in and out: the pending rotation [rad] is applied and set to zero
    pending_turn: wp.array(dtype=Any),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    # out
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
): ...


@wp.kernel
def update_frames(
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    first_block: int,
    threads_a_block: int,
    when: int,
    rest_position: wp.array(dtype=wp.vec3d),
    rest_edge: wp.array(dtype=wp.vec3d),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    # state in
    displacement: wp.array(dtype=wp.vec3d),
    # in and out: the pending rotation [rad] is applied and set to zero
    pending_turn: wp.array(dtype=Any),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    # out
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
):
    """`threads_a_block` threads a block: one, or ROD_LANES on a GPU. `rest_edge` may cross the border of a
    periodic tile."""
    if (when == UNLESS_AHEAD and control[FRAMES_AHEAD] != wp.float64(0.0)) or (when == AHEAD and not is_at_rest(control)):
        return
    thread = wp.tid()
    block = first_block + thread / threads_a_block
    if not is_halted(control):
        frames_of_block(
            block,
            thread % threads_a_block,
            block_first,
            block_count,
            block_wire,
            wire_first,
            wire_count,
            wire_closed,
            rest_row,
            rest_position,
            rest_edge,
            control,
            displacement,
            pending_turn,
            tangent,
            director,
            position,
            length,
        )
