"""Which segments of wires may touch: a spatial hash proposes pairs, their chords decide.

The hash works on rest coordinates F^-1 x, scaled so that a cell is 1 wide and the cells of a periodic tile divide it evenly:
the grid's own wrapping is the tile's. Of two segments the one with the smaller number keeps the pair. Segments of one wire
nearer along it than `apart` do not count: by arc length, not by number, so that segments shorter than the wire is thick do
not push themselves apart. The list is counted before it is filled, and so never overflows.
"""

import warp as wp

from .control import GRADIENT, LENGTH_FACTOR
from .rod_frames import carried
from .wire_curve import CLOSING, closest_on_chords, row, sag, stencil

ELSEWHERE = wp.constant(wp.float64(1.0e30))  # [m] distance along a wire of what is on no common wire


@wp.func
def uncarried(vector: wp.vec3d, control: wp.array(dtype=wp.float64)) -> wp.vec3d:
    """F^-1 times a vector."""
    xx = control[GRADIENT]
    xy = control[GRADIENT + 1]
    yx = control[GRADIENT + 2]
    yy = control[GRADIENT + 3]
    determinant = xx * yy - xy * yx
    return wp.vec3d((yy * vector[0] - xy * vector[1]) / determinant, (xx * vector[1] - yx * vector[0]) / determinant, vector[2])


@wp.func
def whole_tiles(distance: wp.float64, tile: wp.float64) -> wp.float64:
    """The whole number of tiles that is nearest to a distance, as a distance; 0 where the world has no tiles that way."""
    if tile <= wp.float64(0.0):
        return wp.float64(0.0)
    return tile * wp.floor(distance / tile + wp.float64(0.5))


@wp.func
def along_wire(
    i: int,
    j: int,
    shift: wp.vec3d,
    node_wire: wp.array(dtype=wp.int32),
    node_arc: wp.array(dtype=wp.float64),
    wire_closed: wp.array(dtype=wp.int32),
    wire_length: wp.array(dtype=wp.float64),
    wire_period: wp.array(dtype=wp.vec3d),
) -> wp.float64:
    """[m] along the wire from the first node of segment i to that of segment j, moved by `shift`; ELSEWHERE on another wire."""
    wire = node_wire[i]
    if node_wire[j] != wire:
        return ELSEWHERE
    way = node_arc[j] - node_arc[i]
    if wire_closed[wire] == 0:
        return wp.where(wp.length(shift) > wp.float64(0.0), ELSEWHERE, way)
    period = wire_period[wire]
    size = wp.dot(period, period)
    if size == wp.float64(0.0):
        return way - wire_length[wire] * wp.floor(way / wire_length[wire] + wp.float64(0.5))
    rounds = wp.floor(wp.dot(shift, period) / size + wp.float64(0.5))
    if wp.length_sq(shift - rounds * period) > wp.float64(1.0e-12) * size:
        return ELSEWHERE
    return way + rounds * wire_length[wire]


@wp.kernel
def place_segments_in_hash(
    # state in
    control: wp.array(dtype=wp.float64),
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    # how
    cell: wp.vec3d,
    # out
    place: wp.array(dtype=wp.vec3),
):
    """Middles of the segments at rest, in cells; one thread a node."""
    i = wp.tid()
    middle = uncarried(position[i] + (wp.float64(0.5) * length[i]) * tangent[i], control)
    place[i] = wp.vec3(wp.float32(middle[0] / cell[0]), wp.float32(middle[1] / cell[1]), wp.float32(middle[2] / cell[2]))


@wp.kernel
def find_segment_pairs(
    # how
    grid: wp.uint64,
    hash_radius: float,
    margin: wp.float64,
    expected: wp.float64,
    apart: wp.float64,
    most_sag: wp.float64,
    tile: wp.vec3d,
    is_filling: int,
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    node_wire: wp.array(dtype=wp.int32),
    node_arc: wp.array(dtype=wp.float64),
    node_radius: wp.array(dtype=wp.float64),
    rest_bulge: wp.array(dtype=wp.float64),
    wire_closed: wp.array(dtype=wp.int32),
    wire_length: wp.array(dtype=wp.float64),
    wire_period: wp.array(dtype=wp.vec3d),
    # state in
    control: wp.array(dtype=wp.float64),
    place: wp.array(dtype=wp.vec3),
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    # in: where the pairs of each segment begin
    start: wp.array(dtype=wp.int32),
    # out: how many there are, or the pairs
    count: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    pair_way: wp.array(dtype=wp.float64),
    pair_wake: wp.array(dtype=wp.float64),
):
    """One thread a segment. Pairs are segments whose surfaces may come nearer than `margin` [m], and of one wire farther along
    it than `apart` radii. No curve leaves its chord by more than `most_sag` of its segment.

    `pair_shift` [m] at rest moves the second segment next to the first; `pair_way` [m] is along_wire; `pair_wake` [m] is the
    travel since this search at which the pair may touch, the load bringing it nearer by `expected` [m].
    """
    i = wp.tid()
    if is_filling == 0:
        count[i] = 0
    if following[i] < 0:
        return
    found = int(0)
    p = stencil(i, previous, following, position, length, tangent)
    p1 = row(p, 1)
    p2 = row(p, 2)
    grown = control[LENGTH_FACTOR]
    bulge = sag(p, grown * rest_bulge[i])
    half = wp.float64(0.5)
    middle = half * (p1 + p2)
    query = wp.hash_grid_query(grid, place[i], hash_radius)
    j = int(0)
    while wp.hash_grid_query_next(query, j):
        if j <= i or following[j] < 0:
            continue
        q1 = position[j]
        q2 = q1 + length[j] * tangent[j]
        rest_way = uncarried(middle - half * (q1 + q2), control)
        shift = wp.vec3d(whole_tiles(rest_way[0], tile[0]), whole_tiles(rest_way[1], tile[1]), whole_tiles(rest_way[2], tile[2]))
        moved = carried(shift, control)
        q1 = q1 + moved
        q2 = q2 + moved
        touch = grown * (node_radius[i] + node_radius[j])
        reach = touch + margin
        longest = half * (length[i] + length[j]) + reach + bulge
        if wp.length(middle - half * (q1 + q2)) > longest + most_sag * length[j]:
            continue
        way = along_wire(i, j, shift, node_wire, node_arc, wire_closed, wire_length, wire_period)
        if way != ELSEWHERE and wp.abs(way) + wp.max(length[i], length[j]) < apart * node_radius[i]:
            continue
        if (following[i] == j and way > wp.float64(0.0) and way != ELSEWHERE) or (following[j] == i and way < wp.float64(0.0)):
            continue  # they meet in a node and could touch beside it only where the wire is bent back onto itself there
        near = closest_on_chords(p1, p2, q1, q2)
        gap = wp.length(p1 + near[0] * (p2 - p1) - q1 - near[1] * (q2 - q1)) - bulge
        if gap > reach + most_sag * length[j]:
            continue
        gap -= sag(stencil(j, previous, following, position, length, tangent), grown * rest_bulge[j])
        if gap > reach:
            continue
        if is_filling != 0:
            k = start[i] + found
            pair_first[k] = i
            pair_second[k] = j
            pair_shift[k] = shift
            pair_way[k] = way
            pair_wake[k] = (gap - touch - expected) / CLOSING
        found += 1
    if is_filling == 0:
        count[i] = found
