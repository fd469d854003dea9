"""What a run writes as it goes on and at its end, whatever its model: states, rows, summaries, figures, checkpoints.

Every file is written aside and renamed.
"""

from __future__ import annotations

import json
import math
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import measure
from ..errors import OutOfResources, RunDirectoryError
from ..files import write_aside, write_table
from ..frame import Frame, WireLayout
from ..measure import MeshModel
from ..measure.table import Record
from ..memory import available_memory
from ..scene import Scene, resolved_toml
from ..solve.simulate import Progress, Simulation
from .checkpoint import Checkpoint
from .history import Row, account_sliding, account_work, read_history, row_of, write_history
from .panel_report import cord_summary, report_panel
from .progress_display import Progress as Display
from .run_directory import Ending
from .summary import Estimate, run_summary, stage_summary
from .watch import Watch

if TYPE_CHECKING:
    from ..export.frame_files import FrameWriter

RECORD_MEMORY = 400  # bytes a node that writing a record takes: the frame and its tables
RESERVED_DISK = 64 * 2**10  # [bytes] kept free for summary.json of a run whose disk is full

Judge = Callable[[Record], Estimate]


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


def frame_of(record: Record) -> Frame:
    """The state for the exports."""
    return measure.frame(
        record.observables,
        index=record.index,
        stage=record.stage,
        load_factor=record.load_factor,
        temperature=record.temperature,
    )


class Recorder:
    """Runs a simulation and writes what it yields; `judge` is asked for the errors of the last record of a run that came to its
    end."""

    def __init__(
        self,
        simulation: Simulation,
        out: Path,
        display: Display,
        compile_time: float,
        checkpoint: Checkpoint | None,
        hold: int | None,
        judge: Judge | None = None,
    ) -> None:
        self.model: MeshModel = simulation.model.whole
        self.scene: Scene = self.model.scene
        self.simulation = simulation
        self.out = out
        self.display = display
        self.compile_time = compile_time
        self.judge = judge
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
            self._load_rows()
        else:
            with write_aside(out / "scene.toml") as file:
                file.write(resolved_toml(self.scene))
            self.model.layout().save(out / "layout.npz")
        self._reserve = out / ".reserve"
        self._reserve.write_bytes(bytes(RESERVED_DISK))
        self.frames = open_frames(self.scene, self.model.layout(), out, resume=checkpoint is not None, hold=hold)

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
            estimate = self.judge(self.last) if code == 0 and self.judge is not None and self.last is not None else None
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

    # --- records ---

    def _keep(self, record: Record) -> None:
        """Write one record: its state, its USD frame, its row; then the stage's summary where the stage ends."""
        self._reserve_memory()
        row = row_of(record)
        self.frames.add_frame(frame_of(record))
        self.rows.append(row)
        account_work(self.rows, self.simulation.model)
        account_sliding(self.rows)
        write_history(self.out / "history.csv", self.rows)
        if record.load_factor == 1.0:
            self.stages.append(stage_summary(record, self.rows, self._keep_panel(record)))
            with write_aside(self.out / "stages.json") as file:
                json.dump(self.stages, file, allow_nan=False)
        self.last = record

    def _keep_panel(self, record: Record) -> dict[str, Any] | None:
        """Write the maps of a panel at the end of a stage; what the summary says of it."""
        report = report_panel(record)
        if report is None:
            return cord_summary(record)
        folder = self.out / "panel"
        write_table(folder / f"map_{record.index:06d}.csv", report.map_table())
        write_table(folder / f"edge_{record.index:06d}.csv", report.edge)
        if report.surface is not None:
            write_table(folder / f"surface_{record.index:06d}.csv", report.surface_table())
        return report.summary

    def _reserve_memory(self) -> None:
        """Raise `OutOfResources` before a library that does not survive it runs out of memory."""
        needed, available = RECORD_MEMORY * self.model.node_count, available_memory()
        if needed > available:
            raise OutOfResources(
                f"memory ran out: a record needs {needed / 2**20:,.0f} MiB, {available / 2**20:,.0f} MiB are available"
            )

    def _write_summary(self, reason: str, message: str, estimate: Estimate | None = None) -> dict[str, Any]:
        stages = self.stages
        if reason in ("diverged", "interrupted") and self.last is not None:
            unfinished = stage_summary(self.last, self.rows, cord_summary(self.last))
            stages = [s for s in stages if s["name"] != unfinished["name"]] + [unfinished]
        summary = run_summary(
            self.model,
            self.rows,
            stages,
            stop_reason=reason,
            wall=self.watch.wall,
            compile_time=self.compile_time,
            steps=self.simulation.progress.steps,
            message=message,
            notes=self.simulation.notes,
            estimate=estimate,
        )
        with write_aside(self.out / "summary.json") as file:
            json.dump(_finite(summary), file, indent=2, allow_nan=False)
        return summary

    def _load_rows(self) -> None:
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
        rate = progress.steps * self.model.node_count / elapsed if elapsed > 0 and progress.steps else None
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
        if self.model.cloth is not None:
            from ..export.knit_figure import knit_figure

            knit_figure(self.model.cloth, self.scene.wire.diameter, self.out / "figures" / "knit.png")


def _finite(tree: Any) -> Any:
    """The same with None for numbers that are not finite: no file holds a NaN."""
    if isinstance(tree, dict):
        return {key: _finite(value) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [_finite(value) for value in tree]
    if isinstance(tree, float) and not math.isfinite(tree):
        return None
    return tree
