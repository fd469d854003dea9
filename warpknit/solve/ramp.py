"""The drive `ramp`: real time and real (or scaled) masses.

The load of a stage comes on over the loading time, then the stage is held until it is steady.

A direction driven by tension follows it in time: at every convergence check its strain v [1 a loading time] is set to move by
what the tension missing now would stretch the mesh, with the compliance C seen so far, and gathers way,

    v -> v + MOMENTUM_RATE d (TENSION_RATE C miss - v)        d: the time between checks over the loading time

which is a spring of TENSION_RATE MOMENTUM_RATE and a damper of MOMENTUM_RATE whatever the time step; no move is faster than
MOST_STRAIN a loading time, so that a loose mesh is not pulled tight at a blow.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..kernels import control as c
from ..measure import tension_scale
from ..mechanics import advance
from ..mesh.load_point import LoadPoint
from ..numerics import CHECK_STEPS
from ..scene import Stage
from .drive import Drive
from .progress import Record

TENSION_RATE = 60.0  # of the strain that would carry the wanted tension, a loading time
MOMENTUM_RATE = 100.0  # a loading time, at which strains gather way: both ways together a mesh may be far softer than each
TENSION_TOLERANCE = 5e-3  # of the wanted tension, in a steady state
MOST_STRAIN = 0.5  # a loading time
COMPLIANCE_RANGE = 1e-4  # of that of a loose mesh: the least that is reckoned with
RENEWAL_CHECKS = 4  # convergence checks between two renewals of the time step, at most
RENEWALS = 150  # of the time step while a load comes on, at least
HOLD_LIMIT = 5.0  # loading times that a ramp is held at the end before it stops without being steady


class Ramp(Drive):
    """Records `output.frames` states of a stage, the last one steady; the first stage starts with the unloaded state."""

    slower = "solver.loading_time"

    @property
    def dissipated(self) -> float:
        return float(self.state.read_control()[int(c.DISSIPATED)])

    def stage(self, stage: Stage) -> Iterator[Record]:
        self.loading_time = self.model.loading_time
        frames = self.scene.output.frames
        progress = self.progress
        unloaded = progress.stage_index == 0
        if progress.level == 0 and unloaded:
            progress.work = (
                self.mechanics.observe().energies.stored
            )  # of wires that are not free of stress as knitted, or overlap
            yield self._keep(stage, 0.0, steady=True)
        if not progress.solving:
            driven = any(stage.by_tension)
            if not driven:
                self._aim(
                    stage, 1.0, None, math.ceil(self.loading_time / self.mechanics.renew_time_step(CHECK_STEPS)), evenly=False
                )
            progress.compliance = [1.0 / tension_scale(self.model)] * 2
            progress.strain_move = []
            self.mechanics.reserve_for_load()
            progress.solving = True
        recorded = progress.level - unloaded
        while True:
            step = self._step()
            self._follow(stage, step)
            taken, diverged = advance(self.mechanics, CHECK_STEPS)
            progress.steps += taken
            if diverged:
                raise self.divergence()
            if (error := self.overlap_error()) is not None:
                raise error
            progress.time += CHECK_STEPS * step
            progress.checks += 1
            self._account_work()
            control = self.state.read_control()
            share = self._share(stage, control)
            progress.load_factor = smooth(share)
            self.mechanics.follow_load()
            if share >= 1.0 and self._has_settled() and self._carries(stage):
                break
            if progress.time > (1.0 + HOLD_LIMIT) * self.loading_time:
                break
            while recorded < frames - 1 and share * frames >= recorded + 1:
                recorded += 1
                yield self._keep(stage, progress.load_factor, steady=False)
            self.watch(progress)
        progress.solving, progress.load_factor = False, 1.0
        yield self._keep(stage, 1.0, steady=self._is_balanced() and self._carries(stage))

    def _step(self) -> float:
        """The time step [s], renewed every few looks: every one where the load comes on in few steps."""
        control = self.state.read_control()
        checks = np.clip(control[int(c.RAMP_STEPS)] // (CHECK_STEPS * RENEWALS), 1, RENEWAL_CHECKS)
        if self.progress.checks % int(checks):
            return float(control[int(c.TIME_STEP)])
        return self.mechanics.renew_time_step(CHECK_STEPS * int(checks))

    def _share(self, stage: Stage, control: np.ndarray) -> float:
        """Of the loading time that has gone by: in steps, where the load comes on in so many."""
        if any(stage.by_tension):
            return min(1.0, self.progress.time / self.loading_time)
        return min(1.0, float(control[int(c.RAMP_STEP)] / max(control[int(c.RAMP_STEPS)], 1.0)))

    # --- directions driven by tension

    def _wanted_tension(self, stage: Stage, share: float) -> np.ndarray:
        """Tensions (weft, warp) [N/m] that the boundary is to carry, where it is driven by them."""
        start = np.array(self.progress.start.tension)
        end = np.array([stage.tension_weft or 0.0, stage.tension_warp or 0.0])
        return start + smooth(share) * (end - start)

    def _follow(self, stage: Stage, step: float) -> None:
        """Aim at the strains of the next look: the boundary gives way as the wanted tension is more than the mesh carries."""
        if not any(stage.by_tension):
            return
        progress, scale = self.progress, tension_scale(self.model)
        strain, tension = self._carried()
        if progress.followed:
            moved, pulled = strain - np.array(progress.followed[:2]), tension - np.array(progress.followed[2:])
            seen = np.divide(moved, pulled, out=np.zeros(2), where=moved * pulled > 0.0)
            compliance = np.where(seen > 0.0, 0.9 * np.array(progress.compliance) + 0.1 * seen, progress.compliance)
            progress.compliance = np.clip(compliance, COMPLIANCE_RANGE / scale, 1.0 / (0.02 * scale)).tolist()
        progress.followed = [*strain.tolist(), *tension.tolist()]
        look = CHECK_STEPS * step / self.loading_time
        share = min(1.0, progress.time / self.loading_time + look)
        miss = self._wanted_tension(stage, share) - tension
        new = min(1.0, MOMENTUM_RATE * look)
        before = np.array(progress.strain_move or [0.0, 0.0])
        move = (1.0 - new) * before + new * TENSION_RATE * look * np.array(progress.compliance) * miss
        move = np.clip(move, -MOST_STRAIN * look, MOST_STRAIN * look)
        progress.strain_move = move.tolist()
        self._aim(stage, smooth(share), strain + move, CHECK_STEPS, evenly=True)

    def _carries(self, stage: Stage) -> bool:
        """Whether the boundary carries the tensions of the end of the stage, where it is driven by them."""
        driven = np.array(stage.by_tension)
        if not driven.any():
            return True
        _, tension = self._carried()
        wanted = self._wanted_tension(stage, 1.0)
        near = TENSION_TOLERANCE * np.maximum(np.abs(wanted), 0.01 * tension_scale(self.model))
        return bool(np.all(~driven | (np.abs(tension - wanted) <= near)))

    def _is_balanced(self) -> bool:
        """Whether forces balanced and motion had died down at the last check."""
        return self.progress.residual < self.scene.solver.residual_tolerance

    def _has_settled(self) -> bool:
        """Whether forces balance and motion has died down."""
        self.progress.residual = self.mechanics.residual_now()
        return self._is_balanced()

    def _carried(self) -> tuple[np.ndarray, np.ndarray]:
        """Strains and tensions [N/m] of the mesh, each (weft, warp)."""
        observed = self.mechanics.observe()
        return np.diag(observed.gradient) - 1.0, self.mesh_tension(observed)

    def _aim(self, stage: Stage, factor: float, strain: np.ndarray | None, steps: int, *, evenly: bool) -> None:
        """Have the load of the stage at a load factor come on over so many steps; a direction driven by tension goes to its
        `strain` (2,)."""
        target = self.target(stage, factor)
        if strain is not None:
            gradient = target.gradient.copy()
            gradient[np.diag_indices(2)] = np.where(stage.by_tension, 1.0 + strain, np.diag(gradient))
            target = LoadPoint(gradient, target.temperature)
        self.mechanics.set_load(target, steps, evenly=evenly)

    def _account_work(self) -> None:
        """Add the work of the boundary since the last check to the progress."""
        observed: Any = self.mechanics.observe()
        now = self.model.ranks.from_first(lambda: [*observed.nominal_stress.ravel().tolist(), observed.thermal_force])
        now += [*observed.gradient.ravel().tolist(), observed.length_factor]
        if self.progress.stress:
            self.progress.work += work_between(self.progress.stress, now, self.model.panel.area)
        self.progress.stress = now

    def _keep(self, stage: Stage, factor: float, *, steady: bool) -> Record:
        self.progress.level += 1
        return self.record(stage, factor, steady=steady, work=self.progress.work)


def smooth(x: float) -> float:
    """The ramp of kernels/control.py."""
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))


def work_between(before: list[float], now: list[float], area: float) -> float:
    """[J] of the boundary from one look to the next, each as nominal stress (4) [N/m], thermal force [J], gradient (4)
    and length factor: mean forces times what they move."""
    moved = np.array(now[5:]) - before[5:]
    mean = 0.5 * (np.array(now[:5]) + before[:5]) * np.array([area] * 4 + [1.0])
    return float(mean @ moved)
