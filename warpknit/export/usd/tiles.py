"""Arrays of the stage's prims: tiles of whole wires, every eighth point (k8), a sheet (surface).

A mesh is cut into columns along the weft that hold about the same number of points each. Along the warp it is cut only
where its wires are: bands no lower than the longest wire.

At the level of detail k8 a wire keeps its first and its last point, and three at least. The largest stress around a point that
is kept stands for the points that are not, so that no peak is lost.

At the level of detail `surface` each face of a sheet of quadrilaterals is one repeat of the knit, or several where there are
very many. A face carries the largest stress of its wires and the share of its pairs that are active. Wire points belong to the
face that they lie in at the first frame, mapped back by the mean deformation F:  x = F X + u, and the sheet moves as the mean
of u over its faces says.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpknit.results.frame import WireLayout

MILLIMETRES = 1000.0  # stage units in a metre
POINTS_PER_TILE = 500_000
BLOCK = 8192  # points


@dataclass(frozen=True, eq=False)
class Tile:
    """Whole wires, and the bodies whose first wire is among them."""

    name: str  # Tile_ii_jj: column ii along the weft, band jj along the warp
    wires: NDArray[np.int64]  # rising
    runs: tuple[slice, ...]  # the points of its wires, among all drawn curves
    point_counts: NDArray[np.int64]  # [wire of the tile] points of the drawn curve
    bodies: NDArray[np.int64]
    origin: NDArray[np.float64]  # [3] [mm] near the middle, so that float32 is fine enough for what lies around it

    def take(self, values: NDArray[Any], kind: Any = None) -> NDArray[Any]:
        """The tile's part of `values` [point of all drawn curves, ...], as this type of number."""
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
        """Ranges of each run among all points, and among the tile's."""
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
    """Cut the mesh into tiles of about `points_per_tile` points; `position` [point, 3] [m]: of its drawn curves."""
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
    """Share [wire] of each wire, among `count` with similar numbers of points along `place`."""
    order = np.argsort(place, kind="stable")
    share = np.empty(place.size, dtype=np.int64)
    before = np.cumsum(points[order]) - 0.5 * points[order]
    share[order] = (before * (count / points.sum())).astype(np.int64)
    return share


def _middle(
    left: NDArray[Any], right: NDArray[Any], bottom: NDArray[Any], top: NDArray[Any], position: NDArray[Any], wires: NDArray[Any]
) -> NDArray[np.float64]:
    """Middle [3] [mm] of the bounds of these wires, rounded to um; height of the whole mesh."""
    z = position[:, 2]
    bounds = ((left, right), (bottom, top))
    middle = [0.5 * (low[wires].min() + high[wires].max()) for low, high in bounds] + [0.5 * (z.min() + z.max())]
    return np.round(MILLIMETRES * np.array(middle), 3)


STRIDE = 8  # points that are kept lie no farther apart


