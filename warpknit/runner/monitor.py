"""Callback of a run at every convergence check: handles Ctrl-C, writes checkpoints, shows progress.

With several ranks every rank has its own monitor, and all take the same decisions at the same check.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ..base.errors import Diverged
from ..measure.table import Record
from ..solve.simulate import Progress, Simulation
from .checkpoint import write_checkpoint
from .interrupts import Interrupted, Interrupts

DISPLAY_INTERVAL = 0.1  # [s]
# [s] a longer checkpoint, as of millions of nodes, is written less often: in a twentieth of the time
LONG_CHECKPOINT, LONG_SHARE = 1.0, 0.05


@dataclass(frozen=True)
class LoopResult:
    """Ending of the time loop."""

    reason: str  # steady | interrupted | diverged
    exit_code: int = 0
    message: str = ""


class Monitor:
    """Runs a simulation in a directory; `wall_before` [s] is the time of earlier parts of the run."""

    def __init__(
        self,
        simulation: Simulation,
        out: Path,
        *,
        wall_before: float = 0.0,
        show: Callable[[Progress], None] = lambda _progress: None,
        recorded: Callable[[], Mapping[str, object]] = dict,
    ) -> None:
        """recorded: the rows so far, and what else a checkpoint is to hold."""
        self.out = out
        self._scene = simulation.model.scene
        self._ranks = simulation.model.ranks
        self._show, self._recorded = show, recorded
        self._wall_before = wall_before
        self._begin = self._saved = self._shown = time.perf_counter()
        self._interval = self._scene.output.checkpoint_interval
        self.interrupts = Interrupts()
        self._follow(simulation)

    @property
    def wall(self) -> float:
        """[s] wall time of the run so far."""
        return self._wall_before + time.perf_counter() - self._begin

    def _follow(self, simulation: Simulation) -> None:
        self.simulation = simulation
        simulation.monitor = self._check

    def run(self, keep: Callable[[Record], None], then: Callable[[], Simulation | None] = lambda: None) -> LoopResult:
        """Run to the end; `keep` receives every record. then: the simulation that follows one that has ended, or None."""
        with self.interrupts.handled():
            try:
                following: Simulation | None = self.simulation
                while following is not None:
                    self._follow(following)
                    for record in following.run():
                        keep(record)
                        del record  # its fields are as large as the state
                    following = then()
            except Interrupted:
                self._checkpoint()
                return LoopResult("interrupted", 130, "interrupted")
            except Diverged as error:
                return LoopResult("diverged", error.exit_code, str(error))
        return LoopResult("steady")

    def _check(self, progress: Progress) -> None:
        now = time.perf_counter()
        requests = self._ranks.everyone((self.interrupts.is_requested, now - self._saved > self._interval))
        if any(interrupt for interrupt, _ in requests):
            raise Interrupted
        if requests[0][1]:  # by the clock of the first rank
            self._checkpoint()
        if now - self._shown > DISPLAY_INTERVAL:
            self._shown = now
            self._show(progress)

    def _checkpoint(self) -> None:
        begin = time.perf_counter()
        write_checkpoint(self.out, self.simulation, self._scene.hash, self.wall, self._recorded())
        self._saved = time.perf_counter()
        if (elapsed := self._saved - begin) > LONG_CHECKPOINT:
            self._interval = max(self._scene.output.checkpoint_interval, elapsed / LONG_SHARE)
