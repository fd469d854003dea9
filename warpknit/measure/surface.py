"""Out-of-plane shape of a panel under tension, with its edge on a paraboloid.

A mesh under tension has next to no bending stiffness over many loops and carries no pressure: div(N grad w) = 0, with N the
tension of the panel's map (tiles.py) and w = r^2/(4 f) where the edge is held; between net nodes the edge hangs on its
cord, which pulls it straight. What is left of the paraboloid is w less r^2/(4 f): the pillowing. Linear triangles on the strained
panel; slopes are taken to be small (their square against the strain of the mesh). A mesh that leaves its plane has heights of its
own, the mean of the wires of each stitch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import spsolve
from scipy.spatial import Delaunay, cKDTree

from ..mesh.rim import Rim
from .observables import PanelMap

CROWDED = 0.4  # of the spacing: smallest distance of inner points from the edge


@dataclass(frozen=True)
class PanelSurface:
    """Points of the panel, with their heights and the paraboloid's."""

    point: np.ndarray  # (point, 2) [m] of the strained panel, from its centre
    triangle: np.ndarray  # (triangle, 3) points
    height: np.ndarray  # (point,) [m]
    wanted: np.ndarray  # (point,) [m]

    @property
    def deviation(self) -> np.ndarray:
        """(point,) [m] height above the paraboloid."""
        return self.height - self.wanted

    @property
    def area(self) -> np.ndarray:
        """(triangle,) [m2]"""
        return triangle_areas(self.point, self.triangle)

    def rms(self, values: np.ndarray) -> float:
        """Root mean square over the area of values (point,), linear on each triangle."""
        v = values[self.triangle]
        square = (np.sum(v**2, axis=1) + v[:, 0] * v[:, 1] + v[:, 1] * v[:, 2] + v[:, 2] * v[:, 0]) / 6.0
        return float(np.sqrt(np.sum(self.area * square) / self.area.sum()))

    @property
    def rms_deviation(self) -> float:
        """[m] rms deviation from the paraboloid."""
        return self.rms(self.deviation)

    @property
    def rms_best_fit(self) -> float:
        """[m] rms deviation after a best-fit shift and tilt of the panel."""
        weight = np.zeros(len(self.point))
        np.add.at(weight, self.triangle, np.repeat(self.area[:, None], 3, axis=1) / 3.0)
        plane = np.column_stack([np.ones(len(self.point)), self.point])
        root = np.sqrt(weight)[:, None]
        fit = np.linalg.lstsq(root * plane, root[:, 0] * self.deviation, rcond=None)[0]
        return self.rms(self.deviation - plane @ fit)

    @property
    def pillowing(self) -> float:
        """[m] largest deviation from the paraboloid."""
        return float(np.abs(self.deviation).max())


def triangle_areas(point: np.ndarray, triangle: np.ndarray) -> np.ndarray:
    """(triangle,) [m2]"""
    a, b = point[triangle[:, 1]] - point[triangle[:, 0]], point[triangle[:, 2]] - point[triangle[:, 0]]
    return 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def find_surface(
    map_: PanelMap, rim: Rim, gradient: np.ndarray, stations: np.ndarray, middle: np.ndarray, focal_length: float
) -> PanelSurface:
    """Shape of a panel with its edge on z = r^2/(4 focal_length) [m] about its centre.

    rim, gradient (2, 2) and the displacement of the stations (station, 2) [m] define the edge; `middle` (2,) [m] is the middle of
    the panel as knitted. A mesh that leaves its plane has the heights of its wires and of its stations (station, 3) [m].
    """
    sheet, edge = map_.sheet, rim.place - middle
    inner, spacing = (map_.place[map_.known], map_.tile) if sheet is None else (sheet.rest, sheet.cell)
    distance = rim.outline.nearest(inner + middle)[1]
    is_inside = rim.outline.contains(inner + middle) & (distance > CROWDED * spacing.min())
    rest = np.concatenate([edge, inner[is_inside]])
    triangle = Delaunay(rest).simplices
    triangle = triangle[rim.outline.contains(rest[triangle].mean(axis=1) + middle)]
    triangle = triangle[triangle_areas(rest, triangle) > 1e-9 * map_.tile.prod()]
    point = rest @ gradient.T
    point[: len(edge)] += stations[:, :2]
    if sheet is not None:
        point[len(edge) :] = sheet.now[is_inside, :2]
    wanted = np.sum(point**2, axis=1) / (4.0 * focal_length)
    if sheet is not None:
        return PanelSurface(point, triangle, np.concatenate([stations[:, 2], sheet.now[is_inside, 2]]), wanted)
    cord = rim.cord_forces(gradient, stations)[1] if rim.is_free else None
    tension = _tension_at(map_, rest[triangle].mean(axis=1))
    return PanelSurface(point, triangle, _membrane_height(point, triangle, tension, wanted, rim.given, cord), wanted)


