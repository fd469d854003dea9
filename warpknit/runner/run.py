"""Runs a scene into a directory, with interrupt and resume."""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Iterator, Mapping
from pathlib import Path

from ..base.errors import RunDirectoryError
from ..base.files import held_directory
from ..base.text import percent
from ..compute.device import compile_times, find_device
from ..compute.ranks import Ranks
from ..mesh.layout import mesh_nodes
from ..results.row import Values, read_rows
from ..scene import Scene
from ..scene.capabilities import refuse
from ..solve.model import build_model
from ..solve.simulate import Simulation
from .estimates import COMPLETE, estimated_again
from .history import Probe, checked_probes
from .monitor import FILE, Checkpoint, Monitor
from .progress_display import Display
from .recorder import ErrorEstimator, Recorder
from .run_directory import CommandResult, check_directory, clear, make_directory
from .summary import Summary
from .variants_recorder import MeshGroups, VariantsRecorder

_log = logging.getLogger(__name__)

LEAST_SHARED = 10_000  # nodes of a mesh from which on two ranks are as fast as two threads (docs/studies/performance.md)
LOCK_TIMEOUT = 30.0  # [s] for an interrupted run to end


def run_scene(
    scene: Scene,
    *,
    out: Path,
    device: str | None = None,
    resume: bool = False,
    force: bool = False,
    progress: Display | None = None,
    ranks: Ranks | None = None,
    error_estimator: ErrorEstimator | None = None,
    probes: Mapping[str, Probe] | None = None,
) -> CommandResult[Summary | None]:
    """Run `scene` into the directory `out`, on several `ranks` if given. The first one writes the results. `error_estimator`
    estimates the error of the last state of a finished run; `probes` are further columns of history.csv.

    Raises `RunDirectoryError`, `DeviceError`, `ModelError`, `KnitError` before anything is written. A divergence ends with
    exit_code 3, an interrupt with 130; what was finished by then is kept.
    """
    ranks, own = ranks or Ranks(), checked_probes(probes)
    refuse(scene, "run", ranks=ranks.count)
    finished, continues = ranks.from_first(lambda: _earlier_run(scene, out, resume, force, list(own)))
    if finished is not None and (finished.message != COMPLETE or not ranks.is_first):
        return CommandResult(0, finished)
    name = find_device(device, ranks.place, lambda: mesh_nodes(scene))
    if finished is not None:
        with _locked(out, 0.0):
            return estimated_again(scene, out, finished, name, progress or Display())
    if ranks.count > 1 and device is not None and name != "cpu":
        _log.warning("warning W62: --device %s puts all %d ranks on one GPU; leave it out to use all GPUs of the machine",
                     name, ranks.count)  # fmt: skip
    checkpoint = Checkpoint(out, ranks) if continues else None
    if resume and checkpoint is None:
        _log.warning("warning W63: --resume: %s has no checkpoint; a new run begins", out)
    several = MeshGroups(scene, name, checkpoint) if scene.variants.count > 1 else None
    model = build_model(scene, name, ranks) if several is None else several.simulation.model
    if ranks.count > 1 and ranks.is_first and model.global_model.node_count < LEAST_SHARED:
        _log.warning("warning W64: run without mpirun: a mesh of %s nodes is slower on %d ranks",
                     f"{model.global_model.node_count:,}", ranks.count)  # fmt: skip
    with compile_times() as times:
        progress_so_far = checkpoint.progress[0] if checkpoint else None
        simulation = Simulation(model, progress=progress_so_far) if several is None else several.simulation
        simulation.compile()
        if checkpoint is not None:
            checkpoint.restore(simulation)
    if progress_so_far is not None and several is None:
        stage = scene.stages[min(progress_so_far.stage_index, len(scene.stages) - 1)]
        _log.info("resumed at %s of load step %s", percent(progress_so_far.load_factor), stage.name)
    compile_time = sum(times)
    if times:
        _log.info("compiled the kernels in %d s; they are kept for the next run", math.ceil(compile_time))
    with contextlib.ExitStack() as stack:
        ranks.from_first(lambda: stack.enter_context(_locked(out, 0.0)))
        if device is None:
            _log.info("running on %s", name if ranks.count == 1 else f"{ranks.count} ranks, this one on {name}")
        if checkpoint is None:
            ranks.from_first(lambda: clear(out))
        if not ranks.is_first:
            loop = Monitor(simulation, out).run(lambda _record: None)
            return CommandResult(loop.exit_code, None, loop.message)
        where = (out, progress or Display(), compile_time, checkpoint)
        if several is not None:
            return VariantsRecorder(several, *where, probes=own).run()
        return Recorder(simulation, *where, error_estimator, own).run()


def _earlier_run(scene: Scene, out: Path, resume: bool, force: bool, probes: list[str]) -> tuple[Summary | None, bool]:
    """The finished run in `out` on --resume; whether to continue a checkpoint. Raises `RunDirectoryError`.

    An interrupted run may still write its checkpoint: --resume and --force wait for it, a new run does not.
    """
    if out.is_dir():
        with _locked(out, LOCK_TIMEOUT if resume or force else 0.0):
            pass
    finished, continues = check_directory(out, "run", scene, resume=resume, force=force)
    if finished is None:
        return None, continues and (out / FILE).is_file()
    if missing := set(probes) - set(vars(read_rows(out / "history.csv", Values)[0]) if probes else ()):
        raise RunDirectoryError(f"{out}: contains the finished run without the probe {min(missing)}; run it again with --force")
    return Summary.of(finished), False


@contextlib.contextmanager
def _locked(out: Path, patience: float) -> Iterator[None]:
    """Make the directory and lock it against other runs, `patience` [s] after them at most."""
    make_directory(out)
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(held_directory(out, patience))
        except BlockingIOError as error:
            raise RunDirectoryError(f"{out}: another run is writing there; give another directory with --out") from error
        yield
