"""Search radius and hash cells of the contact search."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .rest_curve import RestCurve
from .rods import Rods

APPROACH = 0.12, 0.5  # of a segment, and of the thickness at least: approach allowed before the next search
MAX_OFFSET = 0.25  # thicknesses: most that the multiplier of either wire adds to its radius (contact_multipliers.py)
MAX_SAG = 0.4  # of a segment: bound on the sag of its curve without bumps, 4/27 (1 + MAX_RATIO/3) from either end
STRETCHED = 1.2  # largest length of a segment under load over that at rest
CELL = 0.5  # width of a cell over the radius, which bounds what most segments reach by far
FREE_CELLS = np.array([64, 64, 8])  # fewest along x, y and z in directions without tiles


@dataclass(frozen=True)
class SearchCells:
    """Margin, radius and cells of the search; lengths in m."""

    approach: float  # of two wires, allowed before the next search
    margin: float  # gap up to which pairs are listed: what multipliers push apart, and the approach
    radius: float  # bound on the distance of the midpoints of two segments that may touch before the next search
    count: np.ndarray  # (3,) cells along x, y and z
    size: np.ndarray  # (3,)


def search_cells(rods: Rods, curve: RestCurve) -> SearchCells:
    """Search cells for wires that touch on `curve`, no narrower than the search radius."""
    segments = rods.natural_length[rods.following >= 0]
    approach = max(APPROACH[0] * float(segments.max()), APPROACH[1] * rods.section.thickness)
    margin = approach + 2.0 * MAX_OFFSET * rods.section.thickness
    reach = STRETCHED * float(((0.5 + MAX_SAG) * curve.length + curve.bulge).max())  # of a curve, from the middle of its chord
    radius = 2.0 * reach + 2.0 * rods.largest_radius + margin
    is_tiled = rods.tile > 0
    size = CELL * radius
    count = np.where(is_tiled, np.maximum(np.floor(rods.tile / size), 1), _free_cells(rods, size)).astype(int)
    return SearchCells(approach, margin, radius, count, np.where(is_tiled & (count > 1), rods.tile / count, size))


def _free_cells(rods: Rods, size: float) -> np.ndarray:
    """Number of cells (3,) of `size` [m] that hold the mesh at rest without sharing; about a node each."""
    needed = np.maximum(FREE_CELLS, np.ceil(np.ptp(rods.position, axis=0) / size) + 2.0)
    share = min(1.0, np.sqrt(rods.node_count / np.prod(needed)))
    return np.maximum(FREE_CELLS, np.floor(share * needed))
