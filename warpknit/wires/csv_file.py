"""Polylines from a CSV file: a row a point, x, y and z, with or without the wire's name before them.

Columns are parted by commas, semicolons or tabs. A line of headings may stand on top: x, y, z, and `wire`; in any order, with a
unit in brackets that holds for all three, x [mm], y [mm], z [mm]. Without headings the columns are x, y, z, or wire, x, y, z. A
blank line, or another wire's name, begins the next wire.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np

from warpknit.scene.units import QuantityError, si
from warpknit.wires.bases import polyline
from warpknit.wires.curve import BadFile, CurveFile, check_count, check_points

AXES = ("x", "y", "z")
_COMMA = re.compile(r"[+-]?[\d.]*\d,[\d,.]*(e[+-]?\d+)?", re.IGNORECASE)  # a number with commas
_HEADING = re.compile(r"\s*(x|y|z|wire)\s*(?:\[(.{1,40})\])?\s*", re.IGNORECASE)


def read_table(path: Path, interpolation: str, *, closed: bool = False) -> CurveFile:
    """The wires of a CSV file; interpolation: a key of `bases.polyline`. Raises `BadFile`, OSError."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            first = file.readline()
            file.seek(0)
            delimiter = next((mark for mark in "\t;" if mark in first), ",")
            rows = list(csv.reader(file, delimiter=delimiter))
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadFile(f"a file that is no table of text ({error})") from error
    rows = [[cell.strip() for cell in row] for row in rows]
    start = next((number for number, row in enumerate(rows) if any(row)), 0)
    columns, metres = _headings(rows[start]) if rows else ({}, None)
    if columns:
        start += 1
    check_count(len(rows) - start)
    wires: list[list[list[float]]] = []
    name, width = None, len(columns)
    for number, row in enumerate(rows[start:], start=start + 1):
        if not any(row):
            name = None
            continue
        if not columns:
            columns, width = _plain_columns(row, number)
        if len(row) != width:
            hint = "; a comma parts columns: write decimal points" if delimiter == "," and len(row) > width else ""
            raise BadFile(f"{len(row)} columns in line {number}, {width} before{hint}")
        wire = row[columns["wire"]] if "wire" in columns else ""
        if name is None or wire != name:
            wires.append([])
            name = wire
        try:
            wires[-1].append([float(row[columns[axis]]) for axis in AXES])
        except ValueError as error:
            if comma := next((cell for cell in row if _COMMA.fullmatch(cell)), None):
                written = f"{comma[:40]!r} in line {number}, with a comma where a decimal point is meant"
                raise BadFile(f"{written}: write numbers as 1234.5") from error
            raise BadFile(f"{', '.join(row)[:40]!r} in line {number}, not numbers") from error
    curves = []
    for count, points in enumerate(wires, start=1):
        try:
            curves.append(polyline(check_points(np.array(points)), interpolation, closed=closed))
        except BadFile as error:
            raise BadFile(f"wire {count}: {error}") from error
    return CurveFile(tuple(curves), metres=metres)


def _headings(row: list[str]) -> tuple[dict[str, int], float | None]:
    """The place of each column and the metres of the unit in brackets, or nothing where the row is no headings."""
    found = [_HEADING.fullmatch(cell) for cell in row]
    if not any(found):
        return {}, None
    if not all(found):
        raise BadFile(f"the headings {', '.join(row)[:60]!r}, not x, y, z and at most wire")
    names = [match[1].lower() for match in found if match]
    units = {match[2] for match in found if match and match[1].lower() in AXES}
    if sorted(set(names) - {"wire"}) != list(AXES) or len(set(names)) != len(names):
        raise BadFile(f"the headings {', '.join(row)[:60]!r}, not x, y, z and at most wire")
    if len(units) > 1:
        raise BadFile(f"the headings {', '.join(row)[:60]!r} with more than one unit")
    unit = units.pop()
    try:
        metres = None if unit is None else si(f"1 {unit}", "length")
    except QuantityError as error:
        raise BadFile(f"the unit [{unit}] in its headings") from error
    return {name: place for place, name in enumerate(names)}, metres


def _plain_columns(row: list[str], number: int) -> tuple[dict[str, int], int]:
    if len(row) not in (3, 4):
        raise BadFile(f"{len(row)} columns in line {number}, not x, y, z or wire, x, y, z")
    names = AXES if len(row) == 3 else ("wire", *AXES)
    return {name: place for place, name in enumerate(names)}, len(row)
