"""The drive `ramp`: real time and real (or scaled) masses. A stage loads over `loading_time` and is then held until steady."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .. import measure
from ..kernels import control as c
from ..planar.neighbours import RAMP_SHARE
from ..planar.observables import read
from ..planar.time_step import stable_step
from ..scene import Stage
from .drive import CHECK_STEPS, Drive, LoadPoint, Record
from .ramp_stage import RampStage, work_between


class Ramp(Drive, RampStage):
    """Records `output.frames` states of a stage, the last one steady; the first stage starts with the unloaded state."""

    def _launch_all(self) -> None:
        self.neighbours.search()
        self.stepper.step(2)
        self._is_steady(self.state.read_control())

    def stage(self, stage: Stage) -> Iterator[Record]:
        self.loading_time = self.model.loading_time
        yield from self.ramp_records(stage, self.scene.output.frames)

    def _aim(self, stage: Stage, factor: float, strain: np.ndarray | None, steps: int, *, evenly: bool) -> None:
        target = self.target(stage, factor)
        if strain is not None:
            gradient = target.gradient.copy()
            gradient[np.diag_indices(2)] = np.where(stage.by_tension, 1.0 + strain, np.diag(gradient))
            target = LoadPoint(gradient, target.temperature)
        self._set_ramp(target, steps)
        self.state.write_control({c.EVEN_RAMP: float(evenly)})

    def _begin_ramp(self) -> None:
        self.neighbours.expect(RAMP_SHARE * self.neighbours.margin)

    def _tension_scale(self) -> float:
        return measure.tension_scale(self.model)

    def _carried(self) -> tuple[np.ndarray, np.ndarray]:
        reading = read(self.model, self.state)
        return np.diag(reading.gradient) - 1.0, self._mesh_tension(reading)

    def _control(self) -> np.ndarray:
        return self.state.read_control()

    def _keep(self, stage: Stage, factor: float, *, steady: bool) -> Record:
        return self.record(stage, factor, steady=steady, work=self.progress.work)

    def _is_steady(self, control: np.ndarray) -> bool:
        self.progress.residual = float(self.steadiness.measure(control, self.look.take(), self.state.wire_axial.numpy()))
        return self._rests()

    def _renew_step(self, looks: int) -> float:
        self.stepper.evaluate_contact()  # what the contacts push with is not in a checkpoint
        step = stable_step(self.model, self.state, CHECK_STEPS * looks)
        self.state.write_control({c.TIME_STEP: step})
        return step

    def _account_work(self) -> None:
        reading = read(self.model, self.state)
        now = self.model.ranks.from_first(
            lambda: [*measure.nominal_stress(reading).ravel().tolist(), measure.thermal_force(reading)]
        )
        now += [*reading.gradient.ravel().tolist(), reading.length_factor]
        if self.progress.stress:
            self.progress.work += work_between(self.progress.stress, now, self.model.panel.area)
        self.progress.stress = now

    def _reserve_for_ramp(self, control: np.ndarray) -> None:
        if control[int(c.RAMP_STEP)] < control[int(c.RAMP_STEPS)]:
            self.neighbours.follow(control[int(c.GRADIENT) : int(c.GRADIENT) + 4])
