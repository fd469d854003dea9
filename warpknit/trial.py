"""Numerics that speed and accuracy are traded by: settings of trial runs, and the references that they are held against."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Protocol

from .scene import Scene

SOFTENING = 1000.0  # of settings that are tried


@dataclass(frozen=True)
class Setting:
    """Numerics that a small mesh is run with."""

    nodes_per_loop: int
    axial_softening: float
    residual_tolerance: float
    precision: str

    @property
    def overrides(self) -> tuple[tuple[str, object], ...]:
        """The same as keys of a scene."""
        tables = {"nodes_per_loop": "model"}
        return tuple((f"{tables.get(name, 'solver')}.{name}", value) for name, value in asdict(self).items())


class Trials(Protocol):
    """What a kind of model is tried at: a module of each."""

    def settings(self, scene: Scene, percent: float) -> list[Setting]:
        """Settings to try, the cheapest first; the tolerance leaves a tenth of `percent` or less."""

    def fine(self, scene: Scene) -> Setting:
        """Of the fine run of a small mesh, which counts as true."""

    def reference(self, scene: Scene, nodes: int) -> tuple[int, float]:
        """Nodes a loop, or segments of a hooked wire, and tolerance of the reference of a trade; `nodes` of the mesh."""


def edge_of(scene: Scene) -> str:
    """periodic | gripped | hook: what decides how errors go with the nodes."""
    return "hook" if scene.hook is not None else scene.model.boundary
