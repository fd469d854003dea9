"""A run from a scene to a directory: what it leaves there, how it is interrupted, resumed and refused.

DIR holds summary.json, history.csv, scene.toml (resolved), layout.npz, states/state_######.npz, scene.usda with its layers,
figures/*.png and checkpoint/. Every file is written aside and renamed.
"""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from .. import measure
from ..device import find_device
from ..errors import RunDirectoryError
from ..files import held_directory, write_table
from ..frame import Frame, WireLayout
from ..model import build_model
from ..ranks.ranks import One, Ranks
from ..scene import Scene
from ..scene.capabilities import refuse
from ..solve.simulate import Record, Simulation
from .checkpoint import Checkpoint, has_checkpoint
from .history import Row, row_of
from .panel_report import report_panel
from .progress import Progress as Display
from .recorder import Recorder
from .run_directory import Ending, check_directory, clear, finished_before, make_directory
from .spatial_run import SpatialRecorder
from .summary import Estimate, run_summary, stage_summary
from .watch import Watch

_log = logging.getLogger(__name__)

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
    refuse(scene, "run", ranks=ranks.count)
    finished = ranks.from_first(lambda: _finished_run(scene, out, resume, force))
    if finished is not None:
        return finished
    name = find_device(device, ranks.place)
    if device is None:
        _log.info("running on %s", name if ranks.count == 1 else f"{ranks.count} ranks, this one on {name}")
    checkpoint = None
    if resume and ranks.from_first(lambda: has_checkpoint(out)):
        checkpoint = Checkpoint(out, scene.hash, ranks)
    elif resume:
        _log.info("%s has no checkpoint: starting over", out)
    simulation, compile_time = _ready(_simulation(scene, name, ranks, checkpoint), checkpoint)
    with contextlib.ExitStack() as stack:
        hold = ranks.from_first(lambda: stack.enter_context(_held(out)))
        if checkpoint is None:
            ranks.from_first(lambda: clear(out))
        if not ranks.is_first:
            ending = Watch(simulation, out).run(lambda _record: None)
            return Ending(ending.exit_code, {}, ending.message)
        where = (out, progress or Display(), compile_time, checkpoint, hold)
        if scene.model.kind == "spatial":
            return SpatialRecorder(simulation, *where, judge=judge).run()
        return _PlanarRecorder(simulation.model.whole, simulation, *where, judge=judge).run()


def _simulation(scene: Scene, device: str, ranks: Ranks, checkpoint: Checkpoint | None) -> Simulation:
    """What runs the scene, from where a checkpoint stands."""
    model = build_model(scene, device, ranks)
    return Simulation(model, progress=checkpoint.progress if checkpoint else None)


def _finished_run(scene: Scene, out: Path, resume: bool, force: bool) -> Ending | None:
    """The run that `out` holds where there is nothing left to resume. Raises `RunDirectoryError` where `out` cannot be used."""
    if resume and (finished := finished_before(out, "summary.json", scene.hash)) is not None:
        return finished
    check_directory(out, "run", resume=resume, force=force)
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


def _ready(simulation: Simulation, checkpoint: Checkpoint | None) -> tuple[Simulation, float]:
    """The simulation with its kernels compiled or loaded, and how long that took [s]."""
    begin = time.perf_counter()
    simulation.compile()
    if checkpoint is not None:
        checkpoint.restore(simulation)
    took = time.perf_counter() - begin
    if took > COMPILING_S:
        _log.info("compiled the kernels in %.0f s; they are kept for the next run", took)
    return simulation, took


class _PlanarRecorder(Recorder):
    """Of the planar model, the whole of it where ranks share the mesh."""

    def __init__(self, model: Any, simulation: Simulation, *where: Any, judge: Judge | None) -> None:
        self.model, self.judge = model, judge
        super().__init__(simulation, *where)

    @property
    def layout(self) -> WireLayout:
        return self.model.layout()

    @property
    def nodes(self) -> int:
        return self.model.panel.node_count

    def row_of(self, record: Record) -> Row:
        return row_of(record)

    def frame_of(self, record: Record, row: Row) -> Frame:
        return measure.frame(
            record.observables,
            index=record.index,
            stage=record.stage,
            load_factor=record.load_factor,
            temperature=record.temperature,
        )

    def stage_summary(self, record: Record, *, ended: bool) -> dict[str, Any]:
        return stage_summary(record, self.rows, self._keep_panel(record) if ended else None)

    def summary(self, stages: list[dict[str, Any]], **how: Any) -> dict[str, Any]:
        return run_summary(self.model, self.rows, stages, **how)

    def estimate(self) -> Estimate | None:
        return self.judge(self.last) if self.judge is not None and isinstance(self.last, Record) else None

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
