"""Settings of trial runs of the spatial model (trial.py)."""

from __future__ import annotations

from ..mechanics.trial import SOFTENING, Setting, Varied, combined, edge_of
from ..scene import Scene

NODES = (20, 24, 28, 36)  # a loop
FINE = {"periodic": 64, "gripped": 56, "hook": 68}  # nodes of the fine run, a loop, or segments of a wire
TOLERANCE = 1e-3  # of fine runs and references, about fifty times slower than in the plane
REFERENCE = ((2_000, 96), (float("inf"), 64))  # nodes a loop of the reference of a trade, up to so many nodes of the scene
HOOK_REFERENCE = 68  # segments a wire of the same of a hook, whose lens is a tenth of a wire long

VARIED_NODES = (16, 20, 24, 28, 32, 36, 40, 48)  # of a trade, a loop or a hooked wire
VARIED_SOFTENINGS = (0.5, 0.25, 0.0625)  # times what the model takes
VARIED_TOLERANCES = (0.03, 0.01, 0.003, 0.001)
RAMP_NODES = (40, 48, 80)  # a loop
COMBINED = ((20, 24, 28, 32, 36, 40, 48), (0.01, 0.003, 0.001))  # nodes, tolerances


def settings(scene: Scene, percent: float) -> list[Setting]:
    """Settings to try, the cheapest first; the tolerance contributes at most a tenth of `percent`."""
    tolerance = min(1e-2, max(2.0 * TOLERANCE, percent / 1000.0))
    return [Setting(n, SOFTENING, tolerance, "double") for n in NODES]


def fine(scene: Scene) -> Setting:
    """Setting of the fine run of a small mesh, taken as exact."""
    return Setting(FINE[edge_of(scene)], SOFTENING, TOLERANCE, "double")


def reference(scene: Scene, nodes: int) -> tuple[int, float]:
    """Nodes a loop, or segments of a hooked wire, and tolerance of the reference of a trade."""
    finest = HOOK_REFERENCE if scene.hook is not None else next(n for most, n in REFERENCE if nodes <= most)
    return finest, TOLERANCE


def varied(scene: Scene, softening: float) -> Varied:
    """Values that a trade tries."""
    softenings = tuple(share * softening for share in VARIED_SOFTENINGS)
    nodes, tolerances = COMBINED
    together = combined(nodes, (scene.solver.axial_softening,), tolerances, scene.solver.precision)
    return Varied(VARIED_NODES, softenings, VARIED_TOLERANCES, RAMP_NODES, together)
