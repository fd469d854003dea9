"""The time loop over the stages of a scene: a generator of `Record`s, so that what is recorded stays apart from how to step."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ..mesh.layout import estimated_nodes
from ..planar.model import Model, build_model
from ..planar.prolongation import one_repeat, smaller_scene
from ..planar.state import State, initial_state
from ..ranks.ranks import One, Ranks
from ..scene import Scene
from .drive import Drive, LoadStart, Progress, Record
from .large import LargeRelaxation
from .ramp import Ramp
from .relax import Relaxation

__all__ = ["Progress", "Record", "Simulation"]


NODES_A_STRIP = 4_000  # of a smaller mesh: fewer are not worth the waiting for other ranks


class Simulation:
    """A run of a model through the stages of its scene."""

    def __init__(
        self,
        model: Model,
        state: State,
        *,
        progress: Progress | None = None,
        watch: Callable[[Progress], None] | None = None,
    ) -> None:
        self.model = model
        self.state = state
        self.resumed = progress is not None
        self.progress = progress or Progress()
        self.notes: list[str] = []  # what the user should know
        self.watch = watch or (lambda _progress: None)
        if model.scene.solver.drive == "relax":
            self.drive: Drive = self._relaxation(model, state, self.progress, self._cell_of(model))
        else:
            self.drive = Ramp(model, state, self.progress, self._look)

    def _look(self, _progress: Progress) -> None:
        self.watch(self.progress)

    def _relaxation(self, model: Model, state: State, progress: Progress, cell: Relaxation | None) -> Relaxation:
        """A relaxation with the smaller meshes that it starts from."""
        scene = smaller_scene(model.scene) if model.cloth is not None else None
        if scene is None:
            if cell is None or not model.scene.has_moving_edge:
                return Relaxation(model, state, progress, self._look)
            return LargeRelaxation(model, state, progress, self._look, cell=cell)
        smaller = build_model(scene, model.device, self._sharing(model, scene))
        below = self._relaxation(smaller, initial_state(smaller), Progress(), cell)
        return LargeRelaxation(model, state, progress, self._look, smaller=below, cell=cell)

    @staticmethod
    def _sharing(model: Model, smaller: Scene) -> Ranks:
        """The ranks that share a smaller mesh: all, or each has it to itself where a strip would not be worth the waiting."""
        assert model.cloth is not None
        share = estimated_nodes(smaller, model.cloth) // model.ranks.count
        return model.ranks if share >= NODES_A_STRIP else One()

    @staticmethod
    def _cell_of(model: Model) -> Relaxation | None:
        """One periodic repeat under the same load, for a gripped mesh that is large enough to need it."""
        scene = model.scene
        if model.cloth is None or scene.model.boundary == "periodic":
            return None
        if smaller_scene(scene) is None and not scene.has_moving_edge:
            return None
        cell = build_model(one_repeat(scene), model.device)
        return Relaxation(cell, initial_state(cell), Progress(), lambda _progress: None)

    def warm_up(self) -> None:
        """Have every kernel that the run will use compiled or loaded; the state stays as it is."""
        self.drive.warm_up()

    def memory(self) -> dict[str, np.ndarray]:
        """What a checkpoint needs beside the state: arrays that the loop carries from look to look."""
        return self.drive.memory()

    def recall(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `memory` returned."""
        self.drive.recall(kept)

    def run(self) -> Iterator[Record]:
        """Records of all stages, from where `progress` stands.

        Raises:
            Diverged: the state cannot be brought to rest, or numbers are no longer finite.
        """
        if not self.resumed:
            self.drive.neighbours.search()
        stages = self.model.scene.stages
        progress = self.progress
        while progress.stage_index < len(stages):
            stage = stages[progress.stage_index]
            progress.stage = stage.name
            if not progress.start.gradient:
                progress.start = self.drive.load_now()
            yield from self.drive.stage(stage)
            progress.stage_index += 1
            progress.level, progress.start, progress.time = 0, LoadStart(), 0.0
