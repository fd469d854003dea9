"""A run of the spatial model in its directory: the same files as of a planar one, but no checkpoint.

An interrupted run keeps what it recorded and starts over with --resume.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import Diverged, OutOfResources
from ..files import write_aside
from ..scene import resolved_toml
from ..spatial.mesh import SpatialMesh
from ..spatial.relax import SpatialRecord, SpatialRelaxation
from .history import HookRow, Row, account_sliding, account_work, write_history
from .interrupts import Interrupted, Interrupts
from .progress import Progress as Display
from .spatial_summary import row_of, spatial_summary, stage_summary

if TYPE_CHECKING:
    from ..export.frame_files import FrameWriter


class SpatialRun:
    """Brings the levels of a mesh to rest and writes what it yields."""

    def __init__(self, mesh: SpatialMesh, out: Path, display: Display, frames: FrameWriter) -> None:
        self.mesh, self.out, self.display, self.frames = mesh, out, display, frames
        self.scene = mesh.scene
        self.interrupts = Interrupts()
        self.rows: list[Row] = []
        self.stages: list[dict[str, Any]] = []
        self._shown = -1
        begin = time.perf_counter()
        self.relaxation = SpatialRelaxation(mesh, self._look)
        self.relaxation.warm_up()
        self.compile_time = time.perf_counter() - begin
        self.begin = time.perf_counter()

    def run(self) -> tuple[int, dict[str, Any], str]:
        """Exit status, summary and message."""
        with write_aside(self.out / "scene.toml") as file:
            file.write(resolved_toml(self.scene))
        self.mesh.layout().save(self.out / "layout.npz")
        code, reason, message = 0, "steady", ""
        with self.frames, self.interrupts.caught():
            try:
                for record in self.relaxation.run():
                    self._keep(record)
            except Interrupted:
                code, reason = 130, "interrupted"
                message = f"interrupted; {self.out} keeps what was recorded, --resume starts over"
            except Diverged as error:
                code, reason, message = error.exit_code, "diverged", str(error)
            except (MemoryError, OSError, OutOfResources):
                self._write_summary("interrupted", "ran out of memory or disk")
                raise
            self.frames.flush()
            summary = self._write_summary(reason, message)
            self.frames.close(complete=code == 0)
        if self.scene.output.figures and self.rows:
            from ..export import export_run
            from ..export.knit_figure import knit_figure

            export_run(self.out, "png")
            if self.mesh.cloth is not None:
                knit_figure(self.mesh.cloth, self.scene.wire.diameter, self.out / "figures" / "knit.png")
        if self.scene.output.vtk and self.rows:
            from ..export import export_run

            export_run(self.out, "vtk")
        return code, summary, message

    def _keep(self, record: SpatialRecord) -> None:
        """Write one record: its state, its USD frame, its row; then the stage's summary where the stage ends."""
        row = row_of(record)
        frame = record.reading.frame(
            index=record.index, stage=record.stage, load_factor=record.load_factor, temperature=record.temperature
        )
        if isinstance(row, HookRow):
            frame.body_position[0, :2] = row.body_x_m, row.body_y_m  # where the wires press, once they do
        self.frames.add_frame(frame)
        self.rows.append(row)
        account_work(self.rows, self.mesh)  # type: ignore[arg-type]
        account_sliding(self.rows)
        write_history(self.out / "history.csv", self.rows)
        self.last = record
        if record.load_factor == 1.0:
            self.stages.append(stage_summary(record, self.rows))
            with write_aside(self.out / "stages.json") as file:
                json.dump(self.stages, file, allow_nan=False)

    def _write_summary(self, reason: str, message: str) -> dict[str, Any]:
        stages = self.stages
        if reason != "steady" and self.rows:
            unfinished = stage_summary(self.last, self.rows)
            stages = [s for s in stages if s["name"] != unfinished["name"]] + [unfinished]
        summary = spatial_summary(
            self.mesh,
            self.rows,
            stages,
            notes=self.relaxation.notes,
            stop_reason=reason,
            wall=time.perf_counter() - self.begin,
            compile_time=self.compile_time,
            steps=self.relaxation.steps,
            message=message,
        )
        with write_aside(self.out / "summary.json") as file:
            json.dump(summary, file, indent=2, allow_nan=False)
        return summary

    def _look(self, relaxation: SpatialRelaxation) -> None:
        self.interrupts.check()
        self.frames.check()
        if relaxation.stage_index != self._shown:
            self._shown = relaxation.stage_index
            self.display.stage(relaxation.stage, number=relaxation.stage_index + 1, of=len(self.scene.stages))
        elapsed = time.perf_counter() - self.begin
        self.display.update(
            done=min(1.0, max(0, relaxation.level - 1) / self.scene.output.frames),
            load_factor=relaxation.load_factor,
            node_steps_per_s=relaxation.steps * self.mesh.rods.node_count / elapsed,
        )
