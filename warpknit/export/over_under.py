"""Wires in plan view that pass over and under each other, and the copies of a periodic tile that fill a picture."""

from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

__all__ = ["copied", "over_under", "tile_copies"]

EDGE = 1.3  # [pt] white on either side of a wire: a gap in the wires below it
OVERLAP = 0.3  # of its width, by which a piece of wire reaches over its neighbours: no seam between them
EDGE_OVERLAP = 0.25  # [pt] the same of its white edge: less, for the wire to cover what it hides of its neighbours


def over_under(pieces: NDArray[Any], colours: Any, width: float, points_per_mm: float, edge: float = EDGE) -> LineCollection:
    """Straight pieces (piece, 2, 3) [mm] of wires in `colours` (piece, 4), the lowest first, each on a wider white one.

    width: of the wires [pt]; edge: of the white on either side [pt].
    """
    order = np.argsort(pieces[:, :, 2].sum(axis=1), kind="stable")
    plan = pieces[order, :, :2]
    along = plan[:, 1] - plan[:, 0]
    along /= points_per_mm * np.maximum(np.hypot(*along.T), 1e-12)[:, None]  # [mm]  a point of paper
    ends = np.stack([-along, along], axis=1)
    lines = np.stack([plan + EDGE_OVERLAP * ends, plan + OVERLAP * width * ends], axis=1).reshape(-1, 2, 2)
    white = np.ones((len(plan), 4))
    drawn = np.stack([white, np.asarray(colours)[order]], axis=1).reshape(-1, 4)
    widths = np.tile([width + 2.0 * edge, width], len(plan))
    return LineCollection(list(lines), colors=drawn, linewidths=widths, capstyle="butt", zorder=1)


def tile_copies(points: NDArray[Any], period: NDArray[Any], low: NDArray[Any], high: NDArray[Any]) -> NDArray[Any]:
    """Offsets (copy, 2) of the copies of a tile of `points` (point, 2) that may show between `low` and `high`.

    The columns of `period` (2, 2) lead to the next copy.
    """
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
    place, window = (np.linalg.solve(period, some.T).T for some in (points, corners))
    first = np.floor(window.min(axis=0) - place.max(axis=0)).astype(int)
    last = np.ceil(window.max(axis=0) - place.min(axis=0)).astype(int)
    grid = np.meshgrid(np.arange(first[0], last[0] + 1), np.arange(first[1], last[1] + 1), indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, 2) @ period.T


def copied(pieces: NDArray[Any], offsets: NDArray[Any], low: NDArray[Any], high: NDArray[Any]) -> tuple[NDArray[Any], Any]:
    """Copies of pieces (piece, 2, 3) that may show between `low` and `high`, and which piece each one is."""
    shift = np.concatenate([offsets, np.zeros((len(offsets), 1))], axis=1)
    every = (pieces + shift[:, None, None]).reshape(-1, 2, 3)
    shows = np.all((every[:, :, :2].max(axis=1) > low) & (every[:, :, :2].min(axis=1) < high), axis=1)
    return every[shows], np.tile(np.arange(len(pieces)), len(offsets))[shows]
