"""Prolongation of a small mesh's change to a larger mesh, for a multilevel start.

Both meshes are copies of one repeat. A node at rest position X of the large mesh takes its values from the same node of the
repeat on the small mesh, moved by a shift that depends on X: none within `rim` repeats of an edge, counted from that edge,
and linear in between, so that edges and corners are copied and the interior is stretched. Where it begins, its slope grows over
some repeats: wires that touch lie up to a repeat apart at rest, and would overlap where the slope jumps. Shifts are in general
not integer: values are interpolated between the four repeats around. Stretching reduces gradients, so each repeat is less
strained than its source: the response of a repeat to that difference is subtracted. A launch adds the change of one field: a
displacement, a tension, a multiplier.

A mesh cut along another outline starts from one repeat of endless cloth, whose change is tapered towards the clamps.

| symbol | meaning | unit |
|---|---|---|
| large, small | repeats of the meshes in a direction; small = 1 and periodic: all repeats are alike | - |
| place | distance from the lower edge of the large mesh, in repeats | - |
"""

from typing import Any

import warp as wp

MAX_BLEND = wp.constant(wp.float64(3.0))  # repeats over which the shift begins to change with the place


@wp.struct
class Meshes:
    """The two meshes; see the table above."""

    repeat: wp.vec2d  # [m] size of a repeat
    low: wp.vec2d  # [m] lower corner of the large mesh at rest
    large: wp.vec2i
    small: wp.vec2i
    offset: wp.vec2i  # what to add to a column and row of the large mesh for the table of places, beside the shift
    rim: int
    periodic: int
    taper: wp.float64  # nodes from the end of a wire to where it changes as the small mesh does; 0: all along


@wp.func
def index_on_small(index: int, offset: int, small: int, periodic: int) -> int:
    """Column or row of the small mesh's table of places."""
    if periodic != 0:
        return ((index % small) + small) % small
    return index + offset


@wp.func
def blend_of(small: int, rim: int) -> wp.float64:
    """Repeats over which the shift begins and ends to change."""
    return wp.clamp(wp.float64(0.5) * wp.float64(small - 2 * rim), wp.float64(1.0), MAX_BLEND)


@wp.func
def stretched(large: int, small: int, rim: int) -> wp.float64:
    """Repeats over which a shift of the full slope grows from nothing to all."""
    return wp.max(wp.float64(large - 2 * rim) - blend_of(small, rim), wp.float64(1.0))


@wp.func
def share_along(place: wp.float64, large: int, small: int, rim: int) -> wp.float64:
    """Share 0 .. 1 of the shift at a place, counted from the edge at which the shift is 0: a line with a parabola at
    its beginning."""
    blend = blend_of(small, rim)
    t = wp.max(place - wp.float64(rim), wp.float64(0.0))
    begun = wp.min(t, blend)
    return (t - begun + wp.float64(0.5) * begun * begun / blend) / stretched(large, small, rim)


@wp.func
def shift_along(place: wp.float64, large: int, small: int, rim: int, periodic: int) -> wp.float64:
    if periodic != 0:
        return wp.float64(0.0)
    if place <= wp.float64(0.5) * wp.float64(large):
        return -share_along(place, large, small, rim) * wp.float64(large - small)
    return (share_along(wp.float64(large) - place, large, small, rim) - wp.float64(1.0)) * wp.float64(large - small)


@wp.func
def slope_along(place: wp.float64, large: int, small: int, rim: int, periodic: int) -> wp.float64:
    from_edge = wp.min(place, wp.float64(large) - place) - wp.float64(rim)
    if periodic != 0 or from_edge <= wp.float64(0.0):
        return wp.float64(0.0)
    share = wp.min(from_edge / blend_of(small, rim), wp.float64(1.0))
    return -share * wp.float64(large - small) / stretched(large, small, rim)


@wp.func
def shift_at(m: Meshes, place: wp.vec2d) -> wp.vec2d:
    """Shift in repeats from a place on the large mesh to the small one."""
    return wp.vec2d(
        shift_along(place[0], m.large[0], m.small[0], m.rim, m.periodic),
        shift_along(place[1], m.large[1], m.small[1], m.rim, m.periodic),
    )


