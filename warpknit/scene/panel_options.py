"""The panel of a scene: the outline that a gripped mesh is cut along, what holds it there, and the surface it should make."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from ..base.errors import BadValue
from . import values
from .keys import Table, as_object, key
from .outline import Outline, disc, is_simple, rectangle, regular, signed_area, turned
from .units import DIMENSIONS, QuantityError, si
from .values import Choice, Quantity

MOST_CORNERS = 1000  # of a polygon


@dataclass(frozen=True, kw_only=True)
class Cord(Table):
    """[panel.cord]: an elastic cord along the outline, fixed at the net nodes."""

    tension: Annotated[float, Quantity("force", least=0.0, usual="1 N")] = key(
        'Tension of the cord when it lies on the strained outline. Write `cord = {tension = "1 N", stiffness = "1 kN"}`.'
    )
    stiffness: Annotated[float, Quantity("force", above=0.0, usual="1 kN")] = key("Axial stiffness EA of the cord.")


@dataclass(frozen=True, kw_only=True)
class PanelOptions(Table):
    """[panel]: outline and edge of a gripped mesh, and its target surface. None: not requested."""

    outline: Annotated[str, Choice(("rectangle", "hexagon", "triangle", "disc", "polygon"))] = key(
        "Shape that is cut from endless cloth; weft is horizontal. Give `knit.repeats` for `rectangle` only; for other shapes it"
        " follows from the outline.",
        "rectangle",
    )
    size: values.PanelLength | None = key("Side of a hexagon or triangle, diameter of a disc.", None)
    corners: tuple[values.Vector, ...] | None = key(
        "Corners of a polygon in order along the edge, in either direction. The origin is the middle of an opening of the knit.",
        None,
        allowed="a list of pairs, each a length, such as ['1 mm', '2 mm']",
    )
    rotation: values.Angle = key("Counter-clockwise rotation of the outline relative to the knit.", 0.0)
    grip_pitch: values.EdgeLength | None = key(
        "Distance between net nodes along the outline, adjusted to divide each side evenly. Requires `cord`.",
        None,
        left_out="held along the whole edge",
    )
    cord: Cord | None = key("Cord between the net nodes.", None)
    focal_length: values.PanelLength | None = key(
        "Focal length of the paraboloid on which the edge is held, with its apex below the middle of the panel. In the spatial"
        " model the first load step raises the edge, and the mesh inside takes its shape. The planar model computes the shape"
        " from the map of tensions.",
        None,
    )
    tension_threshold: values.Tension | None = key(
        "The summary reports the fraction of the area with a lower tension in weft or warp.", None
    )
    active_threshold: Annotated[float, Quantity("number", least=0.0, most=100.0)] | None = key(
        "Percent. The summary reports the fraction of the area with fewer active contacts.", None
    )

    def shape(self, rectangle_size: tuple[float, float]) -> Outline:
        """The outline about the origin; a polygon where its corners say. `rectangle_size` [m]: size of all repeats."""
        if self.outline == "rectangle":
            return rectangle(*rectangle_size)
        if self.outline == "polygon":
            assert self.corners is not None
            outline = Outline(np.array(self.corners))
        else:
            assert self.size is not None
            outline = (
                disc(self.size) if self.outline == "disc" else regular({"triangle": 3, "hexagon": 6}[self.outline], self.size)
            )
        return turned(outline, self.rotation) if self.rotation else outline


@dataclass(frozen=True, kw_only=True)
class PanelTable(PanelOptions, one_of=(("corners", "file"),)):
    """[panel] as written in a file, with its alternative keys."""

    file: values.FileName | None = key(
        "Instead of `corners`: a CSV file beside the scene with columns x and y. Write a line as `12.5 mm, 3 mm`, or numbers"
        " under the headings `x [mm], y [mm]`.",
        None,
    )


def panel_options(table: PanelTable, folder: Path) -> PanelOptions:
    """The options of a checked table; a polygon's file is looked for in `folder`. Raises `BadValue` with a key
    of [panel]."""
    has_corners, has_size = table.outline == "polygon", table.outline in ("hexagon", "triangle", "disc")
    has_effect = {"corners": has_corners, "file": has_corners, "size": has_size, "rotation": table.outline != "rectangle"}
    for name, has in has_effect.items():
        if not has and getattr(table, name) not in (None, 0.0):
            raise BadValue(name, f"has no effect with outline = {table.outline!r}", "leave it out, or write another outline")
    if has_size and table.size is None:
        raise BadValue("size", f"missing for outline = {table.outline!r}", "write a length")
    corners = None
    if has_corners:
        if table.corners is None and table.file is None:
            raise BadValue("corners", "missing for outline = 'polygon'", "write panel.corners or panel.file")
        found = _read_corners(folder / table.file, table.file) if table.file is not None else table.corners
        corners = _checked_corners("corners" if table.file is None else "file", list(found or ()))
    if (table.grip_pitch is None) != (table.cord is None):
        missing = "cord" if table.cord is None else "grip_pitch"
        raise BadValue(missing, "missing: between net nodes the edge hangs on its cord", "write both panel.cord and grip_pitch")
    return as_object(PanelOptions, table, corners=corners)


def _checked_corners(key: str, corners: list[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Counter-clockwise, without a repeated last corner."""
    if len(corners) > 1 and corners[0] == corners[-1]:
        corners = corners[:-1]
    if not 3 <= len(corners) <= MOST_CORNERS:
        raise BadValue(key, f"has {len(corners)} corners", f"write 3 to {MOST_CORNERS}")
    points = np.array(corners)
    if not is_simple(points):
        raise BadValue(key, "the outline crosses or touches itself", "write the corners in their order along the edge")
    if abs(signed_area(points)) < 1e-6 * float(np.ptp(points, axis=0).max()) ** 2:
        raise BadValue(key, "the outline has no area", "write corners that are not on one line")
    if signed_area(points) < 0.0:
        points = points[::-1]
    return tuple((float(x), float(y)) for x, y in points)


def _read_corners(path: Path, name: str) -> list[tuple[float, float]]:
    """Corners from a CSV file with two columns, x and y: lengths with a unit, or numbers in m; a first line of names may
    stand above them, with a unit in brackets that all numbers below are in."""
    instead = "write a corner a line, x and y, such as '12.5 mm, 3 mm'"
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    except OSError as error:
        wrong = f"{name!r} cannot be read ({(error.strerror or 'it is unreadable').lower()})"
        raise BadValue("file", wrong, "name a CSV file beside the scene") from error
    except (ValueError, csv.Error) as error:
        raise BadValue("file", f"{name!r} is not text", instead) from error
    units = ["", ""]
    corners = []
    for number, row in enumerate(rows, start=1):
        try:
            if len(row) != 2:
                raise QuantityError(row, DIMENSIONS["length"])
            corners.append(tuple(si(f"{cell.strip()} {unit}".strip(), "length") for cell, unit in zip(row, units, strict=True)))
        except QuantityError as error:
            if number == 1 and len(row) == 2:
                units = [cell[cell.find("[") + 1 : cell.rfind("]")] if "[" in cell else "" for cell in row]
                continue
            raise BadValue("file", f"{', '.join(row)[:40]!r} in line {number} of {name!r} is not a corner", instead) from error
    return corners  # type: ignore[return-value]


def covering_repeats(outline: Outline, repeat: tuple[float, float]) -> tuple[int, int]:
    """Repeats (weft, warp) of size `repeat` [m] that cover the box around an outline."""
    across, along = (max(1, math.ceil(side / each - 1e-9)) for side, each in zip(outline.size, repeat, strict=True))
    return across, along
