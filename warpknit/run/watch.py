"""What happens between looks at the state while a run goes on: Ctrl-C is taken, and checkpoints are written.

Where ranks share the mesh every rank has its watch, and all of them take the same decisions at the same look.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..errors import Diverged
from ..measure.table import Record
from ..solve.simulate import Progress, Simulation
from .checkpoint import write_checkpoint
from .interrupts import Interrupted, Interrupts

SHOWN_EVERY = 0.1  # [s]


@dataclass(frozen=True)
class Ending:
    """How the time loop ended."""

    reason: str  # steady | interrupted | diverged
    exit_code: int = 0
    message: str = ""


class Watch:
    """Runs a simulation in a directory; `wall_before` [s] is what earlier parts of the run took."""

    def __init__(
        self,
        simulation: Simulation,
        out: Path,
        *,
        wall_before: float = 0.0,
        show: Callable[[Progress], None] = lambda _progress: None,
        before_checkpoint: Callable[[], None] = lambda: None,
    ) -> None:
        self.simulation = simulation
        self.out = out
        self._scene = simulation.model.scene
        self._ranks = simulation.model.ranks
        self._show, self._before_checkpoint = show, before_checkpoint
        self._wall_before = wall_before
        self.begin = self._saved = self._shown = time.perf_counter()
        self.interrupts = Interrupts()
        simulation.watch = self._look

    @property
    def wall(self) -> float:
        """[s] the run has taken so far."""
        return self._wall_before + time.perf_counter() - self.begin

    def run(self, keep: Callable[[Record], None]) -> Ending:
        """Run to the end; `keep` gets every record."""
        with self.interrupts.caught():
            try:
                for record in self.simulation.run():
                    keep(record)
            except Interrupted:
                self._checkpoint()
                return Ending("interrupted", 130, f"interrupted; --resume goes on from {self.out}")
            except Diverged as error:
                return Ending("diverged", error.exit_code, str(error))
        return Ending("steady")

    def _look(self, progress: Progress) -> None:
        now = time.perf_counter()
        looks = self._ranks.everyone((self.interrupts.asked, now - self._saved > self._scene.output.checkpoint_interval))
        if any(interrupt for interrupt, _ in looks):
            raise Interrupted
        if looks[0][1]:  # by the clock of the first rank
            self._checkpoint()
        if now - self._shown > SHOWN_EVERY:
            self._shown = now
            self._show(progress)

    def _checkpoint(self) -> None:
        self._before_checkpoint()
        write_checkpoint(self.out, self.simulation, self._scene.hash, self.wall)
        self._saved = time.perf_counter()