@wp.func
def slope_at(m: Meshes, place: wp.vec2d) -> wp.vec2d:
    """Reduction [1/m] of a change's slope by stretching: the derivative of the shift."""
    return wp.vec2d(
        slope_along(place[0], m.large[0], m.small[0], m.rim, m.periodic) / m.repeat[0],
        slope_along(place[1], m.large[1], m.small[1], m.rim, m.periodic) / m.repeat[1],
    )


@wp.func
def corner_weights(shift: wp.vec2d, corner: int) -> wp.vec2d:
    """Weights along x and y of one of the four repeats around a shift."""
    return wp.vec2d(
        wp.abs(wp.float64(1 - corner % 2) - (shift[0] - wp.floor(shift[0]))),
        wp.abs(wp.float64(1 - corner / 2) - (shift[1] - wp.floor(shift[1]))),
    )


@wp.func
def corner_strain(slope: wp.vec2d, weights: wp.vec2d, corner: int, ux: wp.float64, uy: wp.float64) -> wp.vec4d:
    """Part of a corner with the change (ux, uy) in the gradient (xx, xy, yx, yy) lost by stretching."""
    along_x = slope[0] * wp.float64(2 * (corner % 2) - 1) * weights[1]
    along_y = slope[1] * wp.float64(2 * (corner / 2) - 1) * weights[0]
    return wp.vec4d(along_x * ux, along_y * ux, along_x * uy, along_y * uy)


@wp.func
def corner_on_small(m: Meshes, shift: wp.vec2d, column: int, row: int, corner: int):
    """Column and row of the table of places of the small mesh."""
    return (
        index_on_small(column + int(wp.floor(shift[0])) + corner % 2, m.offset[0], m.small[0], m.periodic),
        index_on_small(row + int(wp.floor(shift[1])) + corner / 2, m.offset[1], m.small[1], m.periodic),
    )


@wp.func
def weighed(change: wp.array2d(dtype=wp.float64), i: int, gradient: wp.vec4d) -> wp.float64:
    """Change within a repeat by a strain gradient (xx, xy, yx, yy)."""
    return change[0, i] * gradient[0] + change[1, i] * gradient[1] + change[2, i] * gradient[2] + change[3, i] * gradient[3]


@wp.func
def faded(taper: wp.float64, from_end: int) -> wp.float64:
    """Share of a change at `from_end` nodes from the end of a wire: smooth from 0 at the clamp to 1 after `taper` nodes."""
    if taper <= wp.float64(0.0):
        return wp.float64(1.0)
    s = wp.min(wp.max(wp.float64(from_end - 1), wp.float64(0.0)) / taper, wp.float64(1.0))
    return s * s * (wp.float64(3.0) - wp.float64(2.0) * s)


@wp.func
def found(table: wp.array3d(dtype=wp.int32), a: int, b: int, c: int) -> int:
    """Entry of a table of places, -1 beyond its ends."""
    if b < 0 or b >= table.shape[1] or c < 0 or c >= table.shape[2]:
        return -1
    return table[a, b, c]


@wp.func
def prolonged(
    m: Meshes,
    table: wp.array3d(dtype=wp.int32),
    strand: int,
    column: int,
    row: int,
    stride: int,
    k: int,
    per_source: int,
    side: int,
    place: wp.vec2d,
    change_x: wp.array(dtype=Any),
    change_y: wp.array(dtype=Any),
    change: wp.array(dtype=Any),
    cell: wp.array2d(dtype=wp.float64),
    cell_index: int,
) -> wp.float64:
    """Change of a field at a place on the large mesh.

    `table[strand, column, stride row + k]` is the source on the small mesh, or -1. A source has `per_source` values, with number
    `side` used; `cell[., cell_index]` are the derivatives in one repeat.
    """
    shift = shift_at(m, place)
    slope = slope_at(m, place)
    strained = wp.vec4d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    complete = int(0)
    weight = wp.float64(0.0)
    total = wp.float64(0.0)
    for corner in range(4):
        column_there, row_there = corner_on_small(m, shift, column, row, corner)
        source = found(table, strand, column_there, row_there * stride + k)
        if source >= 0:
            weights = corner_weights(shift, corner)
            w = weights[0] * weights[1]
            weight += w
            strained += corner_strain(slope, weights, corner, wp.float64(change_x[source]), wp.float64(change_y[source]))
            complete += 1
            total += w * wp.float64(change[per_source * source + side])
    if weight > wp.float64(0.0):
        if complete == 4:
            total += weighed(cell, cell_index, strained)
        total /= weight
    return total


