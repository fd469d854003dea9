"""One stage of a ramp in real time, whatever model is stepped: the load comes on over the loading time, then the stage is held
until it is steady.

A direction driven by tension follows it in time: every look its strain v [1 a loading time] is set to move by what the tension
missing now would stretch the mesh, with the compliance C seen so far, and gathers way,

    v -> v + MOMENTUM_RATE d (TENSION_RATE C miss - v)        d: the look over the loading time

which is a spring of TENSION_RATE MOMENTUM_RATE and a damper of MOMENTUM_RATE whatever the time step; no move is faster than
MOST_STRAIN a loading time, so that a loose mesh is not pulled tight at a blow.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..kernels import control as c
from ..scene import Scene, Stage
from .drive import CHECK_STEPS, Progress

TENSION_RATE = 60.0  # of the strain that would carry the wanted tension, a loading time
MOMENTUM_RATE = 100.0  # a loading time, at which strains gather way: both ways together a mesh may be far softer than each
TENSION_TOLERANCE = 5e-3  # of the wanted tension, in a steady state
MOST_STRAIN = 0.5  # a loading time
COMPLIANCE_RANGE = 1e-4  # of that of a loose mesh: the least that is reckoned with
RENEWAL_LOOKS = 4  # looks between two renewals of the time step, at most
RENEWALS = 150  # of the time step while a load comes on, at least
HOLD_LIMIT = 5.0  # loading times that a ramp is held at the end before it stops without being steady


class RampStage(ABC):
    """Steps a model through a stage; what a model has of its own, those for a model say."""

    scene: Scene
    progress: Progress
    watch: Callable[[Progress], None]
    loading_time: float  # [s] of a stage

    def ramp_records(self, stage: Stage, frames: int) -> Iterator[Any]:
        """Records of `frames` states of a stage, the last one steady; the first stage starts with the unloaded state."""
        progress = self.progress
        unloaded = progress.stage_index == 0
        if progress.level == 0 and unloaded:
            yield self._keep(stage, 0.0, steady=True)
        if not progress.settling:
            driven = any(stage.by_tension)
            if not driven:
                self._aim(stage, 1.0, None, math.ceil(self.loading_time / self._renew_step(1)), evenly=False)
            progress.compliance = [1.0 / self._tension_scale()] * 2
            progress.strain_move = []
            self._begin_ramp()
            progress.settling = True
        recorded = progress.level - unloaded
        while True:
            step = self._step()
            self._follow(stage, step)
            self._advance(CHECK_STEPS)
            progress.time += CHECK_STEPS * step
            progress.looks += 1
            self._account_work()
            control = self._control()
            share = self._share(stage, control)
            progress.load_factor = smooth(share)
            self._reserve_for_ramp(control)
            if share >= 1.0 and self._is_steady(control) and self._carries(stage):
                break
            if progress.time > (1.0 + HOLD_LIMIT) * self.loading_time:
                break
            while recorded < frames - 1 and share * frames >= recorded + 1:
                recorded += 1
                yield self._keep(stage, progress.load_factor, steady=False)
            self.watch(progress)
        progress.settling, progress.load_factor = False, 1.0
        yield self._keep(stage, 1.0, steady=self._rests() and self._carries(stage))

    def _step(self) -> float:
        """The time step [s], renewed every few looks: every one where the load comes on in few steps."""
        control = self._control()
        looks = np.clip(control[int(c.RAMP_STEPS)] // (CHECK_STEPS * RENEWALS), 1, RENEWAL_LOOKS)
        if self.progress.looks % int(looks):
            return float(control[int(c.TIME_STEP)])
        return self._renew_step(int(looks))

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
        progress, scale = self.progress, self._tension_scale()
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
        near = TENSION_TOLERANCE * np.maximum(np.abs(wanted), 0.01 * self._tension_scale())
        return bool(np.all(~driven | (np.abs(tension - wanted) <= near)))

    def _rests(self) -> bool:
        """Whether forces balanced and motion had died down at the last look."""
        return self.progress.residual < self.scene.solver.residual_tolerance

    # --- what a model has of its own

    @abstractmethod
    def _control(self) -> np.ndarray:
        """The control array on the host."""

    @abstractmethod
    def _renew_step(self, looks: int) -> float:
        """Set and return the time step [s] that is stable for so many looks from the state as it is."""

    @abstractmethod
    def _tension_scale(self) -> float:
        """EI/C^3 [N/m]."""

    @abstractmethod
    def _carried(self) -> tuple[np.ndarray, np.ndarray]:
        """Strains and tensions [N/m] of the mesh, each (weft, warp)."""

    @abstractmethod
    def _aim(self, stage: Stage, factor: float, strain: np.ndarray | None, steps: int, *, evenly: bool) -> None:
        """Have the load of the stage at a load factor come on over so many steps; a direction driven by tension goes to its
        `strain` (2,)."""

    @abstractmethod
    def _begin_ramp(self) -> None:
        """Get ready for a load that comes on."""

    @abstractmethod
    def _reserve_for_ramp(self, control: np.ndarray) -> None:
        """Search again before the affine motion since the last search uses up what was kept for it."""

    @abstractmethod
    def _advance(self, steps: int) -> None:
        """Take steps. Raises `Diverged`."""

    @abstractmethod
    def _account_work(self) -> None:
        """Add the work of the boundary since the last look to the progress."""

    @abstractmethod
    def _is_steady(self, control: np.ndarray) -> bool:
        """Whether forces balance and motion has died down; the progress says how near that is."""

    @abstractmethod
    def _keep(self, stage: Stage, factor: float, *, steady: bool) -> Any:
        """The record of the state as it is."""


def smooth(x: float) -> float:
    """The ramp of kernels/control.py."""
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))


def work_between(before: list[float], now: list[float], area: float) -> float:
    """[J] of the boundary from one look to the next, each as nominal stress (4) [N/m], thermal force [J], gradient (4)
    and length factor: mean forces times what they move."""
    moved = np.array(now[5:]) - before[5:]
    mean = 0.5 * (np.array(now[:5]) + before[:5]) * np.array([area] * 4 + [1.0])
    return float(mean @ moved)
