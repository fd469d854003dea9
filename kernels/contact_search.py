"""Neighbour search: the segments that a body may touch, by a hash grid and the table of clasps.

The hash works on rest coordinates F^-1 x, scaled per axis so that a cell is 1 wide; on a periodic tile the number of
cells divides the tile exactly, so that the grid's own wrapping is the periodic one. From the nodes that the hash finds
around a body, only those on the pair's own wire and within its reach along the wire count; the nearest one is the
initial guess of the contact point. Its distance bounds the travel (TRAVEL in control.py, a bound on every displacement since
the search) before the pair can close: until then the pair sleeps. The search is valid while the travel is below half the
margin (TRAVEL_LIMIT).
"""

from typing import Any

import warp as wp

from .control import GRADIENT
from .stretch import edge_component
from .wires import node_at


@wp.kernel
def place_nodes_in_hash(
    # in: where
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_origin_x: wp.array(dtype=wp.float64),
    block_origin_y: wp.array(dtype=wp.float64),
    block_size: int,
    # in: how
    control: wp.array(dtype=wp.float64),
    unit: Any,
    cell_x: wp.float64,
    cell_y: wp.float64,
    # in: rest data and state
    place_x: wp.array(dtype=wp.float64),
    place_y: wp.array(dtype=wp.float64),
    ux: wp.array(dtype=Any),
    uy: wp.array(dtype=Any),
    # out
    hash_position: wp.array(dtype=wp.vec3),
):
    """Rest coordinates of the deformed nodes in cells; threads of a block are consecutive."""
    thread = wp.tid()
    block = thread / block_size
    lane = thread - block * block_size
    if lane >= block_count[block]:
        return
    i = block_first[block] + lane
    t = block_table[block] + lane
    scale = wp.float64(unit)
    fxx = control[GRADIENT]
    fxy = control[GRADIENT + 1]
    fyx = control[GRADIENT + 2]
    fyy = control[GRADIENT + 3]
    determinant = fxx * fyy - fxy * fyx
    ax = scale * wp.float64(ux[i])
    ay = scale * wp.float64(uy[i])
    x = block_origin_x[block] + place_x[t] + (fyy * ax - fxy * ay) / determinant
    y = block_origin_y[block] + place_y[t] + (fxx * ay - fyx * ax) / determinant
    hash_position[i] = wp.vec3(wp.float32(x / cell_x), wp.float32(y / cell_y), 0.0)


@wp.kernel
def find_nearest_segments(
    # in: how
    grid: wp.uint64,
    hash_radius: float,
    radius: Any,
    half_chord: Any,
    sag: Any,
    reach: Any,
    expected: Any,
    control: wp.array(dtype=wp.float64),
    unit: Any,
    cell_x: wp.float64,
    cell_y: wp.float64,
    # in: rest data
    table_x: wp.array(dtype=Any),
    table_y: wp.array(dtype=Any),
    body_origin_x: wp.array(dtype=wp.float64),
    body_origin_y: wp.array(dtype=wp.float64),
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
    low = pair_low[pair]
    high = pair_high[pair]
    fxx = type(unit)(control[GRADIENT])
    fxy = type(unit)(control[GRADIENT + 1])
    fyx = type(unit)(control[GRADIENT + 2])
    fyy = type(unit)(control[GRADIENT + 3])
    determinant = control[GRADIENT] * control[GRADIENT + 3] - control[GRADIENT + 1] * control[GRADIENT + 2]
    ax = wp.float64(unit) * wp.float64(body_ux[body])
    ay = wp.float64(unit) * wp.float64(body_uy[body])
    x = body_origin_x[body] + (control[GRADIENT + 3] * ax - control[GRADIENT + 1] * ay) / determinant
    y = body_origin_y[body] + (control[GRADIENT] * ay - control[GRADIENT + 2] * ax) / determinant
    centre = wp.vec3(wp.float32(x / cell_x), wp.float32(y / cell_y), 0.0)

    best = int(-2147483647)
    best_square = radius * radius
    query = wp.hash_grid_query(grid, centre, hash_radius)
    found = int(0)
    while wp.hash_grid_query_next(query, found):
        # position along the pair's own wire, counted from its seed
        if found < first or found >= first + count:
            continue
        offset = found - pair_seed[pair]
        if closed != 0:
            offset = offset - count * wp.int32(wp.floor(wp.float32(offset - low) / wp.float32(count)))
        if offset < low or offset > high + 1:
            continue
        t = pair_table[pair] + offset
        node = node_at(pair_seed[pair] + offset, first, count, closed)
        lx = unit * type(unit)(pair_rest_x[pair] - table_x[t])
        ly = unit * type(unit)(pair_rest_y[pair] - table_y[t])
        dx = edge_component(fxx, fxy, lx, ly, body_ux[body], ux[node], unit)
        dy = edge_component(fyx, fyy, lx, ly, body_uy[body], uy[node], unit)
        square = dx * dx + dy * dy
        if square < best_square or (square == best_square and offset < best):
            best = offset
            best_square = square
    if best == -2147483647:
        pair_wake[pair] = type(unit)(1.0)
        return
    # the chord between two nodes is nearer than the nearer node, the curve nearer still by its sag; both ends may move
    chord_square = wp.max(type(unit)(0.0), best_square - half_chord * half_chord)
    open_by = wp.sqrt(chord_square) - sag - reach - expected
    pair_wake[pair] = wp.max(type(unit)(0.0), type(unit)(0.5) * open_by)
    slide = wp.min(best, high)
    if slide != pair_slide[pair] and slide != pair_slide[pair] + 1:
        pair_slide[pair] = slide
        pair_u[pair] = type(unit)(0.0)
        if slide != best:
            pair_u[pair] = type(unit)(1.0)
