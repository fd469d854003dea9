"""Load paths of meshes: stages are given one after the other, and a path may return to an earlier state.

    path = LoadPath(build_model(scene))
    records = list(path.load(under_strain(scene, np.diag([1.1, 1.1])), levels=20))
    beside = LoadPath(path.model, path.state)                         # goes on from there, as often as wanted
    means = MeshesPath(models).rows(under_strain(scene, np.diag([1.1, 1.1])), levels=20)    # of several meshes side by side
    for world, end in ends_of(knitted_worlds(models, stages, levels)): ...      # each load from the mesh as knitted

Each equilibrium starts from the last one. So states of one path are on one branch of equilibria. A tight knit has several
equilibria under one load: states that are each found from the mesh as knitted may lie on different branches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from ..base.errors import Diverged
from ..measure import Observables
from ..measure.table import Record
from ..results.row import Row
from ..runner.history import row_of
from ..runner.variants import mean_row
from ..scene import Scene, Stage
from ..solve.model import build_model
from ..solve.progress import Progress
from ..solve.simulate import Simulation
from ..solve.variant_models import side_by_side

Mesh: TypeAlias = Any  # a model of either kind
Monitor = Callable[[float], None]  # is called with the share that is done
FEWEST = 2  # meshes, of a mean
# Residual, so that the differences between states hold three digits: the card's stiffness is nearly singular, and its inverse
# loses one more. The contact point is found to 1e-5 of a segment, which leaves residuals of up to 1e-5.
DIFFERENCE_TOLERANCE = 2e-5
ROUGH_TOLERANCE = 1e-4  # for a mesh that does not converge to the finer one


@dataclass(frozen=True)
class PathState:
    """A state at the end of a stage of a path; the default is the mesh as knitted."""

    stages: tuple[Stage, ...] = ()
    kept: dict[str, np.ndarray] = field(default_factory=dict)  # snapshot of the drive


AS_KNITTED = PathState()


class LoadPath:
    """A load path from the mesh as knitted, or from another path's state."""

    def __init__(self, model: Mesh, state: Any = AS_KNITTED) -> None:
        """state: of another path, whose model may differ in its solver's tolerance."""
        self.model, self.state = model, state

    @property
    def scene(self) -> Scene:
        """The scene of the mesh."""
        scene: Scene = self.model.scene
        return scene

    def load(self, stage: Stage, levels: int | str, monitor: Monitor = lambda _: None) -> Iterator[Record]:
        """Records of a load step; the path moves to its end. The first begins as knitted.

        `monitor` is called with the load factor at every convergence check. Raises `Diverged`; then `state` is before the stage.
        """
        model = _onwards(self.model, self.state, stage, levels)
        simulation = Simulation(
            model, progress=Progress() if self.state.kept else None, monitor=lambda progress: monitor(progress.load_factor)
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
        """The rows of these records; of several meshes their means, with the ranges of eight in ten."""
        return map(mean_of, self.beside(stage, levels, monitor))

    def to(self, stage: Stage) -> Record:
        """The record at the end of a stage in one level. Raises `Diverged`."""
        *_, record = self.load(stage, levels=1)
        return record


class MeshesPath(LoadPath):
    """A load path of several meshes side by side. A mesh that does not converge is left out from there on."""

    def __init__(self, models: Sequence[Any], state: Mapping[int, PathState] | None = None) -> None:
        """state: of another path of these meshes, by their place; default: as knitted."""
        super().__init__(models[0], state or dict.fromkeys(range(len(models)), AS_KNITTED))
        self.models = {place: models[place] for place in self.state}

    def beside(self, stage: Stage, levels: int | str, monitor: Monitor = lambda _: None) -> Iterator[list[Record]]:
        """Records of a load step, of all meshes that converge; the path moves to its end.

        Raises `Diverged` where fewer than FEWEST meshes converge; then `state` is before the load step.
        """
        numbers = list(self.models)
        onwards = [_onwards(self.models[number], self.state[number], stage, levels) for number in numbers]
        records: dict[int, list[Record]] = {number: [] for number in numbers}
        state: dict[int, PathState] = {}
        error: Diverged | None = None
        groups = side_by_side(onwards)
        for done, places in enumerate(groups):
            of = [numbers[place] for place in places]
            states = [self.state[number] for number in of]
            simulation = _begun([onwards[place] for place in places], states, part_of(monitor, done, len(groups)))
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


def path_of(meshes: Any, state: Any = None) -> LoadPath:
    """The load path of a mesh, or of a list of meshes; state: of an earlier path, default: as knitted."""
    return MeshesPath(meshes, state) if isinstance(meshes, Sequence) else LoadPath(meshes, state or AS_KNITTED)


def mean_of(records: Sequence[Record]) -> Row:
    """The row of a record; of several meshes the mean row with ranges of eight in ten, and the number of `meshes`."""
    rows = [row_of(record) for record in records]
    return rows[0] if len(rows) == 1 else mean_row([row.changed(variant=None, meshes=len(rows)) for row in rows], 0)


def knitted_worlds(
    models: Sequence[Mesh], stages: Sequence[Stage], levels: Sequence[int], monitor: Monitor = lambda _: None
) -> Simulation:
    """A simulation of meshes as knitted, each with a load step and its levels.

    Loads are independent, so results do not depend on the meshes beside. `monitor` is called at every convergence check.
    """
    onwards = [_onwards(model, AS_KNITTED, stage, count) for model, stage, count in zip(models, stages, levels, strict=True)]
    return _begun(onwards, [AS_KNITTED] * len(onwards), monitor, ends_only=True)


def share_done(simulation: Simulation, levels: Sequence[int]) -> float:
    """Completed share of all load levels of `knitted_worlds`; the first one of each mesh is unloaded."""
    worlds = zip(simulation.drives, levels, strict=True)
    done = (count if drive.progress.stage_index else max(0, drive.progress.level - 1) for drive, count in worlds)
    return sum(done) / sum(levels)


def ends_of(simulation: Simulation) -> Iterator[tuple[int, Record | Diverged]]:
    """Number and last record of each world of one load step, as they converge; then the errors of the others."""
    yield from ((record.world, record) for record in simulation.run())
    yield from simulation.failures.items()


def ends_beside(model: Mesh, state: PathState, stages: Sequence[Stage]) -> list[Record]:
    """Records at the ends of load steps in one level, all from one state. Raises the first `Diverged`."""
    simulation = _begun([_onwards(model, state, stage, 1) for stage in stages], [state] * len(stages))
    ends = dict(ends_of(simulation))
    for error in simulation.failures.values():
        raise error
    return [end for _, end in sorted(ends.items()) if isinstance(end, Record)]


def states_at(model: Mesh, gradients: Sequence[np.ndarray]) -> list[Observables | Diverged]:
    """Equilibrium or error at each upper triangular deformation gradient (2, 2).

    Each is reached proportionally from the mesh as knitted, at the temperature of the scene's first load step.
    """
    count = len(gradients)
    stages, levels = [under_strain(model.scene, f) for f in gradients], [model.scene.output.levels] * count
    ends = dict(ends_of(knitted_worlds([model] * count, stages, levels)))
    return [end if isinstance(end, Diverged) else end.observables for _, end in sorted(ends.items())]


def _begun(
    models: Sequence[Mesh], states: Sequence[PathState], monitor: Monitor = lambda _: None, *, ends_only: bool = False
) -> Simulation:
    """A simulation of models side by side: one load step, from their states."""
    progress = [Progress() for _ in models] if states[0].kept else None
    simulation = Simulation(
        models[0], worlds=models, progress=progress, monitor=lambda one: monitor(one.load_factor), ends_only=ends_only,
        spread=True,
    )  # fmt: skip
    for drive, state in zip(simulation.drives, states, strict=True):
        if state.kept:
            drive.restore(state.kept)
    return simulation


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


def tolerances_of(scene: Scene) -> list[float]:
    """Residual tolerances of a material card, to be tried one after the other: the scene's comes last."""
    return [DIFFERENCE_TOLERANCE, ROUGH_TOLERANCE, scene.solver.residual_tolerance]


def exact_model(scene: Scene, tolerance: float = DIFFERENCE_TOLERANCE) -> Mesh:
    """The mesh of `scene` in double precision, with a tolerance for differences of states. Raises `ModelError`, `KnitError`."""
    return build_model(exact(scene, tolerance))


def exact(scene: Scene, tolerance: float) -> Scene:
    """The scene in double precision, with a residual tolerance that is at most this."""
    tolerance = min(scene.solver.residual_tolerance, tolerance)
    return replace(scene, solver=replace(scene.solver, precision="double", residual_tolerance=tolerance))
