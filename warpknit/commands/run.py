"""`warpknit run` as a function."""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from ..compute.ranks import One, Ranks
from ..errors import InputError
from ..results.run import Run
from ..runner.probes import Probe
from ..runner.progress_display import Progress
from ..runner.run import run_scene
from ..runner.run_directory import CommandResult
from ..scene import Scene, load_scene
from ..scene.capabilities import refuse
from ..scene.units import QuantityError, has_unit, shown, si, tidy
from .carried_out import Directory, Source, carried_out


def run(
    scene: Source,
    out: Directory | None = None,
    *,
    device: str | None = None,
    error: float | str | None = None,
    probes: Mapping[str, Probe] | None = None,
    resume: bool = False,
    force: bool = False,
    quiet: bool = False,
) -> Run:
    """Run a scene into the directory `out`, as `warpknit run` does, and return its results.

        run = warpknit.run("scenes/atlas_cell.toml", "runs/cell")
        run.summary["contacts"]["active_percent"]
        run.history["tension_weft_N_per_m"]                                  # [record] [N/m]

    scene: a `Scene`, or what `load_scene` takes. out: default `runs/<scene name>`.
    device: "cpu" or "cuda:0"; default: the first CUDA device for meshes of 10,000 nodes or more, else the CPU.
    error: [%] 2 or "2 %": choose the cheapest settings within this error, and estimate the error of the run.
    probes: own measures by name, functions of a `Record` (docs/python.md): a column of history.csv and a key of the summary each.
        run(scene, out, probes={"height_m": lambda record: float(np.ptp(record.observables.node_position[:, 2]))})
    resume: continue an interrupted run in `out`; the results of a finished run of the same scene are returned as they are.
    force: replace earlier results in `out`. quiet: show no progress.

    Raises InputError (a scene, a key, a device, a directory), Diverged, OutOfResources, and KeyboardInterrupt with a checkpoint
    written. What was finished by then is in `out`: `load_run(out)`.
    """
    loaded = load_scene(scene, command="run" if error is None else "error")
    return carried_out(
        loaded,
        out,
        quiet,
        lambda where, progress: run_command(
            loaded, where, device=device, error=error, probes=probes, resume=resume, force=force, progress=progress
        ),
        resume=resume,
        force=force,
    )


def run_command(
    scene: Scene,
    out: Path,
    *,
    device: str | None,
    error: float | str | None,
    resume: bool,
    force: bool,
    progress: Progress,
    probes: Mapping[str, Probe] | None = None,
    ranks: Ranks | None = None,
) -> CommandResult:
    """`warpknit run`: with the settings for an `error` [%] where it is given. Raises as `run_scene` does."""
    estimator, ranks = None, ranks or One()
    if error is not None:
        percent = percentage(error)
        from ..studies.error_estimate import settings_for_error

        refuse(scene, "error", ranks=ranks.count)
        bound = ranks.from_first(lambda: settings_for_error(scene, percent))
        estimator = bound.error_estimator(scene)
        scene = load_scene(scene, bound.overrides, command="error", ranks=ranks.count)
    return run_scene(
        scene,
        out=out,
        device=device,
        resume=resume,
        force=force,
        progress=progress,
        ranks=ranks,
        error_estimator=estimator,
        probes=probes,
    )


def percentage(given: float | str) -> float:
    """The percentage of `--error`: a number, or text such as "2" or "2 %". Raises `InputError`."""
    value = math.nan
    if isinstance(given, str):
        with suppress(QuantityError):
            value = tidy(100.0 * si(given, "number")) if has_unit(given) else si(given, "number")
    elif isinstance(given, numbers.Real) and not isinstance(given, bool):
        value = float(given)
    if not 0.0 < value <= 100.0:
        text = shown(given) if math.isnan(value) or isinstance(given, str) else f"{given:g}"
        raise InputError(f"--error: {text} is not a percentage above 0, up to 100; give one, such as 2 or '2 %'")
    return value
