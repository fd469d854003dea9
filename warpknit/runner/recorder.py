"""Files that a run writes: states, rows, summaries, figures, checkpoints.

Every file is written aside and renamed.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from .. import measure
from ..base.errors import OutOfResources, RunDirectoryError
from ..base.files import write_table
from ..compute.memory import available_memory
from ..measure import MeshModel
from ..measure.table import Record
from ..results.frame import Frame, WireLayout, drawn_layout
from ..results.row import Row, write_json
from ..scene import Scene
from ..solve.simulate import Progress, Simulation
from .branches import with_work
from .estimates import Estimator, estimated
from .history import Probe, row_of, with_slides, with_sums, write_history
from .monitor import Checkpoint, LoopResult, Monitor
from .progress_display import Display
from .run_directory import CommandResult, write_scene
from .summary import Estimate, Summary, panel_of, run_summary
from .variants import Means

if TYPE_CHECKING:
    from ..export.frame_files import FrameFiles

RECORD_MEMORY = 400  # bytes a node for writing a record: the frame and its tables
NEEDED_TO_GO_ON = "checkpoint", "variants"  # of an unfinished run
RESERVED_DISK = 64 * 2**10  # [bytes] reserved for summary.json in case the disk is full

ErrorEstimator = Callable[[Record], Estimate]


def open_frames(scene: Scene, layout: WireLayout, out: Path) -> FrameFiles:
    """Writer of the recorded states of a run."""
    from .. import __version__
    from ..export.frame_files import FrameFiles

    if not scene.output.usd:
        return FrameFiles(out, layout, None)
    from ..export.usd.writer import StageWriter

    stage = StageWriter(
        out,
        drawn_layout(layout),
        scene_name=scene.name,
        scene_hash=scene.hash,
        version=__version__,
        colour_stress_max=scene.wire.yield_stress,
        full_every=scene.output.usd_full_every,
        points_per_tile=scene.output.usd_points_per_tile,
    )
    return FrameFiles(out, layout, stage)


def frame_of(record: Record) -> Frame:
    """The recorded state as a frame for the exports."""
    return measure.frame(
        record.observables, index=record.index, stage=record.stage, load_factor=record.load_factor, temperature=record.temperature
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
        error_estimator: ErrorEstimator | None = None,
        probes: Mapping[str, Probe] | None = None,
    ) -> None:
        self.model: MeshModel = simulation.model.global_model
        self.scene: Scene = self.model.scene
        self.simulation = simulation
        self.out = out
        self.display = display
        self.compile_time = compile_time
        self.error_estimator = error_estimator
        self.probes = dict(probes or {})
        self.rows: list[Row] = []
        self.variants: Means | None = None  # how single meshes lie about the mean, where there are several
        self._last: Record | None = None
        self._stage_shown = -1
        self._counted_from: tuple[int, float] | None = None  # steps, and [s] when they were taken, of the rate that is shown
        self.monitor = Monitor(
            simulation, out, wall_before=checkpoint.wall if checkpoint else 0.0, show=self._show, recorded=self._recorded
        )
        if checkpoint is not None:
            self._take_up(checkpoint.rows)
        else:
            write_scene(out, self.scene)
            self.model.layout().save(out / "layout.npz")
        self._reserve = out / ".reserve"
        self._reserve.write_bytes(bytes(RESERVED_DISK))
        with self.monitor.interrupts.handled():  # an interrupt that is raised while USD is imported is lost
            self.frames = open_frames(self.scene, self.model.layout(), self.out)

    def run(self) -> CommandResult[Summary | None]:
        with self.monitor.interrupts.handled(), self.frames:  # a first interrupt waits for what is written
            try:
                loop = self._loop()
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
            reason = "finished" if is_unconverged else loop.reason
            summary = self._write_summary(reason, message)
            self.frames.close(complete=code == 0)
            self._reserve.unlink(missing_ok=True)
            if code == 0:
                for name in NEEDED_TO_GO_ON:
                    shutil.rmtree(self.out / name, ignore_errors=True)
            if self.rows:
                self._export()
        if code:
            return CommandResult(code, summary, message)
        return estimated(self.out, self.scene, summary, self.estimator, self.monitor.interrupts, self.display)

    # --- records ---

    def _loop(self) -> LoopResult:
        return self.monitor.run(self._write_record)

    @property
    def estimator(self) -> Estimator | None:
        """Estimator of the error of the last record of a finished run; None if not requested."""
        find, last = self.error_estimator, self._last
        return None if find is None or last is None else lambda _check: find(last)

    def _write_record(self, record: Record) -> None:
        """Write state, USD frame, maps and last the row of a record."""
        self._reserve_memory()
        row = row_of(record, self.probes)
        self.frames.add_frame(frame_of(record))
        if self.rows and row.is_hook:
            row = with_slides(row, self.rows[-1])
        rows = with_work([*self.rows, row], self.simulation.model)
        tables, panel = panel_of(record)
        for name, table in tables.items():
            write_table(self.out / "panel" / f"{name}_{record.index:06d}.csv", table)
        rows[-1] = with_sums(rows, self.model).changed(panel=panel)
        write_history(self.out / "history.csv", rows)
        self.rows = rows
        if self.error_estimator is not None:
            self._last = record  # else its fields are not kept while the next one is solved

    def _recorded(self) -> dict[str, object]:
        """The rows so far, for a checkpoint, after their frames are on the disk."""
        self.frames.flush()
        return {"rows": [vars(row) for row in self.rows]}

    def _reserve_memory(self) -> None:
        """Raise `OutOfResources` before a library fails for lack of memory."""
        needed, available = RECORD_MEMORY * self.model.node_count, available_memory()
        if needed > available:
            raise OutOfResources(
                f"memory ran out: a record needs {needed / 2**20:,.0f} MiB, {available / 2**20:,.0f} MiB are available"
            )

    @property
    def steps(self) -> int:
        """Time steps so far."""
        return self.simulation.progress.steps

    def _write_summary(self, reason: str, message: str) -> Summary:
        summary = run_summary(
            self.model,
            self.rows,
            stop_reason=reason,
            wall=self.monitor.wall,
            compile_time=self.compile_time,
            steps=self.steps,
            message=message,
            notes=self.simulation.notes,
            variants=self.variants,
        )
        write_json(self.out / "summary.json", summary.json())
        return summary

    def _take_up(self, rows: list[Row]) -> None:
        names = list(self.probes)
        if rows and (began := list(rows[0].probes)) != names:
            raise RunDirectoryError(
                f"{self.out}: the run began with the probes {began}, not {names}; give the same probes, or --force"
            )
        self.rows = rows
        if rows:  # those behind it are solved again
            write_history(self.out / "history.csv", rows)
        else:
            (self.out / "history.csv").unlink(missing_ok=True)

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
        done = (max(0, records) + progress.level_share) / max(1, self.scene.output.levels)
        if isinstance(self.scene.output.frames, str) and self.scene.solver.drive == "relax":
            done = self.rows[-1].load_factor if self.rows and self.rows[-1].stage == progress.stage else 0.0
        self.display.update(done=done, load_factor=progress.load_factor, node_steps_per_s=rate, now=self.simulation.solving)

    # --- exports ---

    def _export(self) -> None:
        from ..export import export_record
        from ..export.knit_figure import knit_figure
        from ..export.run_record import read_run

        output, run = self.scene.output, read_run(self.out)
        run = replace(run, states=run.states[: len(self.rows)])  # a killed run may have left later ones
        for to in ("png",) * output.figures + ("vtk",) * output.vtk:
            export_record(run, to)
        if output.figures and self.model.cloth is not None:
            knit_figure(self.model.cloth, self.scene.wire.thickness, self.out / "figures" / "knit.png")
