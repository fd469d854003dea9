"""Settings of probe runs of the planar model (mechanics/probe_settings.py)."""

from __future__ import annotations

from ..mechanics.probe_settings import SOFTENING, Setting, Varied, combined, edge_of
from ..scene import Scene

NODES = (10, 12, 14, 16, 18, 20, 24, 30, 40)  # a loop
HOOK_NODES = (16, 24, 32, 48, 64, 96)  # a wire
FINE = {"periodic": 48, "gripped": 34, "hook": 128}  # nodes of the fine run, a loop or a wire
TOLERANCE = 1e-4  # of fine runs and references
REFERENCE = (
    (2_000, 96),
    (float("inf"), 54),
)  # nodes a loop of the reference of a trade, up to these numbers of nodes of the scene
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


def reference(scene: Scene, nodes: int) -> tuple[int, float]:
    """Nodes a loop (or segments of a hooked wire) and tolerance of a trade's reference."""
    finest = HOOK_REFERENCE if scene.hook is not None else next(n for most, n in REFERENCE if nodes <= most)
    return finest, TOLERANCE


def varied(scene: Scene, softening: float) -> Varied:
    """Values that a trade tries."""
    is_hook = scene.hook is not None
    nodes = VARIED_NODES + (VARIED_HOOK_NODES if is_hook else ())
    together = combined(*COMBINED, "double" if is_hook else "single")
    return Varied(nodes, VARIED_SOFTENINGS, VARIED_TOLERANCES, RAMP_NODES, together)
