"""A mesh on the way along its load: a run whose stages are given one after the other, and that returns to states it has passed.

    path = LoadPath(mesh_of(scene))
    records = list(path.load(under_strain(scene, np.diag([1.1, 1.1])), levels=20))
    beside = LoadPath(path.model, path.state)                         # goes on from there, as often as wanted
    means = MeshesPath(models).rows(under_strain(scene, np.diag([1.1, 1.1])), levels=20)    # of several meshes side by side

Each equilibrium starts from the one before it. States that lie on one path belong together: where a mesh has several equilibria
under one load, as tight knits have, those found from the mesh as knitted each by itself may not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from ..base.errors import Diverged
from ..measure.table import Record
from ..results.row import Row
from ..runner.history import row_of
from ..runner.variants import mean_row
from ..scene import Scene, Stage
from ..solve.progress import Progress
from ..solve.simulate import Simulation
from ..solve.variant_models import side_by_side

Monitor = Callable[[float], None]  # is called with the share that is done
FEWEST = 2  # meshes, of a mean


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

    @property
    def scene(self) -> Scene:
        """The scene of the mesh."""
        scene: Scene = self.model.scene
        return scene

    def load(self, stage: Stage, levels: int | str, monitor: Monitor = lambda _: None) -> Iterator[Record]:
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

    def beside(self, stage: Stage, levels: int | str, monitor: Monitor = lambda _: None) -> Iterator[list[Record]]:
        """The records of `load`, each as a list."""
        return ([record] for record in self.load(stage, levels, monitor))

    def rows(self, stage: Stage, levels: int | str, monitor: Monitor = lambda _: None) -> Iterator[Row]:
        """The rows of the records of `load`."""
        return map(row_of, self.load(stage, levels, monitor))

    def to(self, stage: Stage) -> Record:
        """The record at the end of a stage in one level. Raises `Diverged`."""
        *_, record = self.load(stage, levels=1)
        return record


class MeshesPath:
    """A load path of several meshes side by side. A mesh that does not converge is left out from there on."""

    def __init__(self, models: Sequence[Any], state: Mapping[int, PathState] | None = None) -> None:
        """state: of another path of these meshes, by their place; default: as knitted."""
        self.state = state or dict.fromkeys(range(len(models)), AS_KNITTED)
        self.models = {place: models[place] for place in self.state}

    @property
    def scene(self) -> Scene:
        """The scene of the first mesh."""
        scene: Scene = next(iter(self.models.values())).scene
        return scene

    def beside(self, stage: Stage, levels: int | str, monitor: Monitor = lambda _: None) -> Iterator[list[Record]]:
        """Records of a load step, of all meshes that converge; the path moves to its end.

        Raises `Diverged` where fewer than FEWEST meshes converge; `state` is that before the load step.
        """
        numbers = list(self.models)
        onwards = [_onwards(self.models[number], self.state[number], stage, levels) for number in numbers]
        records: dict[int, list[Record]] = {number: [] for number in numbers}
        state: dict[int, PathState] = {}
        error: Diverged | None = None
        groups = side_by_side(onwards)
        for done, places in enumerate(groups):
            of = [numbers[place] for place in places]
            kept = [self.state[number].kept for number in of]
            worlds = [onwards[place] for place in places]
            simulation = Simulation(worlds[0], worlds=worlds, progress=[Progress() for _ in of] if kept[0] else None)
            simulation.monitor = partial(_show_load, part_of(monitor, done, len(groups)))
            for drive, one in zip(simulation.drives, kept, strict=True):
                if one:
                    drive.restore(one)
            for record in simulation.run():
                records[of[record.world]].append(record)
            error = next(iter(simulation.failures.values()), error)
            for world, number in enumerate(of):
                if world not in simulation.failures:
                    state[number] = PathState(onwards[places[world]].scene.stages, simulation.drives[world].snapshot())
        if len(state) < FEWEST:
            raise error or Diverged("no mesh")
        self.models, self.state = {number: self.models[number] for number in state}, state
        return map(list, zip(*(records[number] for number in state), strict=True))

    def rows(self, stage: Stage, levels: int | str, monitor: Monitor = lambda _: None) -> Iterator[Row]:
        """Means of the rows of the meshes, with the ranges of eight in ten."""
        return map(mean_of, self.beside(stage, levels, monitor))


def _show_load(monitor: Monitor, progress: Progress) -> None:
    monitor(progress.load_factor)


def path_of(meshes: Any, state: Any = None) -> LoadPath | MeshesPath:
    """The load path of a mesh, or of a list of meshes.

    state: of another path of theirs; default: as knitted.
    """
    return MeshesPath(meshes, state) if isinstance(meshes, Sequence) else LoadPath(meshes, state or AS_KNITTED)


def mean_of(records: Sequence[Record]) -> Row:
    """The row of a record; of several meshes the mean row with ranges of eight in ten, and the number of `meshes`."""
    rows = [row_of(record) for record in records]
    return rows[0] if len(rows) == 1 else mean_row([row.changed(variant=None, meshes=len(rows)) for row in rows], 0)


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
