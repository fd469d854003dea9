"""A mesh on the way along its load: a run whose stages are given one after the other, and that returns to states it has passed.

    path = LoadPath(mesh_of(scene))
    records = list(path.load(under_strain(scene, np.diag([1.1, 1.1])), levels=20))
    beside = LoadPath(path.model, path.state)                         # goes on from there, as often as wanted

Each equilibrium starts from the one before it. States that lie on one path belong together: where a mesh has several equilibria
under one load, as tight knits have, those found from the mesh as knitted each by itself may not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..measure.table import Record
from ..scene import Scene, Stage
from ..solve.progress import Progress
from ..solve.simulate import Simulation


@dataclass(frozen=True)
class PathState:
    """A state at the end of a stage of a path; the default is the mesh as knitted."""

    stages: tuple[Stage, ...] = ()
    kept: dict[str, np.ndarray] = field(default_factory=dict)  # snapshot of the drive


AS_KNITTED = PathState()


class LoadPath:
    """A load path from the mesh as knitted, or from another path's state."""

    def __init__(self, model: Any, state: PathState = AS_KNITTED) -> None:
        """The models of two paths may differ in their solver's tolerance."""
        self.model, self.state = model, state

    def load(self, stage: Stage, levels: int | str, monitor: Callable[[float], None] = lambda _: None) -> Iterator[Record]:
        """Records of a load step; the path moves to its end. The first begins as knitted.

        `monitor` is called with the load factor at every convergence check. Raises `Diverged`; `state` is that before the stage.
        """
        model = _onwards(self.model, self.state, stage, levels)
        simulation = Simulation(
            model,
            progress=Progress() if self.state.kept else None,
            monitor=lambda progress: monitor(progress.load_factor),
        )
        if self.state.kept:
            simulation.drive.restore(self.state.kept)
        else:
            simulation.compile()
        yield from simulation.run()
        self.state = PathState(model.scene.stages, simulation.drive.snapshot())

    def to(self, stage: Stage) -> Record:
        """The record at the end of a stage in one level. Raises `Diverged`."""
        *_, record = self.load(stage, levels=1)
        return record


def ends_beside(models: Sequence[Any], states: Sequence[PathState], stages: Sequence[Stage]) -> list[Record]:
    """Records at the ends of load steps, side by side. Each is one level from its state. Raises the first `Diverged`."""
    onwards = [_onwards(*one, levels=1) for one in zip(models, states, stages, strict=True)]
    simulation = Simulation(onwards[0], worlds=onwards, progress=[Progress() for _ in onwards])
    for drive, state in zip(simulation.drives, states, strict=True):
        drive.restore(state.kept)
    last = {record.world: record for record in simulation.run()}
    for error in simulation.failures.values():
        raise error
    return [last[world] for world in range(len(stages))]


def _onwards(model: Any, state: PathState, stage: Stage, levels: int | str) -> Any:
    """The model of a stage behind a state."""
    scene = model.scene
    stages, output = (*state.stages, stage), replace(scene.output, frames=levels)
    return replace(model, scene=replace(scene, stages=stages, output=output, sweep=None))


def under_strain(scene: Scene, gradient: np.ndarray) -> Stage:
    """The first load step of `scene`, under an upper triangular deformation gradient (2, 2)."""
    load = scene.stages[0]
    f = gradient / (1.0 + scene.model.frame_expansion * (load.temperature - scene.wire.reference_temperature))
    weft, warp, shear = float(f[0, 0]) - 1.0, float(f[1, 1]) - 1.0, float(f[0, 1])
    return replace(load, strain_weft=weft, strain_warp=warp, shear=shear, tension_weft=None, tension_warp=None)


def under_tension(scene: Scene, tension: float, name: str = "equal tension") -> Stage:
    """The first load step of `scene`, with `tension` [N/m] in weft and warp."""
    load = replace(scene.stages[0], strain_weft=None, strain_warp=None, shear=0.0, name=name)
    return replace(load, tension_weft=tension, tension_warp=tension)


def part_of(monitor: Callable[[float], None], number: int, of: int) -> Callable[[float], None]:
    """Progress of one of `of` equal parts."""
    return lambda share: monitor((number + share) / of)
