"""Blocks of nodes of rods (native/rod_block.h).

A block holds at most ROD_BLOCK consecutive nodes of one wire. A thread works on a block, or, on a GPU, ROD_LANES threads share it
(native/sharing.h).
"""

ROD_BLOCK = 50  # with the three nodes on either side that take part a multiple of 8 numbers, without a remainder in vectors
ROD_LANES = 64  # whole warps for the nodes of a block and those around it
