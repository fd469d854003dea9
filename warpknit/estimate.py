"""What a run would take: the form in which every kind of model says it, and what is the same for all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from .knit.cloth import Cloth
from .mesh.layout import copies_of_cloth, estimated_nodes
from .scene import Scene

RAMP_SHARE = 1.2  # steps of a ramp over loading time/step at the start: 1.15 and 1.20, the step shrinks with the load
RAMP_BY_TENSION = 2.0  # times that, where the boundary has to find a tension: 1.9 on the cell at 5 mN/m both ways
HOOKED = 0.5  # times the steps of a tile, of two hooked wires with as many nodes as a loop of it has: 0.3 to 1

HOOK_ENDS = "ends: the lower ones are clamped; the upper ones keep their direction, slide up and down, the right one is driven"


@dataclass(frozen=True)
class Size:
    """The sizes of a mesh, and the numbers that a run of it starts with."""

    nodes: int
    wires: int
    bodies: int  # places where wires hook each other
    spacing: float = 0.0  # [m] of the nodes, the least
    near: int = 0  # pairs of segments near each other at rest, where a model follows them
    close: int = 0  # of these, those that nearly touch
    softening: float = 1.0
    time_step: float = 1.0  # [s]
    limited_by: str = "unit step"
    loading_time: float = 0.0  # [s] of a stage of a ramp


@dataclass(frozen=True)
class Cost:
    """What a run takes on this machine's cores, without compilation and files."""

    steps: int
    seconds: float


@dataclass(frozen=True)
class Notes:
    """What a kind of model says of its estimates, in words."""

    factor: float  # by which steps and time may be off
    exception: str  # what takes longer all the same; empty where nothing does
    hooked_by: str  # what the number of bodies counts
    accuracy: str  # what is known of the error of the scene's settings


class Estimates(Protocol):
    """What a kind of model estimates of a scene without running it: a module of each."""

    def size_of(self, scene: Scene, cloth: Cloth | None) -> tuple[Size, bool]:
        """The sizes of a scene's mesh, and whether they are exact: large meshes are not built to be counted. What a run would
        refuse is refused."""

    def cost_of(self, scene: Scene, size: Size) -> Cost:
        """What a run takes."""

    def map_time(self, scene: Scene, size: Size) -> float | None:
        """[s] of the map of a scene with a sweep, where its loads go one after the other."""

    def notes(self, scene: Scene, size: Size) -> Notes:
        """What is known of these estimates, and of the accuracy."""

    def physics(self, scene: Scene, size: Size) -> Iterator[str]:
        """What the scene switches on and why, a sentence each."""

    def limitations(self, scene: Scene, cloth: Cloth | None) -> Iterator[str]:
        """What a run would not show, a sentence each."""


def endless_counts(scene: Scene, cloth: Cloth) -> tuple[int, int, int]:
    """Nodes, wires and bodies of so many repeats of endless cloth: right for a tile, and but for its edges for a gripped mesh."""
    columns, rows = copies_of_cloth(scene)
    return estimated_nodes(scene, cloth), len(cloth.threads) * columns, len(cloth.clasps) * columns * rows


def ramp_steps(scene: Scene, loading_time: float, time_step: float) -> int:
    """Steps of a ramp: the loading time [s] of each stage over the step [s] at its start, and a little more as that shrinks."""
    stages = sum(RAMP_BY_TENSION if any(stage.by_tension) else 1.0 for stage in scene.stages)
    return max(1, round(RAMP_SHARE * stages * loading_time / time_step))


def boundary_physics(scene: Scene) -> Iterator[str]:
    """What holds the mesh, and how it follows the load, a sentence each."""
    if scene.model.boundary == "periodic":
        yield "periodic boundary: one tile of an endless mesh, model.boundary = 'periodic'"
    else:
        yield "grips: every cut wire end is held in position and direction, model.boundary = 'gripped'"
    yield "affine carry: the interior moves with the boundary, so that only what differs from it has to be solved"
