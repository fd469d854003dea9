"""What a run writes as it goes on and at its end, whatever its model: states, rows, summaries, figures, checkpoints.

Every file is written aside and renamed.
"""

from __future__ import annotations

import json
import math
import shutil
import time
from abc import ABC, abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import OutOfResources, RunDirectoryError
from ..files import write_aside
from ..frame import Frame, WireLayout
from ..knit.cloth import Cloth
from ..memory import available_memory
from ..scene import Scene, resolved_toml
from ..solve.simulate import Progress, Record, Simulation
from .checkpoint import Checkpoint
from .history import Row, account_sliding, account_work, read_history, write_history
from .progress import Progress as Display
from .run_directory import Ending
from .summary import Estimate
from .watch import Watch

if TYPE_CHECKING:
    from ..export.frame_files import FrameWriter

RECORD_MEMORY = 400  # bytes a node that writing a record takes: the frame and its tables
RESERVED_DISK = 64 * 2**10  # [bytes] kept free for summary.json of a run whose disk is full


def open_frames(scene: Scene, layout: WireLayout, out: Path, *, resume: bool, hold: int | None) -> FrameWriter:
    """Where the recorded states of a run go."""
    from .. import __version__
    from ..export.frame_files import StageOptions
    from ..export.writer_process import frame_writer

    stage = StageOptions(
        scene_name=scene.name,
        scene_hash=scene.hash,
        version=__version__,
        colour_stress_max=scene.wire.yield_stress,
        full_every=scene.output.usd_full_every,
        points_per_tile=scene.output.usd_points_per_tile,
    )
    return frame_writer(out, layout, stage if scene.output.usd else None, resume=resume, hold=hold)


