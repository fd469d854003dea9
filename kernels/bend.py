"""Bending at a node between two segments.

    theta = angle from the edge before to the edge after       E = EI/l (theta - theta0)^2 / 2

with l the length of wire that belongs to the node. The moment m = EI/l (theta - theta0) acts on the direction of both
edges: the gradient of E by an edge e with unit normal nu and length |e| is (m - m_next)/|e| nu.

Point turns represent curvature to second order in the spacing h: for a smooth curve theta/h = kappa + h^2/12 kappa'', and E is
the trapezoidal rule for the integral of EI kappa^2/2. The missing part is, to fourth order, the energy of the slope of the
moment along each segment (of natural length L),

    E_slope = L (m_next - m)^2/(12 EI)

which adds to the moment at a node   EI/l [L_before (m - m_before) - L (m_next - m)]/(6 EI).

Behind a free end the moment is 0; a segment that a clamp holds rigid has none.

Source: a beam loaded at its nodes has moments linear between them, so its compliance is the integral of products of linear
functions, l (1 + delta^2/6) where turns at points alone give l; E_slope is the first term of the inverse.

Where a wire yields, p is the plastic turning at the last equilibrium. Beyond the yield moment on either side of the back
turning b (`back_turn`) the stiffness is reduced to the share h (kinematic hardening): with y the turning at yield,

    m = EI/l (theta - theta0 - p - (1 - h) sign(d) max(|d| - y, 0))        d = theta - theta0 - p - b

A segment is an arc: of length L and curvature k, its chord is shorter by (k L)^2/24 of it, with the mean of k^2 at its ends,

    bow = BOW (w theta^2 + w_next theta_next^2)

with weights w = 1 except next to clamps (clamp.py). Where arcs keep their length, a tension T acts on the angles of its ends with
the moment T L d(bow)/d(theta).

wire_forces.py implements these formulas.
"""

import warp as wp

SLOPE_SHARE = 1.0 / 6.0  # factor of the slope term
BEND_EIGENVALUE = 16.0 * (1.0 + 4.0 * SLOPE_SHARE)  # largest of an even straight chain, in EI/h^3: every other node displaced

BOW = wp.constant(1.0 / 48.0)
