"""Blocks of nodes of rods (native/rod_block.h).

A block holds at most ROD_BLOCK consecutive nodes of one wire. A thread works on a block, or, on a GPU, ROD_LANES threads share it
(native/sharing.h).
"""

import warp as wp

ROD_BLOCK = 50  # with the three nodes on either side that take part a multiple of 8 numbers, without a remainder in vectors
ROD_LANES = 64  # whole warps for the nodes of a block and those around it

# in the steps of a relaxation its nodes move; they rest, beside a block that moves; they rest among others
MOVES = wp.constant(0)
RESTS_BESIDE = wp.constant(1)
RESTS = wp.constant(2)


@wp.func
def rests(i: int, node_block: wp.array(dtype=wp.int32), block_rest: wp.array(dtype=wp.int32)) -> bool:
    """Whether the node is in a block that rests."""
    return block_rest[node_block[i]] != MOVES
