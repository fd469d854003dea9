"""The time loop over the stages of a scene: a generator of `Record`s, so that what is recorded stays apart from how to step."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from .drive import Progress, Record
from .model import Model
from .ramp import Ramp
from .relax import Relaxation
from .state import State

__all__ = ["Progress", "Record", "Simulation"]

DRIVES = {"relax": Relaxation, "ramp": Ramp}  # solver.drive


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
        self.watch = watch or (lambda _progress: None)
        self.drive = DRIVES[model.scene.solver.drive](model, state, self.progress, lambda p: self.watch(p))

    def warm_up(self) -> None:
        """Have every kernel that the run will use compiled or loaded; the state stays as it is."""
        before, kept = self.state.arrays(), self.memory()
        self.drive.warm_up()
        self.state.restore(before)
        self.recall(kept)
        self.progress.residual = 0.0

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
            if not progress.start:
                progress.start = self.drive.load_now()
            yield from self.drive.stage(stage)
            progress.stage_index += 1
            progress.level, progress.start, progress.time = 0, {}, 0.0
