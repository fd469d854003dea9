"""Lists of the pairs of segments that a step looks at: by their first segments, and by their second ones.

`near_before` counts the near pairs up to each pair, that one included, in the order of the list of all pairs; `near_by_second` in
the order of their second segments. Both begin as marks, 1 where the pair is near, and are summed up in between.
"""

import warp as wp

from .wire_pairs import SEARCHED, SEARCHED_ANEW
from .wire_travel import travel_of_pair


@wp.func
def before(counts: wp.array(dtype=wp.int32), k: int) -> int:
    """The near pairs before the one at place k."""
    if k == 0:
        return 0
    return counts[k - 1]


@wp.func
def first_of_part(count: int, part: int, parts: int) -> int:
    """First pair of a part of a list, cut into `parts` equal parts."""
    length = (count + parts - 1) / parts
    return wp.min(part * length, count)


@wp.func
def first_of_nodes(start: wp.array(dtype=wp.int32), count: wp.array(dtype=wp.int32), node: int) -> int:
    """First pair of the nodes from `node` on, in a sorted list; behind the last node the number of pairs."""
    if node < start.shape[0]:
        return start[node]
    return count[0]


@wp.func
def first_of_share(
    touch_is_listed: int,
    list_count: wp.array(dtype=wp.int32),
    touch_first_start: wp.array(dtype=wp.int32),
    first_node: int,
    end_node: int,
    part: int,
    parts: int,
) -> int:
    """The first of a part of the near pairs of some nodes; where they are listed, as on a GPU, of a part of the list."""
    if touch_is_listed != 0:
        return first_of_part(list_count[0], part, parts)
    first = touch_first_start[first_node]
    return first + first_of_part(touch_first_start[end_node] - first, part, parts)


@wp.kernel
def count_by_second(
    # in
    pair_count: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    # in and out: [segment]
    count: wp.array(dtype=wp.int32),
    # out: the pairs in their own order
    by_second: wp.array(dtype=wp.int32),
):
    pair = wp.tid()
    if pair >= pair_count[0]:
        return
    by_second[pair] = pair
    wp.atomic_add(count, pair_second[pair], 1)


@wp.kernel
def find_reach(
    # in
    world_nodes: int,
    pair_count: wp.array(dtype=wp.int32),
    rest_position: wp.array(dtype=wp.vec3d),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    # out: [world] [m] largest distance at rest of the first nodes of a pair
    reach: wp.array(dtype=wp.float64),
):
    pair = wp.tid()
    if pair >= pair_count[0]:
        return
    apart = rest_position[pair_first[pair]] - rest_position[pair_second[pair]] - pair_shift[pair]
    wp.atomic_max(reach, pair_first[pair] / world_nodes, wp.length(apart))


@wp.kernel
def mark_by_second(
    # in
    pair_count: wp.array(dtype=wp.int32),
    by_second: wp.array(dtype=wp.int32),
    pair_is_near: wp.array(dtype=wp.int32),
    # out
    near_by_second: wp.array(dtype=wp.int32),
):
    place = wp.tid()
    if place < pair_count[0]:
        near_by_second[place] = pair_is_near[by_second[place]]


@wp.kernel
def list_near_pairs(
    # in
    pair_count: wp.array(dtype=wp.int32),
    pair_is_near: wp.array(dtype=wp.int32),
    near_before: wp.array(dtype=wp.int32),
    by_second: wp.array(dtype=wp.int32),
    near_by_second: wp.array(dtype=wp.int32),
    # out
    touch_pair: wp.array(dtype=wp.int32),
    touch_of_second: wp.array(dtype=wp.int32),
):
    """List near pairs, a thread a pair; it is also a place in the order of the second segments."""
    k = wp.tid()
    if k >= pair_count[0]:
        return
    if pair_is_near[k] != 0:
        touch_pair[before(near_before, k)] = k
    pair = by_second[k]
    if pair_is_near[pair] != 0:
        touch_of_second[before(near_by_second, k)] = before(near_before, pair)


