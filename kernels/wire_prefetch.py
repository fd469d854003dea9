"""Prefetch of the data of a pair of segments that a thread will reach soon.

The segments of successive pairs lie far apart in memory: a pair reads some forty cache lines, in three turns, as what is read
first tells where the rest lies. `stored` is the type of the numbers of forces.
"""

import warp as wp

from warpknit.kernels.native import constants

AHEAD = 4  # pairs

PREFETCH = (
    constants(AHEAD=AHEAD)
    + r"""
    const int count = touch_count.data[0];
    if (touch + 3 * AHEAD < count) {
        const int pair = touch_pair.data[touch + 3 * AHEAD];
        __builtin_prefetch(pair_first.data + pair);
        __builtin_prefetch(pair_second.data + pair);
        __builtin_prefetch(pair_shift.data + pair);
        __builtin_prefetch(pair_found.data + pair);
        __builtin_prefetch(pair_arc_separation.data + pair);
        __builtin_prefetch(pair_wake_travel.data + pair);
        __builtin_prefetch(pair_renewal_travel.data + pair);
        __builtin_prefetch(pair_place.data + 3 * pair);
    }
    if (touch + 2 * AHEAD < count) {
        const int pair = touch_pair.data[touch + 2 * AHEAD];
        for (int side = 0; side < 2 && pair_found.data[pair] != 0; ++side) {
            const int i = side ? pair_second.data[pair] : pair_first.data[pair];
            __builtin_prefetch(previous.data + i);
            __builtin_prefetch(following.data + i);
            __builtin_prefetch(rest_row.data + i);
            __builtin_prefetch(node_block.data + i);
            __builtin_prefetch(position.data + i);
            __builtin_prefetch(position.data + i + 1);
            __builtin_prefetch(length.data + i);
            __builtin_prefetch(tangent.data + i);
            __builtin_prefetch(tangent.data + i + 1);
            __builtin_prefetch(director.data + i);
            __builtin_prefetch(director.data + i + 1);
            __builtin_prefetch(natural_length.data + i);
            __builtin_prefetch(contact_offset.data + i);
            __builtin_prefetch(contact_penalty.data + i);
            __builtin_prefetch(node_radius.data + i);
        }
    }
    if (touch + AHEAD < count) {
        char* force = (char*)(touch_force.data + 8 * (touch + AHEAD));
        char* couple = (char*)(touch_couple.data + 6 * (touch + AHEAD));
        for (int b = 0; b < 8 * 3 * sizeof(stored); b += 64) __builtin_prefetch(force + b, 1);
        for (int b = 0; b < 6 * 3 * sizeof(stored); b += 64) __builtin_prefetch(couple + b, 1);
        const int pair = touch_pair.data[touch + AHEAD];
        for (int side = 0; side < 2 && pair_found.data[pair] != 0; ++side) {
            const int row = rest_row.data[side ? pair_second.data[pair] : pair_first.data[pair]];
            __builtin_prefetch(rest_slope.data + row);
            __builtin_prefetch(rest_bump.data + row);
            __builtin_prefetch(slope_weight.data + row);
        }
    }
"""
)


@wp.func
def first_of_part(count: wp.array(dtype=wp.int32), part: int, parts: int) -> int:
    """The first pair of a part of a list, which is cut into `parts` of the same length."""
    length = (count[0] + parts - 1) / parts
    return wp.min(part * length, count[0])
