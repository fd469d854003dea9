"""Callback of a run at every convergence check: handles Ctrl-C, writes checkpoints, shows progress.

With several ranks every rank has its own monitor, and all take the same decisions at the same check.

A run resumed from a checkpoint gives bit-identical results. Files are written atomically. Each rank writes its strip. Files
alternate between turn 0 and turn 1. The file of the first rank names the valid turn; it is written last, when all others are
complete, so the earlier turn stays valid until then.
"""

from __future__ import annotations

import json
import time
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..base.errors import Diverged, RunDirectoryError
from ..base.files import write_arrays
from ..compute.kept import strip_prefix
from ..compute.ranks import Ranks
from ..measure.table import Record
from ..results.row import Row, Values
from ..solve.simulate import Progress, Simulation
from .interrupts import Interrupted, Interrupts

DISPLAY_INTERVAL = 0.1  # [s]
# [s] a longer checkpoint, as of millions of nodes, is written less often: in a twentieth of the time
LONG_CHECKPOINT, LONG_SHARE = 1.0, 0.05
FILE = Path("checkpoint") / "checkpoint.npz"
UNUSABLE = (OSError, ValueError, AttributeError, KeyError, TypeError, zipfile.BadZipFile)


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
        """recorded: returns the rows so far, and further content of a checkpoint."""
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
        """Run to the end; `keep` receives every record. then: returns the next simulation after one ends, or None."""
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
        write_checkpoint(self.out, self.simulation, self.wall, self._recorded())
        self._saved = time.perf_counter()
        if (elapsed := self._saved - begin) > LONG_CHECKPOINT:
            self._interval = max(self._scene.output.checkpoint_interval, elapsed / LONG_SHARE)


# --- checkpoints


def write_checkpoint(directory: Path, simulation: Simulation, wall: float, recorded: Mapping[str, Any] | None = None) -> None:
    """Save state, solver variables and progress of each world; `wall` [s] is the wall time so far.

    recorded: the `rows` of the records so far, and further plain values.
    """
    ranks = simulation.model.ranks
    turn = ranks.from_first(lambda: 1 - _valid_turn(directory))
    header = {
        "wall_s": wall, "ranks": ranks.count, "turn": turn,
        "progress": [drive.progress.as_dict() for drive in simulation.drives],
        **(recorded or {"rows": []}),
    }  # fmt: skip
    kept = {
        f"{world}/{name}": value
        for world, drive in enumerate(simulation.drives)
        for name, value in drive.state_dict(copied=False).items()
    }
    (directory / FILE).parent.mkdir(parents=True, exist_ok=True)
    if not ranks.is_first:
        _write(_strip_file(directory, turn, ranks.rank), header, kept)
    ranks.everyone(None)  # the files of all others are complete
    if ranks.is_first:
        _write(directory / FILE, header, kept)


def _write(path: Path, header: Mapping[str, object], kept: Mapping[str, np.ndarray]) -> None:
    write_arrays(path, {"about": np.array(json.dumps(header, default=lambda value: value.item())), **kept})


def _strip_file(directory: Path, turn: int, rank: int) -> Path:
    return directory / FILE.parent / f"strip_{rank:05d}_turn_{turn}.npz"


def _valid_turn(directory: Path) -> int:
    """Turn of the checkpoint in a directory; 0 where none is readable."""
    try:
        return int(_header(directory / FILE).turn)
    except UNUSABLE:
        return 0


def _header(path: Path) -> Values:
    with np.load(path, allow_pickle=False) as file:
        return Values(**json.loads(str(file["about"])))


class Checkpoint:
    """A checkpoint read from a run directory. Raises `RunDirectoryError` if it cannot be used for these ranks."""

    def __init__(self, directory: Path, ranks: Ranks) -> None:
        path = directory / FILE
        try:
            header = _header(path)
            count, self.header = header.ranks, header
            self.progress = [Progress.from_dict(one) for one in header.progress]
            self.rows = [Row(**row) for row in header.rows]
            if count == ranks.count and not ranks.is_first:
                path = _strip_file(directory, header.turn, ranks.rank)
            with np.load(path, allow_pickle=False) as file:
                self._arrays = {name: file[name] for name in file.files if name != "about"}
        except UNUSABLE as error:
            raise RunDirectoryError(f"{path}: not a checkpoint of this version ({error}); start over with --force") from error
        if count != ranks.count:
            raise RunDirectoryError(
                f"{path}: written by {count} ranks, not {ranks.count}; run with mpirun -n {count}, or start over with --force"
            )
        self.wall = float(header.wall_s)

    def restore(self, simulation: Simulation) -> None:
        """Restore state and solver variables, once; `simulation` was made with the progress of this checkpoint."""
        try:
            for world, drive in enumerate(simulation.drives):
                drive.load_state_dict(strip_prefix(f"{world}/", self._arrays))
            self._arrays = {}  # as large as the state
        except (AttributeError, KeyError, ValueError) as error:
            raise RunDirectoryError(f"{FILE}: not a checkpoint of this version ({error}); start over with --force") from error
