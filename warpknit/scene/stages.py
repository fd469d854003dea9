"""Stages of the loading from `[load]` and `[[path]]`; a missing key keeps the value of the stage before."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic_core import PydanticCustomError

from ..base.text import at_least, at_most, both, exact
from .keys import as_object, given_values
from .knit import Hook, Knit
from .messages import Location, Source, scene_error
from .options import SIDES, Pull, Stage
from .outline import Outline
from .panel_options import PanelOptions
from .scene import SceneFile
from .units import tidy
from .values import STRAIN
from .wire import Wire
from .wire_file import (
    LOOP_SIZE,
    MOST_THICKNESS,
    POLYLINES,
    SUFFIXES,
    USD,
    WITH_WIDTHS,
    WITHOUT_UNIT,
    WireArrays,
    WireFile,
    WireFileError,
    WiresTable,
    checked_bytes,
)

FARTHEST_PULL = 0.5  # of the width of a panel: largest pull
NEAR_EDGE = 0.1  # of the width of a panel: largest distance of a pull from its edge


def stages_of(source: Source, file: SceneFile, wire: Wire, knit: Knit, panel: PanelOptions, hook: Hook | None) -> Iterator[Stage]:
    """Stages of [load] and each [[path]]; a missing key keeps the value of the stage before."""
    load = Stage(
        strain_weft=0.0,
        strain_warp=0.0,
        displacement=None if hook is None else 0.0,
        shear=0.0,
        clamp_rotation=0.0,
        temperature=wire.reference_temperature,
        temperature_gradient=(0.0, 0.0),
        pull=(),
    )
    outline = panel.shape(knit.size)
    for location, name, table in _named_stages(source, file):
        given = given_values(table) | {"name": name}
        if hook is not None and "displacement" in given:
            given["shear"] = given["displacement"] / hook.height
            wrong = "is above the length of a wire"
            source.limit((*location, "displacement"), abs(given["displacement"]), wrong, most=hook.length)
        elif "displacement" in given:
            given |= _displaced(source, (*location, "displacement"), given.pop("displacement"), knit)
        for side in SIDES:
            if f"strain_{side}" in given or f"tension_{side}" in given:
                given = {f"strain_{side}": None, f"tension_{side}": None} | given
        for index, pull in enumerate(given.get("pull", ())):
            _check_pull(source, file, (*location, "pull", index), pull, outline)
        load = replace(load, **given)
        _check_temperature(source, location, load, outline)
        yield load


def _check_temperature(source: Source, location: Location, load: Stage, outline: Outline) -> None:
    from_middle = outline.corners - (outline.low + 0.5 * outline.size)
    there = load.temperature + from_middle @ np.array(load.temperature_gradient)
    if there.min() <= 0.0 or there.max() > 4000.0:
        wrong = f"gives temperatures from {there.min():.6g} K to {there.max():.6g} K at the edge"
        instead = "write one that keeps them above 0 K and at most at 4000 K"
        raise source.refusal((*location, "temperature_gradient"), load.temperature_gradient, wrong, instead)


def _check_pull(source: Source, file: SceneFile, location: Location, pull: Pull, outline: Outline) -> None:
    size = float(outline.size.min())
    wrong = f"is above {FARTHEST_PULL:g} of the panel's width"
    source.limit((*location, "by"), math.hypot(*pull.by), wrong, most=FARTHEST_PULL * size)
    middle = outline.low + 0.5 * outline.size
    _, away = outline.nearest((middle + np.array(pull.at))[None])
    if away[0] > NEAR_EDGE * size:
        near, found = at_most(NEAR_EDGE * size, "m"), at_least(float(away[0]), "m")
        wrong = f"is {found} away from the edge of the panel"
        raise source.refusal((*location, "at"), pull.at, wrong, f"write a place within {near}")
    if (pull.width is None) == (file.panel.grip_pitch is None):
        wrong, instead = "is missing", "write the length of the edge that is displaced"
        if pull.width:
            wrong, instead = "has no effect with panel.grip_pitch, where net nodes move", "leave it out"
        raise source.refusal((*location, "width"), pull.width or "a width", wrong, instead)


def _named_stages(source: Source, file: SceneFile) -> Iterator[tuple[Location, str, Stage]]:
    tables: list[tuple[Location, Stage]] = [(("load",), file.load)]
    tables += [(("path", index), table) for index, table in enumerate(file.path)]
    names: set[str] = set()
    for number, (location, table) in enumerate(tables, start=1):
        name = table.name or ("load" if number == 1 else f"stage-{number}")
        if name in names:
            raise source.refusal((*location, "name"), name, "is the name of another load step", "write another name")
        names.add(name)
        yield location, name, table


def _displaced(source: Source, location: Location, displacement: float, knit: Knit) -> dict[str, float]:
    """The strains for an outward displacement of every side by `displacement` [m]."""
    strains = {f"strain_{side}": tidy(2 * displacement / size) for side, size in zip(SIDES, knit.size, strict=True)}
    for name, strain in strains.items():
        try:
            STRAIN(strain)
        except PydanticCustomError as error:
            wrong = f"gives {name} = {strain:.6g}"
            instead = f"write one that gives strains {STRAIN.allowed.removeprefix('a number ')}"
            raise source.refusal(location, displacement, wrong, instead) from error
    return strains


SHORTEST = 0.5  # radii of wire
LEAST_OVERLAP = 1.5  # diameters of the wire
LEAST_RADIUS = 4.0  # diameters of the wire


def hook_of(source: Source, file: SceneFile, wire: Wire) -> Hook | None:
    """The hook with its defaults, or None. Raises `SceneError` for values out of range or excluded with a hook."""
    table = file.hook
    if table is None:
        return None
    length = 2.0 * math.pi / 3.0 * table.radius if table.length is None else table.length
    overlap = 0.2 * table.radius if table.overlap is None else table.overlap
    wrong = f"is below {LEAST_RADIUS:g} diameters of the wire"
    source.limit(("hook", "radius"), table.radius, wrong, least=LEAST_RADIUS * wire.diameter)
    wrong = "is not from half a radius to half a circle"
    source.limit(("hook", "length"), length, wrong, least=SHORTEST * table.radius, most=math.pi * table.radius)
    rise = table.radius * (1.0 - math.cos(0.5 * length / table.radius))
    wrong = "does not let the wires cross twice, with room for a body in between"
    source.limit(("hook", "overlap"), overlap, wrong, least=LEAST_OVERLAP * wire.diameter, most=rise)
    usual, crossing = file.model.of_kind.crossing, table.crossing_distance
    if usual is not None:
        crossing = usual * wire.thickness if crossing is None else crossing
        wrong = "is not from the thickness of the wire to hook.overlap"
        source.limit(("hook", "crossing_distance"), crossing, wrong, least=wire.thickness, most=overlap)
    return replace(table, length=length, overlap=overlap, crossing_distance=crossing)


def file_diameter(source: Source, file: SceneFile) -> float | None:
    """[m] Diameter of the thickest wire in a file whose widths count; None: they do not. Raises `SceneError`."""
    table = file.wires
    is_given = "diameter" in source.table.get("wire", {})
    if table is None or table.widths is False or (is_given and table.widths is None):
        return None
    path = _place_of(source, table)
    radius, fault = None, ""
    if isinstance(path, Path) and path.suffix.lower() in WITH_WIDTHS:
        from ..wires.file_curves import stated_radius

        with _naming_the_wires(source, table):
            radius, fault = stated_radius(path, time=table.time)
    if fault and not table.widths:
        raise scene_error(source.path, "wire.diameter", f"missing: {path.name!r} has {fault}", "write one")
    if radius is None:
        if table.widths:
            wrong = f"does not fit {path.name!r}, which has {fault or 'no widths'}"
            raise source.refusal(("wires", "widths"), True, wrong, "leave it out")
        return None
    thickest, thinnest = (2.0 * float(limit) for limit in (radius.max(), radius.min()))
    if thickest > MOST_THICKNESS or file.wire.with_thickness(thinnest).diameter <= 0.0:
        wrong = f"{path.name!r} has wires {both(exact(thinnest, 'm'), exact(thickest, 'm'))} thick"
        instead = f"use wires thicker than their plating, of at most {exact(MOST_THICKNESS, 'm')}"
        raise scene_error(source.path, "wires.file", wrong, instead)
    return file.wire.with_thickness(thickest).diameter


def _place_of(source: Source, table: WiresTable) -> Path | WireArrays:
    return table.file if isinstance(table.file, WireArrays) else source.path.parent / table.file


@contextmanager
def _naming_the_wires(source: Source, table: WiresTable) -> Iterator[None]:
    try:
        yield
    except WireFileError as error:
        raise source.refusal(("wires", "file"), table.file, error.wrong, error.instead) from error


def wire_file(source: Source, file: SceneFile, wire: Wire, has_widths: bool) -> WireFile | None:
    """The file of wires with its defaults, or None; has_widths: whether its widths count. Raises `SceneError`."""
    table = file.wires
    if table is None:
        return None
    path = _place_of(source, table)
    with _naming_the_wires(source, table):
        data = checked_bytes(path)
    suffix = path.suffix.lower()
    if table.unit is None and suffix in WITHOUT_UNIT:
        raise scene_error(source.path, "wires.unit", f"missing: a {suffix} file has no unit", "write one, such as 'mm'")
    formats = {"unit": set(SUFFIXES) - set(USD), "closed": set(POLYLINES), "period": set(SUFFIXES) - {".pyp"}, "time": set(USD)}
    for name, having in formats.items():
        value = getattr(table, name)
        if value is not None and value is not False and suffix not in having:
            raise source.refusal(("wires", name), value, f"is not allowed with a {suffix} file", "leave it out")
    return as_object(
        WireFile,
        table,
        file=path if isinstance(path, WireArrays) else str(path.resolve()),
        widths=has_widths,
        digest=hashlib.sha256(data).hexdigest(),
        node_spacing=wire.diameter if table.node_spacing is None else table.node_spacing,
        loop_size=LOOP_SIZE * wire.diameter if table.loop_size is None else table.loop_size,
    )
