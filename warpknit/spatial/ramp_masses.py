"""Masses, time step, loading time and damping of a ramp in space.

Masses are those of the wire times `mass_scaling`, raised node by node until `target_time_step` is stable. The rotary inertia of a
wire is so small that twist would limit the step: it is raised until the squared frequency of twist is a quarter of the largest
one of translation. Torsional waves remain far faster than bending waves, and the load is slow compared with these.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..mechanics.numerics import LOADING_PERIODS, STEP_MARGIN, slowest_rate
from ..scene import Scene
from .rest_curve import RestCurve
from .rods import Rods
from .step_bound import Rates, largest_rates, masses_for_step, stable_step


@dataclass(frozen=True)
class RampNumerics:
    """Initial masses, step and damping of a ramp."""

    node_mass: np.ndarray  # [node] [kg]
    spin_inertia: np.ndarray  # [node] [kg m2] of the segments
    added_mass: float
    time_step: float  # [s] of the unloaded mesh
    rates: Rates
    loading_time: float  # [s] of a stage
    damping: float  # [1/s]


def ramp_numerics(
    scene: Scene, rods: Rods, curve: RestCurve, *, softening: float, contact_stiffness: float, loop_length: float
) -> RampNumerics:
    """Numerics of a ramp for rods as knitted; contact_stiffness [N/m], loop_length [m] of wire."""
    solver = scene.solver
    stiff: dict[str, Any] = {
        "stretch_stiffness": rods.section.axial_stiffness / softening,
        "turning": rods.widest_turn(rods.rest_turning),
        "contact_stiffness": contact_stiffness,
        "curve": curve,
    }
    true_mass = rods.section.linear_density * rods.node_length
    mass = true_mass * solver.mass_scaling
    spin = rods.section.rotary_inertia * rods.natural_length * solver.mass_scaling
    if solver.target_time_step is not None:
        mass = np.maximum(mass, masses_for_step(rods, solver.target_time_step / STEP_MARGIN, **stiff)[0])
    spinless = largest_rates(rods, mass, np.full(len(spin), np.inf), **stiff)
    spin = np.maximum(spin, masses_for_step(rods, stable_step(spinless), **stiff)[1])
    rates = largest_rates(rods, mass, spin, **stiff)
    slowest = slowest_rate(scene, loop_length)
    return RampNumerics(
        node_mass=mass,
        spin_inertia=spin,
        added_mass=float(mass.sum() / true_mass.sum() - 1.0),
        time_step=STEP_MARGIN * stable_step(rates),
        rates=rates,
        loading_time=solver.loading_time or LOADING_PERIODS * 2.0 * math.pi / slowest,
        damping=slowest if solver.damping is None else solver.damping,
    )
