"""Transfer between a mesh and a coarse membrane grid: gather out-of-balance forces, spread displacements.

Grid node (a, b) stands at low + (a, b) cell; its shape function is bilinear in the rest position and falls to zero at the next
grid nodes. A virtual displacement of the membrane moves nodes and bodies by the shape functions at their rest position, so the
force on a grid node is the sum of their forces with the same weights. A launch spreads the displacement in one direction, or the
change of another field by strain. Spatial displacements are spread as a bicubic surface, whose slopes have no jumps.
"""

from typing import Any

import warp as wp

from .banded_mass import HELD_NODE
from .prolong import weighed


@wp.struct
class Grid:
    """Position of the grid."""

    low: wp.vec2d  # [m]
    cell: wp.vec2d  # [m]
    cells: wp.vec2i


@wp.func
def cell_at(x: wp.float64, low: wp.float64, cell: wp.float64, cells: int) -> wp.float64:
    """Place on the grid in cells, kept on it."""
    return wp.clamp((x - low) / cell, wp.float64(0.0), wp.float64(cells))


@wp.func
def corner_index(grid: Grid, ix: int, iy: int, corner: int) -> int:
    """Grid node at a corner of a cell."""
    return (ix + corner % 2) * (grid.cells[1] + 1) + iy + corner / 2


@wp.func
def place_on(grid: Grid, x: wp.float64, y: wp.float64):
    """Cell (column, row) of a place, and position in it, 0 to 1 in either direction."""
    gx = cell_at(x, grid.low[0], grid.cell[0], grid.cells[0])
    gy = cell_at(y, grid.low[1], grid.cell[1], grid.cells[1])
    ix = wp.min(int(gx), grid.cells[0] - 1)
    iy = wp.min(int(gy), grid.cells[1] - 1)
    return ix, iy, gx - wp.float64(ix), gy - wp.float64(iy)


@wp.func
def corner_weights(sx: wp.float64, sy: wp.float64, corner: int) -> wp.vec2d:
    """Weights along x and y of a corner of the cell; their product is its shape function."""
    one = wp.float64(1.0)
    return wp.vec2d(wp.where(corner % 2 == 0, one - sx, sx), wp.where(corner / 2 == 0, one - sy, sy))


@wp.func
def gather(
    grid: Grid, x: wp.float64, y: wp.float64, fx: wp.float64, fy: wp.float64, unit: wp.float64, force: wp.array2d(dtype=wp.int64)
):
    """Add a force [N] at a place to the grid, in whole counts of `unit` [N]: their sums do not depend on the order."""
    ix, iy, sx, sy = place_on(grid, x, y)
    for corner in range(4):
        weights = corner_weights(sx, sy, corner)
        w = weights[0] * weights[1]
        there = corner_index(grid, ix, iy, corner)
        wp.atomic_add(force, there, 0, wp.int64(wp.round(w * fx / unit)))
        wp.atomic_add(force, there, 1, wp.int64(wp.round(w * fy / unit)))


@wp.func
def spread(grid: Grid, x: wp.float64, y: wp.float64, displacement: wp.array2d(dtype=wp.float64)):
    """Displacement (2,) [m] of the grid at a place, and its gradient (xx, xy, yx, yy)."""
    ix, iy, sx, sy = place_on(grid, x, y)
    moved = wp.vec2d(wp.float64(0.0), wp.float64(0.0))
    gradient = wp.vec4d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    for corner in range(4):
        weights = corner_weights(sx, sy, corner)
        wx = weights[0]
        wy = weights[1]
        slope_x = wp.where(corner % 2 == 0, -wy, wy) / grid.cell[0]
        slope_y = wp.where(corner / 2 == 0, -wx, wx) / grid.cell[1]
        there = corner_index(grid, ix, iy, corner)
        dx = displacement[there, 0]
        dy = displacement[there, 1]
        moved += wx * wy * wp.vec2d(dx, dy)
        gradient += wp.vec4d(slope_x * dx, slope_y * dx, slope_x * dy, slope_y * dy)
    return moved, gradient