@dataclass(frozen=True, eq=False)
class Thinning:
    """Kept points of curves."""

    kept: NDArray[np.int32]  # [kept point] among the points of the curves
    first: NDArray[np.int32]  # [kept point] the first of the points that it stands for
    counts: NDArray[np.int64]  # [curve] kept points

    @classmethod
    def of(cls, point_counts: NDArray[Any]) -> "Thinning":
        """Thinning of consecutive curves with these numbers of points, three or more [curve]."""
        counts = np.maximum(3, 1 - (1 - point_counts) // STRIDE)
        start = np.cumsum(point_counts) - point_counts
        number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        steps, gaps = np.repeat(point_counts - 1, counts), np.repeat(counts - 1, counts)
        kept = np.repeat(start, counts) + number * steps // gaps
        first = np.where(number > 0, (kept + np.roll(kept, 1) + 1) // 2, kept)
        return cls(kept.astype(np.int32), first.astype(np.int32), counts)

    def largest(self, values: NDArray[Any]) -> NDArray[Any]:
        """Largest of `values` [point] around each kept point [kept point]."""
        return np.maximum.reduceat(values, self.first)


FACES_A_SIDE = 1000  # at most
BODIES_A_FACE = 12.0  # about, where the repeats of the knit are not known


class Sheet:
    """Sheet through wire points and bodies at their first positions.

    `points` [point, 2], `bodies` [body, 2] and `size` [2] of the mesh at rest in one unit of length; `deformation` [2, 2] of
    that frame; `repeats` [2] of the knit, 0 where unknown. `face_vertices` [face, 4], counter-clockwise.
    """

    def __init__(
        self, points: NDArray[Any], bodies: NDArray[Any], size: NDArray[Any], deformation: NDArray[Any], repeats: NDArray[Any]
    ) -> None:
        back = np.linalg.inv(deformation).T
        rest, body_rest = points @ back, bodies @ back
        size = np.maximum(size, 1e-9 * np.ptp(rest))  # a single straight wire has no width
        low = 0.5 * (rest.min(axis=0) + rest.max(axis=0) - size)  # loops reach a little beyond the edges
        columns, rows = _face_counts(repeats, size, bodies.shape[0])

        def cell_of(place: NDArray[Any]) -> NDArray[Any]:
            column, row = (
                np.clip(((place[:, axis] - low[axis]) * (count / size[axis])).astype(np.int64), 0, count - 1)
                for axis, count in ((0, columns), (1, rows))
            )
            return row * columns + column

        cell = cell_of(rest)
        cells, face, counts = np.unique(cell, return_inverse=True, return_counts=True)  # cells without a wire have no face
        self._order = np.argsort(face, kind="stable").astype(np.int32)
        self._first = np.cumsum(counts) - counts
        self._rest_mean = self._means(rest)
        row, column = np.divmod(cells, columns)
        corners = np.stack(
            [(row + up) * (columns + 1) + column + right for up, right in ((0, 0), (0, 1), (1, 1), (1, 0))], axis=1
        )
        vertices, self._corner = np.unique(corners, return_inverse=True)
        self._corner = self._corner.ravel()
        self.face_vertices = self._corner.reshape(-1, 4).astype(np.int32)
        vertex_row, vertex_column = np.divmod(vertices, columns + 1)
        self._vertex_rest = low + np.stack((vertex_column / columns, vertex_row / rows), axis=1) * size
        self._faces_at = np.bincount(self._corner)
        body_cell = cell_of(body_rest)
        place = np.minimum(np.searchsorted(cells, body_cell), cells.size - 1)
        self._body_face = np.where(cells[place] == body_cell, place, -1)
        self.pair_counts = 2 * np.bincount(self._body_face[self._body_face >= 0], minlength=cells.size)  # [face]

    @property
    def face_count(self) -> int:
        return int(self.face_vertices.shape[0])

    def position(self, points: NDArray[Any], deformation: NDArray[Any]) -> NDArray[np.float64]:
        """[vertex, 3]  where the sheet is when the wire points lie at `points` [point, 3]."""
        mean = self._means(points)
        mean[:, :2] -= self._rest_mean @ deformation.T
        moved = np.stack([np.bincount(self._corner, np.repeat(column, 4)) / self._faces_at for column in mean.T], axis=1)
        moved[:, :2] += self._vertex_rest @ deformation.T
        return moved

    def largest(self, values: NDArray[Any]) -> NDArray[Any]:
        """[face]  the largest of `values` [point]."""
        return np.maximum.reduceat(values[self._order], self._first)

    def active_percent(self, pair_active: NDArray[Any]) -> NDArray[np.float64]:
        """[face]  share of its pairs that are active, 0 where it has none; `pair_active` [pair], two a body."""
        inside = self._body_face >= 0
        active = pair_active.reshape(-1, 2).sum(axis=1)[inside]
        count = np.bincount(self._body_face[inside], active, minlength=self.face_count)
        return 100.0 * count / np.maximum(self.pair_counts, 1)

    def _means(self, values: NDArray[Any]) -> NDArray[np.float64]:
        """[face, k]  mean of `values` [point, k]."""
        counts = np.diff(self._first, append=self._order.size)
        sums = [np.add.reduceat(column[self._order].astype(np.float64), self._first) for column in values.T]
        return np.stack(sums, axis=1) / counts[:, None]


def _face_counts(repeats: NDArray[Any], size: NDArray[Any], bodies: int) -> tuple[int, int]:
    """Faces along weft and warp."""
    if not np.all(repeats):
        edge = math.sqrt(size[0] * size[1] / max(1.0, bodies / BODIES_A_FACE))
        repeats = np.maximum(1, np.round(size / edge)).astype(np.int64)
    together = -(-int(np.max(repeats)) // FACES_A_SIDE)
    columns, rows = (max(1, round(int(count) / together)) for count in repeats)
    return columns, rows
