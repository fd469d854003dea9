"""Weights of contacts: at the end of a segment, and where two segments touch in two places.

A contact inside both segments has the weight 1. A closest point that is bounded by a node counts only where the wires separate
slowly, side by side or wound round each other, and touch along a line: each node of either wire is then a contact, whichever of
the two adjacent segments the closest point would move to. Its weight depends on what both of these segments have in common, so a
contact passes a node without a jump.

Two segments may touch in two points, a and b, with a saddle c of the distance between them (wire_minima.py). Their energy is

    k (o_a^2 + o_b^2 - w o_c^2)/2        o being no less than zero, w = 1 - (1 - w_a) (1 - w_b)

w_a = (1 - (x/SADDLE_RANGE)^4)^2 with the distance x from a to the saddle, and w_b likewise. A closest point appears or disappears
together with a saddle; there the two cancel, so neither the energy nor its gradient jumps. The saddle therefore pulls as a
contact would push. Farther off it does not count, because wires that touch along a line have one contact a segment. a or b may
be bounded by a node, with the closest point itself in the next segment: the saddle passes the node without a jump. The gradient
of w is left out: w is flat near either end. The friction of each closest point has the weight

    1 - (w o_c/o_a) (1 - v_b (1 - u_a))        u_a = (o_b - w o_c)/(o_a + o_b - 2 w o_c)

with the weight v_b of the other one as a contact, 1 inside the segment. It is 0 for a contact that appears, 1/2 where one splits
into two, and 1 once the wires are separate in between.
"""

import warp as wp

from .wire_curve import Nodes, row

# separation of the wires over the contact distance, within a segment or, if longer, within the contact distance
LINE_FRACTION = wp.constant(wp.float64(0.25))  # below: contact along a line
POINT_FRACTION = wp.constant(wp.float64(0.35))  # above: contact in a point
SADDLE_RANGE = wp.constant(wp.float64(0.5))  # of a segment


@wp.func
def curvature_at(nodes: Nodes, place: wp.float64) -> wp.vec3d:
    """[1/m] curvature vector of the line through four nodes: at nodes 1 and 2, interpolated.

    Both segments beside a node have the same there, unlike the second derivatives of their curves.
    """
    before = row(nodes, 1) - row(nodes, 0)
    edge = row(nodes, 2) - row(nodes, 1)
    after = row(nodes, 3) - row(nodes, 2)
    two = wp.float64(2.0)
    length = wp.length(edge)
    own = edge / length
    one = (two / (length + wp.length(before))) * (own - wp.normalize(before))
    other = (two / (length + wp.length(after))) * (wp.normalize(after) - own)
    return one + place * (other - one)


@wp.func
def spacing_at(nodes: Nodes, place: wp.float64) -> wp.float64:
    """[m] length of segments: the mean of both at a node, interpolated between nodes."""
    half = wp.float64(0.5)
    before = wp.length(row(nodes, 1) - row(nodes, 0))
    own = wp.length(row(nodes, 2) - row(nodes, 1))
    after = wp.length(row(nodes, 3) - row(nodes, 2))
    return half * (own + before + place * (after - before))


@wp.func
def line_weight(
    p: Nodes, q: Nodes, place: wp.vec2d, r: wp.vec3d, dp: wp.vec3d, dq: wp.vec3d, contact_distance: wp.float64
) -> wp.float64:
    """Weight of a contact bounded by the end of a segment: 1 where the wires touch along a line, 0 in a point.

    r points from q to p, dp and dq along the curves. From the determinant of the second derivatives of half the squared distance
    by the arcs: the squared sine of the angle between straight wires, and zero for wires wound round each other.
    """
    one = wp.float64(1.0)
    cosine = wp.dot(wp.normalize(dp), wp.normalize(dq))
    determinant = (one + wp.dot(r, curvature_at(p, place[0]))) * (one - wp.dot(r, curvature_at(q, place[1]))) - cosine * cosine
    sine = wp.sqrt(wp.abs(determinant))
    fraction = sine * wp.max(wp.max(spacing_at(p, place[0]), spacing_at(q, place[1])) / contact_distance, one)
    return wp.clamp((POINT_FRACTION - fraction) / (POINT_FRACTION - LINE_FRACTION), wp.float64(0.0), one)


@wp.func
def saddle_weight(place: wp.vec2d, saddle: wp.vec2d) -> wp.float64:
    """1 where the saddle meets a closest point, 0 beyond SADDLE_RANGE."""
    distance = wp.max(wp.abs(place[0] - saddle[0]), wp.abs(place[1] - saddle[1])) / SADDLE_RANGE
    square = distance * distance
    near = wp.max(wp.float64(1.0) - square * square, wp.float64(0.0))
    return near * near


@wp.func
def friction_weight(own: wp.float64, other: wp.float64, weight_of_other: wp.float64, saddle: wp.float64) -> wp.float64:
    """Friction weight of one of two contacts, from both overlaps and the saddle's."""
    zero = wp.float64(0.0)
    if saddle <= zero or own <= zero:
        return wp.float64(1.0)
    above = wp.max(own - saddle, zero)
    beyond = wp.max(other - saddle, zero)
    share = wp.float64(0.5)
    if above + beyond > zero:
        share = beyond / (above + beyond)
    share = wp.float64(1.0) - weight_of_other * (wp.float64(1.0) - share)
    return wp.max(wp.float64(1.0) - share * wp.min(saddle / own, wp.float64(1.0)), zero)
