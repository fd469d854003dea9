"""`warpknit reflect` as a function, and the reflection of recorded states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..base.errors import INTERRUPTED, InputError, RunDirectoryError
from ..reflection.checks import options_of
from ..reflection.study import reflect
from ..reflection.table import Reflected
from ..results.run import load_run
from ..runner.progress_display import Display
from ..runner.run_directory import CommandResult
from ..scene import Scene
from ..scene.capabilities import refuse

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
