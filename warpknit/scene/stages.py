"""Stages of the loading from `[load]` and `[[path]]`; a missing key keeps the value of the stage before."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic_core import PydanticCustomError

from warpknit.base.text import at_least, at_most, both, exact
from warpknit.scene.keys import as_object, given_values
from warpknit.scene.knit import Hook, Knit
from warpknit.scene.messages import Source, scene_error
from warpknit.scene.options import Pull, Stage
from warpknit.scene.outline import Outline
from warpknit.scene.panel_options import PanelOptions
from warpknit.scene.scene import SceneFile
from warpknit.scene.units import tidy
from warpknit.scene.values import STRAIN
from warpknit.scene.wire import Wire
from warpknit.scene.wire_file import (
    LOOP_SIZE,
    MOST_THICKNESS,
    POLYLINES,
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


def mesh_stages(source: Source, file: SceneFile, wire: Wire, knit: Knit, panel: PanelOptions) -> Iterator[Stage]:
    """Stages of [load] and each [[path]]; a missing key keeps the value of the stage before."""
    load = _unloaded(wire)
    outline = panel.shape(knit.size)
    for location, name, table in _named_stages(source, file):
        given = given_values(table)
        given.pop("name", None)
        if "displacement" in given:
            given |= _displaced(source, (*location, "displacement"), given.pop("displacement"), knit)
        for side in ("weft", "warp"):
            if f"strain_{side}" in given or f"tension_{side}" in given:
                given |= _direction(side, given.pop(f"strain_{side}", None), given.pop(f"tension_{side}", None))
        if "pull" in given:
            for index, pull in enumerate(given["pull"]):
                _check_pull(source, file, (*location, "pull", index), pull, outline)
        load = replace(load, name=name, **given)
        _check_temperature(source, location, load, outline)
        yield load


def _check_temperature(source: Source, location: tuple[int | str, ...], load: Stage, outline: Outline) -> None:
    """Refuse a gradient that gives temperatures out of range."""
    from_middle = outline.corners - (outline.low + 0.5 * outline.size)
    there = load.temperature + from_middle @ np.array(load.temperature_gradient)
    if there.min() <= 0.0 or there.max() > 4000.0:
        wrong = f"gives temperatures from {there.min():.6g} K to {there.max():.6g} K at the edge"
        instead = "write one that keeps them above 0 K and at most at 4000 K"
        raise source.refusal((*location, "temperature_gradient"), load.temperature_gradient, wrong, instead)


def _check_pull(source: Source, file: SceneFile, location: tuple[int | str, ...], pull: Pull, outline: Outline) -> None:
    size = float(outline.size.min())
    if math.hypot(*pull.by) > FARTHEST_PULL * size:
        wrong = f"is above {FARTHEST_PULL:g} of the panel's width"
        raise source.refusal((*location, "by"), pull.by, wrong, f"write at most {at_most(FARTHEST_PULL * size, 'm')}")
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


def _unloaded(wire: Wire) -> Stage:
    """Defaults of the first stage."""
    return Stage(
        strain_weft=0.0,
        strain_warp=0.0,
        shear=0.0,
        clamp_rotation=0.0,
        temperature=wire.reference_temperature,
        temperature_gradient=(0.0, 0.0),
        pull=(),
    )


def _named_stages(source: Source, file: SceneFile) -> Iterator[tuple[tuple[int | str, ...], str, Stage]]:
    """Location in the file, name and table of each stage."""
    tables: list[tuple[tuple[int | str, ...], Stage]] = [(("load",), file.load)]
    tables += [(("path", index), table) for index, table in enumerate(file.path)]
    names: set[str] = set()
    for number, (location, table) in enumerate(tables, start=1):
        name = table.name or ("load" if number == 1 else f"stage-{number}")
        if name in names:
            raise source.refusal((*location, "name"), name, "is the name of another load step", "write another name")
        names.add(name)
        yield location, name, table


def _direction(side: str, strain: float | None, tension: float | None) -> dict[str, float | None]:
    return {f"strain_{side}": strain, f"tension_{side}": tension}


def _displaced(source: Source, location: Sequence[int | str], displacement: float, knit: Knit) -> dict[str, float | None]:
    """The strains for an outward displacement of every side by `displacement` [m]."""
    load: dict[str, float | None] = {}
    for side, size in zip(("weft", "warp"), knit.size, strict=True):
        strain = tidy(2 * displacement / size)
        try:
            STRAIN(strain)
        except PydanticCustomError as error:
            wrong = f"gives a strain of {strain:.6g} in {side}"
            instead = f"write one that gives strains {STRAIN.allowed.removeprefix('a number ')}"
            raise source.refusal(location, displacement, wrong, instead) from error
        load |= _direction(side, strain, None)
    return load


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
    least = LEAST_RADIUS * wire.diameter
    if table.radius < least:
        wrong = f"is below {LEAST_RADIUS:g} diameters of the wire"
        raise source.refusal(("hook", "radius"), table.radius, wrong, f"write at least {at_least(least, 'm')}")
    if not SHORTEST * table.radius <= length <= math.pi * table.radius:
        shortest, longest = at_least(SHORTEST * table.radius, "m"), at_most(math.pi * table.radius, "m")
        wrong = "is not from half a radius to half a circle"
        raise source.refusal(("hook", "length"), length, wrong, f"write {shortest} to {longest}")
    rise = table.radius * (1.0 - math.cos(0.5 * length / table.radius))
    least = LEAST_OVERLAP * wire.diameter
    if not least <= overlap <= rise:
        wrong = "does not let the wires cross twice, with room for a body in between"
        raise source.refusal(("hook", "overlap"), overlap, wrong, f"write {at_least(least, 'm')} to {at_most(rise, 'm')}")
    crossing = _crossing_distance(source, file, table, wire, overlap)
    return replace(table, length=length, overlap=overlap, crossing_distance=crossing)


def _crossing_distance(source: Source, file: SceneFile, table: Hook, wire: Wire, overlap: float) -> float | None:
    """[m] crossing distance with its default; None in the planar model."""
    usual = file.model.of_kind.crossing
    if usual is None:
        return None
    given = table.crossing_distance
    distance = usual * wire.thickness if given is None else given
    if not wire.thickness <= distance <= overlap:
        wrong = "is not from the thickness of the wire to hook.overlap"
        instead = f"write {at_least(wire.thickness, 'm')} to {at_most(overlap, 'm')}"
        raise source.refusal(("hook", "crossing_distance"), distance, wrong, instead)
    return distance


def hook_stages(source: Source, file: SceneFile, wire: Wire, hook: Hook) -> Iterator[Stage]:
    """The stages of a hook, with the shear of its frame; a missing key keeps the value of the stage before."""
    displacement, temperature = 0.0, wire.reference_temperature
    for location, name, table in _named_stages(source, file):
        displacement = displacement if table.displacement is None else table.displacement
        temperature = temperature if table.temperature is None else table.temperature
        if abs(displacement) > hook.length:
            wrong = "is above the length of a wire"
            instead = f"write at most {at_most(hook.length, 'm')}"
            raise source.refusal((*location, "displacement"), displacement, wrong, instead)
        shear = displacement / hook.height
        yield replace(_unloaded(wire), name=name, displacement=displacement, temperature=temperature, shear=shear)


def file_diameter(source: Source, file: SceneFile) -> float | None:
    """[m] Diameter of the thickest wire in a file whose widths count; None: they do not. Raises `SceneError`."""
    table = file.wires
    is_given = "diameter" in source.table.get("wire", {})
    if table is None or table.widths is False or (is_given and table.widths is None):
        return None
    path = _place_of(source, table)
    radius, fault = None, ""
    if isinstance(path, Path) and path.suffix.lower() in WITH_WIDTHS:
        radius, fault = _file_radius(source, path, table)
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
    """The file of wires, relative to the scene."""
    return table.file if isinstance(table.file, WireArrays) else source.path.parent / table.file


def _file_radius(source: Source, path: Path, table: WiresTable) -> tuple[np.ndarray | None, str]:
    """(wire,) [m] radius of the wires in a file, and why it has none. Raises `SceneError`."""
    from warpknit.wires.file_curves import stated_radius

    try:
        return stated_radius(path, time=table.time)
    except WireFileError as error:
        raise scene_error(source.path, "wires.file", f"{table.file!r} {error.wrong}", error.instead) from error


def wire_file(source: Source, file: SceneFile, wire: Wire, has_widths: bool) -> WireFile | None:
    """The file of wires with its defaults, or None; has_widths: whether its widths count. Raises `SceneError`."""
    table = file.wires
    if table is None:
        return None
    path = _place_of(source, table)
    try:
        data = checked_bytes(path)
    except WireFileError as error:
        raise source.refusal(("wires", "file"), table.file, error.wrong, error.instead) from error
    suffix = path.suffix.lower()
    if table.unit is None and suffix in WITHOUT_UNIT:
        raise scene_error(source.path, "wires.unit", f"missing: a {suffix} file has no unit", "write one, such as 'mm'")
    if table.unit is not None and suffix in USD:
        raise source.refusal(("wires", "unit"), table.unit, f"is not allowed: a {suffix} file has its own unit", "leave it out")
    if table.closed and suffix not in POLYLINES:
        raise source.refusal(("wires", "closed"), True, f"is not allowed: a {suffix} file marks its closed wires", "leave it out")
    if table.period is not None and suffix == ".pyp":
        raise source.refusal(("wires", "period"), table.period, "is not allowed: a .pyp file has its own period", "leave it out")
    if table.time is not None and suffix not in USD:
        raise source.refusal(("wires", "time"), table.time, f"has no effect with a {suffix} file", "leave it out")
    return as_object(
        WireFile,
        table,
        file=path if isinstance(path, WireArrays) else str(path.resolve()),
        widths=has_widths,
        digest=hashlib.sha256(data).hexdigest(),
        node_spacing=wire.diameter if table.node_spacing is None else table.node_spacing,
        loop_size=LOOP_SIZE * wire.diameter if table.loop_size is None else table.loop_size,
    )