def _membrane_height(
    point: np.ndarray, triangle: np.ndarray, tension: np.ndarray, wanted: np.ndarray, given: np.ndarray, cord: np.ndarray | None
) -> np.ndarray:
    """[point] [m] heights under a tension (triangle, 2, 2) [N/m]; the first points are the stations of the rim.

    given: [station] whether it is held; cord: [station] [N] tension of the cord behind it, None without cords.
    """
    nodes, n_edge = len(point), len(given)
    area = triangle_areas(point, triangle)
    corner = point[triangle]
    opposite = np.roll(corner, -1, axis=1) - np.roll(corner, -2, axis=1)  # edge opposite each corner
    signed = opposite[:, 0, 0] * opposite[:, 1, 1] - opposite[:, 0, 1] * opposite[:, 1, 0]
    slope = np.stack([opposite[..., 1], -opposite[..., 0]], axis=-1) / signed[:, None, None]
    element = np.einsum("tia,tab,tjb->tij", slope, tension, slope) * area[:, None, None]
    rows, columns = np.repeat(triangle, 3, axis=1), np.tile(triangle, (1, 3))
    matrix = sparse.coo_matrix((element.ravel(), (rows.ravel(), columns.ravel())), (nodes, nodes)).tocsr()
    if cord is not None:
        here, there = np.arange(n_edge), (np.arange(n_edge) + 1) % n_edge
        length = np.hypot(*(point[there] - point[here]).T)
        pull = cord / length
        entries = np.concatenate([pull, pull, -pull, -pull])
        places = (np.concatenate([here, there, here, there]), np.concatenate([here, there, there, here]))
        matrix = matrix + sparse.csr_matrix((entries, places), (nodes, nodes))
    held = np.zeros(nodes, dtype=bool)
    held[:n_edge] = given
    used = np.zeros(nodes, dtype=bool)
    used[triangle] = True
    free = np.nonzero(~held & used)[0]
    height = np.where(held, wanted, 0.0)
    height[free] = spsolve(matrix[free][:, free].tocsc(), -(matrix[free] @ height))
    height[~held & ~used] = wanted[~held & ~used]
    return height


def _tension_at(map_: PanelMap, place: np.ndarray) -> np.ndarray:
    """Tension (place, 2, 2) [N/m] of the nearest tile with a value, made symmetric and positive definite."""
    known = map_.known & np.isfinite(map_.tension).all(axis=(2, 3))
    _, nearest = cKDTree(map_.place[known]).query(place)
    tension = map_.tension[known][nearest]
    tension = 0.5 * (tension + np.swapaxes(tension, 1, 2))
    values, vectors = np.linalg.eigh(tension)
    floor = 1e-3 * np.abs(values).max()
    values = np.maximum(values, floor)  # lower bound of the tension of a slack mesh
    return np.einsum("pab,pb,pcb->pac", vectors, values, vectors)
