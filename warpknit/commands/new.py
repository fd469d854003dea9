"""`warpknit new` as a function: the scene is checked, planned and written."""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from scipy.constants import inch

from ..base.files import write_aside
from ..base.text import either, exact
from ..errors import InputError
from ..knit.chain import KnitError
from ..knit.named import NAMED_KNITS
from ..mesh.layout import knit_scene
from ..scene import Scene, make_scene
from ..scene.new_scene import Refused, SceneRequest, check_file_name, check_value, scene_text
from ..scene.wire import Wire
from .carried_out import naming_the_file
from .plan import Outline, outline_of

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


DENSEST = 4.0  # times the courses that were asked for: the most that are tried


def checked_request(given: Mapping[str, str]) -> SceneRequest:
    """The request of the values of options. Raises `InputError`, which names the option."""
    for name, value in given.items():
        try:
            check_value(name, value)
        except Refused as error:
            raise InputError(f"--{name}: {error}") from error
    return SceneRequest(**given)


def file_of(name: str, *, force: bool) -> Path:
    """The file of a name, with .toml at its end. Raises `InputError` for a file that exists, unless `force`."""
    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    try:
        check_file_name(path.name)
    except Refused as error:
        raise InputError(f"FILE: {error}") from error
    _refuse_existing(path, force)
    return path


def _refuse_existing(path: Path, force: bool) -> None:
    """Refuse to overwrite a file without `force`, and a directory. Raises `InputError`."""
    if path.is_dir():
        raise InputError(f"{path}: a directory; give a file to write")
    if not path.parent.is_dir():
        raise InputError(f"{path}: the directory {path.parent} does not exist; make it, or name another")
    if not force and path.exists():
        raise InputError(f"{path}: the file exists; give another name, or --force to replace it")


def planned_scene(request: SceneRequest, path: Path) -> tuple[str, Scene, Outline]:
    """The text of the file of a request, its scene and what would run. Raises the errors of `warpknit plan`."""
    text = scene_text(request, path.name)
    scene = make_scene(tomllib.loads(text), path=path)
    try:
        with naming_the_file(scene):
            return text, scene, outline_of(scene, "cpu")
    except InputError as error:
        if isinstance(error.__cause__, KnitError):
            wales, courses = request.spacings
            tight = error.__cause__
            loop = [f"in a scene {tight.key} {tight.instead.removeprefix('write ')}"] if "loop" in tight.key else []
            instead = either([*_gauges(request, scene), "thinner wire", *loop])
            given = f"wire of {exact(scene.wire.diameter, 'm')} with {wales!r} and {courses!r}"
            wrong = f"no room for {given} ({tight.key}: {tight.wrong})"
            raise InputError(f"--diameter, --wales, --courses: {wrong}; use {instead}") from error
        raise


def _gauges(request: SceneRequest, scene: Scene) -> Iterator[str]:
    """The nearest wales and courses an inch at which the loops of a request have room, each with the other as given."""
    wales, courses = (inch / spacing for spacing in (scene.knit.wale_spacing, scene.knit.course_spacing))
    fewer, more = range(math.ceil(wales) - 1, 0, -1), range(math.floor(courses) + 1, math.ceil(DENSEST * courses))
    for kind, counts, other in (("wales", fewer, "courses"), ("courses", more, "wales")):
        found = next((count for count in counts if _has_room(replace(request, **{kind: f"{count} /inch"}))), None)
        if found is not None:
            yield f"{found} {kind} an inch with these {other}"


def _has_room(request: SceneRequest) -> bool:
    """Whether the knit of a request can be laid out."""
    try:
        knit_scene(make_scene(tomllib.loads(scene_text(request, ""))))
    except (KnitError, InputError):
        return False
    return True


def new_command(request: SceneRequest, path: Path, *, force: bool) -> list[tuple[str, str]]:
    """Write the scene of a request; return the lines of its table."""
    _refuse_existing(path, force)
    text, scene, outline = planned_scene(request, path)
    with write_aside(path) as file:
        file.write(text)
    wire, knit = scene.wire, request.named
    wales, courses = request.spacings
    return [
        ("scene", str(path)),
        ("knit", f"{knit.name}, {knit.title}: {' and '.join(str(bar) for bar in knit.bars)}"),
        ("", outline.mesh[0][1]),
        ("wire", f"{f'{wire.ends} x ' if wire.ends > 1 else ''}{exact(wire.diameter, 'm')} {wire.material}{_plated(wire)}"),
        ("model", f"{scene.model.kind} ({scene.kind_reason})"),
        *outline.mesh[1:],
        *(("warning", warning) for warning in outline.warnings),
        ("next", f"warpknit plan {shlex.quote(str(path))}"),
        ("", f"warpknit run {shlex.quote(str(path))}"),
    ]


def _plated(wire: Wire) -> str:
    """The coating of the wire, in words."""
    return "" if wire.plating is None else f", plated with {exact(wire.plating.thickness, 'm')} of {wire.plating.material}"


def knit_list() -> list[str]:
    """The knits by name, with chains and a line about each."""
    width = max(map(len, NAMED_KNITS)) + 2
    lines = ["Knits, their bars from back to front:", ""]
    for knit in NAMED_KNITS.values():
        lines.append(f"{knit.name:<{width}}{'  '.join(f'[{bar}]' if ' ' in str(bar) else str(bar) for bar in knit.bars)}")
        lines.append(f"{'':<{width}}{knit.about}")
    return lines
