"""What a contact of two segments counts: at an end of one, and where the segments touch in two places.

A contact belongs to the pair of segments between whose ends it stands. Where the closest point stands at a node and would go on
beyond it, it counts only where the wires part slowly, as they do side by side or wound round each other, and touch along a line:
each node of either wire is then a contact, on whichever side of it the closest point of the next segment may be.

Two segments may touch in two points, a and b, with a saddle c of the distance between them (wire_closest.py). Their energy is

    k (o_a^2 + o_b^2 - w o_c^2)/2        o being no less than zero, w = 1 - (1 - w_a) (1 - w_b)

w_a = (1 - (x/SADDLE_FAR)^4)^2, x being the distance from a to the saddle, and so is w_b. For a closest point appears, or is gone,
together with a saddle: there they cancel, and neither the energy nor its gradient jumps. So the saddle pulls as a contact would
push. Farther off it does not count, as wires that touch along a line have a contact a segment; nor where a and b are within
END_PART of the end of a segment, about to go over to the next one, which knows nothing of the saddle. The gradient leaves out
that of w, which is flat near either. Of friction each
closest point has the share

    1 - (o_c/o_a) w_a        w_a = (o_b - o_c)/(o_a + o_b - 2 o_c)

which is none for one that appears, a half where one parts into two, and all once the wires are apart in between.
"""

import warp as wp

from .wire_curve import Powers, bend_at, point_at, slope_at

# of the distance of touching wires: those that part by less within a segment, or within that distance if it is longer, touch
LINE_PART = wp.constant(wp.float64(0.25))  # along a line, and those that part by more
POINT_PART = wp.constant(wp.float64(0.35))  # in a point
END_PART = wp.constant(wp.float64(0.05))  # of a segment
SADDLE_FAR = wp.constant(wp.float64(0.5))  # of a segment


@wp.func
def line_share(
    p: Powers, q: Powers, place: wp.vec2d, length_p: wp.float64, length_q: wp.float64, touch: wp.float64
) -> wp.float64:
    """What a contact at an end counts that would go on beyond it: 1 where the wires touch along a line, 0 where in a point.

    By the second derivatives of the distance squared along both wires: of straight ones at an angle their determinant is its sine
    squared, and of wires that are wound round each other it is none.
    """
    dp = slope_at(p, place[0])
    dq = slope_at(q, place[1])
    r = point_at(p, place[0]) - point_at(q, place[1])
    pp = wp.dot(dp, dp)
    qq = wp.dot(dq, dq)
    pq = wp.dot(dp, dq)
    determinant = (pp + wp.dot(r, bend_at(p, place[0]))) * (qq - wp.dot(r, bend_at(q, place[1]))) - pq * pq
    sine = wp.sqrt(wp.max(determinant, wp.float64(0.0)) / (pp * qq))
    part = sine * wp.max(wp.max(length_p, length_q) / touch, wp.float64(1.0))
    return wp.clamp((POINT_PART - part) / (POINT_PART - LINE_PART), wp.float64(0.0), wp.float64(1.0))


@wp.func
def inside_share(place: wp.vec2d) -> wp.float64:
    """0 at the ends of either segment, 1 from END_PART off them."""
    one = wp.float64(1.0)
    s = wp.min(place[0], one - place[0])
    t = wp.min(place[1], one - place[1])
    return wp.clamp(wp.min(s, t) / END_PART, wp.float64(0.0), one)


@wp.func
def saddle_share(place: wp.vec2d, saddle: wp.vec2d) -> wp.float64:
    """1 where a saddle is about to meet a closest point, 0 where it is far from it."""
    apart = wp.max(wp.abs(place[0] - saddle[0]), wp.abs(place[1] - saddle[1])) / SADDLE_FAR
    square = apart * apart
    near = wp.max(wp.float64(1.0) - square * square, wp.float64(0.0))
    return near * near


@wp.func
def share_of_friction(own: wp.float64, other: wp.float64, saddle: wp.float64) -> wp.float64:
    """What is left of a contact between two, by their overlaps and that of the saddle between them, none below zero."""
    zero = wp.float64(0.0)
    if saddle <= zero or own <= zero:
        return wp.float64(1.0)
    above = wp.max(own - saddle, zero)
    beyond = wp.max(other - saddle, zero)
    weight = wp.float64(0.5)
    if above + beyond > zero:
        weight = beyond / (above + beyond)
    return wp.max(wp.float64(1.0) - weight * wp.min(saddle / own, wp.float64(1.0)), zero)
