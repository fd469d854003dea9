"""Prefetch of the data of a pair of segments that a thread will reach soon.

The segments of successive pairs lie far apart in memory: a pair reads some forty cache lines. On a GPU it does nothing.
"""

import warp as wp

from .native import constants
from .wire_curve import Bump

AHEAD = 4  # pairs

PREFETCH = (
    constants(AHEAD=AHEAD)
    + r"""
#if !defined(__CUDA_ARCH__)
    const int count = touch_count.data[0], later = touch + 2 * AHEAD * stride, soon = touch + AHEAD * stride;
    if (later < count) {
        const int pair = touch_pair.data[later];
        __builtin_prefetch(pair_first.data + pair);
        __builtin_prefetch(pair_second.data + pair);
        __builtin_prefetch(pair_shift.data + pair);
        __builtin_prefetch(pair_found.data + pair);
        __builtin_prefetch(pair_place.data + 3 * pair);
    }
    if (soon < count) {
        const int pair = touch_pair.data[soon];
        for (int side = 0; side < 2 && pair_found.data[pair] != 0; ++side) {
            const int i = side ? pair_second.data[pair] : pair_first.data[pair];
            __builtin_prefetch(previous.data + i);
            __builtin_prefetch(following.data + i);
            __builtin_prefetch(position.data + i);
            __builtin_prefetch(length.data + i);
            __builtin_prefetch(tangent.data + i);
            __builtin_prefetch(tangent.data + i + 1);
            __builtin_prefetch(director.data + i);
            __builtin_prefetch(director.data + i + 1);
            __builtin_prefetch(natural_length.data + i);
            __builtin_prefetch(contact_offset.data + i);
            __builtin_prefetch(node_radius.data + i);
            const int row = rest_row.data[i];
            __builtin_prefetch(rest_slope.data + row);
            __builtin_prefetch(rest_bump.data + row);
            __builtin_prefetch(slope_weight.data + row);
        }
    }
#endif
"""
)


@wp.func_native(PREFETCH)
def prefetch_pair(
    # in: the number of the pair in the list, the numbers between pairs of this thread, and the list
    touch: int,
    stride: int,
    touch_pair: wp.array(dtype=wp.int32),
    touch_count: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    node_radius: wp.array(dtype=wp.float64),
    natural_length: wp.array(dtype=wp.float64),
    rest_row: wp.array(dtype=wp.int32),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=Bump),
    slope_weight: wp.array(dtype=wp.vec4d),
    contact_offset: wp.array(dtype=wp.float64),
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    director: wp.array(dtype=wp.vec3d),
): ...


@wp.func
def first_of_part(count: wp.array(dtype=wp.int32), part: int, parts: int) -> int:
    """The first pair of a part of a list, which is cut into `parts` of the same length."""
    length = (count[0] + parts - 1) / parts
    return wp.min(part * length, count[0])
