"""The questions of `warpknit new` on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import click

from ..errors import InputError
from ..knit.named import NAMED_KNITS
from ..scene.materials import MATERIALS
from ..scene.new_scene import SceneRequest, check_value
from .new import checked_request, file_of, planned_scene

T = TypeVar("T")
NO_PLATING = "none"
MESH = ("diameter", "ends", "wales", "courses")  # asked again where they do not go together


def on_terminal() -> bool:
    """Whether there is someone to ask."""
    return sys.stdin.isatty() and sys.stdout.isatty()


def ask(given: Mapping[str, str], path: Path | None, *, force: bool) -> tuple[SceneRequest, Path]:
    """Ask for what is not given: the request, and the file to write. Raises click's Abort at Ctrl-C and at the end of input."""
    request = checked_request(given)
    click.echo("Return takes the value in brackets, Ctrl-C ends without a file.\n")
    if "knit" not in given:
        width = max(map(len, NAMED_KNITS))
        click.echo("\n".join(f"  {knit.name:<{width}}  {knit.about}" for knit in NAMED_KNITS.values()) + "\n")

    def answered(request: SceneRequest, *names: str) -> SceneRequest:
        for name in (name for name in names if name not in given):
            request = replace(request, **{name: _answer(name, request)})
        return request

    request = answered(request, "knit", "material", "plating", *MESH)
    while (fault := _fault(request)) is not None:
        if set(MESH) <= given.keys():
            raise fault
        click.echo(f"Error: {fault}")
        request = answered(request, *MESH)
    request = answered(request, "load", "model")
    if path is None:
        path = _prompt("File", f"{request.named.name}.toml", lambda name: file_of(name, force=force))
    click.echo()
    return request, path


def _answer(name: str, request: SceneRequest) -> str:
    """The answer to the question about a value."""
    wales, courses = request.spacings
    question, default = {
        "knit": ("Knit", request.knit),
        "material": (f"Wire material ({', '.join(MATERIALS)})", request.material),
        "plating": ("Plating (none, or such as gold, 0.2 um)", request.plating or NO_PLATING),
        "diameter": ("Wire diameter, without plating", request.diameter),
        "ends": ("Wires in a yarn", request.ends),
        "wales": ("Wales per inch, or with a unit", wales),
        "courses": ("Courses per inch, or with a unit", courses),
        "load": ("Load: a strain, or a tension such as 2 N/m; two with a comma for weft and warp", request.loading),
        "model": ("Model (auto, planar, spatial)", request.model),
    }[name]

    def checked(answer: str) -> str:
        if (name, answer) == ("plating", NO_PLATING):
            return ""
        check_value(name, answer)
        return answer

    return _prompt(question, default, checked)


def _prompt(question: str, default: str, value_of: Callable[[str], T]) -> T:
    """Ask until the answer has a value."""

    def converted(answer: str) -> T:
        try:
            return value_of(answer.strip())
        except ValueError as error:
            raise click.UsageError(str(error)) from error

    try:
        answer: Any = click.prompt(question, default=default, value_proc=converted)
    except click.Abort:
        click.echo()  # behind the question
        raise
    return answer


def _fault(request: SceneRequest) -> InputError | None:
    """Why the mesh of a request cannot be made."""
    try:
        planned_scene(request, Path("scene.toml"))
    except InputError as error:
        return error
    return None
