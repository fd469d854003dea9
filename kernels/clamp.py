"""Where a clamp holds a wire: at a point of its centre line, between two nodes in general.

The two nodes next to it at the end of an open wire are held (grip.py) and carry the contact curve; the mechanics begins at the
clamp itself. The first segment goes from the clamp to the third node, the hinge at the clamp turns from the clamp's direction to
that segment. What differs from the rest data of the repeat stands in CLAMP_NUMBERS numbers for either end of a wire, the
last two nodes and segments being meant at the far end.
"""

from typing import Any

import warp as wp

LEVER_X = wp.constant(0)  # [m] what makes the edge of the held node next to the clamp the edge of the clamp
LEVER_Y = wp.constant(1)
TANGENT_X = wp.constant(2)  # unit vector along the wire at the clamp
TANGENT_Y = wp.constant(3)
LENGTH = wp.constant(4)  # [m] natural length of the segment at the clamp
ANGLE = wp.constant(5)  # [rad] natural turning angle at the clamp
NEXT_ANGLE = wp.constant(6)  # [rad] and at the first free node
HINGE = wp.constant(7)  # stiffness of the hinge at the clamp over that of the table at the held node
NEXT_HINGE = wp.constant(8)  # the same at the first free node
BOW_CHANGE = wp.constant(9)  # what to add to the rest bow of the segment at the clamp (bend.py)
NEXT_BOW_CHANGE = wp.constant(10)  # the same of the next segment
# A hinge next to a clamp stands for another length l than a segment has: the square of its angle counts (L/l)^2 times in the bow
# of a segment of length L (bend.py), this much more than once:
BOW_WEIGHT = wp.constant(11)  # the hinge at the clamp in the segment at the clamp
NEXT_BOW_WEIGHT = wp.constant(12)  # the hinge at the first free node in the segment at the clamp
BEYOND_BOW_WEIGHT = wp.constant(13)  # and in the next segment
CLAMP_NUMBERS = 14


@wp.func
def edge_at_clamp(ex: Any, ey: Any, segment: int, count: int, gripped: int, wire: int, wire_clamp: wp.array2d(dtype=Any)):
    """The edge of a segment, counted from the start of its wire of `count` nodes, as its clamp has it."""
    far = int(0)
    if segment == count - 2 or segment == count - 3:
        far = CLAMP_NUMBERS
    if gripped != 0 and (segment == 0 or segment == count - 2):
        ex = wire_clamp[wire, far + TANGENT_X]
        ey = wire_clamp[wire, far + TANGENT_Y]
    if gripped != 0 and (segment == 1 or segment == count - 3):
        ex = ex + wire_clamp[wire, far + LEVER_X]
        ey = ey + wire_clamp[wire, far + LEVER_Y]
    return ex, ey


@wp.func
def length_at_clamp(length: Any, segment: int, count: int, gripped: int, wire: int, wire_clamp: wp.array2d(dtype=Any)):
    """Natural length [m] of a segment."""
    if gripped != 0 and segment == 1:
        length = wire_clamp[wire, LENGTH]
    if gripped != 0 and segment == count - 3:
        length = wire_clamp[wire, CLAMP_NUMBERS + LENGTH]
    return length


@wp.func
def hinge_at_clamp(angle: Any, local: int, count: int, gripped: int, wire: int, wire_clamp: wp.array2d(dtype=Any)):
    """Natural turning angle [rad] at a node, and the stiffness of its hinge over that of the table."""
    share = type(angle)(1.0)
    if gripped != 0:
        if local == 1 or local == 2:
            angle = wire_clamp[wire, ANGLE + local - 1]
            share = wire_clamp[wire, HINGE + local - 1]
        if local == count - 2 or local == count - 3:
            angle = wire_clamp[wire, CLAMP_NUMBERS + ANGLE + count - 2 - local]
            share = wire_clamp[wire, CLAMP_NUMBERS + HINGE + count - 2 - local]
    return angle, share


@wp.func
def bow_at_clamp(bow: Any, segment: int, count: int, gripped: int, wire: int, wire_clamp: wp.array2d(dtype=Any)):
    """Rest bow of a segment (bend.py); both ends of a short wire may change it."""
    if gripped != 0:
        if segment == 1 or segment == 2:
            bow = bow + wire_clamp[wire, BOW_CHANGE + segment - 1]
        if segment == count - 3 or segment == count - 4:
            bow = bow + wire_clamp[wire, CLAMP_NUMBERS + BOW_CHANGE + count - 3 - segment]
    return bow


@wp.func
def bow_weights_at_clamp(like: Any, local: int, count: int, gripped: int, wire: int, wire_clamp: wp.array2d(dtype=Any)):
    """How often the square of the angle at a node counts in the bows of the segments before and after it."""
    before = type(like)(1.0)
    after = type(like)(1.0)
    if gripped != 0:
        if local == 1:
            after = after + wire_clamp[wire, BOW_WEIGHT]
        if local == 2:
            before = before + wire_clamp[wire, NEXT_BOW_WEIGHT]
            after = after + wire_clamp[wire, BEYOND_BOW_WEIGHT]
        if local == count - 2:
            before = before + wire_clamp[wire, CLAMP_NUMBERS + BOW_WEIGHT]
        if local == count - 3:
            after = after + wire_clamp[wire, CLAMP_NUMBERS + NEXT_BOW_WEIGHT]
            before = before + wire_clamp[wire, CLAMP_NUMBERS + BEYOND_BOW_WEIGHT]
    return before, after
