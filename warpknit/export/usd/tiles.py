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
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from warpknit.results.frame import WireLayout

MILLIMETRES = 1000.0  # stage units in a metre
POINTS_PER_TILE = 500_000


STRIDE = 8  # points that are kept lie no farther apart


@dataclass(frozen=True, eq=False)
class Thinning:
    """Kept points of curves."""

    kept: np.ndarray  # [kept point] among the points of the curves
    first: np.ndarray  # [kept point] the first of the points that it stands for
    counts: np.ndarray  # [curve] kept points

    @classmethod
    def of(cls, point_counts: np.ndarray) -> "Thinning":
        """Thinning of consecutive curves with these numbers of points, three or more [curve]."""
        counts = np.maximum(3, 1 - (1 - point_counts) // STRIDE)
        start = np.cumsum(point_counts) - point_counts
        number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        steps, gaps = np.repeat(point_counts - 1, counts), np.repeat(counts - 1, counts)
        kept = np.repeat(start, counts) + number * steps // gaps
        first = np.where(number > 0, (kept + np.roll(kept, 1) + 1) // 2, kept)
        return cls(kept.astype(np.int32), first.astype(np.int32), counts)

    def largest(self, values: np.ndarray) -> np.ndarray:
        """Largest of `values` [point] around each kept point [kept point]."""
        return np.maximum.reduceat(values, self.first)


@dataclass(frozen=True, eq=False)
class Tile:
    """Whole wires, and the bodies whose first wire is among them."""

    name: str  # Tile_ii_jj: column ii along the weft, band jj along the warp
    wires: np.ndarray  # rising
    points: np.ndarray  # [point of the tile] among all drawn curves
    point_counts: np.ndarray  # [wire of the tile] points of the drawn curve
    bodies: np.ndarray
    origin: np.ndarray  # [3] [mm] near the middle, so that float32 is fine enough for what lies around it

    @cached_property
    def thinning(self) -> Thinning:
        """The points that are kept at the level k8."""
        return Thinning.of(self.point_counts)

    def take(self, values: np.ndarray) -> np.ndarray:
        """The tile's part of `values` [point of all drawn curves, ...]."""
        return values[self.points]

    def local(self, position: np.ndarray) -> np.ndarray:
        """[point, 3] [mm]  positions [m] from the tile's origin."""
        return (MILLIMETRES * position - self.origin).astype(np.float32)


def cut_tiles(layout: WireLayout, position: np.ndarray, points_per_tile: int = POINTS_PER_TILE) -> tuple[Tile, ...]:
    """Cut the mesh into tiles of about `points_per_tile` points; `position` [point, 3] [m]: of its drawn curves."""
    points, start = np.diff(layout.curve_start), layout.curve_start[:-1]
    low, high = np.minimum.reduceat(position, start), np.maximum.reduceat(position, start)  # [wire, 3]
    width, height, _ = high.max(axis=0) - low.min(axis=0)
    count = max(1, round(int(points.sum()) / points_per_tile))
    bands = round(np.sqrt(count * height / width)) if width > 0.0 else count
    longest = (high - low)[:, 1].max()
    bands = max(1, min(bands, count, int(height / longest) if longest > 0.0 else count))
    band = _shares((low + high)[:, 1], points, bands)
    tiles = []
    for row in range(bands):
        of_band = np.flatnonzero(band == row)
        column = _shares((low + high)[of_band, 0], points[of_band], max(1, round(count / bands)))
        for number in np.unique(column):
            wires = of_band[column == number]
            middle = 0.5 * (low[wires].min(axis=0) + high[wires].max(axis=0))
            middle[2] = 0.5 * (position[:, 2].min() + position[:, 2].max())  # of the whole mesh
            tiles.append(
                Tile(
                    name=f"Tile_{number:02d}_{row:02d}",
                    wires=wires,
                    points=np.concatenate([np.arange(start[wire], start[wire] + points[wire]) for wire in wires]),
                    point_counts=points[wires],
                    bodies=np.flatnonzero(np.isin(layout.body_wires[:, 0], wires)),
                    origin=np.round(MILLIMETRES * middle, 3),
                )
            )
    return tuple(tiles)


def _shares(place: np.ndarray, points: np.ndarray, count: int) -> np.ndarray:
    """Share [wire] of each wire, among `count` with similar numbers of points along `place`."""
    order = np.argsort(place, kind="stable")
    share = np.empty(place.size, dtype=np.int64)
    before = np.cumsum(points[order]) - 0.5 * points[order]
    share[order] = (before * (count / points.sum())).astype(np.int64)
    return share


FACES_A_SIDE = 1000  # at most
BODIES_A_FACE = 12.0  # about, where the repeats of the knit are not known


class Sheet:
    """Sheet through wire points and bodies at their first positions.

    `points` [point, 2], `bodies` [body, 2] and `size` [2] of the mesh at rest in one unit of length; `deformation` [2, 2] of
    that frame; `repeats` [2] of the knit, 0 where unknown. `face_vertices` [face, 4], counter-clockwise.
    """

    def __init__(
        self, points: np.ndarray, bodies: np.ndarray, size: np.ndarray, deformation: np.ndarray, repeats: np.ndarray
    ) -> None:
        back = np.linalg.inv(deformation).T
        rest, body_rest = points @ back, bodies @ back
        size = np.maximum(size, 1e-9 * np.ptp(rest))  # a single straight wire has no width
        low = 0.5 * (rest.min(axis=0) + rest.max(axis=0) - size)  # loops reach a little beyond the edges
        columns, rows = _face_counts(repeats, size, bodies.shape[0])

        def cell_of(place: np.ndarray) -> np.ndarray:
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

    def position(self, points: np.ndarray, deformation: np.ndarray) -> np.ndarray:
        """[vertex, 3]  where the sheet is when the wire points lie at `points` [point, 3]."""
        mean = self._means(points)
        mean[:, :2] -= self._rest_mean @ deformation.T
        moved = np.stack([np.bincount(self._corner, np.repeat(column, 4)) / self._faces_at for column in mean.T], axis=1)
        moved[:, :2] += self._vertex_rest @ deformation.T
        return moved

    def largest(self, values: np.ndarray) -> np.ndarray:
        """[face]  the largest of `values` [point]."""
        return np.maximum.reduceat(values[self._order], self._first)

    def active_percent(self, pair_active: np.ndarray) -> np.ndarray:
        """[face]  share of its pairs that are active, 0 where it has none; `pair_active` [pair], two a body."""
        inside = self._body_face >= 0
        active = pair_active.reshape(-1, 2).sum(axis=1)[inside]
        count = np.bincount(self._body_face[inside], active, minlength=len(self.pair_counts))
        return 100.0 * count / np.maximum(self.pair_counts, 1)

    def _means(self, values: np.ndarray) -> np.ndarray:
        """[face, k]  mean of `values` [point, k]."""
        counts = np.diff(self._first, append=self._order.size)
        sums = [np.add.reduceat(column[self._order].astype(np.float64), self._first) for column in values.T]
        return np.stack(sums, axis=1) / counts[:, None]


def _face_counts(repeats: np.ndarray, size: np.ndarray, bodies: int) -> tuple[int, int]:
    """Faces along weft and warp."""
    if not np.all(repeats):
        edge = math.sqrt(size[0] * size[1] / max(1.0, bodies / BODIES_A_FACE))
        repeats = np.maximum(1, np.round(size / edge)).astype(np.int64)
    together = -(-int(np.max(repeats)) // FACES_A_SIDE)
    columns, rows = (max(1, round(int(count) / together)) for count in repeats)
    return columns, rows
