"""Centre lines as a file has them, in its unit: control points to cubic pieces in Bezier form, for each kind of curve.

Of the four control points P0..P3 of a piece, with B0..B3 its Bezier points:

    Catmull-Rom, uniform   B0 = P1                 B1 = P1 + (P2 - P0)/6   B2 = P2 - (P3 - P1)/6   B3 = P2
    B-spline, uniform      B0 = (P0 + 4 P1 + P2)/6  B1 = (2 P1 + P2)/3     B2 = (P1 + 2 P2)/3      B3 = (P1 + 4 P2 + P3)/6
    Bezier                 themselves, three steps from piece to piece

USD's wraps (UsdGeomBasisCurves): nonperiodic takes the points as they are, periodic repeats the first ones behind the last,
pinned puts 2 P[0] - P[1] before the first and 2 P[n-1] - P[n-2] behind the last, so that the curve reaches both ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import CubicSpline

MOST_POINTS = 2_000_000  # of a file
NAMED = 3  # of what is not used in a file, in a note
MOST = 1e9  # of a coordinate, in the file's unit
LEAST = 1e-15  # of a distance between points that differ, in the file's unit


class BadFile(Exception):
    """A file is not what its name says: `given`, such as 'a file that ends in its header'."""


@dataclass(frozen=True, eq=False)
class Curve:
    """pieces (piece, 4, 3): Bezier control points, each piece beginning where the last one ended.

    A closed curve ends where it begins; a periodic one ends at its beginning moved by `shift` repeats.
    """

    pieces: np.ndarray
    kind: str  # open | closed | periodic
    shift: tuple[int, int] = (0, 0)
    slack: np.ndarray | None = None  # (piece,) length free of stress over length
    # of a wire that goes on, at the beginnings of its pieces: natural turn as a vector on the section at rest (piece, 3) [rad];
    # twist at rest less natural twist (piece,) [rad]
    natural_turn: np.ndarray | None = None
    twist: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class CurveFile:
    """Curve found by a reader. Lengths are in the file's unit."""

    curves: tuple[Curve, ...]
    metres: float | None = None  # in a unit of the file, where it says so
    radius: np.ndarray | None = None  # (curve,) where the file says it
    no_radius: str = ""  # why widths of the file are no radius of each curve
    period: np.ndarray | None = None  # (2,)
    notes: tuple[str, ...] = ()  # what the file states and is not used


def some_of(names: list[str]) -> str:
    """The first of these names, and how many more there are."""
    more = f"; {len(names) - NAMED:,} more" if len(names) > NAMED else ""
    return "; ".join(names[:NAMED]) + more


def check_points(points: np.ndarray) -> np.ndarray:
    """`points` (point, 3) as doubles. Raises `BadFile` where a coordinate is no number, or beyond MOST."""
    points = np.asarray(points, dtype=np.float64)
    bad = ~(np.abs(points) <= MOST).all(axis=-1)
    if bad.any():
        number = int(np.argmax(bad))
        raise BadFile(f"point {number + 1} at {', '.join(f'{x:g}' for x in points[number])}")
    return points


def check_count(count: int) -> None:
    """Raises `BadFile` for more points than are read; called before memory is taken."""
    if count > MOST_POINTS:
        raise BadFile(f"{count:,} points, more than {MOST_POINTS:,}")


def upright(points: np.ndarray, up: int) -> np.ndarray:
    """Points (..., 3) turned so that their axis `up` (0, 1 or 2) is z; a rotation, as tools with z up read files with y up."""
    x, y, z = np.moveaxis(points, -1, 0)
    return np.stack([(y, z, x), (x, -z, y), (x, y, z)][up], axis=-1)


MATRICES = {
    "catmullRom": np.array([[0, 6, 0, 0], [-1, 6, 1, 0], [0, 1, 6, -1], [0, 0, 6, 0]]) / 6.0,
    "bspline": np.array([[1, 4, 1, 0], [0, 4, 2, 0], [0, 2, 4, 0], [0, 1, 4, 1]]) / 6.0,
    "bezier": np.eye(4),
}
BASES = tuple(MATRICES)
WRAPS = ("nonperiodic", "periodic", "pinned")
SAME = 1e-6  # points nearer than this, over the size of the curve, are one


