"""Periodic yarn patterns (.pyp) of MADYPG (Sperl, Narain and Wojtan, Mechanics-Aware Deformation of Yarn Pattern Geometry, 2021).

Text in blocks, each under a line that begins with *; blank lines part them, # begins a comment:

    *pattern   px py radius n     width and height of the repeat, radius of the yarn, number of points and of edges [m]
    *Q         x y z twist        n points
    *E         from to i j        n edges: the point that an edge goes to lies i repeats along x and j along y away
    *RL        length             optional, n lengths free of stress of the edges, straight from point to point

A wire keeps the strain that its edges have against *RL along its curve, which is longer than they are. Other blocks (rest
curvature and twist, directors) are left out of account. Each point has one edge in and one out, so the edges make rings; a ring
that goes on by other than no repeats is a periodic wire.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from warpknit.wires.bases import polyline
from warpknit.wires.curve import LEAST, MOST, BadFile, Curve, CurveFile, check_count, check_points

COLUMNS = {"*Q": 4, "*E": 4, "*RL": 1}
MOST_REPEATS = 1000  # that one edge spans


def read_pyp(path: Path, interpolation: str) -> CurveFile:
    """The wires of a pattern; interpolation: a key of `bases.polyline`. Raises `BadFile`, OSError."""
    try:
        blocks = _blocks(path.read_text(encoding="utf-8-sig"))
    except UnicodeDecodeError as error:
        raise BadFile("a file that is no text") from error
    if len(blocks.get("*pattern", [])) != 1:
        raise BadFile("no *pattern with one line of values")
    width, height, radius, count = _numbers(blocks, "*pattern", 1, 4)[0]
    if not all(LEAST < value <= MOST for value in (width, height, radius)) or not 1.0 <= count <= MOST or count % 1.0:
        raise BadFile(f"*pattern {width:g} {height:g} {radius:g} {count:g}, not a width, a height, a radius and a whole number")
    check_count(int(count))
    points = check_points(_numbers(blocks, "*Q", int(count), COLUMNS["*Q"])[:, :3])
    edges = _numbers(blocks, "*E", int(count), COLUMNS["*E"])
    rest = _numbers(blocks, "*RL", int(count), 1)[:, 0] if "*RL" in blocks else None
    if rest is not None and not ((rest > LEAST) & (rest <= MOST)).all():
        raise BadFile("a rest length in *RL that is not above 0")
    period = np.array([width, height])
    curves = _curves(points, _checked_edges(edges, int(count)), rest, period, interpolation)
    return CurveFile(tuple(curves), radius=radius, period=period)


def _blocks(text: str) -> dict[str, list[str]]:
    """Lines of values by heading."""
    blocks: dict[str, list[str]] = {}
    heading = ""
    for line in text.splitlines():
        line = line.split("#", 1)[0].strip()
        if line.startswith("*"):
            heading = line
            if heading in blocks:
                raise BadFile(f"{heading} twice")
            blocks[heading] = []
        elif line and heading:
            blocks[heading].append(line)
        elif line:
            raise BadFile(f"values before the first line that begins with *: {line[:40]!r}")
    return blocks


def _numbers(blocks: dict[str, list[str]], heading: str, rows: int, columns: int) -> np.ndarray:
    """(rows, columns)"""
    lines = blocks.get(heading, [])
    if len(lines) != rows:
        raise BadFile(f"{len(lines):,} lines under {heading} where {rows:,} are announced")
    values = np.empty((rows, columns))
    for row, line in enumerate(lines):
        parts = line.split()
        if len(parts) != columns:
            raise BadFile(f"{line[:40]!r} under {heading}, not {columns} numbers")
        try:
            values[row] = [float(part) for part in parts]
        except ValueError as error:
            raise BadFile(f"{line[:40]!r} under {heading}, not {columns} numbers") from error
    return values


def _checked_edges(edges: np.ndarray, count: int) -> np.ndarray:
    """(count, 4) whole numbers, ordered by the point that each comes from."""
    if not (np.abs(edges[:, 2:]) <= MOST_REPEATS).all() or not (edges == np.floor(edges)).all():
        raise BadFile(f"an edge in *E that is not four whole numbers, the last two at most {MOST_REPEATS}")
    for column in range(2):
        if not np.array_equal(np.sort(edges[:, column]), np.arange(count)):
            raise BadFile("edges in *E that do not go once into and once out of every point")
    return edges.astype(np.int64)


def _curves(
    points: np.ndarray, edges: np.ndarray, rest: np.ndarray | None, period: np.ndarray, interpolation: str
) -> list[Curve]:
    number = np.empty(len(edges), dtype=np.int64)  # of the edge that goes out of each point
    number[edges[:, 0]] = np.arange(len(edges))
    following, step = edges[number, 1], edges[number, 2:]
    seen = np.zeros(len(points), dtype=bool)
    curves = []
    for first in range(len(points)):
        if seen[first]:
            continue
        ring, point = [], first
        while not seen[point]:
            seen[point] = True
            ring.append(point)
            point = int(following[point])
        repeats = np.cumsum(step[ring], axis=0)
        place = points[ring]
        place[1:, :2] += repeats[:-1] * period
        shift = (int(repeats[-1, 0]), int(repeats[-1, 1]))
        closing = np.array([*(repeats[-1] * period), 0.0]) if any(shift) else None
        free = None if rest is None else rest[number[ring]]
        try:
            curves.append(polyline(place, interpolation, closed=closing is None, shift=shift, closing=closing, rest=free))
        except BadFile as error:
            raise BadFile(f"the wire of point {first}: {error}") from error
    return curves
