"""Equilibria of meshes under many loads, side by side.

Each load is applied level by level from the mesh as knitted, as in a relaxation of one mesh. Loads are independent, so results do
not depend on the batch. Meshes that have converged under their full load, or failed, are not stepped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from ..base.errors import Diverged
from ..measure import Observables
from ..scene import Scene, Stage
from ..solve.model import build_model
from ..solve.relax import Relaxation, found_at
from ..solve.side_by_side import Findings, SideBySide
from ..solve.variant_models import MOST_NODES

Mesh = Any  # a model of either kind


@dataclass(frozen=True)
class Outcome:
    """The outcome of one load: observables of an equilibrium, or the error."""

    index: int  # of the load
    steps: int
    observables: Observables | None
    error: Diverged | None
    dissipated: float = 0.0  # [J] since the mesh as knitted


class Batch:
    """One stage for each mesh of a group; `run` yields outcomes as meshes converge."""

    def __init__(
        self,
        models: Mesh | Sequence[Mesh],
        stages: Sequence[Stage],
        levels: Sequence[int] | None = None,
        *,
        monitor: Callable[[Batch], None] | None = None,
    ) -> None:
        """models: of each mesh, or a single one; stages: the load of each, by strain or tension; `levels` of each, default
        `output.frames`.

        `monitor` is called at every convergence check, and may raise to stop.
        """
        self._stages = tuple(stages)
        models = models if isinstance(models, Sequence) else [models] * len(self._stages)
        self._count = list(levels or [models[0].scene.output.levels] * len(self._stages))
        self._worlds = SideBySide(models, self._last_record)
        self._monitor = monitor or (lambda _batch: None)

    @property
    def steps(self) -> int:
        """Steps of all meshes together."""
        return sum(member.progress.steps for member in self._worlds.members)

    @property
    def done(self) -> float:
        """Completed share of all load levels; the first one of each mesh is unloaded."""
        return sum(max(0, member.progress.level - 1) for member in self._worlds.members) / max(1, sum(self._count))

    def run(self) -> Iterator[Outcome]:
        """Find the equilibrium of every mesh under its load."""
        for row, found in self._worlds.run(lambda: self._monitor(self)):
            steps = self._worlds.members[row].progress.steps
            if isinstance(found, Diverged):
                yield Outcome(row, steps, None, found)
            else:
                yield Outcome(row, steps, found.observables, None, found.dissipated)

    def _last_record(self, member: Relaxation) -> Findings:
        """The levels of a mesh, and the record of the last one."""
        stage = self._stages[member.row]
        member.begin_stage(stage)
        yield from found_at(member.levels(stage, self._count[member.row]), lambda _: None)
        yield member.record(stage, 1.0, steady=True)


def mesh_of(scene: Scene) -> Any:
    """The model of a scene, on the CPU. Raises `ModelError`, `MemoryNeeded`, `KnitError`, `SceneError`."""
    return build_model(scene)


def side_by_side(loads: int, nodes: int) -> int:
    """Number of loads, among `loads`, that are solved at once."""
    return min(loads, max(1, MOST_NODES // nodes))
