"""Pairs of segments that may touch: proposed by a spatial hash, decided by chords.

The hash works on rest coordinates F^-1 x, scaled so that a cell is 1 wide and the cells of a periodic tile divide it evenly:
the grid wraps as the tile does. A segment forms a pair with every periodic image of another within reach, so a pair consists of
two segments and the shift of the second. The segment with the smaller number keeps the pair; of the images of the segment
itself, those with a positive shift count. Segments of one wire with an arc separation below `min_arc_separation` are left out, by
arc length and not by number, so that segments shorter than the thickness do not push each other apart. So are two segments in
clamps of a knit: nothing moves there, and the chords of a coarse mesh may overlap where a cut takes two wires. Pairs are counted
before the list is filled, so it never overflows.
"""

from typing import Any

import warp as wp

from .banded_mass import CLAMPED
from .control import GRADIENT, LENGTH_FACTOR, LEVER
from .rod_frames import affine_map
from .wire_curve import CLOSING_RATE, Bump, closest_on_chords, curve_distance, curve_of_segment, row, sag, stencil

KEPT = wp.constant(8)  # segments found by the count of pairs that are kept for the filling of the list
LEVELS = wp.constant(1024.0)  # of a cell, to which places across the mesh are rounded
# of a segment in a search: keeps its pairs, is searched and keeps what is known of its pairs, is searched anew
NOT_SEARCHED, SEARCHED, SEARCHED_ANEW = wp.constant(0), wp.constant(1), wp.constant(2)
ROUND_OFF = wp.constant(wp.float64(2.0e-7))  # of displacements in single precision
NO_COMMON_WIRE = wp.constant(wp.float64(1.0e30))  # [m] arc separation of segments of different wires


@wp.func
def affine_inverse(vector: wp.vec3d, control: wp.array(dtype=wp.float64)) -> wp.vec3d:
    """F^-1 times a vector."""
    xx = control[GRADIENT]
    xy = control[GRADIENT + 1]
    yx = control[GRADIENT + 2]
    yy = control[GRADIENT + 3]
    determinant = xx * yy - xy * yx
    return wp.vec3d((yy * vector[0] - xy * vector[1]) / determinant, (xx * vector[1] - yx * vector[0]) / determinant, vector[2])


@wp.func
def largest_rest_extent(control: wp.array(dtype=wp.float64)) -> wp.vec3d:
    """Largest components of F^-1 v of all unit vectors v."""
    xx = control[GRADIENT]
    xy = control[GRADIENT + 1]
    yx = control[GRADIENT + 2]
    yy = control[GRADIENT + 3]
    determinant = wp.abs(xx * yy - xy * yx)
    return wp.vec3d(wp.sqrt(yy * yy + xy * xy) / determinant, wp.sqrt(xx * xx + yx * yx) / determinant, wp.float64(1.0))


@wp.func
def first_image(distance: wp.float64, reach: wp.float64, tile: wp.float64) -> int:
    """Number of the first periodic image with a shift within `reach` [m] of a distance; 0 in a direction without tiles."""
    if tile <= wp.float64(0.0):
        return 0
    return int(wp.ceil((distance - reach) / tile))


@wp.func
def last_image(distance: wp.float64, reach: wp.float64, tile: wp.float64) -> int:
    """Number of the last one, less than `first_image` where there is none; 0 in a direction without tiles."""
    if tile <= wp.float64(0.0):
        return 0
    return int(wp.floor((distance + reach) / tile))


@wp.func
def is_positive(shift: wp.vec3d) -> bool:
    """Whether the first component that is not zero is positive."""
    if shift[0] != wp.float64(0.0):
        return shift[0] > wp.float64(0.0)
    if shift[1] != wp.float64(0.0):
        return shift[1] > wp.float64(0.0)
    return shift[2] > wp.float64(0.0)


@wp.func
def arc_separation(
    i: int,
    j: int,
    shift: wp.vec3d,
    node_wire: wp.array(dtype=wp.int32),
    node_arc: wp.array(dtype=wp.float64),
    wire_closed: wp.array(dtype=wp.int32),
    wire_length: wp.array(dtype=wp.float64),
    wire_period: wp.array(dtype=wp.vec3d),
) -> wp.float64:
    """[m] along the wire from segment i to segment j moved by `shift`; NO_COMMON_WIRE on another wire."""
    wire = node_wire[i]
    if node_wire[j] != wire:
        return NO_COMMON_WIRE
    separation = node_arc[j] - node_arc[i]
    period = wire_period[wire]
    size = wp.dot(period, period)
    if size == wp.float64(0.0) and wp.length(shift) > wp.float64(0.0):
        return NO_COMMON_WIRE
    if wire_closed[wire] == 0:
        return separation
    if size == wp.float64(0.0):
        return separation - wire_length[wire] * wp.floor(separation / wire_length[wire] + wp.float64(0.5))
    rounds = wp.floor(wp.dot(shift, period) / size + wp.float64(0.5))
    if wp.length_sq(shift - rounds * period) > wp.float64(1.0e-12) * size:
        return NO_COMMON_WIRE
    return separation + rounds * wire_length[wire]


