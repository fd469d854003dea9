"""How far segments are looked for round one another, and the cells of the hash that they are looked for in."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import ModelError
from .rest_curve import RestCurve
from .rods import Rods

MARGIN = 0.5  # of a segment: how much nearer things may come before the next search
MOST_SAG = 0.3  # of a segment: more than Catmull-Rom's curve ever leaves its chord by, 4/27 at either end
FREE_CELLS = (64, 64, 8)  # along x, y and z where the world has no tiles
FEWEST_CELLS = 3  # of a tile, so that a cell has two neighbours that are not one


@dataclass(frozen=True)
class SearchCells:
    """Lengths in m."""

    margin: float  # how much nearer things may come before the next search
    most_sag: float  # of a segment, over its length
    radius: float  # distance of the middles of two segments that may come to touch
    count: np.ndarray  # (3,) cells along x, y and z
    size: np.ndarray  # (3,)


def search_cells(rods: Rods, curve: RestCurve) -> SearchCells:
    """The cells for wires that touch on `curve`.

    Raises:
        ModelError: a tile is so small that a segment would meet two copies of another.
    """
    segments = rods.natural_length[rods.following >= 0]
    margin = MARGIN * float(segments.max())
    longest = 1.2 * float(segments.max())  # with room for what load stretches
    most_sag = MOST_SAG + float((curve.bulge / rods.natural_length).max())
    radius = longest * (1.0 + 2.0 * most_sag) + 2.0 * float(rods.wire_radius.max()) + margin
    count = np.where(rods.tile > 0, np.floor(rods.tile / radius), FREE_CELLS).astype(int)
    if np.any(count < FEWEST_CELLS):
        sides = ((rods.tile > 0) & (count < FEWEST_CELLS)).nonzero()[0]
        needed = FEWEST_CELLS * radius
        times = " and ".join(f"{math.ceil(needed / rods.tile[k])} times as many {('wales', 'courses')[k]}" for k in sides)
        size = " and ".join(f"{rods.tile[k]:.3g} m {('wide', 'high')[k]}" for k in sides)
        raise ModelError(
            f"the periodic tile is {size}, allowed: {needed:.3g} m or more, so that no segment meets two copies of another:"
            f" {times} (knit.repeats), or nodes nearer together"
        )
    return SearchCells(margin, most_sag, radius, count, np.where(rods.tile > 0, rods.tile / count, radius))
