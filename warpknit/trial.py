"""Numerical settings of probe runs and references, for the trade of speed against accuracy."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Protocol

from .scene import Scene

SOFTENING = 1000.0  # axial softening of probe runs


@dataclass(frozen=True)
class Setting:
    """Numerical settings of a probe run."""

    nodes_per_loop: int
    axial_softening: float
    residual_tolerance: float
    precision: str

    @property
    def overrides(self) -> tuple[tuple[str, object], ...]:
        """The settings as keys of a scene."""
        tables = {"nodes_per_loop": "model"}
        return tuple((f"{tables.get(name, 'solver')}.{name}", value) for name, value in asdict(self).items())


class Trials(Protocol):
    """Settings of a kind of model: a module of each."""

    def settings(self, scene: Scene, percent: float) -> list[Setting]:
        """Settings to try, the cheapest first, with a tolerance of at most a tenth of `percent`."""

    def fine(self, scene: Scene) -> Setting:
        """Setting of the fine run of a small mesh, the reference of probe runs."""

    def reference(self, scene: Scene, nodes: int) -> tuple[int, float]:
        """Nodes a loop, or segments of a hooked wire, and tolerance of the reference of a trade; `nodes`: those of the mesh."""


def edge_of(scene: Scene) -> str:
    """periodic | gripped | hook: decides how errors depend on the nodes."""
    return "hook" if scene.hook is not None else scene.model.boundary
