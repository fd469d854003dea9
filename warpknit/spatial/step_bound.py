"""The largest stable step of rods, and the fictitious masses that make a step of one second stable.

A straight uniform chain of segments h with node mass m and spin inertia I has the largest squared frequencies

    a = 4 EA/(h m)      b = 16 EI/(h^3 m)      t = 4 GJ/(h I)

of stretch, bending and twist. A turn p [rad] at the nodes couples them; it adds p^2 EI/(h I) to twist, as a turned section bends
against its natural curvature, and p^2 GJ/(2 h^3 m) to bending, as a node that moves across turns the frames. Tension adds
4 T/(h m), contact of a penalty k at most 4 k/m: the curve of a wire puts it on four nodes whose shares squared sum up to one
at most, on either wire, and two contacts at once may push the same nodes. Where a wire's curve has its shape at rest
(rest_curve.py), its sections carry parts c of it: the shares may then be more, and 4 k c^2/I adds to twist. Friction of a
stiffness k_t, which acts at the surface, adds 4 k_t r^2/I. Two coupled ones
w1, w2 make (w1 + w2)/2 + sqrt((w1 - w2)^2/4 + w1 w2 sin^2 p).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..kernels.rod_step import HELD_NODE
from ..numerics import MASS_MARGIN, TURN_ALLOWANCE
from .rest_curve import RestCurve
from .rods import Rods

STEEPEST = 0.5 * math.pi  # [rad] turn from which on nothing couples more
TWIST_SHARE = 0.25  # largest rate of twist over that of motion, in relax: what couples them then stays below the limit


@dataclass(frozen=True)
class Rates:
    """Largest squared frequencies [1/s2], and what all of them make together."""

    stretch: float
    bending: float
    twist: float
    contact: float
    all: float

    @property
    def limited_by(self) -> str:
        """The one that is largest alone."""
        return max(("stretch", "bending", "twist", "contact"), key=lambda name: getattr(self, name))


def largest_rates(
    rods: Rods,
    node_mass: np.ndarray,
    spin_inertia: np.ndarray,
    *,
    stretch_stiffness: float | None = None,
    turning: np.ndarray | float = 0.0,
    tension: float = 0.0,
    contact_stiffness: float = 0.0,
    curve: RestCurve | None = None,
) -> Rates:
    """Bounds on the squared frequencies of rods.

    node_mass [node] [kg], spin_inertia [node] [kg m2]; stretch_stiffness [N]: EA where left out; turning [node] [rad], the
    angle at the nodes; tension [N], the largest; contact_stiffness [N/m]; curve of the wires, Catmull-Rom's where left out.
    """
    k = _stiffnesses(rods, stretch_stiffness, turning, tension, contact_stiffness, curve)
    a, b, t = k.stretch / node_mass, k.bending / node_mass, k.twist / spin_inertia
    both = _coupled(_coupled(a, b, k.coupling), t, k.coupling) + k.beside / node_mass
    free = (rods.held & int(HELD_NODE)) == 0
    return Rates(*(float(np.max(x[free], initial=0.0)) for x in (a, b, t, k.contact / node_mass, both)))


def stable_step(rates: Rates, look_ahead: float = 0.0) -> float:
    """[s] 2/w, less for a look-ahead of so many steps."""
    return 2.0 / math.sqrt(rates.all * (1.0 + 2.0 * look_ahead))


def unit_step_masses(
    rods: Rods,
    *,
    stretch_stiffness: float,
    turning: np.ndarray | float = 0.0,
    tension: float = 0.0,
    contact_stiffness: float = 0.0,
    stick_stiffness: float = 0.0,
    curve: RestCurve | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Node masses [node] [kg] and spin inertias [node] [kg m2] that are stable at a step of 1 s, with a look-ahead of LOOK_AHEAD.

    A quarter of the largest stiffness is the mass that is just stable; turning [node] [rad] is the angle at each node;
    stick_stiffness [N/m] that of friction.
    """
    turning = np.minimum(np.asarray(turning) + TURN_ALLOWANCE, STEEPEST)
    k = _stiffnesses(rods, stretch_stiffness, turning, tension, contact_stiffness, curve, stick_stiffness)
    moved = _coupled(k.stretch, k.bending, k.coupling) + k.beside
    return MASS_MARGIN / 4.0 * moved, MASS_MARGIN / 4.0 / TWIST_SHARE * k.twist


def masses_for_step(
    rods: Rods,
    time_step: float,
    *,
    stretch_stiffness: float,
    turning: np.ndarray | float = 0.0,
    contact_stiffness: float = 0.0,
    curve: RestCurve | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """The least node masses [node] [kg] and spin inertias [node] [kg m2] with which the bound of `largest_rates` allows this step
    [s]. Twist has TWIST_SHARE of the rate of motion, which adds as much to the largest of both at most."""
    k = _stiffnesses(rods, stretch_stiffness, turning, 0.0, contact_stiffness, curve)
    moved = _coupled(k.stretch, k.bending, k.coupling) + k.beside
    both = (1.0 + TWIST_SHARE) * (0.5 * time_step) ** 2
    return both * moved, both / TWIST_SHARE * k.twist


@dataclass(frozen=True)
class _Stiffnesses:
    """[node] mass times squared frequency, as in the formulas on top."""

    stretch: np.ndarray  # [N/m]
    bending: np.ndarray  # [N/m]
    twist: np.ndarray  # [N m]
    contact: np.ndarray  # [N/m]
    beside: np.ndarray  # [N/m] contact and tension, which only add
    coupling: np.ndarray  # sin^2 of the turn


def _stiffnesses(
    rods: Rods,
    stretch_stiffness: float | None,
    turning: np.ndarray | float,
    tension: float,
    contact_stiffness: float,
    curve: RestCurve | None,
    stick_stiffness: float = 0.0,
) -> _Stiffnesses:
    section = rods.section
    own = np.where(rods.following >= 0, rods.natural_length, np.inf)
    h = np.minimum(own, np.where(rods.previous >= 0, own[rods.previous], np.inf))
    turn = np.minimum(np.broadcast_to(turning, h.shape), STEEPEST)
    axial = section.axial_stiffness if stretch_stiffness is None else stretch_stiffness
    bending = 16 * section.bending_stiffness + 0.5 * turn**2 * section.twist_stiffness
    share, lever = (1.0, 0.0) if curve is None else (curve.share, curve.lever)
    contact = np.full(h.shape, 4.0 * contact_stiffness * share)
    touching = 4.0 * (contact_stiffness * lever**2 + stick_stiffness * float(rods.wire_radius.max()) ** 2)
    # an end has half a node's mass, and one segment and one turn pull at it
    half = np.where((rods.following < 0) | (rods.previous < 0), 0.5, 1.0)
    return _Stiffnesses(
        stretch=half * 4 * axial / h,
        bending=half * bending / h**3,
        twist=(4 * section.twist_stiffness + turn**2 * section.bending_stiffness) / h + touching,
        contact=contact,
        beside=half * 4 * max(tension, 0.0) / h + contact,
        coupling=np.sin(turn) ** 2,
    )


def _coupled(one: np.ndarray, other: np.ndarray, sine_square: np.ndarray) -> np.ndarray:
    """Larger eigenvalue of two stiffnesses whose directions have this squared cosine between them."""
    return 0.5 * (one + other) + np.sqrt(0.25 * (one - other) ** 2 + one * other * sine_square)