@wp.kernel
def find_near_starts(
    # in: [segment] where the pairs of each begin in either order, and the number of all pairs
    pair_start: wp.array(dtype=wp.int32),
    second_start: wp.array(dtype=wp.int32),
    pair_count: wp.array(dtype=wp.int32),
    near_before: wp.array(dtype=wp.int32),
    near_by_second: wp.array(dtype=wp.int32),
    # out: [segment + 1] where the near ones begin
    touch_first_start: wp.array(dtype=wp.int32),
    touch_second_start: wp.array(dtype=wp.int32),
):
    i = wp.tid()
    first = pair_count[0]
    second = pair_count[0]
    if i < pair_start.shape[0]:
        first = pair_start[i]
        second = second_start[i]
    touch_first_start[i] = before(near_before, first)
    touch_second_start[i] = before(near_by_second, second)


@wp.func
def old_pair(
    i: int,
    j: int,
    shift: wp.vec3d,
    old_start: wp.array(dtype=wp.int32),
    old_count_of: wp.array(dtype=wp.int32),
    old_second: wp.array(dtype=wp.int32),
    old_shift: wp.array(dtype=wp.vec3d),
) -> int:
    """Number of a pair of segments and image in the list before; -1 where it was not in there."""
    for old in range(old_start[i], old_start[i] + old_count_of[i]):
        if old_second[old] == j and wp.length(old_shift[old] - shift) == wp.float64(0.0):
            return old
    return -1


@wp.kernel
def carry_pairs(
    # in: what steers the step; [m] travel of blocks
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    node_block: wp.array(dtype=wp.int32),
    block_travel: wp.array(dtype=wp.float64),
    # in: [segment] see `mark_searched`
    searched: wp.array(dtype=wp.int32),
    # in: the list before
    old_start: wp.array(dtype=wp.int32),
    old_count_of: wp.array(dtype=wp.int32),
    old_second: wp.array(dtype=wp.int32),
    old_shift: wp.array(dtype=wp.vec3d),
    old_arc_separation: wp.array(dtype=wp.float64),
    old_wake_travel: wp.array(dtype=wp.float64),
    old_renewal_travel: wp.array(dtype=wp.float64),
    old_found: wp.array(dtype=wp.int32),
    old_is_near: wp.array(dtype=wp.int32),
    old_place: wp.array(dtype=wp.vec2d),
    # in: where the pairs of each segment begin now, and how many they are
    pair_start: wp.array(dtype=wp.int32),
    pair_count_of: wp.array(dtype=wp.int32),
    # in and out: as the search has found them
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    # out
    pair_first: wp.array(dtype=wp.int32),
    pair_arc_separation: wp.array(dtype=wp.float64),
    pair_wake_travel: wp.array(dtype=wp.float64),
    pair_renewal_travel: wp.array(dtype=wp.float64),
    pair_found: wp.array(dtype=wp.int32),
    pair_is_near: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
):
    """A thread a segment: what is known of its pairs goes over into the new list, unless it was searched anew; of pairs that the
    search has found, the travel until they may touch begins now.
    """
    i = wp.tid()
    if searched[i] == SEARCHED_ANEW:
        return
    for n in range(pair_count_of[i]):
        k = pair_start[i] + n
        old = old_start[i] + n
        if searched[i] == SEARCHED:
            pair_wake_travel[k] += travel_of_pair(i, pair_second[k], node_block, block_travel, control[i / world_nodes])
            old = old_pair(i, pair_second[k], pair_shift[k], old_start, old_count_of, old_second, old_shift)
        if old >= 0:
            pair_first[k] = i
            pair_second[k] = old_second[old]
            pair_shift[k] = old_shift[old]
            pair_arc_separation[k] = old_arc_separation[old]
            pair_wake_travel[k] = old_wake_travel[old]
            pair_renewal_travel[k] = old_renewal_travel[old]
            pair_found[k] = old_found[old]
            pair_is_near[k] = old_is_near[old]
            for a in range(3):
                pair_place[3 * k + a] = old_place[3 * old + a]