@wp.func
def nearest_image_square(between: wp.vec3, cell: wp.vec3, tile: wp.vec3) -> float:
    """Squared distance [m2] of nearest images of two places, from their difference in cells."""
    square = float(0.0)
    for k in range(3):
        d = between[k] * cell[k]
        if tile[k] > 0.0:
            d -= tile[k] * wp.floor(d / tile[k] + 0.5)
        square += d * d
    return square


@wp.kernel
def place_segments_in_hash(
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    rest_bulge: wp.array(dtype=wp.float64),
    slope_weight: wp.array(dtype=wp.vec4d),
    # state in
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    # how
    cell: wp.vec3d,
    cells_across: float,
    # out: midpoints of the segments in rest coordinates, in cells; [m] bound on the distance of their curves from them
    place: wp.array(dtype=wp.vec3),
    reach: wp.array(dtype=wp.float32),
    # in and out: [world] [m] the longest reach
    longest_reach: wp.array(dtype=wp.float32),
):
    """One thread a node. The last node of an open wire, which has no segment, has the reach -1."""
    i = wp.tid()
    half = wp.float64(0.5) * length[i]
    world = i / world_nodes
    own = control[world]
    middle = affine_inverse(position[i] + half * wp.vec3d(tangent[i]), own)
    # worlds lie one above the other, in steps that single precision holds exactly
    across = wp.round(wp.float32(middle[2] / cell[2]) * LEVELS) / LEVELS + float(world) * cells_across
    place[i] = wp.vec3(wp.float32(middle[0] / cell[0]), wp.float32(middle[1] / cell[1]), across)
    reach[i] = -1.0
    if following[i] >= 0:
        p = stencil(i, previous, following, position, length, tangent)
        bulge = own[LENGTH_FACTOR] * rest_bulge[rest_row[i]]
        own_reach = wp.float32(half + sag(p, bulge, slope_weight[rest_row[i]]))
        reach[i] = own_reach
        wp.atomic_max(longest_reach, world, own_reach)


@wp.kernel
def find_motion_since_search(
    # in: present state
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    displacement: wp.array(dtype=wp.vec3d),
    director: wp.array(dtype=Any),
    # in: place and director in the last search of the segments that each node shapes
    searched_place: wp.array(dtype=wp.vec3),
    searched_director: wp.array(dtype=wp.vec3),
    # out: [m] bound on the motion of a node, and of the curve that turns with the section behind it
    motion: wp.array(dtype=wp.float32),
):
    """A thread a node."""
    i = wp.tid()
    place = displacement[i]
    moved = wp.length(place - wp.vec3d(searched_place[i])) + ROUND_OFF * wp.length(place)
    turned = wp.float64(2.0) * control[i / world_nodes, LEVER] * wp.length(wp.vec3d(director[i]) - wp.vec3d(searched_director[i]))
    motion[i] = wp.float32(wp.sqrt(moved * moved + turned * turned))


