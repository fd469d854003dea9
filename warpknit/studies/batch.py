"""Equilibria of one mesh under many loads, side by side.

Each load is applied level by level from the mesh as knitted, as in a relaxation of one mesh. Loads are independent, so results
do not depend on the batch. Meshes that have converged under their full load, or failed, are no longer stepped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import Diverged
from ..measure import Observables
from ..scene import Scene, Stage
from ..solve.equilibrium import Equilibrium
from ..solve.model import build_model, worlds_of
from ..solve.relax import Relaxation, Unsolved

Mesh = Any  # a model of either kind
MOST_NODES = 500_000  # of all meshes side by side


@dataclass(frozen=True)
class Outcome:
    """The outcome of one load: observables of an equilibrium, or the error."""

    index: int  # of the load
    steps: int
    observables: Observables | None
    error: Diverged | None


class Batch:
    """One stage for each mesh of a group; `run` yields outcomes as meshes converge."""

    def __init__(
        self,
        model: Any,
        stages: Sequence[Stage],
        levels: Sequence[int] | None = None,
        *,
        watch: Callable[[Batch], None] | None = None,
    ) -> None:
        """`stages`: the load of each mesh, by strain or tension; `levels` of each, default `output.frames`.

        `watch` is called at every convergence check, and may raise to stop.
        """
        self.model, self.stages = model, tuple(stages)
        self.group = worlds_of([model] * len(self.stages))
        self.members: list[Relaxation] = []
        self.equilibrium = Equilibrium(self.group, self.members)
        for row, mechanics in enumerate(self.group.members):
            self.members.append(Relaxation(mechanics, equilibrium=self.equilibrium, row=row))
        self._count = list(levels or [model.scene.output.levels] * len(self.stages))
        of_each = zip(self.members, self.stages, self._count, strict=True)
        self._levels = [member.levels(stage, count) for member, stage, count in of_each]
        self._watch = watch or (lambda _batch: None)

    @property
    def steps(self) -> int:
        """Steps of all meshes together."""
        return sum(member.progress.steps for member in self.members)

    @property
    def done(self) -> float:
        """Completed share of all load levels; the first one of each mesh is unloaded."""
        return sum(max(0, member.progress.level - 1) for member in self.members) / max(1, sum(self._count))

    def run(self) -> Iterator[Outcome]:
        """Find the equilibrium of every mesh under its load."""
        rows = np.arange(len(self.members))
        self.group.search(rows)
        for member, stage in zip(self.members, self.stages, strict=True):
            member.progress.stage = stage.name
            member.progress.start = member.load_now()
        due: dict[int, Diverged | None] = dict.fromkeys(
            rows.tolist()
        )  # rows that go on to their next level, after an error or none
        active: list[int] = []
        while due or active:
            with self.group.together():
                outcomes = {row: self._next_level(row, error) for row, error in due.items()}
            yield from (outcome for outcome in outcomes.values() if outcome is not None)
            active = sorted([*active, *(row for row, outcome in outcomes.items() if outcome is None)])
            if not active:
                return
            check = self.equilibrium.advance(np.array(active))
            due = {row: check.failed.get(row) for row in [*check.failed, *check.converged]}
            active = [row for row in active if row not in due]
            self._watch(self)

    def _next_level(self, row: int, error: Diverged | None = None) -> Outcome | None:
        """Apply the next load, or a smaller one after an error; return the outcome after the full load, or of a failure."""
        member, levels = self.members[row], self._levels[row]
        try:
            step = next(levels, None) if error is None else levels.throw(error)
            while step is not None:
                if isinstance(step, Unsolved):
                    return None
                step = next(levels, None)
        except Diverged as failure:  # also where no strain carries the tension
            return self._outcome(row, None, failure)
        return self._outcome(row, member.record(self.stages[row], 1.0, steady=True).observables, None)

    def _outcome(self, row: int, observables: Any, error: Diverged | None) -> Outcome:
        return Outcome(row, self.members[row].progress.steps, observables, error)


def mesh_of(scene: Scene) -> Any:
    """The model of a scene, on the CPU. Raises `ModelError`, `MemoryNeeded`, `KnitError`, `SceneError`."""
    return build_model(scene)


def side_by_side(loads: int, nodes: int) -> int:
    """How many of so many loads of a mesh are solved at once."""
    return min(loads, max(1, MOST_NODES // nodes))
