"""From a command with an exit status to a function that returns a `Run`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import INTERRUPTED, Diverged, ModelError, in_python, naming_arguments
from ..knit.chain import KnitError
from ..results.run import Run, load_run
from ..runner.interrupts import to_continue
from ..runner.progress_display import Progress, progress_for
from ..runner.run_directory import CommandResult, directory_of
from ..scene import Scene
from ..scene.messages import scene_error
from ..scene.options import DEFAULT, GIVEN

Source = str | os.PathLike[str] | Mapping[str, Any] | Scene  # what `load_scene` takes
Directory = str | os.PathLike[str]


def carried_out(
    scene: Scene,
    out: Directory | None,
    quiet: bool,
    command: Callable[[Path, Progress], CommandResult],
    *,
    resume: bool,
    force: bool,
) -> Run:
    """The results of a command in its directory; what its exit status says is raised.

    resume: whether it already continues an interrupted one, of itself or by the argument.
    """
    where = default_directory(scene) if out is None else directory_of(out, "out")
    with naming_arguments(), naming_the_file(scene), progress_for(quiet=quiet) as progress:
        result = command(where, progress)
    if result.exit_code == INTERRUPTED:
        raise KeyboardInterrupt(result.message + in_python(to_continue("call", resume=resume, force=force)))
    if result.exit_code != 0:
        raise Diverged(result.message)
    return load_run(where)


def default_directory(scene: Scene) -> Path:
    """Where results go if nothing else is said."""
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
