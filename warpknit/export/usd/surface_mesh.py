"""A panel as a coarse sheet of quadrilaterals: the level of detail `surface`.

Each face is one repeat of the knit, or several where there are very many. A face carries the largest stress of its wires
and the share of its pairs that are active. Wire points belong to the face that they lie in at the first frame, mapped
back by the mean deformation F:  x = F X + u, and the sheet moves as the mean of u over its faces says.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Surface"]

FACES_A_SIDE = 1000  # at most
BODIES_A_FACE = 12.0  # about, where the repeats of the knit are not known


class Surface:
    """The sheet through some wire points and bodies, from where they lie at the first frame.

    `points` [point, 2], `bodies` [body, 2] and `size` [2] of the mesh at rest in one unit of length; `deformation` [2, 2] of
    that frame; `repeats` [2] of the knit, 0 where unknown. `face_vertices` [face, 4], counter-clockwise.
    """

    def __init__(
        self,
        points: NDArray[Any],
        bodies: NDArray[Any],
        size: NDArray[Any],
        deformation: NDArray[Any],
        repeats: NDArray[Any],
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
