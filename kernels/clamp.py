"""Clamps: a wire is held at a point of its centre line, in general between two nodes.

The two nodes next to it at the end of an open wire are held (grip.py) and carry the contact curve; the mechanics begins at the
clamp itself. The first segment goes from the clamp to the third node, the hinge at the clamp turns from the clamp's direction to
that segment. What differs from the rest data of the repeat stands in CLAMP_NUMBERS numbers for either end of a wire, the
last two nodes and segments being meant at the far end.
"""

import warp as wp

LEVER_X = wp.constant(0)  # [m] difference between the edges at the clamp and at the held node next to it
LEVER_Y = wp.constant(1)
TANGENT_X = wp.constant(2)  # unit vector along the wire at the clamp
TANGENT_Y = wp.constant(3)
LENGTH = wp.constant(4)  # [m] natural length of the segment at the clamp
ANGLE = wp.constant(5)  # [rad] natural turning angle at the clamp
NEXT_ANGLE = wp.constant(6)  # [rad] and at the first free node
HINGE = wp.constant(7)  # stiffness of the hinge at the clamp over the table's at the held node
NEXT_HINGE = wp.constant(8)  # the same at the first free node
BOW_CHANGE = wp.constant(9)  # addition to the rest bow of the segment at the clamp (bend.py)
NEXT_BOW_CHANGE = wp.constant(10)  # the same for the next segment
# A hinge next to a clamp stands for another length l than a segment has: the square of its angle counts (L/l)^2 times in the bow
# of a segment of length L (bend.py), this much more than once:
BOW_WEIGHT = wp.constant(11)  # the hinge at the clamp in the segment at the clamp
NEXT_BOW_WEIGHT = wp.constant(12)  # the hinge at the first free node in the segment at the clamp
BEYOND_BOW_WEIGHT = wp.constant(13)  # and in the next segment
CLAMP_NUMBERS = 14
