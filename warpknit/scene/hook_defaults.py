"""Defaults, limits and loads of a hook."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from warpknit.base.text import at_least, at_most
from warpknit.scene.file import SceneFile
from warpknit.scene.hook import Hook
from warpknit.scene.keys import given_values
from warpknit.scene.loads import Stage
from warpknit.scene.source import Source
from warpknit.scene.wire import Wire

SHORTEST = 0.5  # radii of wire
LEAST_OVERLAP = 1.5  # diameters of the wire
LEAST_RADIUS = 4.0  # diameters of the wire
CROSSING = {"planar": None, "spatial": 1.3}  # thicknesses of the wire by which hooked wires pass each other at rest, as in a knit


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
    usual = CROSSING[file.model.kind]
    if usual is None:
        return None
    given = table.crossing_distance
    distance = usual * wire.thickness if given is None else given
    if not wire.thickness <= distance <= overlap:
        wrong = "is not from the thickness of the wire to hook.overlap"
        instead = f"write {at_least(wire.thickness, 'm')} to {at_most(overlap, 'm')}"
        raise source.refusal(("hook", "crossing_distance"), distance, wrong, instead)
    return distance


def hook_loads(
    source: Source, stages: Iterator[tuple[tuple[int | str, ...], str, Stage]], wire: Wire, hook: Hook
) -> Iterator[dict[str, Any]]:
    """Name, displacement, temperature and shear of the frame of each stage, given where it stands in the file, its name and its
    table; a stage takes over from the one before what it leaves out."""
    displacement, temperature = 0.0, wire.reference_temperature
    for location, name, table in stages:
        given = given_values(table)
        given.pop("name", None)
        displacement, temperature = given.get("displacement", displacement), given.get("temperature", temperature)
        if abs(displacement) > hook.length:
            wrong = "is above the length of a wire"
            instead = f"write at most {at_most(hook.length, 'm')}"
            raise source.refusal((*location, "displacement"), displacement, wrong, instead)
        shear = displacement / hook.height
        yield {"name": name, "displacement": displacement, "temperature": temperature, "shear": shear}
