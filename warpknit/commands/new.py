"""`warpknit new` as a function: the scene is checked, planned and written."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from pathlib import Path

from ..errors import InputError
from ..files import write_aside
from ..knit.chain import KnitError
from ..knit.named import NAMED_KNITS
from ..plan import Plan, make_plan
from ..scene import Scene, make_scene
from ..scene.new_scene import Refused, SceneRequest, check_file_name, check_value, scene_text
from ..scene.wire import Wire
from ..text import exact
from .carried_out import naming_the_file

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


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
        raise InputError(f"{path}: given a directory, allowed: a file to write")
    if not path.parent.is_dir():
        raise InputError(f"{path}: given a directory that does not exist ({path.parent}), allowed: an existing one")
    if not force and path.exists():
        raise InputError(f"{path}: given a file that exists, allowed: another name, or --force to replace it")


def planned_scene(request: SceneRequest, path: Path) -> tuple[str, Scene, Plan]:
    """The text of the file of a request, its scene and its plan. Raises the errors of `warpknit plan`."""
    text = scene_text(request, path.name)
    scene = make_scene(tomllib.loads(text), path=path)
    try:
        with naming_the_file(scene):
            return text, scene, make_plan(scene, "cpu")
    except InputError as error:
        if isinstance(error.__cause__, KnitError):
            wales, courses = request.spacings
            tight = error.__cause__
            remedy = "fewer wales, more courses" if "course spacings" in tight.allowed else "fewer wales"
            allowed = f"{remedy} or thinner wire ({tight.key} {tight.allowed})"
            raise InputError(f"--wales, --courses: given {wales!r} and {courses!r}, allowed: {allowed}") from error
        raise


def new_command(request: SceneRequest, path: Path, *, force: bool) -> list[tuple[str, str]]:
    """Write the scene of a request; return the lines of its table."""
    _refuse_existing(path, force)
    text, scene, plan = planned_scene(request, path)
    with write_aside(path) as file:
        file.write(text)
    wire, knit = scene.wire, request.named
    wales, courses = request.spacings
    return [
        ("scene", str(path)),
        ("knit", f"{knit.name}, {knit.title}: {' and '.join(str(bar) for bar in knit.bars)}"),
        ("", plan.knit),
        ("wire", f"{f'{wire.ends} x ' if wire.ends > 1 else ''}{exact(wire.diameter, 'm')} {wire.material}{_plated(wire)}"),
        ("model", f"{plan.kind}, {plan.kind_reason}"),
        ("mesh", f"{plan.nodes:,} nodes, {plan.bodies:,} {plan.hooked_by}"),
        *(("warning", warning) for warning in plan.warnings),
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