def cubic(points: np.ndarray, basis: str, wrap: str) -> Curve:
    """The curve of control points (point, 3). Raises `BadFile` for a number of points that the basis and wrap do not have."""
    step, count = (3, len(points)) if basis == "bezier" else (1, len(points))
    if wrap == "periodic":
        least, valid = 3, count % step == 0
    elif wrap == "pinned" and basis != "bezier":
        least, valid = 2, True
    else:
        least, valid = 4, (count - 4) % step == 0
    if count < least or not valid:
        raise BadFile(f"a {wrap} {basis} curve of {count} points")
    if wrap == "periodic":
        points = np.concatenate([points, points[: 4 - step]])
    elif wrap == "pinned" and basis != "bezier":
        points = np.concatenate([2.0 * points[:1] - points[1:2], points, 2.0 * points[-1:] - points[-2:-1]])
    windows = sliding_window_view(points, 4, axis=0)[::step].transpose(0, 2, 1)
    pieces = np.einsum("bp,npk->nbk", MATRICES[basis], windows)
    corners = pieces.reshape(-1, 3)
    meets = len(pieces) > 1 and _near(corners[0], corners[-1], float(np.ptp(corners, axis=0).max()))
    return Curve(pieces, "closed" if wrap == "periodic" or meets else "open")


def polyline(
    points: np.ndarray,
    interpolation: str,
    *,
    closed: bool = False,
    shift: tuple[int, int] = (0, 0),
    closing: np.ndarray | None = None,
    rest: np.ndarray | None = None,
) -> Curve:
    """The curve through points (point, 3): straight from one to the next, or a cubic spline over the chords.

    closed: it continues from the last point to the first; so does a curve whose last point repeats the first. closing (3,): its
    shift a period, `shift` repeats along x and y: a periodic curve. rest (edge,): stress-free lengths of its edges. The spline
    has continuous curvature; at free ends its third derivative is continuous at the second point (not-a-knot), for fourth-order
    convergence up to the ends. Raises `BadFile` where points coincide so that no curve is left.
    """
    goes_on = closed or closing is not None
    if not goes_on and len(points) > 2 and _near(points[0], points[-1], float(np.ptp(points, axis=0).max())):
        points, goes_on = points[:-1], True
    closing = np.zeros(3) if closing is None else closing
    kind = "periodic" if any(shift) else "closed" if goes_on else "open"
    if goes_on:
        points = np.concatenate([points, points[:1] + closing])
    chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
    kept = chord > max(LEAST, 1e-9 * chord.max(initial=0.0))
    least = 3 if kind == "closed" else 1
    if np.count_nonzero(kept) < least:
        raise BadFile(f"fewer than {max(2, least)} points that differ")
    if rest is not None and not kept.all():
        raise BadFile("two points of a wire in one place")
    if goes_on:  # a last point that repeats the first goes, not the first
        points, chord = points[np.concatenate([[True], kept[:-1], [True]])][: 1 + np.count_nonzero(kept)], chord[kept]
        points[-1] = points[0] + closing
    else:
        points, chord = points[np.concatenate([[True], kept])], chord[kept]
    begin, end = points[:-1], points[1:]
    slope = _slopes(points, chord, closing, goes_on) if interpolation == "spline" else (end - begin) / chord[:, None]
    first, last = (slope[:-1], slope[1:]) if interpolation == "spline" else (slope, slope)
    along = chord[:, None] / 3.0
    pieces = np.stack([begin, begin + along * first, end - along * last, end], axis=1)
    return Curve(pieces, kind, shift, None if rest is None else rest / chord)


def _slopes(points: np.ndarray, chord: np.ndarray, closing: np.ndarray, goes_on: bool) -> np.ndarray:
    """(point, 3) derivatives by the chord, at its points, of the spline through them; it goes on moved by `closing`."""
    arc = np.concatenate([[0.0], np.cumsum(chord)])
    drift = closing / arc[-1]
    around = points - arc[:, None] * drift
    if goes_on:
        around[-1] = around[0]
    return np.asarray(CubicSpline(arc, around, bc_type="periodic" if goes_on else "not-a-knot")(arc, 1) + drift)


def _near(first: np.ndarray, last: np.ndarray, size: float) -> bool:
    return bool(np.abs(last - first).max() <= SAME * size)