@wp.kernel
def mark_searched(
    # how
    first_segment: int,
    grid: wp.uint64,
    round_off: float,
    cell: wp.vec3,
    tile: wp.vec3d,
    # in: of each world; [m] nodes that have moved farther are searched around, all if below 0
    moved_limit: wp.array(dtype=wp.float32),
    largest_distance: wp.array(dtype=wp.float32),
    rest_scale: wp.array(dtype=wp.float32),
    longest_reach: wp.array(dtype=wp.float32),
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    # in: state
    world_nodes: int,
    place: wp.array(dtype=wp.vec3),
    reach: wp.array(dtype=wp.float32),
    motion: wp.array(dtype=wp.float32),
    displacement: wp.array(dtype=wp.vec3d),
    director: wp.array(dtype=Any),
    # out: places and directors of nodes that are searched around
    searched_place: wp.array(dtype=wp.vec3),
    searched_director: wp.array(dtype=wp.vec3),
    # out: NOT_SEARCHED before
    searched: wp.array(dtype=wp.int32),
):
    """Mark the segments to search: those that a node shapes that has moved, and those near them with a smaller number, which
    keep the pairs. A thread a segment, from `first_segment` on; arguments as of `find_segment_pairs`.
    """
    i = first_segment + wp.tid()
    world = i / world_nodes
    limit = moved_limit[world]
    after = wp.where(following[i] >= 0, following[i], i)
    behind = wp.where(following[after] >= 0, following[after], after)
    before = wp.where(previous[i] >= 0, previous[i], i)
    if motion[i] > limit:
        searched_place[i] = wp.vec3(displacement[i])
        searched_director[i] = wp.vec3(wp.vec3d(director[i]))
    if limit < 0.0:
        searched[i] = SEARCHED_ANEW
        return
    if not (wp.max(wp.max(motion[before], motion[i]), wp.max(motion[after], motion[behind])) > limit):
        return  # also where a world has failed, with motions that are not numbers
    searched[i] = SEARCHED
    if reach[i] < 0.0:
        return
    scale = rest_scale[world]
    tile_size = wp.vec3(float(tile[0]), float(tile[1]), float(tile[2]))
    farthest = scale * (reach[i] + longest_reach[world] + largest_distance[world] + round_off)
    query = wp.hash_grid_query(grid, place[i], farthest / wp.min(cell[0], wp.min(cell[1], cell[2])))
    j = int(0)
    while wp.hash_grid_query_next(query, j):
        if j < i and j / world_nodes == world and reach[j] >= 0.0:
            both = scale * (reach[i] + reach[j] + largest_distance[world] + round_off)
            if nearest_image_square(place[j] - place[i], cell, tile_size) <= both * both:
                searched[j] = SEARCHED


