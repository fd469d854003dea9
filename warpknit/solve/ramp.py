"""The drive `ramp`: real time and real (or scaled) masses. A stage loads over `loading_time` and is then held until steady."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .. import measure
from ..kernels import control as c
from ..scene import Stage
from .drive import CHECK_STEPS, Drive, LoadPoint, Record
from .neighbours import RAMP_SHARE
from .ramp_stage import RampStage, smooth, work_between
from .timestep import stable_step

TENSION_RATE = 60.0  # of the strain that would carry the wanted tension, a loading time
MOST_GAIN = 0.1  # of it a look
MOMENTUM_RATE = 100.0  # a loading time, at which strains slow down: both ways together a mesh may be far softer than each
TENSION_TOLERANCE = 5e-3  # of the wanted tension, in a steady state
MOST_STRAIN = 0.5  # a loading time
COMPLIANCE_RANGE = 1e-4  # of that of a loose mesh: the least that is reckoned with


class Ramp(Drive, RampStage):
    """Records `output.frames` states of a stage, the last one steady; the first stage starts with the unloaded state."""

    def _launch_all(self) -> None:
        self.neighbours.search()
        self.stepper.step(2)
        self._is_steady(self.state.read_control())

    def stage(self, stage: Stage) -> Iterator[Record]:
        self.loading_time = self.model.loading_time
        yield from self.ramp_records(stage, self.scene.output.frames)

    def _begin_stage(self, stage: Stage) -> None:
        progress = self.progress
        if not any(stage.by_tension):
            self._set_ramp(self.target(stage, 1.0), self._loading_steps())
        progress.compliance = [1.0 / measure.tension_scale(self.model)] * 2
        progress.strain_move = []
        self.neighbours.expect(RAMP_SHARE * self.neighbours.margin)

    def _share(self, stage: Stage, control: np.ndarray) -> float:
        if any(stage.by_tension):
            return min(1.0, self.progress.time / self.loading_time)
        return super()._share(stage, control)

    def _control(self) -> np.ndarray:
        return self.state.read_control()

    def _keep(self, stage: Stage, factor: float, *, steady: bool) -> Record:
        return self.record(stage, factor, steady=steady, work=self.progress.work)

    def _watch(self) -> None:
        self.watch(self.progress)

    # --- directions driven by tension ---

    def _wanted_tension(self, stage: Stage, share: float) -> np.ndarray:
        """Tensions (weft, warp) [N/m] that the boundary is to carry, where it is driven by them."""
        start = np.array(self.progress.start.tension)
        end = np.array([stage.tension_weft or 0.0, stage.tension_warp or 0.0])
        return start + smooth(share) * (end - start)

    def _follow(self, stage: Stage, step: float) -> None:
        """Aim at the strains of the next look: the boundary gives way as the wanted tension is more than the mesh carries.

        The strain moves at TENSION_RATE of what the compliance seen so far asks for, and by MOST_STRAIN a loading time at most,
        so that a loose mesh is not pulled tight at a blow.
        """
        driven = np.array(stage.by_tension)
        if not driven.any():
            return
        progress, loading_time = self.progress, self.loading_time
        reading = measure.read(self.model, self.state)
        strain, tension = np.diag(reading.gradient) - 1.0, self._mesh_tension(reading)
        if progress.followed:
            moved, pulled = strain - np.array(progress.followed[:2]), tension - np.array(progress.followed[2:])
            seen = np.divide(moved, pulled, out=np.zeros(2), where=moved * pulled > 0.0)
            least = COMPLIANCE_RANGE / measure.tension_scale(self.model)
            compliance = np.where(seen > 0.0, 0.9 * np.array(progress.compliance) + 0.1 * seen, progress.compliance)
            progress.compliance = np.clip(compliance, least, 1.0 / (0.02 * measure.tension_scale(self.model))).tolist()
        progress.followed = [*strain.tolist(), *tension.tolist()]
        share = min(1.0, (progress.time + CHECK_STEPS * step) / loading_time)
        miss = self._wanted_tension(stage, share) - tension
        most = MOST_STRAIN * CHECK_STEPS * step / loading_time
        gain = min(MOST_GAIN, TENSION_RATE * CHECK_STEPS * step / loading_time)
        kept = max(0.0, 1.0 - MOMENTUM_RATE * CHECK_STEPS * step / loading_time)
        before = np.array(progress.strain_move or [0.0, 0.0])
        move = np.clip(gain * np.array(progress.compliance) * miss + kept * before, -most, most)
        progress.strain_move = move.tolist()
        target = self.target(stage, smooth(share))
        gradient = target.gradient.copy()
        gradient[np.diag_indices(2)] = np.where(driven, 1.0 + strain + move, np.diag(gradient))
        self._set_ramp(LoadPoint(gradient, target.temperature), CHECK_STEPS)

    def _carries(self, stage: Stage) -> bool:
        driven = np.array(stage.by_tension)
        if not driven.any():
            return True
        tension = self._mesh_tension(measure.read(self.model, self.state))
        wanted = self._wanted_tension(stage, 1.0)
        near = TENSION_TOLERANCE * np.maximum(np.abs(wanted), 0.01 * measure.tension_scale(self.model))
        return bool(np.all(~driven | (np.abs(tension - wanted) <= near)))

    def _is_steady(self, control: np.ndarray) -> bool:
        self.progress.residual = float(self.steadiness.measure(control, self.look.take(), self.state.wire_axial.numpy()))
        return self._rests()

    def _rests(self) -> bool:
        return self.progress.residual < self.scene.solver.residual_tolerance

    def _renew_step(self, looks: int) -> float:
        self.stepper.evaluate_contact()  # what the contacts push with is not in a checkpoint
        step = stable_step(self.model, self.state, CHECK_STEPS * looks)
        self.state.write_control({c.TIME_STEP: step})
        return step

    def _account_work(self) -> None:
        reading = measure.read(self.model, self.state)
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
