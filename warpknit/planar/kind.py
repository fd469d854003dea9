"""The planar model by the names that every kind of model has (solve/model.py).

Its parts, its description for `warpknit plan`, and the settings of its probe runs (mechanics/probe_settings.py).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

from ..base.text import engineering, rounded
from ..knit.cloth import Cloth
from ..mechanics.probe_settings import SOFTENING, Setting, Varied, edge_of
from ..scene import Scene
from .mechanics import PlanarWorlds as worlds
from .model import Model, build_model
from .model import tight_loops as limitations
from .state import initial_state

__all__ = ["build_model", "initial_state", "limitations", "worlds"]  # other modules' parts of it

NODES = (10, 12, 14, 16, 18, 20, 24, 30, 40)  # a loop
HOOK_NODES = (16, 24, 32, 48, 64, 96)  # a wire
FINE = {"periodic": 48, "gripped": 34, "hook": 128}  # nodes of the fine run, a loop or a wire
TOLERANCE = 1e-4  # of fine runs and references
# nodes a loop of the reference of a trade, up to these numbers of nodes of the scene
REFERENCE = ((2_000, 96), (float("inf"), 54))
HOOK_REFERENCE = 192  # segments a wire of the same, where two wires are hooked

VARIED_NODES = (8, 10, 12, 14, 16, 18, 20, 24, 30, 40, 54)  # of a trade, a loop
VARIED_HOOK_NODES = (64, 96, 128)  # beside these, segments of a hooked wire
VARIED_SOFTENINGS = (16.0, 64.0, 200.0, 400.0, 700.0, 1000.0, 2000.0)
VARIED_TOLERANCES = (0.1, 0.03, 0.01, 0.003, 0.001)
RAMP_NODES = (12, 16, 40)  # a loop
COMBINED = ((8, 10, 12, 14, 16, 18, 20, 24, 30, 40), (700.0, 2000.0), (0.03, 0.01, 0.003))  # nodes, softenings, tolerances


def settings(scene: Scene, percent: float) -> list[Setting]:
    """Settings to try, the cheapest first; tolerance at most a tenth of `percent`."""
    if scene.hook is not None:
        tolerance = min(1e-2, max(1e-4, percent / 1000.0))
        return [Setting(n, 64.0, tolerance, "double") for n in HOOK_NODES]
    tolerance = min(1e-2, max(1e-3, percent / 1000.0))
    return [Setting(n, SOFTENING, tolerance, "single") for n in NODES]


def fine(scene: Scene) -> Setting:
    """Setting of the fine run of a small mesh, the reference of probe runs."""
    return Setting(FINE[edge_of(scene)], 64.0 if scene.hook is not None else 300.0, TOLERANCE, "double")


def varied(scene: Scene, softening: float) -> Varied:
    """Values that a trade tries."""
    is_hook = scene.hook is not None
    nodes = VARIED_NODES + (VARIED_HOOK_NODES if is_hook else ())
    combined = tuple(Setting(*each, "double" if is_hook else "single") for each in product(*COMBINED))
    return Varied(nodes, VARIED_SOFTENINGS, VARIED_TOLERANCES, RAMP_NODES, combined)


def accuracy(scene: Scene) -> str:
    """Expected error of the settings of the scene."""
    preset = scene.preset_measured
    if preset is None:
        return "accuracy unknown for these settings; run --error PERCENT chooses settings for an error"
    grips = "; larger for short wires between grips" if scene.model.boundary == "gripped" and scene.hook is None else ""
    return (
        f"{scene.preset_error_text}{grips};"
        f" {rounded(preset.node_steps):,} node-steps a load level on this tile; run --error PERCENT measures it on this scene"
    )


def physics(model: Model, bodies: int) -> Iterator[str]:
    """Physics of a mesh with `bodies` bodies, one sentence each."""
    scene, wire = model.scene, model.scene.wire
    yield f"stretching: wires carry tension, EA = {engineering(wire.axial_stiffness, 'N')}"
    yield f"bending: wires resist a change of curvature, EI = {engineering(1e6 * wire.bending_stiffness, 'N mm2')}"
    if scene.hook is not None:
        yield f"contact: one place, contact.treatment = {scene.contact.treatment!r}"
    elif bodies:
        merged = "nested lenses merged" if scene.model.merge_lenses else "one for each lens, model.merge_lenses = false"
        yield f"contact: {bodies:,} clasps, each with a body between its two wires ({merged})"
    if model.softening != 1.0:
        yield f"softening: axial stiffness divided by {model.softening:g} in the dynamics, solver.axial_softening"
    if scene.solver.drive == "relax" and scene.solver.multipliers:
        yield "augmented Lagrangian: multipliers correct the errors of softening and contact penalty, solver.multipliers"


def overlaps_as_knitted(scene: Scene, repeat: Cloth) -> Iterator[str]:
    """Warning where bodies of a repeat have no room as knitted. Merged lenses do not count: their bodies may move aside."""
    reach = 0.5 * scene.wire.thickness + scene.model.body_radius
    narrow = [clasp for clasp in repeat.clasps if clasp.lenses == 1 and sum(arm.clearance for arm in clasp.arms) < 2.0 * reach]
    if narrow:
        of_all = f"{2 * len(narrow)} of {2 * len(repeat.clasps)} pairs of a repeat"
        yield f"At least {of_all} are active as knitted."