@wp.kernel
def find_segment_pairs(
    # how
    first_segment: int,
    grid: wp.uint64,
    round_off: float,
    cell: wp.vec3,
    margin: wp.float64,
    min_arc_separation: wp.float64,
    tile: wp.vec3d,
    is_filling: int,
    # in: [segment] see `mark_searched`; of each world
    searched: wp.array(dtype=wp.int32),
    largest_distance: wp.array(dtype=wp.float32),
    rest_scale: wp.array(dtype=wp.float32),
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    held: wp.array(dtype=wp.int32),
    node_wire: wp.array(dtype=wp.int32),
    node_arc: wp.array(dtype=wp.float64),
    node_radius: wp.array(dtype=wp.float64),
    natural_length: wp.array(dtype=wp.float64),
    rest_row: wp.array(dtype=wp.int32),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=Bump),
    rest_bulge: wp.array(dtype=wp.float64),
    slope_weight: wp.array(dtype=wp.vec4d),
    wire_closed: wp.array(dtype=wp.int32),
    wire_length: wp.array(dtype=wp.float64),
    wire_period: wp.array(dtype=wp.vec3d),
    # state in
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    place: wp.array(dtype=wp.vec3),
    reach: wp.array(dtype=wp.float32),
    longest_reach: wp.array(dtype=wp.float32),
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    # in: of segments that are not searched, the number of pairs in the previous list; where the pairs of each begin
    old_count: wp.array(dtype=wp.int32),
    pair_start: wp.array(dtype=wp.int32),
    # in and out: how many other segments form pairs with each, and the first KEPT of them
    partner_count: wp.array(dtype=wp.int32),
    partner: wp.array(dtype=wp.int32),
    # out: how many there are, or the pairs
    pair_count_of: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    pair_arc_separation: wp.array(dtype=wp.float64),
    pair_wake_travel: wp.array(dtype=wp.float64),
):
    """Find pairs of segments and images with surfaces nearer than `margin` [m]. One thread a segment, from `first_segment` on. On
    one wire their arc separation is at least `min_arc_separation` radii. Rest lengths are at most `rest_scale` times present
    ones; wires touch or are listed at most `largest_distance` [m] from each other, both [world]; single precision moves places by
    at most `round_off` [m]. The list is filled from the segments that the count has kept, or by the hash again if there were too
    many. Segments that are not `searched` keep their pairs.

    `pair_shift` [m] at rest moves the second segment next to the first; `pair_arc_separation` [m] is `arc_separation`;
    `pair_wake_travel` [m] is the travel since this search at which the pair may touch.
    """
    i = first_segment + wp.tid()
    world = i / world_nodes
    if is_filling == 0:
        pair_count_of[i] = wp.where(searched[i] != NOT_SEARCHED, 0, old_count[i])
    if searched[i] == NOT_SEARCHED:
        return
    own = control[world]
    scale = rest_scale[world]
    own_reach = reach[i]
    if own_reach < 0.0:
        return
    found = int(0)
    partners = int(0)
    is_kept = is_filling != 0 and partner_count[i] <= KEPT
    tile_size = wp.vec3(float(tile[0]), float(tile[1]), float(tile[2]))
    p = stencil(i, previous, following, position, length, tangent)
    p1 = row(p, 1)
    p2 = row(p, 2)
    length_factor = own[LENGTH_FACTOR]
    bulge = sag(p, length_factor * rest_bulge[rest_row[i]], slope_weight[rest_row[i]])
    curve = curve_of_segment(i, p, length_factor, previous, following, natural_length, rest_row, rest_slope, rest_bump,
                             slope_weight, tangent, director)  # fmt: skip
    zero = wp.float64(0.0)
    half = wp.float64(0.5)
    middle = half * (p1 + p2)
    rest_extent = largest_rest_extent(own)
    farthest = scale * (own_reach + longest_reach[world] + largest_distance[world] + round_off)
    query = wp.hash_grid_query(grid, place[i], farthest / wp.min(cell[0], wp.min(cell[1], cell[2])))
    j = int(0)
    number = int(0)
    is_left = bool(True)
    while is_left:
        if is_kept:
            is_left = number < partner_count[i]
            if is_left:
                j = partner[KEPT * i + number]
                number += 1
        else:
            is_left = wp.hash_grid_query_next(query, j)
        if not is_left or j < i or j / world_nodes != world or reach[j] < 0.0 or (held[i] & held[j] & CLAMPED) != 0:
            continue
        before = found
        contact_distance = length_factor * (node_radius[i] + node_radius[j])
        search_distance = contact_distance + margin
        both = own_reach + reach[j] + float(search_distance) + round_off
        if nearest_image_square(place[j] - place[i], cell, tile_size) > scale * scale * both * both:
            continue
        q1 = position[j]
        q2 = q1 + length[j] * wp.vec3d(tangent[j])
        between = middle - half * (q1 + q2)
        rest_offset = affine_inverse(between, own)
        rest_reach = wp.float64(both) * rest_extent
        first_x = first_image(rest_offset[0], rest_reach[0], tile[0])
        first_y = first_image(rest_offset[1], rest_reach[1], tile[1])
        first_z = first_image(rest_offset[2], rest_reach[2], tile[2])
        images_x = wp.max(last_image(rest_offset[0], rest_reach[0], tile[0]) - first_x + 1, 0)
        images_y = wp.max(last_image(rest_offset[1], rest_reach[1], tile[1]) - first_y + 1, 0)
        images_z = wp.max(last_image(rest_offset[2], rest_reach[2], tile[2]) - first_z + 1, 0)
        for image in range(images_x * images_y * images_z):
            shift = wp.vec3d(
                tile[0] * wp.float64(first_x + image % images_x),
                tile[1] * wp.float64(first_y + (image / images_x) % images_y),
                tile[2] * wp.float64(first_z + image / (images_x * images_y)),
            )
            if j == i and not is_positive(shift):
                continue
            offset = affine_map(shift, own)
            if wp.length(between - offset) > wp.float64(both):
                continue
            separation = arc_separation(i, j, shift, node_wire, node_arc, wire_closed, wire_length, wire_period)
            is_same = separation != NO_COMMON_WIRE
            if is_same and wp.abs(separation) + wp.max(length[i], length[j]) < min_arc_separation * node_radius[i]:
                continue
            is_near = is_same and wp.abs(separation) < wire_length[node_wire[i]]
            if is_near and ((following[i] == j and separation > zero) or (following[j] == i and separation < zero)):
                continue  # neighbours share a node; they could touch only where the wire is bent back onto itself
            r1 = q1 + offset
            r2 = q2 + offset
            near = closest_on_chords(p1, p2, r1, r2)
            gap = wp.length(p1 + near[0] * (p2 - p1) - r1 - near[1] * (r2 - r1)) - bulge
            if gap > search_distance + wp.float64(reach[j]) - half * length[j] + wp.float64(round_off):
                continue
            q = stencil(j, previous, following, position, length, tangent)
            gap -= sag(q, length_factor * rest_bulge[rest_row[j]], slope_weight[rest_row[j]])
            if gap > search_distance:
                continue
            q = q + wp.matrix_from_rows(offset, offset, offset, offset)
            other = curve_of_segment(j, q, length_factor, previous, following, natural_length, rest_row, rest_slope, rest_bump,
                                     slope_weight, tangent, director)  # fmt: skip
            gap = wp.max(gap, curve_distance(curve, other))
            if gap > search_distance:
                continue
            if is_filling != 0:
                k = pair_start[i] + found
                pair_first[k] = i
                pair_second[k] = j
                pair_shift[k] = shift
                pair_arc_separation[k] = separation
                pair_wake_travel[k] = (gap - contact_distance) / CLOSING_RATE
            found += 1
        if is_filling == 0 and found > before:
            if partners < KEPT:
                partner[KEPT * i + partners] = j
            partners += 1
    if is_filling == 0:
        pair_count_of[i] = found
        partner_count[i] = partners
