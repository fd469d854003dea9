"""Files that a run writes: states, rows, summaries, figures, checkpoints.

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
from ..base.files import write_aside, write_table
from ..compute.memory import available_memory
from ..errors import OutOfResources, RunDirectoryError
from ..measure import MeshModel
from ..measure.table import Record
from ..mesh.layout import contact_classes
from ..results.frame import Frame, WireLayout
from ..scene import Scene, resolved_toml
from ..solve.simulate import Progress, Simulation
from .checkpoint import Checkpoint
from .history import Row, add_sliding, extra_columns, read_history, row_of, write_history
from .panel_report import cord_summary, report_panel
from .probes import Probes
from .progress_display import Progress as Display
from .run_directory import CommandResult
from .summary import Estimate, run_summary, stage_summary
from .watch import Watch
from .work import add_work

if TYPE_CHECKING:
    from ..export.writer_process import FrameWriter

RECORD_MEMORY = 400  # bytes a node for writing a record: the frame and its tables
RESERVED_DISK = 64 * 2**10  # [bytes] reserved for summary.json in case the disk is full

ErrorEstimator = Callable[[Record], Estimate]


def open_frames(scene: Scene, layout: WireLayout, out: Path, *, resume: bool, hold: int | None) -> FrameWriter:
    """Writer of the recorded states of a run."""
    from .. import __version__
    from ..export.writer_process import StageOptions, frame_writer

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
    """The recorded state as a frame for the exports."""
    return measure.frame(
        record.observables,
        index=record.index,
        stage=record.stage,
        load_factor=record.load_factor,
        temperature=record.temperature,
    )


class Recorder:
    """Runs a simulation and writes its records; `error_estimator` estimates the error of the last one of a finished run."""

    def __init__(
        self,
        simulation: Simulation,
        out: Path,
        display: Display,
        compile_time: float,
        checkpoint: Checkpoint | None,
        hold: int | None,
        error_estimator: ErrorEstimator | None = None,
        probes: Probes | None = None,
    ) -> None:
        self.model: MeshModel = simulation.model.global_model
        self.scene: Scene = self.model.scene
        self.simulation = simulation
        self.out = out
        self.display = display
        self.compile_time = compile_time
        self.error_estimator = error_estimator
        self.probes = probes or Probes()
        self.rows: list[Row] = []
        self.stages: list[dict[str, Any]] = []  # summaries at the last record of each stage
        self._last: Record | None = None
        self._stage_shown = -1
        self._counted_from: tuple[int, float] | None = None  # steps, and [s] when they were taken, of the rate that is shown
        self.watch = Watch(
            simulation,
            out,
            wall_before=checkpoint.wall if checkpoint else 0.0,
            show=self._show,
            recorded=self._recorded,
        )
        if checkpoint is not None:
            self._load_rows()
            self.stages = checkpoint.stages
        else:
            with write_aside(out / "scene.toml") as file:
                file.write(resolved_toml(self.scene))
            self.model.layout().save(out / "layout.npz")
        self._reserve = out / ".reserve"
        self._reserve.write_bytes(bytes(RESERVED_DISK))
        with self.watch.interrupts.handled():  # an interrupt that is raised while USD is imported is lost
            self.frames = open_frames(self.scene, self.model.layout(), out, resume=checkpoint is not None, hold=hold)

    def run(self) -> CommandResult:
        with self.frames:
            try:
                loop = self.watch.run(self._write_record)
                self.frames.flush()
            except (MemoryError, OSError, OutOfResources):
                self._reserve.unlink(missing_ok=True)
                self._write_summary("interrupted", "ran out of memory or disk")
                raise
            except KeyboardInterrupt:  # the second one, which stops without a checkpoint
                self._write_summary("interrupted", "interrupted")
                raise
            code, message = loop.exit_code, loop.message
            is_unconverged = loop.reason == "steady" and not self.rows[-1].steady
            estimate = None
            if code == 0 and self.error_estimator is not None and self._last is not None:
                estimate = self.error_estimator(self._last)
            summary = self._write_summary("finished" if is_unconverged else loop.reason, message, estimate)
            self.frames.close(complete=code == 0)
        self._reserve.unlink(missing_ok=True)
        if self.scene.output.figures and self.rows:
            self._draw()
        if self.scene.output.vtk and self.rows:
            from ..export import export_run

            export_run(self.out, "vtk")
        if code == 0:
            shutil.rmtree(self.out / "checkpoint", ignore_errors=True)
        return CommandResult(code, summary, message)

    # --- records ---

    def _write_record(self, record: Record) -> None:
        """Write the state, the USD frame, the maps and last the row of a record, which counts from then on."""
        self._reserve_memory()
        row = row_of(record)
        vars(row).update(self.probes.values(record))
        self.frames.add_frame(frame_of(record))
        rows = [*self.rows, row]
        add_work(rows, self.simulation.model)
        add_sliding(rows)
        edge = self._write_panel(record) if record.load_factor == 1.0 else cord_summary(record)
        stage = stage_summary(record, rows, edge, self.probes.names)
        write_history(self.out / "history.csv", rows)
        self.rows = rows
        self.stages = [one for one in self.stages if one["name"] != record.stage] + [stage]
        if self.error_estimator is not None:
            self._last = record  # else its fields are not kept while the next one is solved

    def _recorded(self) -> list[dict[str, Any]]:
        """Summaries of the stages so far, for a checkpoint, whose frames are on the disk then."""
        self.frames.flush()
        return self.stages

    def _write_panel(self, record: Record) -> dict[str, Any] | None:
        """Write the maps of a panel at the end of a stage; return its part of the summary."""
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
        """Raise `OutOfResources` before a library fails for lack of memory."""
        needed, available = RECORD_MEMORY * self.model.node_count, available_memory()
        if needed > available:
            raise OutOfResources(
                f"memory ran out: a record needs {needed / 2**20:,.0f} MiB, {available / 2**20:,.0f} MiB are available"
            )

    def _write_summary(self, reason: str, message: str, estimate: Estimate | None = None) -> dict[str, Any]:
        summary = run_summary(
            self.model,
            self.rows,
            self.stages,
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
        """Load the rows up to the checkpoint, and remove later ones from history.csv: their records are solved again."""
        count, path = self.simulation.progress.records, self.out / "history.csv"
        self.rows = read_history(path)[:count] if count else []
        if len(self.rows) < count:
            raise RunDirectoryError(f"{self.out}: history.csv is shorter than the checkpoint; start over with --force")
        probed = extra_columns(vars(self.rows[0])) if self.rows else self.probes.names
        if probed != self.probes.names:
            raise RunDirectoryError(
                f"{self.out}: the run began with the probes {probed}, not {self.probes.names}; give those, or --force"
            )
        if self.rows:
            write_history(path, self.rows)
        else:
            path.unlink(missing_ok=True)

    # --- while it runs ---

    def _show(self, progress: Progress) -> None:
        self.frames.check()
        stages = self.scene.stages
        if progress.stage_index != self._stage_shown:
            self._stage_shown = progress.stage_index
            self.display.stage(stages[progress.stage_index].name, number=progress.stage_index + 1, of=len(stages))
        clock = time.perf_counter()
        if self._counted_from is None or not progress.steps:  # before, the smaller meshes of a large one are solved
            self._counted_from = progress.steps, clock
        before, begin = self._counted_from
        rate = (progress.steps - before) * self.model.node_count / (clock - begin) if progress.steps > before else None
        records = progress.level - (progress.stage_index == 0)  # the first stage begins with the unloaded state
        is_search = self.scene.solver.drive == "relax" and any(stages[progress.stage_index].by_tension)
        done = (max(0, records) + progress.level_share) / max(1, self.scene.output.levels)
        if isinstance(self.scene.output.frames, str) and self.scene.solver.drive == "relax":
            done = self.rows[-1].load_factor if self.rows and self.rows[-1].stage == progress.stage else 0.0
        self.display.update(
            done=None if is_search else done,
            load_factor=progress.load_factor,
            node_steps_per_s=rate,
            now=self.simulation.solving,
        )

    # --- exports ---

    def _draw(self) -> None:
        from ..export import export_run

        export_run(self.out, "png")
        if self.model.cloth is not None:
            from ..export.knit_figure import knit_figure

            classes = contact_classes(self.scene)
            knit_figure(self.model.cloth, self.scene.wire.thickness, self.out / "figures" / "knit.png", classes=classes)


def _finite(tree: Any) -> Any:
    """The tree with None in place of numbers that are not finite."""
    if isinstance(tree, dict):
        return {key: _finite(value) for key, value in tree.items()}
    if isinstance(tree, list | tuple):
        return [_finite(value) for value in tree]
    if isinstance(tree, float) and not math.isfinite(tree):
        return None
    return tree
