"""Search radius and hash cells of the contact search."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import ModelError
from .rest_curve import RestCurve
from .rods import Rods

MARGIN = 0.5  # of a segment: approach allowed before the next search
MAX_SAG = 0.3  # of a segment: bound on the sag of a Catmull-Rom curve, 4/27 from either end
FREE_CELLS = (64, 64, 8)  # along x, y and z in directions without tiles
MIN_CELLS = 3  # of a tile, so that a cell has two different neighbours


@dataclass(frozen=True)
class SearchCells:
    """Margin, radius and cells of the search; lengths in m."""

    margin: float  # approach allowed before the next search
    max_sag: float  # of a segment, over its length
    radius: float  # largest distance of the midpoints of two segments that may touch before the next search
    count: np.ndarray  # (3,) cells along x, y and z
    size: np.ndarray  # (3,)


def search_cells(rods: Rods, curve: RestCurve) -> SearchCells:
    """The search cells for wires that touch on `curve`.

    Raises:
        ModelError: the tile is so small that a segment could touch two periodic images of another.
    """
    segments = rods.natural_length[rods.following >= 0]
    margin = MARGIN * float(segments.max())
    longest = 1.2 * float(segments.max())  # allows for stretch by the load
    max_sag = MAX_SAG + float((curve.bulge / rods.natural_length).max())
    radius = longest * (1.0 + 2.0 * max_sag) + 2.0 * float(rods.wire_radius.max()) + margin
    count = np.where(rods.tile > 0, np.floor(rods.tile / radius), FREE_CELLS).astype(int)
    if np.any(count < MIN_CELLS):
        sides = ((rods.tile > 0) & (count < MIN_CELLS)).nonzero()[0]
        needed = MIN_CELLS * radius
        times = " and ".join(f"{math.ceil(needed / rods.tile[k])} times as many {('wales', 'courses')[k]}" for k in sides)
        size = " and ".join(f"{1e3 * rods.tile[k]:.3g} mm {('wide', 'high')[k]}" for k in sides)
        raise ModelError(
            f"the periodic tile is {size}, allowed: {1e3 * needed:.3g} mm or more, so that no segment touches two periodic"
            f" images of another: use {times} (knit.repeats) or a smaller node spacing"
        )
    return SearchCells(margin, max_sag, radius, count, np.where(rods.tile > 0, rods.tile / count, radius))
