"""Neighbour search: the segment of its wire that a body may touch.

Of the nodes of the pair's own wire within its reach along that wire, the nearest one within the search radius is the initial
guess of the contact point. Its distance bounds the travel (TRAVEL in control.py, a bound on every displacement since the
search) before the pair can close: until then the pair sleeps. The search is valid while the travel is below half the margin
(TRAVEL_LIMIT).
"""

from typing import Any

import warp as wp

from .control import GRADIENT
from .stretch import edge_component
from .wires import node_at


@wp.kernel
def find_nearest_segments(
    # in: how
    radius: Any,
    half_chord: Any,
    sag: Any,
    reach: Any,
    control: wp.array(dtype=wp.float64),
    unit: Any,
    # in: rest data
    table_x: wp.array(dtype=Any),
    table_y: wp.array(dtype=Any),
    # in: pairs
    pair_wire: wp.array(dtype=wp.int32),
    pair_seed: wp.array(dtype=wp.int32),
    pair_table: wp.array(dtype=wp.int32),
    pair_low: wp.array(dtype=wp.int32),
    pair_high: wp.array(dtype=wp.int32),
    pair_rest_x: wp.array(dtype=Any),
    pair_rest_y: wp.array(dtype=Any),
    pair_force: wp.array(dtype=Any),
    pair_gap: wp.array(dtype=Any),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    # state in
    ux: wp.array(dtype=Any),
    uy: wp.array(dtype=Any),
    body_ux: wp.array(dtype=Any),
    body_uy: wp.array(dtype=Any),
    # in and out
    pair_slide: wp.array(dtype=wp.int32),
    # out
    pair_u: wp.array(dtype=Any),
    pair_wake: wp.array(dtype=Any),
):
    """`pair_wake` [m] is the travel at which the pair wakes up: 0 in touch, beyond any travel where no wire is near."""
    pair = wp.tid()
    if pair_wire[pair] < 0:
        return  # its wire is in another strip: it sleeps for ever
    if pair_force[pair] != type(unit)(0.0) or pair_gap[pair] < type(unit)(0.0):
        pair_wake[pair] = type(unit)(0.0)  # in touch, or pushed through: never asleep
        return
    body = pair / 2
    wire = pair_wire[pair]
    first = wire_first[wire]
    count = wire_count[wire]
    closed = wire_closed[wire]
    # of the wire, counted from its seed: every node once
    low = pair_low[pair]
    last = wp.min(pair_high[pair] + 1, low + count - 1)
    if closed == 0:
        low = wp.max(pair_low[pair], first - pair_seed[pair])
        last = wp.min(pair_high[pair] + 1, first + count - 1 - pair_seed[pair])
    fxx = type(unit)(control[GRADIENT])
    fxy = type(unit)(control[GRADIENT + 1])
    fyx = type(unit)(control[GRADIENT + 2])
    fyy = type(unit)(control[GRADIENT + 3])
    best = int(-2147483647)
    best_square = radius * radius
    for offset in range(low, last + 1):
        t = pair_table[pair] + offset
        node = node_at(pair_seed[pair] + offset, first, count, closed)
        lx = unit * type(unit)(pair_rest_x[pair] - table_x[t])
        ly = unit * type(unit)(pair_rest_y[pair] - table_y[t])
        dx = edge_component(fxx, fxy, lx, ly, body_ux[body], ux[node], unit)
        dy = edge_component(fyx, fyy, lx, ly, body_uy[body], uy[node], unit)
        square = dx * dx + dy * dy
        if square < best_square:
            best = offset
            best_square = square
    if best == -2147483647:
        pair_wake[pair] = type(unit)(1.0)
        return
    # the chord between two nodes is nearer than the nearer node, the curve nearer still by its sag; both ends may move
    chord_square = wp.max(type(unit)(0.0), best_square - half_chord * half_chord)
    open_by = wp.sqrt(chord_square) - sag - reach
    pair_wake[pair] = wp.max(type(unit)(0.0), type(unit)(0.5) * open_by)
    slide = wp.min(best, pair_high[pair])
    if slide != pair_slide[pair] and slide != pair_slide[pair] + 1:
        pair_slide[pair] = slide
        pair_u[pair] = type(unit)(0.0)
        if slide != best:
            pair_u[pair] = type(unit)(1.0)
