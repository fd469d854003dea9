"""Control points to cubic pieces in Bezier form, for each way in which files describe a curve.

Of the four control points P0..P3 of a piece, with B0..B3 its Bezier points:

    Catmull-Rom, uniform   B0 = P1                 B1 = P1 + (P2 - P0)/6   B2 = P2 - (P3 - P1)/6   B3 = P2
    B-spline, uniform      B0 = (P0 + 4 P1 + P2)/6  B1 = (2 P1 + P2)/3     B2 = (P1 + 2 P2)/3      B3 = (P1 + 4 P2 + P3)/6
    Bezier                 themselves, three steps from piece to piece

USD's wraps (UsdGeomBasisCurves): nonperiodic takes the points as they are, periodic repeats the first ones behind the last,
pinned puts 2 P[0] - P[1] before the first and 2 P[n-1] - P[n-2] behind the last, so that the curve reaches both ends.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import CubicSpline

from warpknit.wires.curve import LEAST, BadFile, Curve

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
    return Curve(pieces, "closed" if wrap == "periodic" or _meets(pieces) else "open")


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

    closed: it goes on from the last point to the first; so does a curve whose last point repeats the first.
    closing (3,): what it is on by when it repeats, `shift` repeats along x and y: a periodic curve.
    rest (edge,): lengths free of stress of its edges.
    The spline has continuous curvature and meets the points; at free ends its third derivative is continuous at the second
    point (not-a-knot), so that it converges with the fourth power of their distance up to its ends.
    Raises `BadFile` where points coincide so that no curve is left.
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


def _meets(pieces: np.ndarray) -> bool:
    """Whether an open curve of several pieces ends where it began."""
    corners = pieces.reshape(-1, 3)
    return len(pieces) > 1 and _near(corners[0], corners[-1], float(np.ptp(corners, axis=0).max()))
