"""A long overhand knot that slides with friction, for any braid length.

From Jawed, Dieleman, Audoly and Reis (PRL 115, 118302), equations 3 to 5. The text of the paper was not available: the equations
are as quoted, with the paper's numbers, in the public examples of another code (ryanchaiyakul/dismech-newton), and agree with
what is derived here.

Two strands wind round each other n times, over a length l; a planar elastica, the loop, joins one end of the braid to the other.
It leaves the braid with the curvature 1/r along the axis of the braid. The rod has radius h and bending stiffness B. The work of
the couple B/r that winds the strands and their bending balance where the wave number k of the braid is (knot_braid.py: k l is
3^(-1/4) over the length sqrt(2 h r))

    h k = (h/(sqrt(12) r))^(1/2),    l = 2 pi n/k                                                  equation 3
    contact force   q h^2/B = 2 pi n (h k)^3,    F = mu q while the strands slide                  equation 4

The loop turns by 2 pi, with curvature (1 - m sin^2(theta/2))^(1/2)/r at the angle theta. Its length and the distance of its ends:

    L = 4 K r,    l = (8 (K - E)/m - 4 K) r        complete elliptic integrals K(m), E(m)

m = 0 is the circle, m near 1 a narrow loop by a long braid. The end-to-end shortening is S = L + l; F against S is equation 5.
The pull that bends the loop without friction, B/(2 r^2) or so, is left out: the law holds for large friction and n much above 1.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.special import ellipe, ellipk

TURN = 2.0 * np.pi * 12.0**0.25  # l/r of one turn, over (h/r)^(1/2)


@cache
def loops() -> tuple[np.ndarray, np.ndarray]:
    """Lengths of braid and loop over r, (4000,) each: l/r, rising, and L/r."""
    m = 1.0 - np.geomspace(1.0 - 1e-6, 1e-12, 4000)
    k, e = ellipk(m), ellipe(m)
    return 8.0 * (k - e) / m - 4.0 * k, 4.0 * k


def sliding_contact_force(turns: int, e: np.ndarray) -> np.ndarray:
    """Contact force q h^2/B of a long knot with the shortening S = 2 pi h/e^2."""
    braid, loop = loops()
    radius = (TURN * turns / braid) ** 2  # r/h
    shortening = radius * (braid + loop)
    at = np.interp(-np.log(2.0 * np.pi / np.asarray(e) ** 2), -np.log(shortening), np.log(braid), left=np.nan, right=np.nan)
    return np.asarray(2.0 * np.pi * turns * 12.0**-0.75 * (np.exp(at) / (TURN * turns)) ** 3)
