"""`warpknit new` as a function: the scene is checked, planned and written."""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import TypeVar

import click
from scipy.constants import inch

from ..base import toml
from ..base.errors import InputError
from ..base.files import write_aside
from ..base.text import either, exact
from ..knit.lapping import KnitError
from ..knit.named import NAMED_KNITS, named_knit
from ..mesh.layout import knit_scene
from ..results.finding import Finding
from ..scene import Scene, make_scene
from ..scene.materials import MATERIALS
from ..scene.new_scene import SceneRequest, check_file_name, scene_text
from ..scene.scene_loader import first_sentence, nearest_scene, shipped_scenes
from .plan import Overview, overview_of
from .run import naming_the_file

DENSEST = 4.0  # times the courses that were asked for: the most that are tried


def file_of(name: str, *, force: bool) -> Path:
    """The file of a name, with .toml at its end. Raises `InputError` for a file that exists, unless `force`."""
    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    check_file_name(path.name)
    if path.is_dir():
        raise InputError(f"{path}: is a directory; give the name of a file")
    if not path.parent.is_dir():
        raise InputError(f"{path}: the directory {path.parent} does not exist; make it, or give another")
    if not force and path.exists():
        raise InputError(f"{path}: the file exists; give another name, or --force to replace it")
    return path


def planned_scene(request: SceneRequest, path: Path) -> tuple[str, Scene, Overview]:
    """Text of the scene file, its scene and its plan. Raises the errors of `warpknit plan`."""
    text = scene_text(request, path.name)
    scene = make_scene(toml.loads(text), path=path)
    try:
        with naming_the_file(scene):
            return text, scene, overview_of(scene, "cpu")
    except InputError as error:
        tight = error.__cause__
        if not isinstance(tight, KnitError):
            raise
        asked, gauges = request.filled_in, [] if tight.key == "knit" else list(_gauges(request, scene))
        given = f"wire of {exact(scene.wire.diameter, 'm')} with {asked.wales!r} and {asked.courses!r}"
        instead = f"use {either([*gauges, 'thinner wire'])}; in a scene, {tight.instead}" if gauges else tight.instead
        wrong = f"no room for {given} ({tight.key}: {tight.wrong})"
        raise InputError(f"--diameter, --wales, --courses: {wrong}; {instead}") from error


def _gauges(request: SceneRequest, scene: Scene) -> Iterator[str]:
    """Nearest feasible wales an inch, and courses; each with the other as given."""
    wales, courses = (inch / spacing for spacing in (scene.knit.wale_spacing, scene.knit.course_spacing))
    fewer, more = range(math.ceil(wales) - 1, 0, -1), range(math.floor(courses) + 1, math.ceil(DENSEST * courses))
    for kind, counts, other in (("wales", fewer, "courses"), ("courses", more, "wales")):
        found = next((count for count in counts if _has_room(replace(request, **{kind: f"{count} /inch"}))), None)
        if found is not None:
            yield f"{found} {kind} an inch with these {other}"


def _has_room(request: SceneRequest) -> bool:
    try:
        knit_scene(make_scene(toml.loads(scene_text(request, ""))))
    except (KnitError, InputError):
        return False
    return True


def new_command(request: SceneRequest, path: Path, *, force: bool) -> list[Finding]:
    """Write the scene of a request; return the lines of its table."""
    text, scene, overview = planned_scene(request, path)
    file_of(str(path), force=force)  # which may have come to exist since it was named
    with write_aside(path) as file:
        file.write(text)
    wire, knit = scene.wire, named_knit(request.knit)
    plated = "" if wire.plating is None else f", plated with {exact(wire.plating.thickness, 'm')} of {wire.plating.material}"
    lines = (
        ("scene", str(path)),
        ("knit", f"{knit.name}: {' and '.join(str(bar) for bar in knit.bars)}"),
        ("", overview.mesh[0][1]),
        ("wire", f"{f'{wire.ends} x ' if wire.ends > 1 else ''}{exact(wire.diameter, 'm')} {wire.material}{plated}"),
        ("model", f"{scene.model.kind} ({scene.kind_reason})"),
        *overview.mesh[1:],
        *(("warning", str(warning)) for warning in overview.warnings),
        ("next", f"warpknit plan {shlex.quote(str(path))}"),
        ("", f"warpknit run {shlex.quote(str(path))}"),
    )
    return [Finding(*line) for line in lines]


