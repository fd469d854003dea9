"""Contact of a body with the smooth curve of a wire.

On segment j between nodes j and j + 1, with u in [0, 1] and everything taken relative to node j,

    p(u) = h10 M0 + h01 e + h11 M1 + u^2 (1 - u)^2 (b_t(u) e + b_n(u) J e)
    M = m + a m + b J m,    m0 = (e_before + e)/2,  m1 = (e + e_after)/2

h.. are the Hermite polynomials, m the Catmull-Rom tangents, J turns by +90 degrees. The numbers a, b of the nodes and
the cubics b_t, b_n of the segment come from a table of one repeat, such that p is the true curve of the wire at
rest. M belongs to the node and the last term has no slope there, so the curve is always continuously
differentiable. With the closest point, n the left normal there and `side` telling on which side of the wire the
body belongs,

    gap = side n.(c - p) - reach         F = max(0, offset - k gap)

The sign of the gap is the side's, so a body that was pushed through is pushed back. F acts on the body along side n, and on the
four nodes, in which p is linear, with minus the transposed weights: the gradient of the energy. There is no net force and,
because p rotates with the nodes, no net moment.

| symbol | argument | unit |
|---|---|---|
| c | body centre, from pair_rest (counts, in the frame of the table) and the displacements | m |
| reach | contact distance of body centre and wire centre line | m |
| offset | pair_offset: augmented Lagrangian multiplier | N |
| k | CONTACT_STIFFNESS | N/m |
"""

from typing import Any

import warp as wp

from .control import CONTACT_STIFFNESS, GRADIENT, LENGTH_FACTOR, STATUS, STATUS_RUNNING, TRAVEL
from .stretch import edge_component
from .wires import node_at

CURVE_COEFFICIENTS = 10  # a, b of the node; then four of b_t and four of b_n of the segment to the next node
CLOSEST_POINT_ITERATIONS = 8
# [segments] tolerance of the contact point. It lags behind a sliding body by this much; the force then deviates from the normal
# by that over the radius and does positive work on the slide, so that an undamped mesh gains energy
CLOSEST_POINT_SINGLE = wp.constant(wp.float32(1.0e-5))
CLOSEST_POINT_DOUBLE = wp.constant(wp.float64(1.0e-9))


@wp.func
def closest_point_tolerance(unit: wp.float32):
    return CLOSEST_POINT_SINGLE


@wp.func
def closest_point_tolerance(unit: wp.float64):
    return CLOSEST_POINT_DOUBLE


@wp.func
def cubic(c0: Any, c1: Any, c2: Any, c3: Any, u: Any):
    return c0 + u * (c1 + u * (c2 + u * c3))


@wp.func
def cubic_slope(c1: Any, c2: Any, c3: Any, u: Any):
    return c1 + u * (c2 + c2 + (c3 + c3 + c3) * u)


@wp.func
def turned(a: Any, b: Any, x: Any, y: Any):
    """a v + b J v of the vector v = (x, y)."""
    return a * x - b * y, a * y + b * x


