"""Load paths of meshes side by side: stages are given one after the other, and a path may return to an earlier state.

    path = LoadPath(meshes_of(scene))                     # or a model
    rows = list(path.rows(under_strain(scene, np.diag([1.1, 1.1])), levels=20))    # means over the meshes
    beside = LoadPath(path.meshes, path.states)           # goes on from there, as often as wanted
    for world, end in ends_of(knitted_worlds(models, stages, levels)): ...         # each load from the mesh as knitted

Each equilibrium starts from the last one. So states of one path are on one branch of equilibria. A tight knit has several
equilibria under one load: states that are each found from the mesh as knitted may lie on different branches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias, TypeVar

import numpy as np

from ..base.errors import Diverged
from ..measure import Observables
from ..measure.table import Record
from ..results.row import Row
from ..runner.estimates import MESHES, other_frictions
from ..runner.history import row_of
from ..runner.other_model import FIGURES
from ..runner.variants import first_meshes, mean_row
from ..scene import Scene, Stage
from ..solve.model import build_model
from ..solve.progress import Progress
from ..solve.simulate import Simulation
from ..solve.variant_models import VariantModels, side_by_side

Found = TypeVar("Found")
Mesh: TypeAlias = Any  # a model of either kind
Monitor: TypeAlias = Callable[[float], None]  # is called with the share that is done
FEWEST = 2  # meshes, of a mean
# Residual, so that the differences between states hold three digits: the card's stiffness is nearly singular, and its inverse
# loses one more. The contact point is found to 1e-5 of a segment, which leaves residuals of up to 1e-5.
DIFFERENCE_TOLERANCE = 2e-5


@dataclass(frozen=True)
class Meshes:
    """The meshes of a scene, and some of them again with another friction."""

    models: Mapping[int, Mesh]  # by place
    again: Mapping[int, tuple[str, int]] = field(default_factory=dict)  # of a mesh with another friction: which, and the
    # place of the same mesh with the scene's friction

    @classmethod
    def of(cls, meshes: Meshes | Sequence[Mesh] | Mesh) -> Meshes:
        """One or several models."""
        if isinstance(meshes, Meshes):
            return meshes
        return cls(dict(enumerate(meshes if isinstance(meshes, Sequence) else [meshes])))

    @property
    def first(self) -> Mesh:
        """The first model."""
        return next(iter(self.models.values()))

    @property
    def scene(self) -> Scene:
        """The scene of the first mesh."""
        scene: Scene = self.first.scene
        return scene

    @property
    def own(self) -> list[int]:
        """Places of the meshes with the friction of the scene."""
        return [place for place in self.models if place not in self.again]

    @property
    def fewest(self) -> int:
        """Number of these meshes that a mean needs."""
        return min(FEWEST, len(self.own))

    def jumps(self, find: Callable[[Mesh, Sequence[Any]], list[Found]], rows: Sequence[Row]) -> list[Found]:
        """The jumps that `find` finds in the rows of a single mesh; of means there are none."""
        return find(self.first, rows) if len(self.own) == 1 else []

    def with_tolerance(self, tolerance: float) -> Meshes:
        """The meshes with a residual tolerance that is at most this."""
        changed = {place: replace(model, scene=exact(model.scene, tolerance)) for place, model in self.models.items()}
        return replace(self, models=changed)

    def means(self, values: Mapping[int, Mapping[str, float]], name: str) -> dict[str, float]:
        """The mean of a value over the meshes with each other friction: that over the scene's meshes, and the mean change.

        values: by place. The change is over the meshes with both frictions, so their scatter drops out.
        """
        mean = float(np.mean([values[place][name] for place in self.own if place in values]))
        changes: dict[str, list[float]] = {}
        for place, (friction, same) in self.again.items():
            if place in values and same in values:
                changes.setdefault(friction, []).append(values[place][name] - values[same][name])
        return {friction: mean + float(np.mean(of)) for friction, of in changes.items()}

    def mean_of(self, records: Mapping[int, Record]) -> Row:
        """The mean row of records by place, or the row of a single mesh.

        It has ranges of eight in ten, `meshes` in the mean, and FRICTION_NAME for another friction.
        """
        rows = {place: row_of(record) for place, record in records.items()}
        own = [rows[place] for place in self.own if place in rows]
        if len(own) == 1:
            return own[0]
        mean = mean_row([row.changed(variant=None, meshes=len(own)) for row in own], 0)
        values = {place: vars(row) for place, row in rows.items()}
        frictions = {f"{one}_{name}": value for name in FIGURES for one, value in self.means(values, name).items()}
        return mean.changed(**frictions)


def meshes_of(scene: Scene) -> Meshes:
    """The first meshes of `[variants]`, and some of them with other frictions; or the single mesh of the scene.

    In double precision. Raises `ModelError`, `KnitError`.
    """
    variants = scene.variants
    scene, tolerance = replace(scene, stages=scene.stages[:1], sweep=None), scene.solver.residual_tolerance
    if variants.count == 1:
        return Meshes.of(exact_model(scene, tolerance))
    own = VariantModels(exact(scene, tolerance))
    own.take(first_meshes(variants))
    return with_frictions(own)


def with_frictions(own: VariantModels) -> Meshes:
    """The taken meshes, and by `variants.sensitivity` some with other frictions. Raises `ModelError`, `KnitError`."""
    models, again = {place: own.of_place(place) for place in range(len(own.taken))}, dict[int, tuple[str, int]]()
    for name, changed in (other_frictions(own.scene) if own.scene.variants.sensitivity else {}).items():
        other = VariantModels(changed, own.device)
        for same, number in enumerate(own.taken[:MESHES]):
            again[len(models)], models[len(models)] = (name, same), other.model(number)
    return Meshes(models, again)


@dataclass(frozen=True)
class PathState:
    """A state at the end of a stage of a path; the default is the mesh as knitted."""

    stages: tuple[Stage, ...] = ()
    kept: dict[str, np.ndarray] = field(default_factory=dict)  # snapshot of the drive
    gradient: np.ndarray = field(default_factory=lambda: np.eye(2))  # (2, 2) deformation gradient


AS_KNITTED = PathState()


@dataclass(frozen=True)
class Load:
    """A load step of one mesh, from a state."""

    place: int  # of the mesh: loads of equal places are on one mesh
    mesh: Mesh
    stage: Stage
    begin: PathState = AS_KNITTED


@dataclass(frozen=True)
class Followed:
    """Records of a load step, and the state at its end."""

    records: Sequence[Record]
    end: PathState | None  # None where it does not converge
    error: Diverged | None = None


def follow(loads: Sequence[Load], levels: int | str, monitor: Monitor = lambda _: None) -> list[Followed]:
    """Load steps in `levels` of load, side by side. They are independent: results do not depend on those beside."""
    onwards = [_onwards(load.mesh, load.begin, load.stage, levels) for load in loads]
    groups = side_by_side(onwards, [load.place for load in loads])
    found: dict[int, Followed] = {}
    for done, places in enumerate(groups):
        simulation = _begun([onwards[k] for k in places], [loads[k].begin for k in places], part_of(monitor, done, len(groups)))
        records: list[list[Record]] = [[] for _ in places]
        for record in simulation.run():
            records[record.world].append(record)
        for world, k in enumerate(places):
            error, end = simulation.failures.get(world), None
            if error is None:
                gradient = np.asarray(records[world][-1].observables.gradient)
                end = PathState(onwards[k].scene.stages, simulation.drives[world].snapshot(), gradient)
            found[k] = Followed(records[world], end, error)
    return [found[k] for k in range(len(loads))]


def levels_of(followed: Mapping[int, Followed], meshes: Meshes) -> Iterator[dict[int, Record]]:
    """Records of the meshes that reach the end of a load step, by level.

    Raises `Diverged` where too few for a mean reach it, after the levels that enough of them reach.
    """
    ended = {place: one.records for place, one in followed.items() if one.end is not None}
    own = [place for place in meshes.own if place in ended]
    if len(own) < meshes.fewest:
        ordered = sorted((place for place in followed if place not in meshes.again), key=lambda k: -len(followed[k].records))
        ended = {place: followed[place].records for place in ordered[: meshes.fewest]}
    for level in zip(*ended.values(), strict=len(own) >= meshes.fewest):
        yield dict(zip(ended, level, strict=True))
    if len(own) < meshes.fewest:
        raise next((one.error for one in followed.values() if one.error is not None), Diverged("no mesh"))


class LoadPath:
    """A load path from the meshes as knitted, or another path's states. It drops a mesh that does not converge."""

    def __init__(self, meshes: Meshes | Sequence[Mesh] | Mesh, states: Mapping[int, PathState] | None = None) -> None:
        """states: of another path of these meshes, by place; it may have had another tolerance."""
        self.meshes = Meshes.of(meshes)
        self.states = dict.fromkeys(self.meshes.models, AS_KNITTED) if states is None else dict(states)

    @property
    def scene(self) -> Scene:
        """The scene of the meshes."""
        return self.meshes.scene

    def load(
        self, stage: Stage | Mapping[int, Stage], levels: int | str, monitor: Monitor = lambda _: None
    ) -> Iterator[dict[int, Record]]:
        """Records of a load step by place, level by level; the path moves to its end. The first begins as knitted.

        stage: of all meshes, or of each by its place, and then of these only. `monitor` is called with the load factor at every
        convergence check. Raises `Diverged` where too few meshes converge; then `states` are before the load step.
        """
        stages = stage if isinstance(stage, Mapping) else dict.fromkeys(self.states, stage)
        loads = [Load(place, self.meshes.models[place], one, self.states[place]) for place, one in stages.items()]
        followed = dict(zip(stages, follow(loads, levels, monitor), strict=True))
        yield from levels_of(followed, self.meshes)
        self.states = {place: one.end for place, one in followed.items() if one.end is not None}

    def rows(self, stage: Stage | Mapping[int, Stage], levels: int | str, monitor: Monitor = lambda _: None) -> Iterator[Row]:
        """The mean rows of `load`."""
        return map(self.meshes.mean_of, self.load(stage, levels, monitor))

    def to(self, stage: Stage | Mapping[int, Stage]) -> dict[int, Record]:
        """The records at the end of a load step in one level. Raises `Diverged`."""
        *_, records = self.load(stage, levels=1)
        return records


