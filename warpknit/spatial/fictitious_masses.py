"""Fictitious masses of a dynamic relaxation, banded along the wire, for which a step of one second is stable.

A diagonal mass that bounds the bending stiffness EI/h^3 of the shortest waves makes long waves slow: their steps grow with the
square of the nodes. A mass that is itself a difference operator along the wire moves waves of all lengths at about the same rate
(selective mass scaling: Olovsson, Simonsson and Unosson, Int. J. Numer. Methods Eng. 63, 2005). Per node n between segments a
and b, with turning angle p, moment m and lengths l, and per segment with axial stiffness K and tension T, the stiffness is
bounded by

    (1 + e) (B/l_n + bow) |dx_b/l_b - dx_a/l_a|^2                 bending across; bow = (T_a l_a + T_b l_b)/24, kernels/bend.py
    [(1 + 1/e) B + GJ] p^2/(2 l_n) (|dx_a|^2/l_a^2 + |dx_b|^2/l_b^2)        turning edges: the normals of a and b differ by p,
                                                                  |n_b . v - n_a . u|^2 <= (1 + e)|v - u|^2 + (1 + 1/e) p^2 ...
    |m| (|dx_a|^2/l_a^2 + |dx_b|^2/l_b^2)                         second derivative of the angle
    (K + T)/l |dx|^2                                              stretch along the segment, tension across
    k (sum of |w n|) |w_i n_x| dx_i^2, ...                        a contact k (w n . dx)^2 of normal n, by Cauchy and Schwarz,
                                                                  and the same along y and z

with the difference dx of the displacements of the two nodes of a segment and B = 19/9 EI, by which slopes of moments stiffen the
shortest waves (kernels/rod_forces.py); and of twist by EI/l_n (df_b - df_a)^2, as a sharp turn couples bending and twist, and
B p^2/(2 l_n) (df_a^2 + df_b^2). Displacements and twist are coupled: the stiffness of both is bounded by 1 + COUPLING times the
first and 1 + 1/COUPLING times the second. A quarter of the bound is the mass at the stability limit (kernels/rod_masses.py).

A uniform mass moves waves longer than `wave_length`, which carry almost no force.
"""

from __future__ import annotations

import math

import warp as wp

from ..compute.host import lanes
from ..kernels.rod_blocks import ROD_LANES
from ..kernels.rod_masses import find_masses
from ..mechanics.numerics import MASS_MARGIN
from .rod_checks import RodChecks
from .step_bound import SLOPE_FACTOR

COUPLING = 0.5  # of displacements and twist


class BandedMasses:
    """Fictitious masses of rods for the state they are in."""

    def __init__(self, checks: RodChecks, wave_length: float, *, keeps_arc_length: bool) -> None:
        """wave_length [m] of the slowest wave; keeps_arc_length: whether tension acts on the turns at nodes."""
        self._checks, rods = checks, checks.stepper.strip.whole
        wave = 2.0 * math.pi / wave_length
        share, spin_share = (0.25 * MASS_MARGIN * (1.0 + x) for x in (COUPLING, 1.0 / COUPLING))
        self._constants = {
            "slope_factor": wp.float64(SLOPE_FACTOR),
            "hardening": wp.float64(rods.section.hardening),
            "keeps_arc_length": wp.int32(keeps_arc_length),
            "share": wp.float64(share),
            "spin_share": wp.float64(spin_share),
            "wave_square": wp.float64(wave**2),
            "wave_fourth": wp.float64(wave**4),
            "spacing": wp.float64(float(rods.natural_length[rods.following >= 0].mean())),
        }

    def find(self) -> None:
        """Set the masses of the dynamics for the state last evaluated and the bounds on its contacts."""
        stepper = self._checks.stepper
        threads, touches = lanes(ROD_LANES, stepper.device), stepper.contact is not None
        self._checks.launches.run(
            f"masses {touches}", find_masses, "first_block", stepper.blocks, stepper.arrays, stepper.state,
            self._checks.arrays, threads=threads, threads_a_block=threads, may_touch=wp.int32(touches), **self._constants,
        )  # fmt: skip
        stepper.factor_masses()
