"""Pairs of neighbouring segments at rest, found on the host: for estimates."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.spatial import cKDTree

from ..wires.overlaps import segment_distances
from .rods import Rods
from .search_cells import SearchCells

MIN_ARC_SEPARATION = 2.0  # thicknesses along a wire, below which it does not touch itself


def pair_gaps(rods: Rods, cells: SearchCells) -> np.ndarray:
    """[pair] [m] gaps between straight segments, of the pairs that a search at rest finds, with all periodic images."""
    segment = np.flatnonzero(rods.following >= 0)
    begin, edge = rods.position[segment], rods.rest_edge[segment]
    first, second, shift = _near_images(begin + 0.5 * edge, rods.tile, cells.radius)
    moved = begin[second] + shift
    distance, _, _ = segment_distances(begin[first], begin[first] + edge[first], moved, moved + edge[second])
    wire, radius = rods.wire_of, rods.wire_radius
    first, second = segment[first], segment[second]
    length = np.maximum(rods.natural_length[first], rods.natural_length[second])
    neighbours = _arc_separation(rods, first, second, shift) < np.maximum(
        1.01 * length, MIN_ARC_SEPARATION * 2.0 * radius[wire[first]] - length
    )
    gap = distance - radius[wire[first]] - radius[wire[second]]
    return gap[~neighbours & (gap < cells.margin)]


def _near_images(middle: np.ndarray, tile: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of points (n, 3) [m] within `radius` [m], each once: numbers of both, and the shift (pair, 3) [m] of the second."""
    box = np.where(tile > 0, tile, 1.0)
    moved = np.where(tile > 0, -np.floor(middle / box), 0.0)
    inside = middle + moved * box
    most = np.where(tile > 0, np.ceil(radius / box), 0).astype(int)
    numbers, offsets = [], []
    for offset in itertools.product(*(range(-m, m + 1) for m in most)):
        place = inside + offset * box
        near = np.flatnonzero(((place >= -radius) & (place <= tile + radius) | (tile == 0)).all(axis=1))
        numbers.append(near)
        offsets.append(np.broadcast_to(offset, (len(near), 3)))
    number, image = np.concatenate(numbers), np.concatenate(offsets)
    near = cKDTree(inside).sparse_distance_matrix(cKDTree(inside[number] + image * box), radius, output_type="ndarray")
    first, second, image = near["i"], number[near["j"]], image[near["j"]]
    x, y, z = image.T
    is_later = (x > 0) | ((x == 0) & ((y > 0) | ((y == 0) & (z > 0))))
    kept = (first < second) | ((first == second) & is_later)
    first, second, image = first[kept], second[kept], image[kept]
    return first, second, np.where(tile > 0, (image + moved[second] - moved[first]) * box, 0.0)


def _arc_separation(rods: Rods, first: np.ndarray, second: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """[pair] [m] along the wire between two segments, the second moved by `shift` (pair, 3) [m]; infinite between two wires."""
    wire = rods.wire_of[first]
    period, length = rods.wire_period[wire], rods.wire_length[wire]
    size = np.sum(period**2, axis=1)
    turns = np.rint(np.divide(np.sum(shift * period, axis=1), size, out=np.zeros(len(wire)), where=size > 0))
    is_along = np.linalg.norm(shift - turns[:, None] * period, axis=1) <= 1e-6 * length
    is_same = (wire == rods.wire_of[second]) & is_along
    separation = np.abs(rods.arc[second] - rods.arc[first] + turns * length)
    is_ring = rods.wire_closed[wire] & (size == 0)
    return np.where(is_same, np.where(is_ring, np.minimum(separation, length - separation), separation), np.inf)
