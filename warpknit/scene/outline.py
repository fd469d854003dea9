"""Outline of a gripped mesh: a simple polygon as knitted, x weft and y warp.

Its corners run counter-clockwise; places on it are counted by arc length from the first corner.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

SAMPLES = 8  # by which the part of a cell inside an outline is found, in a direction
DISC_CORNERS = 96  # of the polygon that stands for a disc; it has the disc's area


@dataclass(frozen=True)
class Outline:
    """corners (corner, 2) [m], counter-clockwise."""

    corners: np.ndarray

    @property
    def low(self) -> np.ndarray:
        """(2,) [m] lower corner of the box around it."""
        return self.corners.min(axis=0)

    @property
    def size(self) -> np.ndarray:
        """(2,) [m] of the box around it."""
        return np.ptp(self.corners, axis=0)

    @cached_property
    def area(self) -> float:
        """[m2]"""
        return signed_area(self.corners)

    @cached_property
    def edges(self) -> np.ndarray:
        """(corner, 2) [m] from each corner to the next."""
        return np.roll(self.corners, -1, axis=0) - self.corners

    @cached_property
    def lengths(self) -> np.ndarray:
        """(corner,) [m] of the edges."""
        return np.hypot(self.edges[:, 0], self.edges[:, 1])

    @cached_property
    def arcs(self) -> np.ndarray:
        """(corner,) [m] arc length at which each corner stands."""
        return np.concatenate([[0.0], np.cumsum(self.lengths)[:-1]])

    @property
    def length(self) -> float:
        """[m] all round."""
        return float(self.lengths.sum())

    def shifted(self, by: np.ndarray) -> Outline:
        """The same moved by (2,) [m]."""
        return Outline(self.corners + by)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """(point,) whether points (point, 2) [m] lie inside."""
        from matplotlib.path import Path  # a third of a second, for gripped meshes only

        return Path(np.vstack([self.corners, self.corners[:1]]), closed=True).contains_points(points)

    def cover(self, low: np.ndarray, cell: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
        """Share (column, row) of each grid cell inside the outline. The grid starts at `low` (2,) [m], with cells of `cell` (2,)
        [m].
        """
        inside = (np.arange(SAMPLES) + 0.5) / SAMPLES
        x, y = (low[k] + cell[k] * (np.arange(shape[k])[:, None] + inside).ravel() for k in range(2))
        there = self.contains(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2))
        return there.reshape(shape[0], SAMPLES, shape[1], SAMPLES).mean(axis=(1, 3))

    def place(self, arc: np.ndarray) -> np.ndarray:
        """Points (..., 2) [m] at arc lengths [m]."""
        arc = np.mod(arc, self.length)
        edge = np.searchsorted(self.arcs, arc, side="right") - 1
        return self.corners[edge] + self.edges[edge] * ((arc - self.arcs[edge]) / self.lengths[edge])[..., None]

    def nearest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Arc lengths (point,) [m] of the nearest places on the outline; distances (point,) [m] to points (point, 2) [m]."""
        best, arc = np.full(len(points), np.inf), np.zeros(len(points))
        for corner, edge, length, start in zip(self.corners, self.edges, self.lengths, self.arcs, strict=True):
            from_corner = points - corner
            along = np.clip(from_corner @ edge / length**2, 0.0, 1.0)
            away = from_corner - along[:, None] * edge
            distance = np.hypot(away[:, 0], away[:, 1])
            nearer = distance < best
            best, arc = np.where(nearer, distance, best), np.where(nearer, start + along * length, arc)
        return arc, best


def signed_area(corners: np.ndarray) -> float:
    """[m2] of a polygon (corner, 2) [m], positive where its corners run counter-clockwise."""
    following = np.roll(corners, -1, axis=0)
    return 0.5 * float(np.sum(corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]))


def is_simple(corners: np.ndarray) -> bool:
    """Whether edges of the polygon (corner, 2) meet only at common corners."""
    n = len(corners)
    start, end = corners, np.roll(corners, -1, axis=0)

    def turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        return (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])

    i, j = np.triu_indices(n, k=2)
    apart = (i > 0) | (j < n - 1)
    i, j = i[apart], j[apart]
    sides = turn(start[i], end[i], start[j]) * turn(start[i], end[i], end[j])
    others = turn(start[j], end[j], start[i]) * turn(start[j], end[j], end[i])
    return not np.any((sides <= 0.0) & (others <= 0.0))


def rectangle(width: float, height: float) -> Outline:
    """width and height [m], round the origin."""
    return Outline(0.5 * np.array([[-width, -height], [width, -height], [width, height], [-width, height]]))


def regular(corners: int, side: float) -> Outline:
    """Regular polygon with `side` [m] about the origin, its lowest side along weft."""
    radius = side / (2.0 * np.sin(np.pi / corners))
    angle = -0.5 * np.pi + np.pi / corners * (2 * np.arange(corners) - 1)
    return Outline(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def disc(diameter: float) -> Outline:
    """Polygon with DISC_CORNERS corners and a disc's area, about the origin."""
    n = DISC_CORNERS
    radius = 0.5 * diameter * np.sqrt(2.0 * np.pi / (n * np.sin(2.0 * np.pi / n)))
    angle = 2.0 * np.pi * np.arange(n) / n
    return Outline(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def turned(outline: Outline, angle: float) -> Outline:
    """The outline turned counter-clockwise round the origin by `angle` [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return Outline(outline.corners @ np.array([[c, s], [-s, c]]))
