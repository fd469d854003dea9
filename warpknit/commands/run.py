"""`warpknit run`, `warpknit map` and `warpknit reflect` as functions."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ..base.errors import FINISHED, INTERRUPTED, Diverged, InputError, ModelError, RunDirectoryError, in_python, naming_arguments
from ..compute.ranks import Ranks
from ..knit.lapping import KnitError
from ..reflection.study import options_of, reflect
from ..reflection.table import Reflected
from ..results.run import Run, load_run
from ..runner.history import Probe
from ..runner.interrupts import to_continue
from ..runner.progress_display import Display, progress_for
from ..runner.run import run_scene
from ..runner.run_directory import CommandResult, directory_of
from ..runner.summary import Summary
from ..scene import Scene, load_scene
from ..scene.capabilities import refuse
from ..scene.messages import scene_error
from ..scene.options import DEFAULT, GIVEN
from ..scene.overrides import as_written
from ..scene.units import QuantityError, has_unit, shown, si, tidy
from ..studies.contact_map import MapSummary
from ..studies.sweep import run_map as sweep_scene

Source = str | os.PathLike[str] | Mapping[str, Any] | Scene  # what `load_scene` takes
Directory = str | os.PathLike[str]


def finished_run(
    scene: Scene, out: Directory | None, quiet: bool, command: Callable[..., CommandResult[Any]], *, resume: bool, force: bool
) -> Run:
    """The results of a command in its directory; what its exit status says is raised.

    resume: whether it already continues an interrupted one, of itself or by the argument.
    """
    where = default_directory(scene) if out is None else directory_of(out, "out")
    with naming_arguments(), at_work(scene, quiet=quiet) as progress:
        result = command(where, resume=resume, force=force, progress=progress)
    if result.exit_code == INTERRUPTED:
        go_on = in_python(to_continue("call", resume=resume, force=force)) if result.goes_on else ""
        raise KeyboardInterrupt(result.message + go_on)
    if result.exit_code != FINISHED:
        raise Diverged(result.message)
    return load_run(where)


@contextmanager
def at_work(scene: Scene, *, quiet: bool) -> Iterator[Display]:
    """Show the progress of a command, and name the scene file in its errors."""
    with naming_the_file(scene), progress_for(quiet=quiet) as progress:
        yield progress


def default_directory(scene: Scene) -> Path:
    """Default directory of the results of a scene."""
    return Path("runs") / scene.name


@contextmanager
def naming_the_file(scene: Scene) -> Iterator[None]:
    """Prefix errors of the knit and the model with the scene file."""
    try:
        yield
    except KnitError as error:
        raise scene_error(scene.path, error.key, error.wrong, error.instead) from error
    except ModelError as error:
        chosen = "" if scene.kind_reason in (GIVEN, DEFAULT) else f" (model.kind = '{scene.model.kind}': {scene.kind_reason})"
        raise type(error)(f"{scene.path}: {error}{chosen}") from error


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
    """Run a scene into the directory `out`, and return its results.

        run = warpknit.run("scenes/atlas_cell.toml", "runs/cell")
        run.summary["contacts"]["active_percent"]
        run.history["tension_weft_N_per_m"]                                  # [record] [N/m]

    scene: a `Scene`, or a source for `load_scene`. out: default `runs/<scene name>`.
    device: "cpu" or "cuda:0"; default: the first CUDA device for meshes of 10,000 nodes or more, else the CPU.
    error: [%] 2 or "2 %": choose the cheapest settings within this error, and estimate the error of the run.
    probes: functions of a `Record` by name (docs/python.md); each becomes a column of history.csv and a key of the summary.
        run(scene, out, probes={"height_m": lambda record: float(np.ptp(record.observables.node_position[:, 2]))})
    resume: continue an interrupted run in `out`; the results of a finished run of the same scene are returned as they are.
    force: replace earlier results in `out`. quiet: show no progress.

    Raises InputError (a scene, a key, a device, a directory), Diverged, OutOfResources, and KeyboardInterrupt with a checkpoint
    written. The finished records are then in `out`: `load_run(out)`.
    """
    loaded = load_scene(scene, command="run" if error is None else "error")
    command = partial(run_command, loaded, device=device, error=error, probes=probes)
    return finished_run(loaded, out, quiet, command, resume=resume, force=force)


def run_command(
    scene: Scene,
    out: Path,
    *,
    device: str | None,
    error: float | str | None,
    resume: bool,
    force: bool,
    progress: Display,
    probes: Mapping[str, Probe] | None = None,
    ranks: Ranks | None = None,
) -> CommandResult[Summary | None]:
    """`warpknit run`: with the settings for an `error` [%] where it is given. Raises as `run_scene` does."""
    estimator, ranks = None, ranks or Ranks()
    if error is not None:
        percent = percentage(error)
        from ..studies.probe_run import estimate_of, settings_for_error

        refuse(scene, "error", ranks=ranks.count)
        setting = ranks.from_first(lambda: settings_for_error(scene, percent))
        estimator = partial(estimate_of, scene=scene, setting=setting, percent=percent)
        scene = load_scene(scene, setting.overrides, command="error", ranks=ranks.count)
    command = partial(
        run_scene, scene, out=out, device=device, resume=resume, force=force, progress=progress, ranks=ranks,
        error_estimator=estimator, probes=probes,
    )  # fmt: skip
    return with_reflection(scene, out, progress, command, is_first=ranks.is_first)


def percentage(given: float | str) -> float:
    """The percentage of `--error`: a number, or text such as "2" or "2 %". Raises `InputError`."""
    try:
        number = si(as_written(given, "--error"), "number")
        value = tidy(100.0 * number) if isinstance(given, str) and has_unit(given) else number
    except QuantityError:
        value = 0.0
    if not 0.0 < value <= 100.0:
        raise InputError(f"--error: {shown(given)} is not a percentage above 0 and at most 100; write one such as 2 or '2 %'")
    return value


def run_map(
    scene: Source, out: Directory | None = None, *, resume: bool = False, force: bool = False, quiet: bool = False
) -> Run:
    """Run all loads of [sweep] into the directory `out`, and return the results.

        run = warpknit.run_map("scenes/contact_map.toml", "runs/map")
        run.summary["optimum"]["strain_weft"]
        run.tables["map"]["active_percent"]                                  # [pair of strains] [%]
        run.tables["map"].grid("active_percent", "strain_warp", "strain_weft")  # (warp, weft) [%]

    scene, out, resume, force, quiet and exceptions: as in `run`. Maps run on the CPU.
    """
    loaded = load_scene(scene, command="map")
    return finished_run(loaded, out, quiet, partial(map_command, loaded), resume=resume, force=force)


def map_command(
    scene: Scene, out: Path, *, resume: bool, force: bool, progress: Display, device: str | None = None
) -> CommandResult[MapSummary]:
    """`warpknit map`. Raises as `sweep_scene` does."""
    refuse(scene, "map")
    command = partial(
        sweep_scene, scene, out=out, device=device, resume=resume, force=force, progress=progress,
        keep_states=scene.reflection is not None,
    )  # fmt: skip
    return with_reflection(scene, out, progress, command)


# --- reflection

TABLE = "reflection."  # the keys that may be set for finished results


def reflect_command(directory: Path, overrides: Sequence[str], progress: Display) -> Reflected:
    """Solve the waves from the states of finished results. Raises InputError, RunDirectoryError, KeyboardInterrupt.

    overrides: keys of [reflection] that replace keys of their scene.
    """
    for override in overrides:
        if not override.startswith(TABLE):
            raise InputError(f"--set: {override!r} is not of [reflection]; other keys need a new run")
    run = load_run(directory)
    if not {"stages", "cells"} & set(run.summary):
        raise RunDirectoryError(f"{directory}: has no states; give the directory of a run or a map")
    scene = run.scene.changed(overrides)
    refuse(scene)
    return reflect(directory, scene, progress)


def with_reflection(
    scene: Scene, directory: Path, progress: Display, command: Callable[[], CommandResult[Any]], *, is_first: bool = True
) -> CommandResult[Any]:
    """The result of a command; if it finished and its scene has [reflection], the waves from its states are in `directory`.

    is_first: whether this rank solves the waves. Raises InputError for a [reflection] that cannot be solved.
    """
    if scene.reflection is not None:
        options_of(scene)
    result = command()
    if scene.reflection is not None and is_first and result.exit_code == 0 and not (directory / "reflection.csv").exists():
        try:
            reflect(directory, scene, progress)
        except KeyboardInterrupt as stop:
            return replace(result, exit_code=INTERRUPTED, message=str(stop) or "interrupted")
    return result
