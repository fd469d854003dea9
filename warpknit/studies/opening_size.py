"""Size of the openings of a mesh: the areas between its wires in plan view, and the largest circle in each.

The plan view of one repeat has a grid of points, fine against the wire. A point is free if it is farther than half a wire from
every centre line. Connected free points are an opening.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ..measure import Observables

POINTS_ACROSS = 5  # grid points on a wire thickness
MAX_POINTS = 6_000_000  # of the grid over nine tiles; coarser for a large repeat of thin wire
SMALLEST = 0.01  # of the area of the largest opening: smaller slits do not count

BANDS = (("L", 1.5e9), ("S", 3e9), ("C", 6e9), ("X", 10e9), ("Ku", 15e9), ("K", 22e9), ("Ka", 35e9), ("Q", 43e9))  # [Hz]
FINE_ENOUGH = (10.0, 20.0, 50.0)  # required wavelengths over the opening, for increasing demands on the transmission


@dataclass(frozen=True)
class OpeningSize:
    """One opening of a repeat."""

    area: float  # [m2]
    circle: float  # [m] diameter of the largest circle in it
    width: float  # [m] extent along weft
    height: float  # [m] along warp


def openings(r: Observables) -> list[OpeningSize]:
    """The openings of one tile of a periodic mesh, the largest first."""
    layout = r.model.layout()
    node = r.node_position[:, None, :2]
    points = np.concatenate([node, node + r.between[..., :2]], axis=1)
    node = points.reshape(-1, 2)  # and points of the curve between them
    starts, counts = points.shape[1] * layout.wire_start[:-1], points.shape[1] * np.diff(layout.wire_start)
    period = r.gradient @ [0.0, layout.period[1]]
    wires = [node[first : first + count] for first, count in zip(starts, counts, strict=True)]
    ends = np.concatenate([np.append(wire[1:], wire[:1] + period, axis=0) for wire in wires])
    return openings_between(node, ends, r.gradient @ np.diag(layout.period), r.model.scene.wire.thickness)


def openings_between(begins: np.ndarray, ends: np.ndarray, periods: np.ndarray, thickness: float) -> list[OpeningSize]:
    """Openings between wires (segment, 2) of `thickness` [m] that repeat by the columns of `periods` (2, 2), largest first."""
    corners = periods @ np.array([[-1, 2, -1, 2], [-1, -1, 2, 2]])  # of nine tiles
    low, size = corners.min(axis=1), np.ptp(corners, axis=1)
    pitch = max(thickness / POINTS_ACROSS, float(np.sqrt(np.prod(size) / MAX_POINTS)))
    shape = np.ceil(size / pitch).astype(int)
    points = _along(begins, ends, 0.5 * pitch)
    share = np.linalg.solve(periods, points.T).T % 1.0
    free = np.ones(shape, dtype=bool)
    for tile in np.ndindex(5, 5):
        place = np.floor(((share + tile - 2.0) @ periods.T - low) / pitch).astype(int)
        place = place[np.all((place >= 0) & (place < shape), axis=1)]
        free[place[:, 0], place[:, 1]] = False
    distance = pitch * ndimage.distance_transform_edt(free)
    pieces, _ = ndimage.label(distance > 0.5 * thickness)
    found = []
    for number, where in enumerate(ndimage.find_objects(pieces), start=1):
        if any(s.start == 0 or s.stop == n for s, n in zip(where, shape, strict=True)):
            continue  # cut by the border of the nine tiles
        inside = pieces[where] == number
        place = np.stack(np.nonzero(inside), axis=1) + [s.start + 0.5 for s in where]
        middle = np.linalg.solve(periods, low + pitch * place.mean(axis=0))
        if np.any((middle < 0.0) | (middle >= 1.0)):
            continue  # the copy of another tile
        circle = 2.0 * float(distance[where][inside].max()) - thickness
        extent = pitch * (np.ptp(place, axis=0) + 1.0)
        found.append(OpeningSize(pitch**2 * len(place), circle, *extent.tolist()))
    if not found:
        return []
    ordered = sorted(found, key=lambda opening: -opening.area)
    return [opening for opening in ordered if opening.area >= SMALLEST * ordered[0].area]


def _along(begins: np.ndarray, ends: np.ndarray, spacing: float) -> np.ndarray:
    """Points (k, 2) on the stretches, at most `spacing` apart."""
    count = np.maximum(1, np.ceil(np.linalg.norm(ends - begins, axis=1) / spacing).astype(int))
    which = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)) / count[which]
    return np.asarray(begins[which] + share[:, None] * (ends - begins)[which])
