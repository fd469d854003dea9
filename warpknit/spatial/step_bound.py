"""Bounds on the stable step of rods; masses for a time step, and of a ramp. Masses are diagonal.

A straight uniform chain of segments h with node mass m and spin inertia I has the largest squared frequencies

    a = 4 EA/(h m)      b = 16 B/(h^3 m)      t = 4 GJ/(h I)

of stretch, bending and twist, with B = 19/9 EI by the slopes of moments (kernels/rod_forces.py). A turning angle p [rad] at the
nodes couples them. It adds p^2 B/(h I) to twist, because a rotated
section bends against its natural curvature, and p^2 GJ/(2 h^3 m) to bending, because the transverse motion of a node rotates the
frames. Tension adds 4 T/(h m). Contact of penalty k adds at most 4 k/m: its force acts on four nodes of either wire, with weights
whose squares sum to one at most, and two contacts may act on the same nodes. With a rest-shape correction (rest_curve.py) a part
c of the curve rotates with the sections: the weights may be larger, and 4 k c^2/I adds to twist. Two coupled squared frequencies
w1, w2 give (w1 + w2)/2 + sqrt((w1 - w2)^2/4 + w1 w2 sin^2 p).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..kernels.bend import SLOPE_SHARE
from ..mechanics.numerics import LOADING_PERIODS, STEP_MARGIN, slowest_rate
from .rest_curve import RestCurve
from .rods import Rods

SLOPE_FACTOR = 1.0 + 4.0 * SLOPE_SHARE + (4.0 * SLOPE_SHARE) ** 2  # 19/9: of the slopes of moments, for the shortest waves
MAX_TURN = 0.5 * math.pi  # [rad] turning angle of the largest coupling
TWIST_SHARE = 0.25  # largest squared frequency of twist over translation: keeps the coupled one below the limit


TERMS = ("stretch", "bending", "twist", "contact")


def largest_rates(rods: Rods, node_mass: np.ndarray, spin_inertia: np.ndarray, **stiff: Any) -> dict[str, float]:
    """Bounds on the squared frequencies [1/s2] of rods.

    Of each of TERMS and of "all" together. node_mass [node] [kg], spin_inertia [node] [kg m2], and see `_stiffnesses`.
    """
    stretch, bending, twist, contact, additive, coupling = _stiffnesses(rods, **stiff)
    a, b, t = stretch / node_mass, bending / node_mass, twist / spin_inertia
    scaled = _coupled(_coupled(a, b, coupling), t, coupling) + additive / node_mass
    squares = (a, b, t, contact / node_mass, scaled)
    return {name: float(np.max(x[rods.is_free], initial=0.0)) for name, x in zip((*TERMS, "all"), squares, strict=True)}


def stable_step(rates: dict[str, float]) -> float:
    """[s] stable step 2/w."""
    return 2.0 / math.sqrt(rates["all"])


def masses_for_step(rods: Rods, time_step: float, **stiff: Any) -> tuple[np.ndarray, np.ndarray]:
    """Smallest stable node masses [node] [kg] and spin inertias [node] [kg m2]. At a time step [s], by `largest_rates`.

    Twist has TWIST_SHARE of the squared frequency of translation, and adds at most as much to the coupled one.
    """
    stretch, bending, twist, _, additive, coupling = _stiffnesses(rods, **stiff)
    translation = _coupled(stretch, bending, coupling) + additive
    scaled = (1.0 + TWIST_SHARE) * (0.5 * time_step) ** 2
    return scaled * translation, scaled / TWIST_SHARE * twist


def _stiffnesses(
    rods: Rods,
    *,
    stretch_stiffness: float | None = None,
    turning: np.ndarray | float = 0.0,
    tension: float = 0.0,
    contact_stiffness: float = 0.0,
    curve: RestCurve | None = None,
) -> tuple[np.ndarray, ...]:
    """Mass times squared frequency [node] of stretch, bending [N/m], twist [N m] and contact [N/m], by the formulas above.

    Also the share of contact and tension in all modes [N/m], and sin^2 of the turn.

    stretch_stiffness [N]: EA where left out; turning [node] [rad], the angle at the nodes; tension [N], the largest;
    contact_stiffness [N/m]; curve of the wires, Catmull-Rom's where left out.
    """
    section = rods.section
    own = np.where(rods.following >= 0, rods.natural_length, np.inf)
    h = np.minimum(own, np.where(rods.previous >= 0, own[rods.previous], np.inf))
    turn = np.minimum(np.broadcast_to(turning, h.shape), MAX_TURN)
    axial = section.axial_stiffness if stretch_stiffness is None else stretch_stiffness
    bending = 16 * SLOPE_FACTOR * section.bending_stiffness + 0.5 * turn**2 * section.twist_stiffness
    share, lever = (1.0, 0.0) if curve is None else (curve.weight_square, curve.lever)
    contact = np.full(h.shape, 4.0 * contact_stiffness * share)
    surface = 4.0 * contact_stiffness * lever**2
    # an end node has half the mass, and one segment and one turn act on it
    half = np.where((rods.following < 0) | (rods.previous < 0), 0.5, 1.0)
    twist = (4 * section.twist_stiffness + turn**2 * SLOPE_FACTOR * section.bending_stiffness) / h + surface
    additive = half * 4 * max(tension, 0.0) / h + contact
    return half * 4 * axial / h, half * bending / h**3, twist, contact, additive, np.sin(turn) ** 2


def _coupled(one: np.ndarray, other: np.ndarray, sine_square: np.ndarray) -> np.ndarray:
    """Larger eigenvalue of two stiffnesses whose directions have this squared cosine between them."""
    return 0.5 * (one + other) + np.sqrt(0.25 * (one - other) ** 2 + one * other * sine_square)


@dataclass(frozen=True)
class RampNumerics:
    """Initial masses of a ramp, and its damping."""

    node_mass: np.ndarray  # [node] [kg]
    spin_inertia: np.ndarray  # [node] [kg m2] of the segments
    rates: dict[str, float]
    damping: float  # [1/s]


def ramp_numerics(model: Any) -> dict[str, Any]:
    """Fields of a `SpatialModel` for a ramp of its rods as knitted.

    Masses are the wire's times `mass_scaling`, raised node by node until `target_time_step` is stable. The rotary inertia of a
    wire is so small that twist would limit the step: it is raised until the squared frequency of twist is a quarter of the
    largest one of translation. Torsional waves remain far faster than bending waves, and the load is slow compared with both.
    """
    rods, solver = model.rods, model.scene.solver
    stiff: dict[str, Any] = {
        "stretch_stiffness": rods.section.axial_stiffness / model.softening,
        "turning": rods.widest_turn(rods.rest_turning),
        "contact_stiffness": model.contact_stiffness,
        "curve": model.curve,
    }
    true_mass = rods.section.linear_density * rods.node_length
    mass = true_mass * solver.mass_scaling
    spin = rods.section.rotary_inertia * rods.natural_length * solver.mass_scaling
    if solver.target_time_step is not None:
        mass = np.maximum(mass, masses_for_step(rods, solver.target_time_step / STEP_MARGIN, **stiff)[0])
    spinless = largest_rates(rods, mass, np.full(len(spin), np.inf), **stiff)
    spin = np.maximum(spin, masses_for_step(rods, stable_step(spinless), **stiff)[1])
    rates = largest_rates(rods, mass, spin, **stiff)
    slowest = slowest_rate(model.scene, model.loop_length)
    return {
        "time_step": STEP_MARGIN * stable_step(rates),
        "limited_by": max(TERMS, key=lambda name: rates[name]),
        "loading_time": solver.loading_time or LOADING_PERIODS * 2.0 * math.pi / slowest,
        "added_mass": float(mass.sum() / true_mass.sum() - 1.0),
        "ramp": RampNumerics(mass, spin, rates, slowest if solver.damping is None else solver.damping),
    }