@wp.kernel
def find_contact_forces(
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    unit: Any,
    reach_at_rest: Any,
    first_pair: int,
    # in: rest data of one repeat
    table_x: wp.array(dtype=Any),
    table_y: wp.array(dtype=Any),
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    curve: wp.array2d(dtype=Any),
    # in: pairs
    pair_wire: wp.array(dtype=wp.int32),
    pair_seed: wp.array(dtype=wp.int32),
    pair_table: wp.array(dtype=wp.int32),
    pair_low: wp.array(dtype=wp.int32),
    pair_high: wp.array(dtype=wp.int32),
    pair_side: wp.array(dtype=wp.int32),
    pair_rest_x: wp.array(dtype=Any),
    pair_rest_y: wp.array(dtype=Any),
    pair_wake: wp.array(dtype=Any),
    pair_offset: wp.array(dtype=Any),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    # state in
    ux: wp.array(dtype=Any),
    uy: wp.array(dtype=Any),
    body_ux: wp.array(dtype=Any),
    body_uy: wp.array(dtype=Any),
    # state in and out: the contact point of the step before is where the search starts
    pair_slide: wp.array(dtype=wp.int32),
    pair_u: wp.array(dtype=Any),
    # out
    pair_node: wp.array(dtype=wp.int32),
    pair_gap: wp.array(dtype=Any),
    pair_force: wp.array(dtype=Any),
    pair_body_x: wp.array(dtype=Any),
    pair_body_y: wp.array(dtype=Any),
    pair_nodal_x: wp.array(dtype=Any),
    pair_nodal_y: wp.array(dtype=Any),
):
    pair = first_pair + wp.tid()
    if control[STATUS] != STATUS_RUNNING:
        return
    zero = type(unit)(0.0)
    one = type(unit)(1.0)
    half = type(unit)(0.5)
    two = type(unit)(2.0)
    three = type(unit)(3.0)
    if control[TRAVEL] < wp.float64(pair_wake[pair]):
        pair_force[pair] = zero
        return
    length_factor = type(unit)(control[LENGTH_FACTOR])
    body = pair / 2
    wire = pair_wire[pair]
    first = wire_first[wire]
    count = wire_count[wire]
    closed = wire_closed[wire]
    fxx = type(unit)(control[GRADIENT])
    fxy = type(unit)(control[GRADIENT + 1])
    fyx = type(unit)(control[GRADIENT + 2])
    fyy = type(unit)(control[GRADIENT + 3])
    bx = body_ux[body]
    by = body_uy[body]
    slide = pair_slide[pair]
    u = pair_u[pair]

    node = int(0)
    gx = zero
    gy = zero
    px = zero
    py = zero
    dx = zero
    dy = zero
    bend_t = zero
    bend_n = zero
    t = int(0)
    open_square = type(unit)(9.0) * reach_at_rest * reach_at_rest
    here = u  # where on the segment the curve was evaluated last
    for _iteration in range(CLOSEST_POINT_ITERATIONS):
        node = node_at(pair_seed[pair] + slide, first, count, closed)
        before = node_at(pair_seed[pair] + slide - 1, first, count, closed)
        after = node_at(pair_seed[pair] + slide + 1, first, count, closed)
        last = node_at(pair_seed[pair] + slide + 2, first, count, closed)
        t = pair_table[pair] + slide
        e0x = edge_component(fxx, fxy, rest_x[t], rest_y[t], ux[after], ux[node], unit)
        e0y = edge_component(fyx, fyy, rest_x[t], rest_y[t], uy[after], uy[node], unit)
        m0x = half * (e0x + edge_component(fxx, fxy, rest_x[t - 1], rest_y[t - 1], ux[node], ux[before], unit))
        m0y = half * (e0y + edge_component(fyx, fyy, rest_x[t - 1], rest_y[t - 1], uy[node], uy[before], unit))
        m1x = half * (e0x + edge_component(fxx, fxy, rest_x[t + 1], rest_y[t + 1], ux[last], ux[after], unit))
        m1y = half * (e0y + edge_component(fyx, fyy, rest_x[t + 1], rest_y[t + 1], uy[last], uy[after], unit))
        lx = unit * type(unit)(pair_rest_x[pair] - table_x[t])
        ly = unit * type(unit)(pair_rest_y[pair] - table_y[t])
        gx = edge_component(fxx, fxy, lx, ly, bx, ux[node], unit)
        gy = edge_component(fyx, fyy, lx, ly, by, uy[node], unit)
        m0x, m0y = turned(one + curve[t, 0], curve[t, 1], m0x, m0y)
        m1x, m1y = turned(one + curve[t + 1, 0], curve[t + 1, 1], m1x, m1y)
        here = u
        # point, slope and curvature of p(u)
        h10 = u * (one - u) * (one - u)
        h01 = u * u * (three - two * u)
        h11 = u * u * (u - one)
        d10 = (one - u) * (one - three * u)
        d01 = type(unit)(6.0) * u * (one - u)
        d11 = u * (three * u - two)
        c10 = type(unit)(6.0) * u - type(unit)(4.0)
        c01 = type(unit)(6.0) - type(unit)(12.0) * u
        c11 = type(unit)(6.0) * u - two
        rise = u * (one - u)
        bump = rise * rise
        bump_slope = two * rise * (one - two * u)
        along_chord = cubic(curve[t, 2], curve[t, 3], curve[t, 4], curve[t, 5], u)
        across_chord = cubic(curve[t, 6], curve[t, 7], curve[t, 8], curve[t, 9], u)
        bend_t = h01 + bump * along_chord
        bend_n = bump * across_chord
        turn_t = d01 + bump_slope * along_chord + bump * cubic_slope(curve[t, 3], curve[t, 4], curve[t, 5], u)
        turn_n = bump_slope * across_chord + bump * cubic_slope(curve[t, 7], curve[t, 8], curve[t, 9], u)
        px = h10 * m0x + bend_t * e0x - bend_n * e0y + h11 * m1x
        py = h10 * m0y + bend_t * e0y + bend_n * e0x + h11 * m1y
        dx = d10 * m0x + turn_t * e0x - turn_n * e0y + d11 * m1x
        dy = d10 * m0y + turn_t * e0y + turn_n * e0x + d11 * m1y
        ax = c10 * m0x + c01 * e0x + c11 * m1x
        ay = c10 * m0y + c01 * e0y + c11 * m1y
        # Newton step towards (c - p).p' = 0, kept positive where the curve bends away from the body
        along = (gx - px) * dx + (gy - py) * dy
        square = dx * dx + dy * dy
        denominator = wp.max(square - ((gx - px) * ax + (gy - py) * ay), type(unit)(0.25) * square)
        step = wp.clamp(along / denominator, -one, one)
        target = u + step
        if target < zero and slide > pair_low[pair]:
            slide = slide - 1
            u = wp.clamp(target + one, zero, one)
        elif target > one and slide < pair_high[pair]:
            slide = slide + 1
            u = wp.clamp(target - one, zero, one)
        else:
            target = wp.clamp(target, zero, one)
            done = wp.abs(target - u) < closest_point_tolerance(unit)
            if done:
                break
            u = target
        # a pair well open here, across the wire, moves its point once a step; only near contact must it be exact
        across = type(unit)(pair_side[pair]) * (dx * (gy - py) - dy * (gx - px))
        if across > zero and across * across > open_square * square:
            break
    pair_slide[pair] = slide
    pair_u[pair] = u
    pair_node[pair] = node
    side = type(unit)(pair_side[pair])
    speed = one / wp.sqrt(dx * dx + dy * dy)
    nx = -side * dy * speed
    ny = side * dx * speed
    gap = nx * (gx - px) + ny * (gy - py) - reach_at_rest * length_factor
    force = wp.max(zero, pair_offset[pair] - type(unit)(control[CONTACT_STIFFNESS]) * gap)
    pair_gap[pair] = gap
    pair_force[pair] = force
    if force == zero:
        return
    fx = force * nx
    fy = force * ny
    pair_body_x[pair] = fx
    pair_body_y[pair] = fy
    h10 = half * here * (one - here) * (one - here)
    h11 = half * here * here * (here - one)
    # transposed weights of the chord and of the two tangents
    cx, cy = turned(bend_t, -bend_n, fx, fy)
    before_x, before_y = turned(h10 * (one + curve[t, 0]), -h10 * curve[t, 1], fx, fy)
    after_x, after_y = turned(h11 * (one + curve[t + 1, 0]), -h11 * curve[t + 1, 1], fx, fy)
    pair_nodal_x[4 * pair] = before_x
    pair_nodal_y[4 * pair] = before_y
    pair_nodal_x[4 * pair + 1] = cx + after_x - fx
    pair_nodal_y[4 * pair + 1] = cy + after_y - fy
    pair_nodal_x[4 * pair + 2] = -(cx + before_x)
    pair_nodal_y[4 * pair + 2] = -(cy + before_y)
    pair_nodal_x[4 * pair + 3] = -after_x
    pair_nodal_y[4 * pair + 3] = -after_y
