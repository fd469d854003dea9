"""The spatial model, by the names that both kinds of model have (solve/model.py).

Its parts, its description for `warpknit plan`, and the settings of its probe runs (mechanics/probe_settings.py).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np

from ..base.text import counted, engineering, rounded, short_percent
from ..knit.cloth import Cloth
from ..knit.lapping import KnitError
from ..mechanics.probe_settings import SOFTENING, Setting, Varied, edge_of
from ..scene import Scene
from ..wires.centre_lines import Wires
from ..wires.overlaps import CLOSEST, find_overlaps
from .convergence import parting_text
from .model import SpatialModel, build_model, initial_state
from .worlds import SpatialWorlds as worlds

__all__ = ["build_model", "initial_state", "worlds"]  # other modules' parts of it

NODES = (20, 24, 28, 36)  # a loop
FINE = {"periodic": 64, "gripped": 56, "hook": 68}  # nodes of the fine run, a loop, or segments of a wire
TOLERANCE = 1e-3  # of fine runs and references, about fifty times slower than planar ones
# nodes a loop of the reference of a trade, up to these numbers of nodes of the scene
REFERENCE = ((2_000, 96), (float("inf"), 64))
HOOK_REFERENCE = 68  # segments a wire of the same of a hook, whose lens is a tenth of a wire long

VARIED_NODES = (16, 20, 24, 28, 32, 36, 40, 48)  # of a trade, a loop or a hooked wire
VARIED_SOFTENINGS = (0.5, 0.25, 0.0625)  # times what the model takes
VARIED_TOLERANCES = (0.03, 0.01, 0.003, 0.001)
RAMP_NODES = (40, 48, 80)  # a loop
COMBINED = ((20, 24, 28, 32, 36, 40, 48), (0.01, 0.003, 0.001))  # nodes, tolerances

# --- the model in words


def accuracy(scene: Scene) -> str:
    """Expected error of the settings of the scene."""
    if scene.hook is not None or scene.wires is not None:
        return "accuracy not measured on such wires; compare two values of model.nodes_per_loop"
    if (preset := scene.preset_measured) is not None:
        more = f"; {scene.preset_caveat}" if scene.preset_caveat else ""
        return (
            f"{scene.preset_error_text}{more};"
            f" {rounded(preset.node_steps):,} node-steps a load level on this tile; run --error PERCENT measures it on this scene"
        )
    return (
        f"{scene.model.nodes_per_loop} nodes a loop; on the double atlas tile 20 to 32 nodes miss up to 2.1 % of tension, 48"
        " miss 0.1 %; run --error PERCENT measures it on this scene"
    )


def physics(model: SpatialModel, bodies: int) -> Iterator[str]:
    """Physics of a mesh with `bodies` hooks, one sentence each."""
    scene, wire = model.scene, model.scene.wire
    yield f"stretching: wires carry tension, EA = {engineering(wire.axial_stiffness, 'N')}"
    yield f"bending: wires resist a change of curvature, EI = {engineering(1e6 * wire.bending_stiffness, 'N mm2')}"
    yield f"twist: wires resist being twisted, GJ = {engineering(1e6 * wire.twist_stiffness, 'N mm2')}"
    hooks = "two wires hook once, over and under each other"
    places = hooks if scene.hook is not None else f"shares of active contacts refer to {bodies:,} clasps"
    yield f"contact: round wires touch each other anywhere; {places}"
    corrected = "; multipliers correct its error" if scene.solver.drive == "relax" else ""
    yield f"softening: axial stiffness is reduced in the dynamics{corrected}, solver.axial_softening"


def overlaps_as_knitted(scene: Scene, repeat: Cloth) -> Iterator[str]:
    """Warning where wires of a repeat overlap as knitted. Raises `KnitError` where their centre lines intersect."""
    threads = tuple(thread.points for thread in repeat.threads)
    kinds, along_warp = ("periodic",) * len(threads), np.tile([0, 1], (len(threads), 1))
    found = find_overlaps(Wires(threads, kinds, along_warp, repeat.size, None, None), scene.wire.thickness)
    if found.closest is not None and found.places:
        places = counted(found.places, "place")
        if found.closest < CLOSEST * scene.wire.thickness:
            raise KnitError("knit", "centre lines of wires intersect as knitted", parting_text(scene))
        depth = short_percent(1.0 - found.closest / scene.wire.thickness)
        yield f"As knitted, wires overlap in {places} of a repeat, by up to {depth} of their thickness."


def limitations(_scene: Scene, _cloth: Cloth) -> tuple[str, ...]:
    """Limits of the model: none."""
    return ()


# --- settings of probe runs


def settings(scene: Scene, percent: float) -> list[Setting]:
    """Settings to try, the cheapest first; the tolerance contributes at most a tenth of `percent`."""
    tolerance = min(1e-2, max(2.0 * TOLERANCE, percent / 1000.0))
    return [Setting(n, SOFTENING, tolerance, "double") for n in NODES]


def fine(scene: Scene) -> Setting:
    """Setting of the fine run of a small mesh, taken as exact."""
    return Setting(FINE[edge_of(scene)], SOFTENING, TOLERANCE, "double")


def varied(scene: Scene, softening: float) -> Varied:
    """Values that a trade tries."""
    softenings = tuple(share * softening for share in VARIED_SOFTENINGS)
    solver = scene.solver
    combined = tuple(Setting(nodes, solver.axial_softening, least, solver.precision) for nodes, least in product(*COMBINED))
    return Varied(VARIED_NODES, softenings, VARIED_TOLERANCES, RAMP_NODES, combined)