@wp.kernel
def gather_node_forces(
    # in: blocks
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    block_origin_x: wp.array(dtype=wp.float64),
    block_origin_y: wp.array(dtype=wp.float64),
    block_size: int,
    place_x: wp.array(dtype=wp.float64),
    place_y: wp.array(dtype=wp.float64),
    grid: Grid,
    # in: masses and accelerations
    wire_mass: wp.array(dtype=Any),
    node_mass: wp.array(dtype=Any),
    acceleration_x: wp.array(dtype=Any),
    acceleration_y: wp.array(dtype=Any),
    force_unit: wp.float64,
    # out, added to
    force: wp.array2d(dtype=wp.int64),
):
    """force[grid node], counts of `force_unit` [N]; held nodes have no acceleration."""
    thread = wp.tid()
    block = thread / block_size
    lane = thread - block * block_size
    if lane >= block_count[block]:
        return
    i = block_first[block] + lane
    t = block_table[block] + lane
    mass = wp.float64(node_mass[t] * wire_mass[block_wire[block]])
    x = place_x[t] + block_origin_x[block]
    y = place_y[t] + block_origin_y[block]
    gather(grid, x, y, mass * wp.float64(acceleration_x[i]), mass * wp.float64(acceleration_y[i]), force_unit, force)


@wp.kernel
def gather_body_forces(
    # in: bodies
    body_origin_x: wp.array(dtype=wp.float64),
    body_origin_y: wp.array(dtype=wp.float64),
    grid: Grid,
    # in: contact
    pair_force: wp.array(dtype=Any),
    pair_body_x: wp.array(dtype=Any),
    pair_body_y: wp.array(dtype=Any),
    force_unit: wp.float64,
    # out, added to
    force: wp.array2d(dtype=wp.int64),
):
    """The same for bodies."""
    body = wp.tid()
    for p in range(2 * body, 2 * body + 2):
        if pair_force[p] != pair_force.dtype(0.0):
            fx = wp.float64(pair_body_x[p])
            fy = wp.float64(pair_body_y[p])
            gather(grid, body_origin_x[body], body_origin_y[body], fx, fy, force_unit, force)


@wp.kernel
def gather_forces(
    # in: rest positions [m] and forces [N] of spatial nodes
    first_node: int,
    held: wp.array(dtype=wp.int32),
    rest_position: wp.array(dtype=wp.vec3d),
    force: wp.array(dtype=Any),
    grid: Grid,
    force_unit: wp.float64,
    # out, added to
    grid_force: wp.array2d(dtype=wp.int64),
    across_force: wp.array2d(dtype=wp.int64),
):
    """Gather forces of free nodes on the grid, as counts of `force_unit` [N]. In plane: grid_force[grid node]; across it:
    across_force[grid node, 0].
    """
    i = first_node + wp.tid()
    if (held[i] & HELD_NODE) == 0:
        x = rest_position[i][0]
        y = rest_position[i][1]
        push = wp.vec3d(force[i])
        gather(grid, x, y, push[0], push[1], force_unit, grid_force)
        gather(grid, x, y, push[2], wp.float64(0.0), force_unit, across_force)


@wp.func
def strained(
    grid: Grid,
    x: wp.float64,
    y: wp.float64,
    displacement: wp.array2d(dtype=wp.float64),
    direction: int,
    cell: wp.array2d(dtype=wp.float64),
    cell_index: int,
) -> wp.float64:
    """Change of a field at a place: the response of a repeat to the strain, and the displacement along `direction` (0, 1)."""
    moved, gradient = spread(grid, x, y, displacement)
    total = weighed(cell, cell_index, gradient)
    if direction >= 0:
        total += moved[direction]
    return total


@wp.kernel
def spread_to_nodes(
    # in: blocks
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    block_origin_x: wp.array(dtype=wp.float64),
    block_origin_y: wp.array(dtype=wp.float64),
    block_size: int,
    place_x: wp.array(dtype=wp.float64),
    place_y: wp.array(dtype=wp.float64),
    grid: Grid,
    # in: displacement of the grid [m]; the field is a displacement along `direction`, or another one with -1
    displacement: wp.array2d(dtype=wp.float64),
    direction: int,
    # in: derivatives of the field in one repeat by its deformation gradient, and factors
    cell_node: wp.array(dtype=wp.int32),
    cell: wp.array2d(dtype=wp.float64),
    scale: wp.float64,
    wire_scale: wp.array(dtype=Any),
    # in and out
    value: wp.array(dtype=Any),
):
    """Change a field of every node with the grid, and by a repeat's response.

    `cell_node[entry]` is the node of the repeat; `cell[gradient entry, node]` the derivative.
    """
    thread = wp.tid()
    block = thread / block_size
    lane = thread - block * block_size
    if lane >= block_count[block]:
        return
    i = block_first[block] + lane
    t = block_table[block] + lane
    x = place_x[t] + block_origin_x[block]
    y = place_y[t] + block_origin_y[block]
    total = strained(grid, x, y, displacement, direction, cell, cell_node[t])
    value[i] = value[i] + value.dtype(scale * wp.float64(wire_scale[block_wire[block]]) * total)


