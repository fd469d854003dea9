"""The drive `ramp`: real time and real (or scaled) masses. A stage loads over `loading_time` and is then held until steady."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from . import measure
from .drive import CHECK_STEPS, Drive, Record
from .kernels import control as c
from .neighbours import RAMP_SHARE
from .scene import Stage
from .timestep import stable_step

HOLD_LIMIT = 5.0  # loading times that a ramp is held at the end before it stops without being steady


class Ramp(Drive):
    """Records `output.frames` states of a stage, the last one steady; the first stage starts with the unloaded state."""

    def warm_up(self) -> None:
        self.neighbours.search()
        self.stepper.step(2)
        self.steadiness.measure(self.state.read_control())

    def stage(self, stage: Stage) -> Iterator[Record]:
        progress, frames = self.progress, self.scene.output.frames
        loading_time = self.model.loading_time
        unloaded = progress.stage_index == 0
        if progress.level == 0 and unloaded:
            yield self._record(stage, 0.0, steady=True, work=progress.work)
        if not progress.settling:
            self._set_ramp(self._target(stage, 1.0), math.ceil(loading_time / self._renew_step()))
            self.neighbours.expect(RAMP_SHARE * self.neighbours.margin)
            progress.settling = True
        recorded = progress.level - unloaded
        while True:
            step = self._renew_step()
            self._advance(CHECK_STEPS)
            progress.time += CHECK_STEPS * step
            progress.looks += 1
            self._account_work()
            control = self.state.read_control()
            share = min(1.0, float(control[int(c.RAMP_STEP)] / max(control[int(c.RAMP_STEPS)], 1.0)))
            progress.load_factor = _smooth(share)
            self._reserve_for_ramp(control)
            if share >= 1.0 and self._is_steady(control):
                break
            if progress.time > (1.0 + HOLD_LIMIT) * loading_time:
                break
            while recorded < frames - 1 and share * frames >= recorded + 1:
                recorded += 1
                yield self._record(stage, progress.load_factor, steady=False, work=progress.work)
            self.watch(progress)
        progress.settling, progress.load_factor = False, 1.0
        steady = progress.residual < self.scene.solver.residual_tolerance
        yield self._record(stage, 1.0, steady=steady, work=progress.work)

    def _is_steady(self, control: np.ndarray) -> bool:
        self.progress.residual = self.steadiness.measure(control)
        return self.progress.residual < self.scene.solver.residual_tolerance

    def _renew_step(self) -> float:
        """The time step that the present tension and contact allow."""
        step = stable_step(self.model, self.state)
        self.state.write_control({c.TIME_STEP: step})
        return step

    def _account_work(self) -> None:
        """Work of the boundary since the last look: mean nominal stress times the change of the gradient times the area."""
        reading = measure.read(self.model, self.state)
        now = [*measure.nominal_stress(reading).ravel().tolist(), measure.thermal_force(reading)]
        now += [*reading.gradient.ravel().tolist(), reading.length_factor]
        if self.progress.stress:
            before = np.array(self.progress.stress)
            area = float(np.prod(self.model.panel.size))
            moved = np.array(now[5:]) - before[5:]
            mean = 0.5 * (np.array(now[:5]) + before[:5]) * np.array([area] * 4 + [1.0])
            self.progress.work += float(mean @ moved)
        self.progress.stress = now

    def _reserve_for_ramp(self, control: np.ndarray) -> None:
        """Search again before the affine motion since the last search uses up what was kept for it."""
        if control[int(c.RAMP_STEP)] < control[int(c.RAMP_STEPS)]:
            self.neighbours.follow(control[int(c.GRADIENT) : int(c.GRADIENT) + 4])


def _smooth(x: float) -> float:
    """The ramp of kernels/control.py."""
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))
