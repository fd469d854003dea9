"""The drive `ramp`: real time and real (or scaled) masses. A stage loads over `loading_time` and is then held until steady."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from .. import measure
from ..kernels import control as c
from ..scene import Stage
from .drive import CHECK_STEPS, Drive, LoadPoint, Record
from .neighbours import RAMP_SHARE
from .timestep import stable_step

TENSION_RATE = 60.0  # of the strain that would carry the wanted tension, a loading time
MOST_GAIN = 0.1  # of it a look
MOMENTUM_RATE = 100.0  # a loading time, at which strains slow down: both ways together a mesh may be far softer than each
TENSION_TOLERANCE = 5e-3  # of the wanted tension, in a steady state
MOST_STRAIN = 0.5  # a loading time
COMPLIANCE_RANGE = 1e-4  # of that of a loose mesh: the least that is reckoned with
RENEWAL_LOOKS = 4  # looks between two renewals of the time step, at most
RENEWALS = 150  # of the time step while a load comes on, at least
HOLD_LIMIT = 5.0  # loading times that a ramp is held at the end before it stops without being steady


class Ramp(Drive):
    """Records `output.frames` states of a stage, the last one steady; the first stage starts with the unloaded state."""

    def _launch_all(self) -> None:
        self.neighbours.search()
        self.stepper.step(2)
        self._is_steady(self.state.read_control())

    def stage(self, stage: Stage) -> Iterator[Record]:
        progress, frames = self.progress, self.scene.output.frames
        loading_time = self.model.loading_time
        unloaded = progress.stage_index == 0
        if progress.level == 0 and unloaded:
            yield self.record(stage, 0.0, steady=True, work=progress.work)
        driven = np.array(stage.by_tension)
        if not progress.settling:
            if not driven.any():
                self._set_ramp(self.target(stage, 1.0), math.ceil(loading_time / self._renew_step()))
            progress.compliance = [1.0 / measure.tension_scale(self.model)] * 2
            progress.strain_move = []
            self.neighbours.expect(RAMP_SHARE * self.neighbours.margin)
            progress.settling = True
        recorded = progress.level - unloaded
        while True:
            step = self._step()
            if driven.any():
                self._follow_tension(stage, driven, step)
            self._advance(CHECK_STEPS)
            progress.time += CHECK_STEPS * step
            progress.looks += 1
            self._account_work()
            control = self.state.read_control()
            if driven.any():
                share = min(1.0, progress.time / loading_time)
            else:
                share = min(1.0, float(control[int(c.RAMP_STEP)] / max(control[int(c.RAMP_STEPS)], 1.0)))
            progress.load_factor = _smooth(share)
            self._reserve_for_ramp(control)
            if share >= 1.0 and self._is_steady(control) and self._carries(stage, driven):
                break
            if progress.time > (1.0 + HOLD_LIMIT) * loading_time:
                break
            while recorded < frames - 1 and share * frames >= recorded + 1:
                recorded += 1
                yield self.record(stage, progress.load_factor, steady=False, work=progress.work)
            self.watch(progress)
        progress.settling, progress.load_factor = False, 1.0
        steady = progress.residual < self.scene.solver.residual_tolerance and self._carries(stage, driven)
        yield self.record(stage, 1.0, steady=steady, work=progress.work)

    # --- directions driven by tension ---

    def _wanted_tension(self, stage: Stage, share: float) -> np.ndarray:
        """Tensions (weft, warp) [N/m] that the boundary is to carry, where it is driven by them."""
        start = np.array(self.progress.start.tension)
        end = np.array([stage.tension_weft or 0.0, stage.tension_warp or 0.0])
        return start + _smooth(share) * (end - start)

    def _follow_tension(self, stage: Stage, driven: np.ndarray, step: float) -> None:
        """Aim at the strains of the next look: the boundary gives way as the wanted tension is more than the mesh carries.

        The strain moves at TENSION_RATE of what the compliance seen so far asks for, and by MOST_STRAIN a loading time at most,
        so that a loose mesh is not pulled tight at a blow.
        """
        progress, loading_time = self.progress, self.model.loading_time
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
        target = self.target(stage, _smooth(share))
        gradient = target.gradient.copy()
        gradient[np.diag_indices(2)] = np.where(driven, 1.0 + strain + move, np.diag(gradient))
        self._set_ramp(LoadPoint(gradient, target.temperature), CHECK_STEPS)

    def _carries(self, stage: Stage, driven: np.ndarray) -> bool:
        """Whether the boundary carries the tensions of the end of the stage."""
        if not driven.any():
            return True
        tension = self._mesh_tension(measure.read(self.model, self.state))
        wanted = self._wanted_tension(stage, 1.0)
        near = TENSION_TOLERANCE * np.maximum(np.abs(wanted), 0.01 * measure.tension_scale(self.model))
        return bool(np.all(~driven | (np.abs(tension - wanted) <= near)))

    def _is_steady(self, control: np.ndarray) -> bool:
        self.progress.residual = float(self.steadiness.measure(control, self.look.take(), self.state.wire_axial.numpy()))
        return self.progress.residual < self.scene.solver.residual_tolerance

    def _step(self) -> float:
        """The time step [s], renewed every few looks: every one where the load comes on in few steps."""
        control = self.state.read_control()
        looks = np.clip(control[int(c.RAMP_STEPS)] // (CHECK_STEPS * RENEWALS), 1, RENEWAL_LOOKS)
        if self.progress.looks % int(looks):
            return float(control[int(c.TIME_STEP)])
        return self._renew_step(int(looks))

    def _renew_step(self, looks: int = 1) -> float:
        """The time step that the present tension and contact allow until so many looks on."""
        self.stepper.evaluate_contact()  # what the contacts push with is not in a checkpoint
        step = stable_step(self.model, self.state, CHECK_STEPS * looks)
        self.state.write_control({c.TIME_STEP: step})
        return step

    def _account_work(self) -> None:
        """Work of the boundary since the last look: mean nominal stress times the change of the gradient times the area."""
        reading = measure.read(self.model, self.state)
        now = self.model.ranks.from_first(
            lambda: [*measure.nominal_stress(reading).ravel().tolist(), measure.thermal_force(reading)]
        )
        now += [*reading.gradient.ravel().tolist(), reading.length_factor]
        if self.progress.stress:
            before = np.array(self.progress.stress)
            area = self.model.panel.area
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