@wp.kernel
def prolong_nodes(
    # in: blocks of the large mesh; column and row of the repeat of the first node
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    block_column: wp.array(dtype=wp.int32),
    block_row: wp.array(dtype=wp.int32),
    block_thread: wp.array(dtype=wp.int32),
    block_size: int,
    thread_start: wp.array(dtype=wp.int32),
    thread_nodes: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    # in: rest places
    place_x: wp.array(dtype=wp.float64),
    place_y: wp.array(dtype=wp.float64),
    # in: the two meshes
    m: Meshes,
    small_node: wp.array3d(dtype=wp.int32),
    # in: displacements [m] and the field that changed on the small mesh
    change_x: wp.array(dtype=Any),
    change_y: wp.array(dtype=Any),
    change: wp.array(dtype=Any),
    # in: derivatives of the field in one repeat by its deformation gradient, see kernels/membrane_transfer.py
    cell_node: wp.array(dtype=wp.int32),
    cell: wp.array2d(dtype=wp.float64),
    # in: factors of the change
    scale: wp.float64,
    wire_scale: wp.array(dtype=Any),
    # in and out
    value: wp.array(dtype=Any),
):
    """Add what changed; `small_node[thread, column, row n + k]` is the node of the small mesh, -1 where there is none."""
    thread = wp.tid()
    block = thread / block_size
    lane = thread - block * block_size
    if lane >= block_count[block]:
        return
    i = block_first[block] + lane
    t = block_table[block] + lane
    strand = block_thread[block]
    n = thread_nodes[strand]
    local = block_table[block] - thread_start[strand] + lane  # counted from the row of the block
    place = wp.vec2d(
        (place_x[t] - m.low[0]) / m.repeat[0] + wp.float64(block_column[block]),
        (place_y[t] - m.low[1]) / m.repeat[1] + wp.float64(block_row[block]),
    )
    row = block_row[block] + local / n
    column = block_column[block]
    total = prolonged(
        m, small_node, strand, column, row, n, local % n, 1, 0, place, change_x, change_y, change, cell, cell_node[t]
    )  # fmt: skip
    wire = block_wire[block]
    fade = faded(m.taper, wp.min(i - wire_first[wire], wire_first[wire] + wire_count[wire] - 1 - i))
    value[i] = value[i] + value.dtype(scale * wp.float64(wire_scale[wire]) * fade * total)


@wp.kernel
def prolong_bodies(
    # in: bodies of the large mesh
    body_clasp: wp.array(dtype=wp.int32),
    body_column: wp.array(dtype=wp.int32),
    body_row: wp.array(dtype=wp.int32),
    body_origin_x: wp.array(dtype=wp.float64),
    body_origin_y: wp.array(dtype=wp.float64),
    body_from_end: wp.array(dtype=wp.int32),
    # in: the two meshes
    m: Meshes,
    small_body: wp.array3d(dtype=wp.int32),
    # in: displacements [m] and the field that changed on the small mesh, with `per_body` values a body
    change_x: wp.array(dtype=Any),
    change_y: wp.array(dtype=Any),
    change: wp.array(dtype=Any),
    per_body: int,
    # in: derivatives of the field in one repeat by its deformation gradient
    cell: wp.array2d(dtype=wp.float64),
    scale: wp.float64,
    is_positive: int,
    # in and out
    value: wp.array(dtype=Any),
):
    """The same for bodies or their pairs, kept positive if `is_positive`.

    `small_body[clasp, column, row]` is the body of the small mesh, or -1.
    """
    i = wp.tid()
    body = i / per_body
    side = i % per_body
    clasp = body_clasp[body]
    place = wp.vec2d((body_origin_x[body] - m.low[0]) / m.repeat[0], (body_origin_y[body] - m.low[1]) / m.repeat[1])
    column = body_column[body]
    total = prolonged(
        m, small_body, clasp, column, body_row[body], 1, 0, per_body, side, place, change_x, change_y, change, cell,
        per_body * clasp + side,
    )  # fmt: skip
    moved = value[i] + value.dtype(scale * faded(m.taper, body_from_end[body]) * total)
    value[i] = wp.where(is_positive != 0, wp.max(moved, value.dtype(0)), moved)
