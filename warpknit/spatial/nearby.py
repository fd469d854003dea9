"""How many pairs of segments are near each other at rest, found without a device: for estimates."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..wires.overlaps import segment_distances
from .rods import Rods
from .search_cells import SearchCells

APART = 2.0  # thicknesses along a wire below which its segments do not touch each other


def pair_gaps(rods: Rods, cells: SearchCells) -> np.ndarray:
    """[pair] [m] between the surfaces of segments as straight rods, of those that a search at rest finds."""
    segment = np.flatnonzero(rods.following >= 0)
    begin, edge = rods.position[segment], rods.rest_edge[segment]
    middle = begin + 0.5 * edge
    box = rods.tile
    inside = np.where(box > 0, np.mod(middle, np.where(box > 0, box, 1.0)), middle)
    first, second = segment[cKDTree(inside, boxsize=box).query_pairs(cells.radius, output_type="ndarray")].T
    number = np.searchsorted(segment, [first, second])
    shift = middle[number[0]] - middle[number[1]]
    shift = box * np.rint(np.divide(shift, box, out=np.zeros_like(shift), where=box > 0))
    distance, _, _ = segment_distances(
        begin[number[0]], (begin + edge)[number[0]], begin[number[1]] + shift, (begin + edge)[number[1]] + shift
    )
    wire, arc, radius = rods.wire_of, rods.arc, rods.wire_radius
    way = np.abs(arc[first] - arc[second])
    way = np.where(rods.wire_closed[wire[first]], np.minimum(way, rods.wire_length[wire[first]] - way), way)
    length = np.maximum(rods.natural_length[first], rods.natural_length[second])
    neighbours = (wire[first] == wire[second]) & (way < np.maximum(1.01 * length, APART * 2.0 * radius[wire[first]] - length))
    gap = distance - radius[wire[first]] - radius[wire[second]]
    return gap[~neighbours & (gap < cells.margin)]