def knitted_worlds(
    models: Sequence[Mesh], stages: Sequence[Sequence[Stage]], levels: Sequence[int], monitor: Monitor = lambda _: None
) -> Simulation:
    """A simulation of meshes as knitted, each with its load steps.

    stages, levels: of each mesh, and of each of its load steps. Meshes are independent, so results do not depend on those
    beside. `monitor` is called at every convergence check.
    """
    onwards = [
        _onwards(model, PathState(tuple(before)), last, count)
        for model, (*before, last), count in zip(models, stages, levels, strict=True)
    ]
    return _begun(onwards, [AS_KNITTED] * len(onwards), monitor, ends_only=True)


def share_done(simulation: Simulation, levels: Sequence[int]) -> float:
    """Completed share of all load levels of `knitted_worlds`; the first one of each mesh is unloaded."""
    done = total = 0
    for drive, count in zip(simulation.drives, levels, strict=True):
        progress = drive.progress
        done += count * progress.stage_index + max(0, progress.level - (progress.stage_index == 0))
        total += count * len(drive.model.scene.stages)
    return done / total


def ends_of(simulation: Simulation) -> Iterator[tuple[int, Record | Diverged]]:
    """Worlds and their records at the ends of load steps; then errors."""
    yield from ((record.world, record) for record in simulation.run())
    yield from simulation.failures.items()


