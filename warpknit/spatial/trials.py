"""Settings of trial runs of the spatial model (trial.py)."""

from __future__ import annotations

from ..scene import Scene
from ..trial import SOFTENING, Setting, edge_of

NODES = (20, 24, 28, 36)  # a loop
FINE = {"periodic": 64, "gripped": 56, "hook": 68}  # nodes of the fine run, a loop, or segments of a wire
TOLERANCE = 1e-3  # of fine runs and references, about fifty times slower than in the plane
REFERENCE = 64  # nodes a loop of the reference of a trade
HOOK_REFERENCE = 68  # segments a wire of the same of a hook, whose lens is a tenth of a wire long


def settings(scene: Scene, percent: float) -> list[Setting]:
    """Settings to try, the cheapest first; the tolerance contributes at most a tenth of `percent`."""
    tolerance = min(1e-2, max(2.0 * TOLERANCE, percent / 1000.0))
    return [Setting(n, SOFTENING, tolerance, "double") for n in NODES]


def fine(scene: Scene) -> Setting:
    """Setting of the fine run of a small mesh, taken as exact."""
    return Setting(FINE[edge_of(scene)], SOFTENING, TOLERANCE, "double")


def reference(scene: Scene, nodes: int) -> tuple[int, float]:
    """Nodes a loop, or segments of a hooked wire, and tolerance of the reference of a trade."""
    return HOOK_REFERENCE if scene.hook is not None else REFERENCE, TOLERANCE
