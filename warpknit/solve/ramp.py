"""The drive `ramp`: real time and real (or scaled) masses.

The load of a stage is applied over the loading time, then held until equilibrium.

Tension control: at every convergence check the strain rate v [1/loading time] of a tension-driven direction is updated from
the tension error e, with a running estimate C of the compliance,

    v -> v + MOMENTUM_RATE d (TENSION_RATE C e - v)        d: the time between checks over the loading time

This acts as a spring of TENSION_RATE MOMENTUM_RATE and a damper of MOMENTUM_RATE, independent of the time step. |v| is limited
to MAX_STRAIN_RATE, so that a loose mesh is not pulled tight abruptly.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..compute.steering import Steering
from ..measure import tension_scale
from ..measure.table import Record
from ..mechanics.numerics import CHECK_STEPS
from ..mesh.rim import LoadPoint
from ..scene import Stage
from .drive import Drive

TENSION_RATE = 60.0  # [1/loading time] gain of the tension control
MOMENTUM_RATE = 100.0  # [1/loading time] inverse time constant of the strain rate
TENSION_TOLERANCE = 5e-3  # relative to the prescribed tension, in equilibrium
MAX_STRAIN_RATE = 0.5  # [1/loading time]
COMPLIANCE_RANGE = 1e-4  # smallest compliance, over a loose mesh's
RENEWAL_CHECKS = 4  # largest number of convergence checks between updates of the time step
RENEWALS = 150  # smallest number of updates of the time step during loading
HOLD_LIMIT = 5.0  # loading times that the end load is held before the ramp stops unconverged


class Ramp(Drive):
    """Records `output.frames` states of a stage, the last one in equilibrium; the first stage starts with the unloaded state."""

    rate_key = "solver.loading_time"

    @property
    def dissipated(self) -> float:
        return float(self.state.steering.dissipated + self.mechanics.dissipated)

    def stage(self, stage: Stage) -> Iterator[Record]:
        self.loading_time = self.model.loading_time
        frames = self.scene.output.levels
        progress = self.progress
        unloaded = progress.stage_index == 0
        if progress.level == 0 and unloaded:
            # wires may be stressed or overlap as knitted
            progress.work = self.mechanics.observe().energies.stored
            yield self._record(stage, 0.0, steady=True)
        if not progress.solving:
            if not any(stage.by_tension):
                steps = math.ceil(self.loading_time / self.mechanics.renew_time_step(CHECK_STEPS))
                self._apply_load(stage, 1.0, None, steps, evenly=False)
            progress.compliance = [1.0 / tension_scale(self.model)] * 2
            progress.strain_move = []
            self.mechanics.begin_level()
            progress.solving = True
        recorded = progress.level - unloaded
        while True:
            step = self._step()
            self._follow(stage, step)
            self.advance(CHECK_STEPS)
            if (error := self.overlap_error(self.mechanics.overlap())) is not None:
                raise error
            progress.time += CHECK_STEPS * step
            progress.checks += 1
            self._add_work()
            control = self.state.steering.read()
            share = self._share(stage, control)
            progress.load_factor = smooth(share)
            if share >= 1.0:
                progress.residual = self.mechanics.residual_now()
                if self._met_tolerance() and self._has_tension(stage):
                    break
            if progress.time > (1.0 + HOLD_LIMIT) * self.loading_time:
                break
            while recorded < frames - 1 and share * frames >= recorded + 1:
                recorded += 1
                yield self._record(stage, progress.load_factor, steady=False)
            self.monitor(progress)
        progress.solving, progress.load_factor = False, 1.0
        yield self._record(stage, 1.0, steady=self._met_tolerance() and self._has_tension(stage))

    def _step(self) -> float:
        """The time step [s], updated every few convergence checks, more often for short loading."""
        control = self.state.steering.read()
        checks = np.clip(control.ramp_steps // (CHECK_STEPS * RENEWALS), 1, RENEWAL_CHECKS)
        if self.progress.checks % int(checks):
            return control.time_step
        return self.mechanics.renew_time_step(CHECK_STEPS * int(checks))

    def _share(self, stage: Stage, control: Steering) -> float:
        """Elapsed share of the loading time."""
        if any(stage.by_tension):
            return min(1.0, self.progress.time / self.loading_time)
        return min(1.0, float(control.ramp_step / max(control.ramp_steps, 1.0)))

    # --- directions driven by tension

    def _wanted_tension(self, stage: Stage, share: float) -> np.ndarray:
        """Prescribed tensions (weft, warp) [N/m] at a share of the loading time."""
        start = np.array(self.progress.start.tension)
        end = np.array([stage.tension_weft or 0.0, stage.tension_warp or 0.0])
        return start + smooth(share) * (end - start)

    def _follow(self, stage: Stage, step: float) -> None:
        """Tension control: set the strains of the next convergence check."""
        if not any(stage.by_tension):
            return
        progress, scale = self.progress, tension_scale(self.model)
        strain, tension = self._strain_and_tension()
        if progress.followed:
            moved, pulled = strain - np.array(progress.followed[:2]), tension - np.array(progress.followed[2:])
            seen = np.divide(moved, pulled, out=np.zeros(2), where=moved * pulled > 0.0)
            compliance = np.where(seen > 0.0, 0.9 * np.array(progress.compliance) + 0.1 * seen, progress.compliance)
            progress.compliance = np.clip(compliance, COMPLIANCE_RANGE / scale, 1.0 / (0.02 * scale)).tolist()
        progress.followed = [*strain.tolist(), *tension.tolist()]
        interval = CHECK_STEPS * step / self.loading_time
        share = min(1.0, progress.time / self.loading_time + interval)
        error = self._wanted_tension(stage, share) - tension
        new = min(1.0, MOMENTUM_RATE * interval)
        before = np.array(progress.strain_move or [0.0, 0.0])
        move = (1.0 - new) * before + new * TENSION_RATE * interval * np.array(progress.compliance) * error
        move = np.clip(move, -MAX_STRAIN_RATE * interval, MAX_STRAIN_RATE * interval)
        progress.strain_move = move.tolist()
        self._apply_load(stage, smooth(share), strain + move, CHECK_STEPS, evenly=True)

    def _has_tension(self, stage: Stage) -> bool:
        """Whether the boundary carries the prescribed tensions at the end of the stage."""
        driven = np.array(stage.by_tension)
        if not driven.any():
            return True
        _, tension = self._strain_and_tension()
        wanted = self._wanted_tension(stage, 1.0)
        tolerance = TENSION_TOLERANCE * np.maximum(np.abs(wanted), 0.01 * tension_scale(self.model))
        return bool(np.all(~driven | (np.abs(tension - wanted) <= tolerance)))

    def _met_tolerance(self) -> bool:
        """Whether the residual met its tolerance at the last check."""
        return self.progress.residual < self.scene.solver.residual_tolerance

    def _strain_and_tension(self) -> tuple[np.ndarray, np.ndarray]:
        """Strains and tensions [N/m] of the mesh, each (weft, warp)."""
        observed = self.mechanics.observe()
        return np.diag(observed.gradient) - 1.0, self.mesh_tension(observed)

    def _apply_load(self, stage: Stage, factor: float, strain: np.ndarray | None, steps: int, *, evenly: bool) -> None:
        """Apply the load at a load factor over `steps` steps; tension-driven directions go to `strain` (2,)."""
        target = self.target(stage, factor)
        if strain is not None:
            gradient = target.gradient.copy()
            gradient[np.diag_indices(2)] = np.where(stage.by_tension, 1.0 + strain, np.diag(gradient))
            target = LoadPoint(gradient, target.temperature)
        self.mechanics.set_load(target, steps, evenly=evenly)

    def _add_work(self) -> None:
        """Add the work of the boundary since the last check, by the trapezoidal rule.

        `stress` of the progress: nominal stress (4) [N/m], thermal force [J], gradient (4) and length factor.
        """
        observed: Any = self.mechanics.observe()
        now = self.model.ranks.from_first(lambda: [*observed.nominal_stress.ravel().tolist(), observed.thermal_force])
        now += [*observed.gradient.ravel().tolist(), observed.length_factor]
        if self.progress.stress:
            before = np.array(self.progress.stress)
            mean = 0.5 * (np.array(now[:5]) + before[:5]) * np.array([self.model.panel.area] * 4 + [1.0])
            self.progress.work += float(mean @ (np.array(now[5:]) - before[5:]))
        self.progress.stress = now

    def _record(self, stage: Stage, factor: float, *, steady: bool) -> Record:
        self.progress.level += 1
        return self.record(stage, factor, steady=steady, work=self.progress.work)


def smooth(x: float) -> float:
    """The ramp of kernels/control.py."""
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))
