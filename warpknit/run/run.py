"""A run from a scene to a directory: what it leaves there, how it is interrupted, resumed and refused.

DIR holds summary.json, history.csv, scene.toml (resolved), layout.npz, states/state_######.npz, scene.usda with its layers,
figures/*.png and checkpoint/. Every file is written aside and renamed.
"""

from __future__ import annotations

import contextlib
import json
import logging
import math
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import measure
from ..device import find_device
from ..errors import ModelError, OutOfResources, RunDirectoryError
from ..files import held_directory, write_aside, write_table
from ..frame import WireLayout
from ..model.model import Model, available_memory, build_model
from ..model.state import initial_state
from ..ranks.ranks import One, Ranks
from ..scene import Scene, resolved_toml
from ..solve.simulate import Progress, Record, Simulation
from ..spatial.mesh import build_mesh
from .checkpoint import Checkpoint, has_checkpoint
from .history import Row, account_sliding, account_work, read_history, row_of, write_history
from .panel_report import report_panel
from .progress import Progress as Display
from .run_directory import Ending, check_directory, clear, finished_before, make_directory
from .spatial_run import SpatialRun
from .summary import Estimate, run_summary, stage_summary
from .watch import Watch

if TYPE_CHECKING:
    from ..export.frame_files import FrameWriter

_log = logging.getLogger(__name__)

RECORD_MEMORY = 400  # bytes a node that writing a record takes: the frame and its tables
PATIENCE = 30.0  # [s] that an earlier run may take to finish its last frame after it was killed
COMPILING_S = 1.0  # kernels that took longer to be ready were compiled, not loaded


Judge = Callable[[Record], Estimate]


def run_scene(
    scene: Scene,
    *,
    out: Path,
    device: str | None = None,
    resume: bool = False,
    force: bool = False,
    progress: Display | None = None,
    ranks: Ranks | None = None,
    judge: Judge | None = None,
) -> Ending:
    """Run `scene` into the directory `out`; several `ranks` that share it all call this, and the first one writes the results.
    `judge` is asked for the errors of the last state of a run that came to its end.

    Raises `RunDirectoryError`, `DeviceError`, `ModelError`, `KnitError` before anything is written. A divergence ends with
    exit_code 3, an interrupt with 130; what was finished by then is kept.
    """
    ranks = ranks or One()
    finished = ranks.from_first(lambda: _finished_run(scene, out, resume, force))
    if finished is not None:
        return finished
    name = find_device(device, ranks.place)
    if device is None:
        _log.info("running on %s", name if ranks.count == 1 else f"{ranks.count} ranks, this one on {name}")
    if scene.model.kind == "spatial":
        if resume:
            _log.info("the spatial model has no checkpoint: starting over")
        return _run_spatial(scene, out, name, ranks, progress or Display())
    checkpoint = None
    if resume and ranks.from_first(lambda: has_checkpoint(out)):
        checkpoint = Checkpoint(out, scene.hash, ranks)
    elif resume:
        _log.info("%s has no checkpoint: starting over", out)
    model = build_model(scene, name, ranks)
    simulation, compile_time = _ready(model, checkpoint)
    with contextlib.ExitStack() as stack:
        hold = ranks.from_first(lambda: stack.enter_context(_held(out)))
        if checkpoint is None:
            ranks.from_first(lambda: clear(out))
        if not ranks.is_first:
            ending = Watch(simulation, out).run(lambda _record: None)
            return Ending(ending.exit_code, {}, ending.message)
        return _Recorder(model.whole, simulation, out, progress or Display(), compile_time, checkpoint, hold, judge).run()


def _run_spatial(scene: Scene, out: Path, device: str, ranks: Ranks, display: Display) -> Ending:
    """Run the spatial model of a scene, which one process has to itself."""
    if ranks.count > 1:
        raise ModelError(f"model.kind: given 'spatial', which {ranks.count} ranks cannot share: run without mpirun")
    mesh = build_mesh(scene, device)
    with _held(out) as hold:
        clear(out)
        frames = _open_frames(scene, mesh.layout(), out, resume=False, hold=hold)
        return Ending(*SpatialRun(mesh, out, display, frames).run())


