"""Periodic yarn patterns (.pyp) of MADYPG (Sperl, Narain and Wojtan, Mechanics-Aware Deformation of Yarn Pattern Geometry, 2021).

Text in blocks, each under a line that begins with *; blank lines part them, # begins a comment:

    *pattern   px py radius n     width and height of the repeat, radius of the yarn, number of points and of edges [m]
    *Q         x y z twist        n points
    *E         from to i j        n edges: the point that an edge goes to lies i repeats along x and j along y away
    *RL        length             n lengths free of stress of the edges, straight from point to point
    *RK        k1 k2              n natural curvatures, integrated over the points
    *RT        twist              n natural twists, integrated over the points
    *RefD1     x y z              n reference directors of the edges
    *RefT      twist              n twists of the reference directors at the points

All but the first three are optional. Values of an edge stand in the line of the point that it leaves. A wire keeps the strain
that its edges have against *RL along its curve, which is longer than they are. Each point has one edge in and one out, so the
edges make rings; a ring that goes on by other than no repeats is a periodic wire.

Curvature and twist follow discrete elastic rods (Bergou and others 2010; kernels/rod_forces.py): the twist t of an edge turns its
reference director into its material director d1, and d2 = tangent x d1. With the means of d1 and d2 before and behind a point, k1
= d2 . kb, k2 = - d1 . kb, |kb| = 2 tan(angle/2); the twist is t - t_before + *RefT. Missing reference directors are the directors
without twist; a missing *RefT is the twist of the directors.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from warpknit.wires.bases import LEAST, MOST, BadFile, Curve, CurveFile, check_count, check_points, polyline
from warpknit.wires.centre_lines import across, dot, even_directors, twist

COLUMNS = {"*Q": 4, "*E": 4, "*RL": 1, "*RK": 2, "*RT": 1, "*RefD1": 3, "*RefT": 1}
MOST_TURN = 1e3  # [rad] at a point
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
    given = {
        name: _numbers(blocks, name, int(count), columns)
        for name, columns in COLUMNS.items()
        if name in blocks or name in ("*Q", "*E")
    }
    check_points(given["*Q"][:, :3])
    if "*RL" in given and not ((given["*RL"] > LEAST) & (given["*RL"] <= MOST)).all():
        raise BadFile("a rest length in *RL that is not above 0")
    for name in ("*RK", "*RT", "*RefT"):
        if name in given and not (np.abs(given[name]) <= MOST_TURN).all():
            raise BadFile(f"a value in {name} that is no angle")
    if "*RK" in given and given["*RK"].any() and "*RefD1" not in given:
        raise BadFile("*RK without *RefD1, to whose directors it refers")
    period = np.array([width, height])
    edges = given["*E"]
    if not (np.abs(edges[:, 2:]) <= MOST_REPEATS).all() or not (edges == np.floor(edges)).all():
        raise BadFile(f"an edge in *E that is not four whole numbers, the last two at most {MOST_REPEATS}")
    if not all(np.array_equal(np.sort(points), np.arange(count)) for points in edges.T[:2]):
        raise BadFile("edges in *E that do not go once into and once out of every point")
    curves = _curves(given, edges.astype(np.int64), period, interpolation)
    unknown = sorted(blocks.keys() - COLUMNS.keys() - {"*pattern"})
    notes = (f"blocks that are not read: {', '.join(unknown)}",) if unknown else ()
    return CurveFile(tuple(curves), radius=np.full(len(curves), radius), period=period, notes=notes)


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
        try:
            values[row] = np.array([float(part) for part in line.split()]).reshape(columns)
        except ValueError as error:
            raise BadFile(f"{line[:40]!r} under {heading}, not {columns} numbers") from error
    return values


def _curves(given: dict[str, np.ndarray], edges: np.ndarray, period: np.ndarray, interpolation: str) -> list[Curve]:
    points = given["*Q"][:, :3]
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
        free = given["*RL"][ring, 0] if "*RL" in given else None
        try:
            curve = polyline(place, interpolation, closed=closing is None, shift=shift, closing=closing, rest=free)
            curves.append(_with_natural_shape(curve, {name: values[ring] for name, values in given.items()}))
        except BadFile as error:
            raise BadFile(f"the wire of point {first}: {error}") from error
    return curves


def _with_natural_shape(curve: Curve, given: dict[str, np.ndarray]) -> Curve:
    """Curve with natural turn and twist, from blocks in the order of its points. Raises `BadFile`."""
    if "*RK" not in given and "*RT" not in given:
        return curve
    if len(curve.pieces) != len(given["*Q"]):
        raise BadFile("two points of a wire in one place")
    edge = curve.pieces[:, 3] - curve.pieces[:, 0]
    after = edge / np.linalg.norm(edge, axis=1)[:, None]
    before, angle, count = np.roll(after, 1, axis=0), given["*Q"][:, 3], len(after)
    turn = strain = None
    with np.errstate(invalid="ignore", divide="ignore"):
        if "*RefD1" in given:
            reference = across(given["*RefD1"], after)
        else:
            reference = even_directors(after, np.array([0]), np.array([count]), np.array([True]))
        if "*RK" in given:
            d1 = np.cos(angle)[:, None] * reference + np.sin(angle)[:, None] * np.cross(after, reference)
            d2 = np.cross(after, d1)
            turn = _turns(given["*RK"], 0.5 * (d1 + np.roll(d1, 1, axis=0)), 0.5 * (d2 + np.roll(d2, 1, axis=0)))
        if "*RT" in given:
            own = given["*RefT"][:, 0] if "*RefT" in given else twist(np.roll(reference, 1, axis=0), reference, before, after)
            strain = angle - np.roll(angle, 1) + own - given["*RT"][:, 0]
    if not all(np.isfinite(values).all() for values in (turn, strain) if values is not None):
        raise BadFile("a director in *RefD1 along its edge, or a wire that turns back")
    return replace(curve, natural_turn=turn, twist=strain)


def _turns(curvature: np.ndarray, d1: np.ndarray, d2: np.ndarray) -> np.ndarray:
    """(point, 3) [rad] turns k 2 atan(|k|/2)/|k| with d2 . k = k1 and - d1 . k = k2, of curvatures (point, 2)."""
    normal = np.cross(d1, d2)
    k = curvature[:, :1] * np.cross(normal, d1) + curvature[:, 1:] * np.cross(normal, d2)
    k /= dot(normal, normal)[:, None]
    size = np.linalg.norm(k, axis=1)[:, None]
    return np.asarray(k * np.where(size > 0.0, 2.0 * np.arctan(0.5 * size) / np.maximum(size, 1e-300), 1.0))
