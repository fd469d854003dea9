"""Bending at a node between two segments.

    theta = angle from the edge before to the edge after       E = EI/l (theta - theta0)^2 / 2

with l the rest length that belongs to the node. The moment g = EI/l (theta - theta0) acts on the direction of both
edges: the gradient of E by an edge e with unit normal nu and length |e| is (g - g_next)/|e| nu.
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


# A segment is an arc: of length L and curvature k, its chord is shorter by (k L)^2/24 of it, with the mean of k^2 at its ends.
# Where the wire keeps the length of its arcs, a tension T pulls on the angles of its ends with the moment T L d(bow)/d(theta).
BOW = wp.constant(1.0 / 48.0)


@wp.func
def bow(angle: Any, angle_after: Any):
    """Share by which the arc of a segment is longer than its chord, from the turning angles [rad] at its two nodes."""
    return type(angle)(BOW) * (angle * angle + angle_after * angle_after)
