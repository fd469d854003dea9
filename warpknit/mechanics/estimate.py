"""Estimates of a run: their form, and what all kinds of model share."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from ..knit.cloth import Cloth
from ..mesh.layout import copies_of_cloth, estimated_nodes
from ..mesh.smaller import smaller_scene
from ..scene import Scene

RAMP_SHARE = 1.2  # steps of a ramp over loading time/initial step: 1.15 and 1.20 measured, as the step shrinks with the load
RAMP_BY_TENSION = 2.0  # factor for tension control: 1.9 measured on the cell at 5 mN/m in both directions
HOOKED = 0.5  # times the steps of a tile, of two hooked wires with as many nodes as a loop of it has: 0.3 to 1

HOOK_ENDS = "ends: the lower ones are clamped; the upper ones keep their direction, slide up and down, the right one is driven"


@dataclass(frozen=True)
class Size:
    """Sizes of a mesh, and its initial numerics."""

    nodes: int
    wires: int
    bodies: int  # places where wires hook each other
    spacing: float = 0.0  # [m] smallest node spacing
    near: int = 0  # pairs of segments near each other at rest, where a model follows them
    close: int = 0  # of these, pairs that nearly touch
    softening: float = 1.0
    time_step: float = 1.0  # [s]
    limited_by: str = "unit step"
    loading_time: float = 0.0  # [s] of a stage of a ramp
    notes: tuple[str, ...] = ()  # how the mesh was cut, where it was laid out


@dataclass(frozen=True)
class Cost:
    """Cost of a run, without compilation and files."""

    steps: int
    seconds: float  # on this machine's cores
    gpu_seconds: float | None = None  # on GPU_MEASURED; None: not estimated


GPU_MEASURED = "an NVIDIA H100"


@dataclass(frozen=True)
class GpuTimes:
    """Times [s] of a relaxation on GPU_MEASURED beside 16 cores, by docs/studies/performance.md."""

    node: float  # model, start and membrane corrections
    step: float
    node_step: float
    check: float
    node_check: float
    node_record: float
    check_steps: int
    smaller: float  # the smallest mesh of a multilevel start

    def of_run(self, steps: int, nodes: int, records: int, *, is_multilevel: bool) -> float:
        """Of so many steps and records of so many nodes."""
        stepping = steps * (self.step + nodes * self.node_step)
        checking = steps / self.check_steps * (self.check + nodes * self.node_check)
        return nodes * (self.node + records * self.node_record) + stepping + checking + is_multilevel * self.smaller


@dataclass(frozen=True)
class Notes:
    """Remarks on the estimates, in words."""

    factor: float  # uncertainty of steps and time
    exception: str  # known exceptions; may be empty
    hooked_by: str  # meaning of the number of bodies
    accuracy: str  # expected error of the settings of the scene


class Estimates(Protocol):
    """Estimates of a kind of model: a module of each."""

    def size_of(self, scene: Scene, cloth: Cloth | None) -> tuple[Size, bool]:
        """Sizes of the mesh of a scene, and whether they are exact (large meshes are not built). Raises the errors of a run."""

    def cost_of(self, scene: Scene, size: Size) -> Cost:
        """Cost of a run."""

    def map_time(self, scene: Scene, size: Size, levels: Sequence[int]) -> float:
        """Time [s] of loads of a map with so many levels each, on all cores."""

    def notes(self, scene: Scene, size: Size) -> Notes:
        """Remarks on estimates and accuracy."""

    def physics(self, scene: Scene, size: Size) -> Iterator[str]:
        """Physics that the scene switches on and why, one sentence each."""

    def overlaps_as_knitted(self, scene: Scene, repeat: Cloth) -> Iterator[str]:
        """Warning where wires of a repeat overlap as knitted, so that a run begins with forces in the contacts."""

    def limitations(self, scene: Scene, cloth: Cloth | None) -> Iterator[str]:
        """Limitations of the model for this scene, one sentence each."""


def endless_counts(scene: Scene, cloth: Cloth) -> tuple[int, int, int]:
    """Nodes, wires and bodies of endless cloth: exact for a tile, approximate for a gripped mesh."""
    columns, rows = copies_of_cloth(scene)
    return estimated_nodes(scene, cloth), len(cloth.threads) * columns, len(cloth.clasps) * columns * rows


def ramp_steps(scene: Scene, loading_time: float, time_step: float) -> int:
    """Steps of a ramp from loading time [s] and initial step [s], which shrinks with the load."""
    stages = sum(RAMP_BY_TENSION if any(stage.by_tension) else 1.0 for stage in scene.stages)
    return max(1, round(RAMP_SHARE * stages * loading_time / time_step))


def gpu_time(times: GpuTimes, scene: Scene, steps: int, nodes: int) -> float:
    """Time [s] of a relaxation on GPU_MEASURED."""
    records = 1 + scene.output.frames * len(scene.stages)
    return times.of_run(steps, nodes, records, is_multilevel=smaller_scene(scene) is not None)


def multilevel_start(smaller: Scene | None) -> Iterator[str]:
    """The start from a smaller mesh, if there is one, in a sentence."""
    if smaller is not None:
        repeats = " x ".join(map(str, smaller.knit.repeats))
        yield f"multilevel start: from the equilibrium of a smaller mesh of {repeats} repeats, recursively"


def levels_of_pairs(pairs: Sequence[tuple[float, float]], levels: int) -> list[int]:
    """[pair] load levels of pairs of strains in a map, so many to the largest strain: increments of one size for all."""
    largest = max((abs(strain) for pair in pairs for strain in pair), default=0.0) or 1.0
    return [max(1, math.ceil(max(map(abs, pair)) / largest * levels - 1e-9)) for pair in pairs]


def boundary_physics(scene: Scene) -> Iterator[str]:
    """The boundary conditions, one sentence each."""
    if scene.model.boundary == "periodic":
        yield "periodic boundary: one tile of an endless mesh, model.boundary = 'periodic'"
    else:
        yield "grips: every cut wire end is held in position and direction, model.boundary = 'gripped'"
    yield "affine prediction: the interior moves with the boundary; only the deviation is solved"