def states_at(model: Mesh, gradients: Sequence[np.ndarray]) -> list[Observables | Diverged]:
    """Equilibrium or error at each upper triangular deformation gradient (2, 2).

    Each is reached proportionally from the mesh as knitted, at the temperature of the scene's first load step.
    """
    count = len(gradients)
    stages, levels = [under_strain(model.scene, f) for f in gradients], [model.scene.output.levels] * count
    ends = dict(ends_of(knitted_worlds([model] * count, [[stage] for stage in stages], levels)))
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


def under_tension(scene: Scene, tension: float) -> Stage:
    """The first load step of `scene`, with `tension` [N/m] in weft and warp."""
    load = replace(scene.stages[0], strain_weft=None, strain_warp=None, shear=0.0, name="equal tension")
    return replace(load, tension_weft=tension, tension_warp=tension)


def part_of(monitor: Monitor, number: int, of: int) -> Monitor:
    """Progress of one of `of` equal parts."""
    return lambda share: monitor((number + share) / of)


def exact_model(scene: Scene, tolerance: float = DIFFERENCE_TOLERANCE) -> Mesh:
    """The mesh of `scene` in double precision, with a tolerance for differences of states. Raises `ModelError`, `KnitError`."""
    return build_model(exact(scene, tolerance))


def exact(scene: Scene, tolerance: float) -> Scene:
    """The scene in double precision, with a residual tolerance that is at most this."""
    tolerance = min(scene.solver.residual_tolerance, tolerance)
    return replace(scene, solver=replace(scene.solver, precision="double", residual_tolerance=tolerance))
