"""One stage of a ramp in real time, whatever model is stepped: the load comes on over the loading time, then the stage is held
until it is steady.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..kernels import control as c
from ..scene import Stage
from .drive import CHECK_STEPS, Progress

RENEWAL_LOOKS = 4  # looks between two renewals of the time step, at most
RENEWALS = 150  # of the time step while a load comes on, at least
HOLD_LIMIT = 5.0  # loading times that a ramp is held at the end before it stops without being steady


class RampStage(ABC):
    """Steps a model through a stage; what a model has of its own, those for a model say."""

    progress: Progress
    loading_time: float  # [s] of a stage

    def ramp_records(self, stage: Stage, frames: int) -> Iterator[Any]:
        """Records of `frames` states of a stage, the last one steady; the first stage starts with the unloaded state."""
        progress = self.progress
        unloaded = progress.stage_index == 0
        if progress.level == 0 and unloaded:
            yield self._keep(stage, 0.0, steady=True)
        if not progress.settling:
            self._begin_stage(stage)
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
            self._watch()
        progress.settling, progress.load_factor = False, 1.0
        yield self._keep(stage, 1.0, steady=self._rests() and self._carries(stage))

    def _loading_steps(self) -> int:
        """Steps of the loading time, each as long as the first one."""
        return math.ceil(self.loading_time / self._renew_step(1))

    def _step(self) -> float:
        """The time step [s], renewed every few looks: every one where the load comes on in few steps."""
        control = self._control()
        looks = np.clip(control[int(c.RAMP_STEPS)] // (CHECK_STEPS * RENEWALS), 1, RENEWAL_LOOKS)
        if self.progress.looks % int(looks):
            return float(control[int(c.TIME_STEP)])
        return self._renew_step(int(looks))

    def _share(self, stage: Stage, control: np.ndarray) -> float:
        """Of the loading time that has gone by, in steps."""
        return min(1.0, float(control[int(c.RAMP_STEP)] / max(control[int(c.RAMP_STEPS)], 1.0)))

    def _follow(self, stage: Stage, step: float) -> None:
        """Look where the load should go in the steps until the next look."""
        return

    def _carries(self, stage: Stage) -> bool:
        """Whether the boundary carries what it should at the end of the stage."""
        return True

    # --- what a model has of its own

    @abstractmethod
    def _control(self) -> np.ndarray:
        """The control array on the host."""

    @abstractmethod
    def _renew_step(self, looks: int) -> float:
        """Set and return the time step [s] that is stable for so many looks from the state as it is."""

    @abstractmethod
    def _begin_stage(self, stage: Stage) -> None:
        """Have the load of the stage begin to come on."""

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
    def _rests(self) -> bool:
        """The same of the last look."""

    @abstractmethod
    def _watch(self) -> None:
        """Call whoever watches."""

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
