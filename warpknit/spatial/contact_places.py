"""Places of contacts and sites on spatial wires."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..wires.overlaps import segment_distances
from .sites import NOWHERE

AT_A_TIME = 2**14  # pairs of segments whose distances are computed at a time


def site_places(r: Any) -> np.ndarray:
    """Contact point (site, 3) [m] of both wires of each site; the one with the largest force.

    Without contact, the midpoint between the nearest points of both wires. In the tile in which the first wire is drawn.
    """
    place = np.full((r.sites.count, 3), np.nan)
    site, sign = r.touching_site
    order = np.lexsort((-r.touching.force, site))
    order = order[site[order] != NOWHERE]
    number, first = np.unique(site[order], return_index=True)
    strongest = order[first]
    place[number] = touched_places(r, strongest, sign[strongest])
    apart = np.flatnonzero(np.isnan(place[:, 0]))
    place[apart] = _nearest(r, apart)
    return place


def touched_places(r: Any, contact: np.ndarray, sign: np.ndarray | float = 1.0) -> np.ndarray:
    """(contact, 3) [m] places of contacts; sign: 1 where the first wire of one is the first wire of the site, else -1."""
    t, sign = r.touching, np.broadcast_to(sign, len(contact))
    side = np.where(sign > 0.0, 0, 1)
    node = np.where(side == 0, t.first[contact], t.second[contact])
    rods = r.model.rods
    half = r.length_factor * rods.wire_radius[rods.wire_of[node]] - 0.5 * t.overlap[contact]
    own = r.position[node] + r.curve.offset(node, t.place[contact, side])
    return np.asarray(own - (sign * half)[:, None] * t.normal[contact])


def _nearest(r: Any, sites: np.ndarray) -> np.ndarray:
    """(site, 3) [m] midpoints between the nearest points of the two wires of sites, within their reach."""
    wires = r.model.wires
    nodes = (wires.site_high - wires.site_low)[sites].max(axis=0, initial=0.0) + 3.0
    parts = np.array_split(sites, max(1, int(np.ceil(len(sites) * nodes.prod() / AT_A_TIME))))
    return np.concatenate([_between(r, part) for part in parts])


def _between(r: Any, sites: np.ndarray) -> np.ndarray:
    """The same of a few sites."""
    (line, drawn), (other, _) = (_line(r, sites, side) for side in (0, 1))
    shift = r.sites.shift[sites].copy()
    shift[:, :2] = shift[:, :2] @ r.gradient.T
    other = other + shift[:, None]
    a, b = (grid.ravel() for grid in np.meshgrid(np.arange(line.shape[1] - 1), np.arange(other.shape[1] - 1)))
    ends = (line[:, a], line[:, a + 1], other[:, b], other[:, b + 1])
    distance, place_a, place_b = (
        values.reshape(len(sites), len(a)) for values in segment_distances(*(end.reshape(-1, 3) for end in ends))
    )
    row, k = np.arange(len(sites)), np.argmin(distance, axis=1)
    a, b = a[k], b[k]
    own = line[row, a] + place_a[row, k][:, None] * (line[row, a + 1] - line[row, a])
    facing = other[row, b] + place_b[row, k][:, None] * (other[row, b + 1] - other[row, b])
    return np.asarray(0.5 * (own + facing) - drawn[row, a])


def _line(r: Any, sites: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (site, node, 3) [m] of one wire of sites within reach, and the periodic shift [m] of each.

    Shorter lines end in segments without length: the last ones before them are as near, and count.
    """
    rods, wires = r.model.rods, r.model.wires
    wire, seed = wires.site_wire[sites, side], wires.site_seed[sites, side]
    end, is_closed = rods.wire_count[wire] - 1, rods.wire_closed[wire] != 0
    first = np.floor(seed + wires.site_low[sites, side]).astype(int)
    last = np.ceil(seed + wires.site_high[sites, side]).astype(int)
    first, last = np.where(is_closed, first, np.maximum(first, 0)), np.where(is_closed, last, np.minimum(last, end))
    is_short = ~is_closed & (last <= first)
    nearest = np.minimum(np.rint(seed).astype(int), end)
    first, last = np.where(is_short, np.maximum(nearest - 1, 0), first), np.where(is_short, nearest, last)
    count, size = rods.wire_count[wire][:, None], int((last - first).max(initial=1)) + 1
    number = np.minimum(first[:, None] + np.arange(size), last[:, None])
    turns = np.where(is_closed[:, None], number // count, 0)
    closing = np.zeros((len(sites), 3))
    closing[:, :2] = rods.wire_period[wire, :2] @ r.gradient.T
    shift = turns[:, :, None] * closing[:, None]
    return r.position[rods.wire_first[wire][:, None] + number - turns * count] + shift, shift
