"""Pairs of neighbouring segments at rest, found on the host: for estimates."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ..wires.overlaps import segment_distances
from .rods import Rods
from .search_cells import SearchCells

MIN_ARC_SEPARATION = 2.0  # thicknesses along a wire, below which it does not touch itself


def pair_gaps(rods: Rods, cells: SearchCells) -> np.ndarray:
    """[pair] [m] gaps between straight segments, of the pairs that a search at rest finds."""
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
    arc_separation = np.abs(arc[first] - arc[second])
    arc_separation = np.where(
        rods.wire_closed[wire[first]], np.minimum(arc_separation, rods.wire_length[wire[first]] - arc_separation), arc_separation
    )
    length = np.maximum(rods.natural_length[first], rods.natural_length[second])
    neighbours = (wire[first] == wire[second]) & (
        arc_separation < np.maximum(1.01 * length, MIN_ARC_SEPARATION * 2.0 * radius[wire[first]] - length)
    )
    gap = distance - radius[wire[first]] - radius[wire[second]]
    return gap[~neighbours & (gap < cells.margin)]