def _open_frames(scene: Scene, layout: WireLayout, out: Path, *, resume: bool, hold: int | None) -> FrameWriter:
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


def _finished_run(scene: Scene, out: Path, resume: bool, force: bool) -> Ending | None:
    """The run that `out` holds where there is nothing left to resume. Raises `RunDirectoryError` where `out` cannot be used."""
    if resume and (finished := finished_before(out, "summary.json", scene.hash)) is not None:
        return finished
    check_directory(out, unfinished="run" if has_checkpoint(out) else None, resume=resume, force=force)
    return None


@contextlib.contextmanager
def _held(out: Path) -> Iterator[int | None]:
    """Make the directory and keep other runs out of it."""
    make_directory(out)
    with contextlib.ExitStack() as stack:
        try:
            hold = stack.enter_context(held_directory(out, PATIENCE))
        except BlockingIOError as error:
            raise RunDirectoryError(f"{out}: another run is writing there; --out names another directory") from error
        yield hold


def _ready(model: Model, checkpoint: Checkpoint | None) -> tuple[Simulation, float]:
    """The simulation with its kernels compiled or loaded, and how long that took [s]."""
    begin = time.perf_counter()
    simulation = Simulation(
        model, initial_state(model), progress=checkpoint.progress if checkpoint else None
    )
    simulation.warm_up()
    if checkpoint is not None:
        checkpoint.restore(simulation)
    took = time.perf_counter() - begin
    if took > COMPILING_S:
        _log.info("compiled the kernels in %.0f s; they are kept for the next run", took)
    return simulation, took


class _Recorder:
    """Runs a simulation and writes what it yields."""

    def __init__(
        self,
        model: Model,
        simulation: Simulation,
        out: Path,
        display: Display,
        compile_time: float,
        checkpoint: Checkpoint | None,
        hold: int | None,
        judge: Judge | None,
    ) -> None:
        self.model = model
        self.judge = judge
        self.scene = model.scene
        self.simulation = simulation
        self.out = out
        self.display = display
        self.compile_time = compile_time
        self.rows: list[Row] = []
        self.stages: list[dict[str, Any]] = []
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
            model.layout().save(out / "layout.npz")
        self.frames = _open_frames(model.scene, model.layout(), out, resume=checkpoint is not None, hold=hold)

    def run(self) -> Ending:
        with self.frames:
            try:
                ending = self.watch.run(self._keep)
                self.frames.flush()
            except (MemoryError, OSError, OutOfResources):
                self._write_summary("interrupted", "ran out of memory or disk")
                raise
            code, message = ending.exit_code, ending.message
            unsteady = ending.reason == "steady" and not self.rows[-1].steady
            estimate = self.judge(self.last) if self.judge is not None and code == 0 and hasattr(self, "last") else None
            summary = self._write_summary("finished" if unsteady else ending.reason, message, estimate)
            self.frames.close(complete=code == 0)
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
        frame = measure.frame(
            record.reading,
            index=record.index,
            stage=record.stage,
            load_factor=record.load_factor,
            temperature=record.temperature,
        )
        self.frames.add_frame(frame)
        self.rows.append(row_of(record))
        account_work(self.rows, self.model)
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
            return None
        folder = self.out / "panel"
        write_table(folder / f"map_{record.index:06d}.csv", report.map_table())
        write_table(folder / f"edge_{record.index:06d}.csv", report.edge)
        if report.surface is not None:
            write_table(folder / f"surface_{record.index:06d}.csv", report.surface_table())
        return report.summary

    def _reserve_memory(self) -> None:
        """Raise `OutOfResources` before a library that does not survive it runs out of memory."""
        needed, available = RECORD_MEMORY * self.model.panel.node_count, available_memory()
        if needed > available:
            raise OutOfResources(
                f"memory ran out: a record needs {needed / 2**20:,.0f} MiB, {available / 2**20:,.0f} MiB are available"
            )

    def _write_summary(self, reason: str, message: str, estimate: Estimate | None = None) -> dict[str, Any]:
        stages = self.stages
        if reason in ("diverged", "interrupted") and self.rows and hasattr(self, "last"):
            unfinished = stage_summary(self.last, self.rows)
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
        rate = progress.steps * self.model.panel.node_count / elapsed if elapsed > 0 and progress.steps else None
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