def copy_scene(name: str, path: Path) -> list[Finding]:
    """Copy the scene of a name to a file; return the lines of its table. Raises `InputError`."""
    if name not in shipped_scenes():
        nearest = nearest_scene(Path(name))
        raise InputError(f"--from: {name!r} is not a scene; " + (f"the nearest is {nearest}" if nearest else "see --list"))
    text = shipped_scenes()[name].read_text(encoding="utf-8")
    make_scene(toml.loads(text), path=path)  # raises where it needs a file beside it
    with write_aside(path) as file:
        file.write(text)
    return [Finding("scene", str(path)), Finding("next", f"warpknit run {shlex.quote(str(path))}")]


def names_list() -> list[str]:
    """The knits by name, with chains and a line about each, then the scenes."""
    width = max(map(len, (*NAMED_KNITS, *shipped_scenes()))) + 2
    lines = ["Knits, their bars from back to front:", ""]
    for knit in NAMED_KNITS.values():
        lines.append(f"{knit.name:<{width}}{'  '.join(f'[{bar}]' if ' ' in str(bar) else str(bar) for bar in knit.bars)}")
        lines.append(f"{'':<{width}}{knit.about}")
    lines += ["", "Scenes, for warpknit run NAME:", ""]
    return lines + [f"{name:<{width}}{first_sentence(path)}" for name, path in shipped_scenes().items()]


T = TypeVar("T")
MESH = ("diameter", "ends", "wales", "courses")  # asked again where they do not go together
QUESTIONS = {
    "knit": "Knit",
    "material": f"Wire material ({', '.join(MATERIALS)})",
    "plating": "Plating (none, or such as gold, 0.2 um)",
    "diameter": "Wire diameter, without plating",
    "ends": "Wires in a yarn",
    "wales": "Wales per inch, or with a unit",
    "courses": "Courses per inch, or with a unit",
    "load": "Load: a strain, or a tension such as 2 N/m; two with a comma for weft and warp",
    "model": "Model (auto, planar, spatial)",
}


def on_terminal() -> bool:
    """Whether there is someone to ask."""
    return sys.stdin.isatty() and sys.stdout.isatty()


def ask(given: Mapping[str, str], path: Path | None, *, force: bool) -> tuple[SceneRequest, Path]:
    """Ask for what is not given: the request, and the file to write. Raises click's Abort at Ctrl-C and at the end of input."""
    request = SceneRequest(**given)
    click.echo("Return accepts the value in brackets; Ctrl-C quits without a file.\n")
    if "knit" not in given:
        width = max(map(len, NAMED_KNITS))
        click.echo("\n".join(f"  {knit.name:<{width}}  {knit.about}" for knit in NAMED_KNITS.values()) + "\n")

    def answered(request: SceneRequest, *names: str) -> SceneRequest:
        return reduce(_answered, (name for name in names if name not in given), request)

    request = answered(request, "knit", "material", "plating", *MESH)
    while True:
        try:
            planned_scene(request, Path("scene.toml"))
            break
        except InputError as fault:
            if set(MESH) <= given.keys():
                raise
            click.echo(f"Error: {fault}")
            request = answered(request, *MESH)
    request = answered(request, "load", "model")
    if path is None:
        path = _prompt("File", f"{named_knit(request.knit).name}.toml", lambda name: file_of(name, force=force))
    click.echo()
    return request, path


def _answered(request: SceneRequest, name: str) -> SceneRequest:
    return _prompt(QUESTIONS[name], getattr(request.filled_in, name), lambda answer: replace(request, **{name: answer}))


def _prompt(question: str, default: str, value_of: Callable[[str], T]) -> T:
    """Ask until the answer has a value."""

    def converted(answer: str) -> T:
        try:
            return value_of(answer.strip())
        except InputError as error:
            raise click.UsageError(str(error)) from error

    try:
        answer: T = click.prompt(question, default=default, value_proc=converted)
    except click.Abort:
        click.echo()  # behind the question
        raise
    return answer
