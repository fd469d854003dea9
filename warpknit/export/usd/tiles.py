"""Tiles of whole wires: what one prim of the stage holds.

A mesh is cut into columns along the weft that hold about the same number of points each. Along the warp it is cut only
where its wires are: bands no lower than the longest wire.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpknit.results.frame import WireLayout

__all__ = ["MILLIMETRES", "POINTS_PER_TILE", "Tile", "cut_tiles", "from_origin", "tile_of"]

MILLIMETRES = 1000.0  # stage units in a metre
POINTS_PER_TILE = 500_000
BLOCK = 8192  # points


@dataclass(frozen=True, eq=False)
class Tile:
    """Whole wires, and the bodies whose first wire is among them."""

    name: str  # Tile_ii_jj: column ii along the weft, band jj along the warp
    wires: NDArray[np.int64]  # rising
    runs: tuple[slice, ...]  # the points of its wires among those of all drawn curves
    point_counts: NDArray[np.int64]  # [wire of the tile] points of the drawn curve
    bodies: NDArray[np.int64]
    origin: NDArray[np.float64]  # [3] [mm] near the middle, so that float32 is fine enough for what lies around it

    def take(self, values: NDArray[Any], kind: Any = None) -> NDArray[Any]:
        """The part of `values` [point of all drawn curves, ...] that belongs to the tile, as this type of number."""
        taken = np.empty((int(self.point_counts.sum()), *values.shape[1:]), kind or values.dtype)
        for run, place in self._places():
            taken[place] = values[run]
        return taken

    def local(self, position: NDArray[Any]) -> NDArray[np.float32]:
        """[point of the tile, 3] [mm]  its part of `position` [point, 3] [m] from its origin."""
        points = np.empty((int(self.point_counts.sum()), 3), dtype=np.float32)
        for run, place in self._places():
            from_origin(position[run], self.origin, points[place])
        return points

    def _places(self) -> Iterator[tuple[slice, slice]]:
        """Each run among all points, and among those of the tile."""
        first = 0
        for run in self.runs:
            length = run.stop - run.start
            yield run, slice(first, first + length)
            first += length


def from_origin(position: NDArray[Any], origin: NDArray[Any], out: NDArray[np.float32]) -> NDArray[np.float32]:
    """Positions [point, 3] [m] from `origin` [3] [mm] in mm, into `out`: in double precision, and rounded at the end.

    In blocks that stay in cache, over all three coordinates at once: twice as fast as a coordinate at a time.
    """
    flat, flat_out = np.ascontiguousarray(position).reshape(-1), out.reshape(-1)
    repeated, block = np.tile(origin, BLOCK), np.empty(3 * BLOCK)
    for first in range(0, flat.size, 3 * BLOCK):
        part = flat[first : first + 3 * BLOCK]
        moved = np.multiply(part, MILLIMETRES, out=block[: part.size])
        moved -= repeated[: part.size]
        flat_out[first : first + part.size] = moved
    return out


def cut_tiles(layout: WireLayout, position: NDArray[Any], points_per_tile: int = POINTS_PER_TILE) -> tuple[Tile, ...]:
    """Cut the mesh whose drawn curves lie at `position` [point, 3] [m] into tiles of about `points_per_tile` points."""
    points = np.diff(layout.curve_start)
    (left, right), (bottom, top) = (_wire_bounds(layout, position[:, axis]) for axis in (0, 1))
    width, height = right.max() - left.min(), top.max() - bottom.min()
    count = max(1, round(int(points.sum()) / points_per_tile))
    bands = round(np.sqrt(count * height / width)) if width > 0.0 else count
    longest = (top - bottom).max()
    bands = max(1, min(bands, count, int(height / longest) if longest > 0.0 else count))
    band = _shares(bottom + top, points, bands)
    tiles = []
    for row in range(bands):
        wires = np.flatnonzero(band == row)
        column = _shares((left + right)[wires], points[wires], max(1, round(count / bands)))
        for number in range(int(column.max(initial=-1)) + 1):
            chosen = wires[column == number]
            if chosen.size:
                name = f"Tile_{number:02d}_{row:02d}"
                tiles.append(tile_of(layout, name, chosen, _middle(left, right, bottom, top, position, chosen)))
    return tuple(tiles)


def tile_of(layout: WireLayout, name: str, wires: NDArray[Any], origin: NDArray[Any]) -> Tile:
    """The tile of these wires, rising; `origin` [3] in mm."""
    breaks = np.flatnonzero(np.diff(wires) != 1)
    first, last = wires[np.append(0, breaks + 1)], wires[np.append(breaks, wires.size - 1)]
    start = layout.curve_start
    is_inside = np.zeros(layout.wire_count, dtype=bool)
    is_inside[wires] = True
    return Tile(
        name=name,
        wires=np.asarray(wires, dtype=np.int64),
        runs=tuple(slice(int(start[a]), int(start[b + 1])) for a, b in zip(first, last, strict=True)),
        point_counts=np.diff(start)[wires],
        bodies=np.flatnonzero(is_inside[layout.body_wires[:, 0]]),
        origin=np.asarray(origin, dtype=np.float64),
    )


def _wire_bounds(layout: WireLayout, values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """[wire]  lowest and highest of a coordinate along each drawn curve."""
    values, first = np.ascontiguousarray(values), layout.curve_start[:-1]
    return np.minimum.reduceat(values, first), np.maximum.reduceat(values, first)


def _shares(place: NDArray[Any], points: NDArray[Any], count: int) -> NDArray[np.int64]:
    """[wire]  which of `count` shares of about as many points each wire belongs to, counted along `place`."""
    order = np.argsort(place, kind="stable")
    share = np.empty(place.size, dtype=np.int64)
    before = np.cumsum(points[order]) - 0.5 * points[order]
    share[order] = (before * (count / points.sum())).astype(np.int64)
    return share


def _middle(
    left: NDArray[Any], right: NDArray[Any], bottom: NDArray[Any], top: NDArray[Any], position: NDArray[Any], wires: NDArray[Any]
) -> NDArray[np.float64]:
    """[3] [mm]  of the bounds of these wires, rounded to um; the height is that of the whole mesh."""
    z = position[:, 2]
    bounds = ((left, right), (bottom, top))
    middle = [0.5 * (low[wires].min() + high[wires].max()) for low, high in bounds] + [0.5 * (z.min() + z.max())]
    return np.round(MILLIMETRES * np.array(middle), 3)
