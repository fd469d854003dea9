"""Forces of planar wires (native/wire_forces.h): one C++ source for steps, energies and diagnostics, on CPU and GPU.

    e = F E0 + (u_next - u)                 T = offset + (EA/s) (|e|/L - 1)             stretch
    g = EI/l (theta - theta0)                                                          bending at a node
        + EI/l [L_before (g - g_before) - L (g_next - g)]/(6 EI)                        slope of the moment
        + 2 BOW theta (T L + T_before L_before)                                         bow of arcs that keep their length
    n = T t + (g - g_next)/|e| nu                                                       force of a segment

with t and nu the unit tangent and left normal of the segment from a node to the next one; see stretch.py, bend.py and clamp.py.

It is C++, as loops of a Warp kernel do not vectorise on the CPU: loops over short arrays, in which every segment and angle of a
block is computed once. A block holds at most BLOCK_SIZE consecutive nodes of one wire; the rest data of its first node stand
at `block_table` of the table of one repeat, whose entries unroll in step with the nodes. A thread works on a block, or, on a
GPU, WIRE_LANES threads share it (sharing.h).
"""

BLOCK_SIZE = 128
BLOCK_PAD = 32  # table entries behind a block that may be read
WIRE_LANES = 160  # whole warps for the nodes of a block and those around it
