"""Bending at a node between two segments.

    theta = angle from the edge before to the edge after       E = EI/l (theta - theta0)^2 / 2

with l the length of wire that belongs to the node. The moment m = EI/l (theta - theta0) acts on the direction of both
edges: the gradient of E by an edge e with unit normal nu and length |e| is (m - m_next)/|e| nu.

Turns at points see curvature to second order of the spacing h only: of a smooth curve theta/h = kappa + h^2/12 kappa'', and
E is the trapezoidal rule for the integral of EI kappa^2/2. What both miss is, to fourth order, the energy of the slope
of the moment along each segment (of natural length L),

    E_slope = L (m_next - m)^2/(12 EI)

which adds to the moment at a node   EI/l [L_before (m - m_before) - L (m_next - m)]/(6 EI).

Behind a free end the moment is 0; a segment that a clamp holds rigid has none.

Source: a beam loaded at its nodes has moments linear between them, so its compliance is the integral of products of linear
functions, l (1 + delta^2/6) where turns at points alone give l; E_slope is the first term of the inverse.
"""

from typing import Any

import warp as wp


@wp.func
def turning_angle(ax: Any, ay: Any, bx: Any, by: Any):
    """Angle from edge a to edge b, in (-pi, pi]."""
    return wp.atan2(ax * by - ay * bx, ax * bx + ay * by)


@wp.func
def elastic_turning(turning: Any, plastic: Any, back: Any, most: Any, kept: Any):
    """Part of a turning (theta - theta0) [rad] that is elastic: the moment is EI/l times it.

    plastic: turning that stays, as of the last state at rest; beyond `most` on either side of `back` the wire yields, and keeps
    the share `kept` of its stiffness (kinematic hardening). most = 0: it never yields.
    """
    trial = turning - plastic
    beyond = trial - back
    over = wp.abs(beyond) - most
    if most > type(turning)(0.0) and over > type(turning)(0.0):
        trial = trial - wp.sign(beyond) * over * (type(turning)(1.0) - kept)
    return trial


SLOPE_SHARE = 1.0 / 6.0  # of what the slope of the moment adds
BEND_EIGENVALUE = 16.0 * (1.0 + 4.0 * SLOPE_SHARE)  # largest of an even straight chain, in EI/h^3: every other node displaced


@wp.func
def slope_moment(before: Any, here: Any, after: Any, length_before: Any, length_after: Any, stiffness: Any, slope_factor: Any):
    """What the slopes of the moment along both segments at a node add to its moment [N m]; a length of 0 for a segment that
    is not between two hinges. stiffness: EI/l [N m] at the rest length; slope_factor: SLOPE_SHARE/EI [1/(N m2)]."""
    return slope_factor * stiffness * (length_before * (here - before) - length_after * (after - here))


# A segment is an arc: of length L and curvature k, its chord is shorter by (k L)^2/24 of it, with the mean of k^2 at its ends.
# Where the wire keeps the length of its arcs, a tension T pulls on the angles of its ends with the moment T L d(bow)/d(theta).
BOW = wp.constant(1.0 / 48.0)


@wp.func
def bow(angle: Any, angle_after: Any, weight: Any, weight_after: Any):
    """Share by which the arc of a segment is longer than its chord, from the turning angles [rad] at its two nodes and how often
    their squares count: once, where both stand for a length like the segment's (see clamp.py)."""
    return type(angle)(BOW) * (weight * angle * angle + weight_after * angle_after * angle_after)
