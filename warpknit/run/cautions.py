"""What to know about a result because of what was asked for: constants that no wire has, loads too fast, few nodes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ..measure import MeshModel
from ..scene import Scene
from ..scene.materials import MATERIALS
from .history import Row

METAL_STIFFNESS = (10e9, 600e9)  # [Pa] Young's modulus, from lead to osmium
METAL_DENSITY = (500.0, 23e3)  # [kg/m3] from lithium to osmium
CONSTANTS_HOLD = (70.0, 600.0)  # [K] where moduli are within a few percent of those at 20 degC
QUASI_STATIC = 0.1  # kinetic over stored energy that a ramp may have on its way
FEWEST_NODES = 12  # a loop: with 8 the tension of the double atlas cell is 9 % off, with 12 it is 1 %
STEADY_FRICTION = 0.1  # coefficient up to which it does not matter how far steady states on a path are apart
CONVERGED_STEP = 0.0003125  # of strain between them, from which on it does not matter either


def cautions(model: MeshModel, rows: list[Row]) -> Iterator[str]:
    """A line each."""
    scene = model.scene
    yield from _about_constants(scene)
    nodes = scene.model.nodes_per_loop
    if scene.hook is None and nodes < FEWEST_NODES:
        yield f"{nodes} nodes a loop are few: tensions and contact forces may be off by more than 10 %"
    if scene.solver.drive == "ramp" and rows:
        yield from _about_ramp(rows)
    if scene.solver.drive == "relax" and scene.contact.friction > STEADY_FRICTION:
        yield from _about_friction(scene)


def _about_constants(scene: Scene) -> Iterator[str]:
    wire = scene.wire
    for name, value, unit, (low, high) in (
        ("youngs_modulus", wire.youngs_modulus, "Pa", METAL_STIFFNESS),
        ("density", wire.density, "kg/m^3", METAL_DENSITY),
    ):
        if not low <= value <= high:
            yield f"wire.{name} = {value:.3g} {unit} is that of no metal ({low:.3g} to {high:.3g} {unit})"
    temperatures = [wire.reference_temperature, *(stage.temperature for stage in scene.stages)]
    hottest, melting = max(temperatures), MATERIALS[wire.material].melting if wire.material in MATERIALS else float("inf")
    if hottest > melting:
        yield f"{wire.material} melts at {melting:.0f} K: at {hottest:.4g} K there is no mesh"
    for temperature in (min(temperatures), hottest):
        if not CONSTANTS_HOLD[0] <= temperature <= CONSTANTS_HOLD[1]:
            yield (
                f"at {temperature:.4g} K stiffness, expansion and strength of the wire are not those at 20 degC, which the result"
                " is for: give wire.youngs_modulus, wire.expansion, wire.yield_stress"
            )


def _about_friction(scene: Scene) -> Iterator[str]:
    strains = [np.zeros(2), *(np.array([stage.strain_weft or 0.0, stage.strain_warp or 0.0]) for stage in scene.stages)]
    furthest = max(float(np.abs(after - before).max()) for before, after in pairwise(strains))
    if furthest > CONVERGED_STEP * scene.output.frames * (1.0 + 1e-6):
        frames = math.ceil(furthest / CONVERGED_STEP - 1e-6)
        yield (
            f"with a friction of {scene.contact.friction:g} the tension depends on how far the steady states of the path are"
            f" apart, by up to some 5 % where contacts close: output.frames = {frames} brings them near enough"
        )


def _about_ramp(rows: list[Row]) -> Iterator[str]:
    moving = max((row.energy_kinetic_J / row.stored for row in rows if row.load_factor > 0.1 and row.stored > 0.0), default=0.0)
    if not rows[-1].steady and rows[-1].load_factor == 1.0:
        yield (
            f"the ramp is not at rest at its end (residual {rows[-1].residual:.2g}), so this is no static result:"
            " raise solver.loading_time or solver.damping"
        )
    if moving > QUASI_STATIC:
        yield (
            f"the load comes on so fast that the kinetic energy reached {moving:.2g} of what was stored: raise"
            " solver.loading_time for a quasi-static path"
        )
