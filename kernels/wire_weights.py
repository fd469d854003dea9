"""Weights of contacts: at the end of a segment, and where two segments touch in two places.

A contact inside both segments has the weight 1. A closest point that is bounded by a node counts only where the wires separate
slowly, side by side or wound round each other, and touch along a line: each node of either wire is then a contact, whichever of
the two adjacent segments the closest point would move to.

Two segments may touch in two points, a and b, with a saddle c of the distance between them (wire_minima.py). Their energy is

    k (o_a^2 + o_b^2 - w o_c^2)/2        o being no less than zero, w = 1 - (1 - w_a) (1 - w_b)

w_a = (1 - (x/SADDLE_RANGE)^4)^2 with the distance x from a to the saddle, and w_b likewise. A closest point appears or disappears
together with a saddle; there the two cancel, so neither the energy nor its gradient jumps. The saddle therefore pulls as a
contact would push. Farther off it does not count, because wires that touch along a line have one contact a segment; nor where a
or b is within END_FRACTION of the end of a segment, about to move to the next one, which does not have the saddle. The gradient
of w is left out: w is flat near either end. The friction of each closest point has the weight

    1 - (o_c/o_a) w_a        w_a = (o_b - o_c)/(o_a + o_b - 2 o_c)

which is 0 for a contact that appears, 1/2 where one splits into two, and 1 once the wires are separate in between.
"""

import warp as wp

from .wire_curve import Powers, derivative_at, point_at, second_derivative_at

# separation of the wires over the contact distance, within a segment or, if longer, within the contact distance
LINE_FRACTION = wp.constant(wp.float64(0.25))  # below: contact along a line
POINT_FRACTION = wp.constant(wp.float64(0.35))  # above: contact in a point
END_FRACTION = wp.constant(wp.float64(0.05))  # of a segment
SADDLE_RANGE = wp.constant(wp.float64(0.5))  # of a segment


@wp.func
def line_weight(
    p: Powers, q: Powers, place: wp.vec2d, length_p: wp.float64, length_q: wp.float64, contact_distance: wp.float64
) -> wp.float64:
    """Weight of a contact bounded by the end of a segment: 1 where the wires touch along a line, 0 in a point.

    From the determinant of the second derivatives of the squared distance: the squared sine of the angle between straight wires,
    and zero for wires wound round each other.
    """
    dp = derivative_at(p, place[0])
    dq = derivative_at(q, place[1])
    r = point_at(p, place[0]) - point_at(q, place[1])
    pp = wp.dot(dp, dp)
    qq = wp.dot(dq, dq)
    pq = wp.dot(dp, dq)
    determinant = (pp + wp.dot(r, second_derivative_at(p, place[0]))) * (
        qq - wp.dot(r, second_derivative_at(q, place[1]))
    ) - pq * pq
    sine = wp.sqrt(wp.max(determinant, wp.float64(0.0)) / (pp * qq))
    fraction = sine * wp.max(wp.max(length_p, length_q) / contact_distance, wp.float64(1.0))
    return wp.clamp((POINT_FRACTION - fraction) / (POINT_FRACTION - LINE_FRACTION), wp.float64(0.0), wp.float64(1.0))


@wp.func
def inside_weight(place: wp.vec2d) -> wp.float64:
    """0 at the ends of either segment, 1 from END_FRACTION off them."""
    one = wp.float64(1.0)
    s = wp.min(place[0], one - place[0])
    t = wp.min(place[1], one - place[1])
    return wp.clamp(wp.min(s, t) / END_FRACTION, wp.float64(0.0), one)


@wp.func
def saddle_weight(place: wp.vec2d, saddle: wp.vec2d) -> wp.float64:
    """1 where the saddle meets a closest point, 0 beyond SADDLE_RANGE."""
    distance = wp.max(wp.abs(place[0] - saddle[0]), wp.abs(place[1] - saddle[1])) / SADDLE_RANGE
    square = distance * distance
    near = wp.max(wp.float64(1.0) - square * square, wp.float64(0.0))
    return near * near


@wp.func
def friction_weight(own: wp.float64, other: wp.float64, saddle: wp.float64) -> wp.float64:
    """Friction weight of one of two contacts, from both overlaps and that of the saddle between them."""
    zero = wp.float64(0.0)
    if saddle <= zero or own <= zero:
        return wp.float64(1.0)
    above = wp.max(own - saddle, zero)
    beyond = wp.max(other - saddle, zero)
    weight = wp.float64(0.5)
    if above + beyond > zero:
        weight = beyond / (above + beyond)
    return wp.max(wp.float64(1.0) - weight * wp.min(saddle / own, wp.float64(1.0)), zero)
