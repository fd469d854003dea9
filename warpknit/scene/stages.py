"""Stages of the loading from `[load]` and `[[path]]`; a missing key keeps the value of the stage before."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from pydantic_core import PydanticCustomError

from warpknit.base.text import at_least, at_most
from warpknit.scene.file import SceneFile
from warpknit.scene.hook import Hook
from warpknit.scene.hook_defaults import hook_loads
from warpknit.scene.keys import given_values
from warpknit.scene.knit import Knit
from warpknit.scene.loads import Pull, Stage
from warpknit.scene.outline import Outline
from warpknit.scene.panel_options import PanelOptions
from warpknit.scene.source import Source
from warpknit.scene.units import tidy
from warpknit.scene.values import STRAIN
from warpknit.scene.wire import Wire

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
            load |= _displaced(source, (*location, "displacement"), given.pop("displacement"), knit)
        for side in ("weft", "warp"):
            if f"strain_{side}" in given or f"tension_{side}" in given:
                load |= _direction(side, given.pop(f"strain_{side}", None), given.pop(f"tension_{side}", None))
        if "pull" in given:
            for index, pull in enumerate(given["pull"]):
                _check_pull(source, file, (*location, "pull", index), pull, outline)
        load |= given
        _check_warmth(source, location, load, outline)
        yield Stage(name=name, **load)


def _check_warmth(source: Source, location: tuple[int | str, ...], load: dict[str, Any], outline: Outline) -> None:
    """Refuse a gradient that gives temperatures out of range."""
    from_middle = outline.corners - (outline.low + 0.5 * outline.size)
    there = load["temperature"] + from_middle @ np.array(load["temperature_gradient"])
    if there.min() <= 0.0 or there.max() > 4000.0:
        wrong = f"gives temperatures from {there.min():.6g} K to {there.max():.6g} K at the edge"
        instead = "write one that keeps them above 0 K and at most at 4000 K"
        raise source.refusal((*location, "temperature_gradient"), load["temperature_gradient"], wrong, instead)


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


def hook_stages(source: Source, file: SceneFile, wire: Wire, hook: Hook) -> Iterator[Stage]:
    """The stages of a hook."""
    for load in hook_loads(source, _named_stages(source, file), wire, hook):
        yield Stage(**{**_unloaded(wire), **load})


def _unloaded(wire: Wire) -> dict[str, Any]:
    """Defaults of the first stage."""
    return {
        **_direction("weft", 0.0, None),
        **_direction("warp", 0.0, None),
        "shear": 0.0,
        "clamp_rotation": 0.0,
        "temperature": wire.reference_temperature,
        "temperature_gradient": (0.0, 0.0),
        "pull": (),
    }


def _named_stages(source: Source, file: SceneFile) -> Iterator[tuple[tuple[int | str, ...], str, Stage]]:
    """Location in the file, name and table of each stage."""
    tables: list[tuple[tuple[int | str, ...], Stage]] = [(("load",), file.load)]
    tables += [(("path", index), table) for index, table in enumerate(file.path)]
    names: set[str] = set()
    for number, (location, table) in enumerate(tables, start=1):
        name = table.name or ("load" if number == 1 else f"stage-{number}")
        if name in names:
            raise source.refusal((*location, "name"), name, "is the name of another stage", "write another name")
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