@wp.kernel
def spread_to_bodies(
    # in: bodies
    body_origin_x: wp.array(dtype=wp.float64),
    body_origin_y: wp.array(dtype=wp.float64),
    body_clasp: wp.array(dtype=wp.int32),
    grid: Grid,
    # in: see spread_to_nodes; the field has `per_body` values a body
    displacement: wp.array2d(dtype=wp.float64),
    direction: int,
    per_body: int,
    cell: wp.array2d(dtype=wp.float64),
    scale: wp.float64,
    is_positive: int,
    # in and out
    value: wp.array(dtype=Any),
):
    """The same for bodies or their pairs, kept positive if `is_positive`."""
    i = wp.tid()
    body = i / per_body
    index = per_body * body_clasp[body] + i % per_body
    total = strained(grid, body_origin_x[body], body_origin_y[body], displacement, direction, cell, index)
    moved = value[i] + value.dtype(scale * total)
    value[i] = wp.where(is_positive != 0, wp.max(moved, value.dtype(0)), moved)


@wp.func
def cubic_weights(s: wp.float64) -> wp.vec4d:
    """Weights of value and slope at 0, then at 1, in the Hermite cubic at s."""
    r = wp.float64(1.0) - s
    two = wp.float64(2.0)
    one = wp.float64(1.0)
    return wp.vec4d((one + two * s) * r * r, s * r * r, s * s * (one + two * r), -s * s * r)


@wp.func
def cubic_slopes(s: wp.float64) -> wp.vec4d:
    """Derivatives of `cubic_weights`."""
    r = wp.float64(1.0) - s
    three = wp.float64(3.0)
    six = wp.float64(6.0)
    one = wp.float64(1.0)
    return wp.vec4d(-six * s * r, r * (one - three * s), six * s * r, s * (three * s - wp.float64(2.0)))


@wp.kernel
def spread_surface(
    # in: rest positions [m] of spatial nodes
    rest_position: wp.array(dtype=wp.vec3d),
    grid: Grid,
    # in: value, slopes along x and y and cross slope at each grid node, the slopes per cell
    surface: wp.array2d(dtype=wp.float64),
    # out
    value: wp.array(dtype=wp.float64),
    slope_x: wp.array(dtype=wp.float64),
    slope_y: wp.array(dtype=wp.float64),
):
    """Bicubic surface through the grid nodes at rest places of nodes; slopes [1/m]."""
    i = wp.tid()
    ix, iy, sx, sy = place_on(grid, rest_position[i][0], rest_position[i][1])
    wx = cubic_weights(sx)
    wy = cubic_weights(sy)
    dx = cubic_slopes(sx)
    dy = cubic_slopes(sy)
    total = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    for corner in range(4):
        there = corner_index(grid, ix, iy, corner)
        a = 2 * (corner % 2)
        b = 2 * (corner / 2)
        for degree in range(4):  # whether it is a slope in x, and in y
            p = a + degree % 2
            q = b + degree / 2
            known = surface[there, degree]
            total += known * wp.vec3d(wx[p] * wy[q], dx[p] * wy[q], wx[p] * dy[q])
    value[i] = total[0]
    slope_x[i] = total[1] / grid.cell[0]
    slope_y[i] = total[2] / grid.cell[1]


@wp.kernel
def respond_to_strain(
    # in: [node] entries of the rest table
    node_entry: wp.array(dtype=wp.int32),
    # in: [node] displacement gradient
    gradient_xx: wp.array(dtype=wp.float64),
    gradient_xy: wp.array(dtype=wp.float64),
    gradient_yx: wp.array(dtype=wp.float64),
    gradient_yy: wp.array(dtype=wp.float64),
    # in: see spread_to_nodes
    cell_node: wp.array(dtype=wp.int32),
    cell: wp.array2d(dtype=wp.float64),
    # out
    value: wp.array(dtype=wp.float64),
):
    """Change of a field of a panel's nodes by the strain of the repeats."""
    i = wp.tid()
    gradient = wp.vec4d(gradient_xx[i], gradient_xy[i], gradient_yx[i], gradient_yy[i])
    value[i] = weighed(cell, cell_node[node_entry[i]], gradient)
