"""Bending and twist at a node between two segments of a rod (discrete elastic rods; Bergou and others 2008, 2010).

With e, f the unit tangents before and after the node, d1, d2 the directors of either segment and l the natural length of the
node,

    kb = 2 e x f/(1 + e . f)                                        curvature binormal, integrated over the node
    k1 = (d2_before + d2_after) . kb/2     k2 = - (d1_before + d1_after) . kb/2
    a  = k 2 atan(|k|/2)/|k|                                        turning vector: |k| is 2 tan(angle/2), |a| the angle itself
    m  = angle from d1_before, transported to f, to d1_after        twist, integrated
    E  = B |a - A|^2/(2 l) + C (m - M)^2/(2 l)                      A, M: natural values

Where the wire yields, p [rad] is the plastic part of the turn at the last equilibrium, and the moment is B e/l with

    t = a - A - p      b = kept/(1 - kept) p      e = t - (1 - kept) max(0, 1 - y/|t - b|) (t - b)

in place of a - A. A round section is isotropic: it yields where the moment differs from its back moment by y B/l in any
direction, and flows in that direction (radial return; linear kinematic hardening, `kept` being the tangent stiffness over the
elastic one).

A segment of length L between turns a and a' is an arc, longer than its chord by L (|a|^2 + |a'|^2)/48. Where arc lengths are kept
(BOW_MOMENT), its tension T adds the moment T L a/24 at either end (bend.py, in the plane).

The gradient by the two edges, with transported directors, and by the angle of either segment:

    dk1/d(edge before) = (- k1 t' + f x d2')/|edge|       dk1/d(edge after) = (- k1 t' - e x d2')/|edge|
    dk2/d(edge before) = (- k2 t' - f x d1')/|edge|       dk2/d(edge after) = (- k2 t' + e x d1')/|edge|
    dm/d(either edge)  = kb/(2 |edge|)
    dk1/d(angle) = - d1 . kb/2      dk2/d(angle) = - d2 . kb/2      dm/d(angle) = -1 before, +1 after

with t' = (e + f)/(1 + e . f) and d' = (d_before + d_after)/(1 + e . f).
"""

import warp as wp

from .control import BOW_MOMENT, LENGTH_FACTOR
from .rod_frames import transported
from .stretch import axial_force

SMALL = wp.constant(wp.float64(1.0e-4))  # |k| below which two terms of the series are exact to round-off


@wp.func
def twist_between(before: wp.vec3d, after: wp.vec3d, tangent_before: wp.vec3d, tangent_after: wp.vec3d) -> wp.float64:
    """Twist angle [rad] from one director to the next, in (-pi, pi]."""
    moved = transported(before, tangent_before, tangent_after)
    return wp.atan2(wp.dot(wp.cross(moved, after), tangent_after), wp.dot(moved, after))


@wp.func
def turning_share(size: wp.float64) -> wp.float64:
    """2 atan(x/2)/x."""
    if size < SMALL:
        return wp.float64(1.0) - size * size / wp.float64(12.0)
    return wp.float64(2.0) * wp.atan(wp.float64(0.5) * size) / size


@wp.func
def turning_slope(size: wp.float64, share: wp.float64) -> wp.float64:
    """Derivative of `turning_share` by x, over x; `share` is its value."""
    if size < SMALL:
        return -wp.float64(1.0 / 6.0)
    square = size * size
    return (wp.float64(1.0) / (wp.float64(1.0) + wp.float64(0.25) * square) - share) / square


@wp.func
def elastic_turn(turn: wp.vec2d, plastic: wp.vec2d, most: wp.float64, kept: wp.float64) -> wp.vec2d:
    """Elastic part e [rad] of the turn a - A; most [rad] is y, 0: no yield."""
    one = wp.float64(1.0)
    trial = turn - plastic
    if most <= wp.float64(0.0) or kept >= one:
        return trial
    beyond = trial - (kept / (one - kept)) * plastic
    size = wp.length(beyond)
    if size <= most:
        return trial
    return trial - ((one - kept) * (one - most / size)) * beyond


@wp.kernel
def bend_rods(
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    node_length: wp.array(dtype=wp.float64),
    natural_curvature: wp.array(dtype=wp.vec2d),
    natural_twist: wp.array(dtype=wp.float64),
    bending_stiffness: wp.float64,
    twist_stiffness: wp.float64,
    yield_curvature: wp.float64,
    hardening: wp.float64,
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    # state in
    stretch_stiffness: wp.array(dtype=wp.float64),
    tension_offset: wp.array(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    director: wp.array(dtype=wp.vec3d),
    plastic_turn: wp.array(dtype=wp.vec2d),
    # out: turning vector and twist [rad], the gradient by the edges [N] and by the angles of both segments [N m]
    curvature: wp.array(dtype=wp.vec2d),
    twist: wp.array(dtype=wp.float64),
    edge_gradient_before: wp.array(dtype=wp.vec3d),
    edge_gradient_after: wp.array(dtype=wp.vec3d),
    angle_gradient_before: wp.array(dtype=wp.float64),
    angle_gradient_after: wp.array(dtype=wp.float64),
):
    """One thread a node; entries of end nodes stay zero."""
    i = wp.tid()
    a = previous[i]
    if a < 0 or following[i] < 0:
        return
    half = wp.float64(0.5)
    e = tangent[a]
    f = tangent[i]
    one_before = director[a]
    one_after = director[i]
    two_before = wp.cross(e, one_before)
    two_after = wp.cross(f, one_after)
    share = wp.float64(1.0) / (wp.float64(1.0) + wp.dot(e, f))
    binormal = (wp.float64(2.0) * share) * wp.cross(e, f)
    k1 = half * wp.dot(two_before + two_after, binormal)
    k2 = -half * wp.dot(one_before + one_after, binormal)
    m = twist_between(one_before, one_after, e, f)
    k = wp.vec2d(k1, k2)
    size = wp.length(k)
    turning_part = turning_share(size)
    turning = turning_part * k
    curvature[i] = turning
    twist[i] = m
    factor = control[LENGTH_FACTOR]
    natural = node_length[i] * factor
    elastic = elastic_turn(turning - natural_curvature[i], plastic_turn[i], yield_curvature * natural, hardening)
    moment = (bending_stiffness / natural) * elastic
    if control[BOW_MOMENT] > wp.float64(0.0):
        before = natural_length[a] * factor
        after = natural_length[i] * factor
        pull = before * axial_force(length[a], before, stretch_stiffness[a], tension_offset[a])
        pull += after * axial_force(length[i], after, stretch_stiffness[i], tension_offset[i])
        moment += (control[BOW_MOMENT] * pull) * turning
    couple_k = turning_part * moment + (turning_slope(size, turning_part) * wp.dot(k, moment)) * k
    g1 = couple_k[0]
    g2 = couple_k[1]
    g = twist_stiffness / natural * (m - natural_twist[i])
    along = share * (e + f)
    one = share * (one_before + one_after)
    two = share * (two_before + two_after)
    lean = -(g1 * k1 + g2 * k2) * along + (half * g) * binormal
    couple = g1 * two - g2 * one
    edge_gradient_before[i] = (lean + wp.cross(f, couple)) / length[a]
    edge_gradient_after[i] = (lean - wp.cross(e, couple)) / length[i]
    angle_gradient_before[i] = -half * wp.dot(g1 * one_before + g2 * two_before, binormal) - g
    angle_gradient_after[i] = -half * wp.dot(g1 * one_after + g2 * two_after, binormal) + g