class Recorder(ABC):
    """Runs a simulation and writes what it yields; what a record says, those for a model know."""

    def __init__(
        self,
        simulation: Simulation,
        out: Path,
        display: Display,
        compile_time: float,
        checkpoint: Checkpoint | None,
        hold: int | None,
    ) -> None:
        self.scene: Scene = simulation.model.scene
        self.simulation = simulation
        self.out = out
        self.display = display
        self.compile_time = compile_time
        self.rows: list[Row] = []
        self.stages: list[dict[str, Any]] = []
        self.last: Record | None = None
        self._stage_shown = -1
        self.watch = Watch(
            simulation,
            out,
            wall_before=checkpoint.wall if checkpoint else 0.0,
            show=self._show,
            before_checkpoint=lambda: self.frames.flush(),  # a checkpoint is not ahead of the frames that it counts
        )
        if checkpoint is not None:
            self._recall()
        else:
            with write_aside(out / "scene.toml") as file:
                file.write(resolved_toml(self.scene))
            self.layout.save(out / "layout.npz")
        self._reserve = out / ".reserve"
        self._reserve.write_bytes(bytes(RESERVED_DISK))
        self.frames = open_frames(self.scene, self.layout, out, resume=checkpoint is not None, hold=hold)

    def run(self) -> Ending:
        with self.frames:
            try:
                ending = self.watch.run(self._keep)
                self.frames.flush()
            except (MemoryError, OSError, OutOfResources):
                self._reserve.unlink(missing_ok=True)
                self._write_summary("interrupted", "ran out of memory or disk")
                raise
            code, message = ending.exit_code, ending.message
            unsteady = ending.reason == "steady" and not self.rows[-1].steady
            estimate = self.estimate() if code == 0 else None
            summary = self._write_summary("finished" if unsteady else ending.reason, message, estimate)
            self.frames.close(complete=code == 0)
        self._reserve.unlink(missing_ok=True)
        if self.scene.output.figures and self.rows:
            self._draw()
        if self.scene.output.vtk and self.rows:
            from ..export import export_run

            export_run(self.out, "vtk")
        if code == 0:
            shutil.rmtree(self.out / "checkpoint", ignore_errors=True)
        return Ending(code, summary, message)

    # --- what a model has of its own

    @property
    @abstractmethod
    def layout(self) -> WireLayout:
        """How the wires of the whole mesh are laid out."""

    @property
    @abstractmethod
    def nodes(self) -> int:
        """Of the whole mesh."""

    @property
    def cloth(self) -> Cloth | None:
        """What was knitted; None where nothing was."""
        return self.simulation.model.cloth

    @abstractmethod
    def row_of(self, record: Any) -> Row:
        """The row of history.csv."""

    @abstractmethod
    def frame_of(self, record: Any, row: Row) -> Frame:
        """The state for the exports."""

    @abstractmethod
    def stage_summary(self, record: Any, *, ended: bool) -> dict[str, Any]:
        """What the summary says of a stage; `ended` where this is its last record."""

    @abstractmethod
    def summary(self, stages: list[dict[str, Any]], **how: Any) -> dict[str, Any]:
        """The whole of summary.json; `how` goes to `run_summary`."""

    def estimate(self) -> Estimate | None:
        """How far the last record may be from the true one, where that is asked for."""
        return None

    # --- records ---

    def _keep(self, record: Record) -> None:
        """Write one record: its state, its USD frame, its row; then the stage's summary where the stage ends."""
        self._reserve_memory()
        row = self.row_of(record)
        self.frames.add_frame(self.frame_of(record, row))
        self.rows.append(row)
        account_work(self.rows, self.simulation.model)
        account_sliding(self.rows)
        write_history(self.out / "history.csv", self.rows)
        if record.load_factor == 1.0:
            self.stages.append(self.stage_summary(record, ended=True))
            with write_aside(self.out / "stages.json") as file:
                json.dump(self.stages, file, allow_nan=False)
        self.last = record

    def _reserve_memory(self) -> None:
        """Raise `OutOfResources` before a library that does not survive it runs out of memory."""
        needed, available = RECORD_MEMORY * self.nodes, available_memory()
        if needed > available:
            raise OutOfResources(
                f"memory ran out: a record needs {needed / 2**20:,.0f} MiB, {available / 2**20:,.0f} MiB are available"
            )

    def _write_summary(self, reason: str, message: str, estimate: Estimate | None = None) -> dict[str, Any]:
        stages = self.stages
        if reason in ("diverged", "interrupted") and self.last is not None:
            unfinished = self.stage_summary(self.last, ended=False)
            stages = [s for s in stages if s["name"] != unfinished["name"]] + [unfinished]
        summary = self.summary(
            stages,
            stop_reason=reason,
            wall=self.watch.wall,
            compile_time=self.compile_time,
            steps=self.simulation.progress.steps,
            message=message,
            estimate=estimate,
        )
        with write_aside(self.out / "summary.json") as file:
            json.dump(_finite(summary), file, indent=2, allow_nan=False)
        return summary

    def _recall(self) -> None:
        """Take up the rows and stage summaries that stand in the directory, up to the checkpoint."""
        count = self.simulation.progress.records
        self.rows = read_history(self.out / "history.csv")[:count] if count else []
        if len(self.rows) < count:
            raise RunDirectoryError(f"{self.out}: history.csv is shorter than the checkpoint: start over with --force")
        path = self.out / "stages.json"
        if path.exists():
            done = self.simulation.progress.stage_index
            self.stages = json.loads(path.read_text(encoding="utf-8"))[:done]

    # --- while it runs ---

    def _show(self, progress: Progress) -> None:
        self.frames.check()
        stages = self.scene.stages
        if progress.stage_index != self._stage_shown:
            self._stage_shown = progress.stage_index
            self.display.stage(stages[progress.stage_index].name, number=progress.stage_index + 1, of=len(stages))
        elapsed = time.perf_counter() - self.watch.begin
        # none while a large mesh waits for its smaller ones
        rate = progress.steps * self.nodes / elapsed if elapsed > 0 and progress.steps else None
        records = progress.level - (progress.stage_index == 0)  # the first stage begins with the unloaded state
        self.display.update(
            done=min(1.0, max(0, records) / max(1, self.scene.output.frames)),
            load_factor=progress.load_factor,
            node_steps_per_s=rate,
        )

    # --- exports ---

    def _draw(self) -> None:
        from ..export import export_run

        export_run(self.out, "png")
        if self.cloth is not None:
            from ..export.knit_figure import knit_figure

            knit_figure(self.cloth, self.scene.wire.diameter, self.out / "figures" / "knit.png")


def _finite(tree: Any) -> Any:
    """The same with None for numbers that are not finite: no file holds a NaN."""
    if isinstance(tree, dict):
        return {key: _finite(value) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [_finite(value) for value in tree]
    if isinstance(tree, float) and not math.isfinite(tree):
        return None
    return tree
