"""Bound on the travel of segments since the pair search. By the fastest nodes of blocks.

The speed of a node and the speed of the curve beside it, which turns with the section, count as perpendicular to each other.
Each block has a travel by steps (rod_motion.py, and clamps below), which holds for the nodes of its segments, those beside it
included. Travel of all nodes, by the load or from outside, comes on top. Where nodes have one block, the fastest of all count.
"""

import warp as wp

from .native_text import native_text


@wp.func_native(native_text("travel_of_pair") + "return travel;\n")
def travel_of_pair(
    # in: segments
    i: int,
    j: int,
    node_block: wp.array(dtype=wp.int32),
    # in: [m] travel of blocks, and what steers the step
    block_travel: wp.array(dtype=wp.float64),
    control: wp.array(dtype=wp.float64),
) -> wp.float64: ...


@wp.func
def add_travel(
    i: int,
    way: wp.float64,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    node_block: wp.array(dtype=wp.int32),
    block_travel: wp.array(dtype=wp.float64),
):
    """Add the path length `way` [m] of a node to the travel of blocks. These are blocks with segments shaped by it, where blocks
    count (travel_of_pair.h).
    """
    if block_travel.shape[0] == 1:
        return
    own = node_block[i]
    wp.atomic_add(block_travel, own, way)
    before = previous[i]
    if before >= 0:
        if previous[before] >= 0:
            before = previous[before]
        if node_block[before] != own:
            wp.atomic_add(block_travel, node_block[before], way)
    after = following[i]
    if after >= 0:
        if node_block[after] != own:
            wp.atomic_add(block_travel, node_block[after], way)
