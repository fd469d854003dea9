"""Lists of the pairs of segments that a step looks at: by their first segments, and by their second ones.

`near_before` counts the near pairs up to each pair, that one included, in the order of the list of all pairs; `near_by_second` in
the order of their second segments. Both begin as marks, 1 where the pair is near, and are summed up in between.
"""

import warp as wp


@wp.func
def before(counts: wp.array(dtype=wp.int32), k: int) -> int:
    """The near pairs before the one at place k."""
    if k == 0:
        return 0
    return counts[k - 1]


@wp.func
def first_of_part(count: wp.array(dtype=wp.int32), part: int, parts: int) -> int:
    """The first pair of a part of a list, which is cut into `parts` of the same length."""
    length = (count[0] + parts - 1) / parts
    return wp.min(part * length, count[0])


@wp.kernel
def count_by_second(
    # in
    pair_second: wp.array(dtype=wp.int32),
    # in and out: [segment]
    count: wp.array(dtype=wp.int32),
    # out
    pair_number: wp.array(dtype=wp.int32),
):
    pair = wp.tid()
    pair_number[pair] = pair
    wp.atomic_add(count, pair_second[pair], 1)


@wp.kernel
def find_reach(
    # in
    rest_position: wp.array(dtype=wp.vec3d),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    # out: [m] largest distance at rest of the first nodes of a pair
    reach: wp.array(dtype=wp.float64),
):
    pair = wp.tid()
    apart = rest_position[pair_first[pair]] - rest_position[pair_second[pair]] - pair_shift[pair]
    wp.atomic_max(reach, 0, wp.length(apart))


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
    """A thread a pair, which is also a place in the order of the second segments."""
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
    start: wp.array(dtype=wp.int32),
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
    if i < start.shape[0]:
        first = start[i]
        second = second_start[i]
    touch_first_start[i] = before(near_before, first)
    touch_second_start[i] = before(near_by_second, second)
