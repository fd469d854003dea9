"""Sites: the places where the knit hooks two wires into each other, and the contacts that belong to them.

The planar model has one body at each site (a clasp of the knit, nested lenses merged) with a pair for each of the two wires; a
pair may slide along its wire within a reach. A spatial contact belongs to a site if it is between the wires of the site, in the
periodic images that hook there, and within the reach on both; if several sites qualify, to the nearest. Other contacts belong to
no site.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from ..wires.overlaps import segment_distances
from .placed_wires import SpatialWires
from .rods import Rods

NOWHERE = -1
AT_A_TIME = 2**14  # pairs of segments whose distances are computed at a time
SAME_SHIFT = 1e-3  # of the tile: round-off of a periodic shift


class Sites:
    """The sites of a mesh, by their wires and reaches."""

    def __init__(self, wires: SpatialWires, rods: Rods) -> None:
        self.count = len(wires.site_wire)
        self._wire, self._seed = wires.site_wire, wires.site_seed
        self._low, self._high = wires.site_low, wires.site_high
        self._wire_round = np.where(rods.wire_closed, rods.wire_count, 0)
        self._round = self._wire_round[self._wire]
        self._node_wire, self._first = rods.wire_of, rods.wire_first
        self._period = rods.wire_period[self._wire]
        self._tile = rods.tile
        # sites in the order of their wires and places on the first one, with the keys and the span of places
        self._span = int(np.ceil(np.abs(self._seed).max(initial=0.0))) + 2
        key = self._key(self._wire, self._seed[:, 0])
        self._order = np.argsort(key, kind="stable")
        self._keys = key[self._order]
        # (site, 3) [m] at rest, periodic shift of the second wire next to the first that joins both at their seeds
        place = []
        for wire, seed in zip(self._wire.T, self._seed.T, strict=True):
            node = rods.wire_first[wire] + np.clip(seed, 0, rods.wire_count[wire] - 1).astype(int)
            place.append(rods.position[node] + (seed - np.floor(seed))[:, None] * rods.edge_after(node))
        apart = place[0] - place[1]
        self.shift = self._tile * np.rint(np.divide(apart, self._tile, out=np.zeros_like(apart), where=self._tile > 0))

    def of(
        self, first: np.ndarray, second: np.ndarray, shift: np.ndarray, place: np.ndarray | float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """[contact] site of contacts between segments that begin at these nodes, NOWHERE for none; and a sign.

        The sign is +1 where the first node is on the first wire of the site, -1 where it is on the second. shift (contact, 3)
        [m]: at rest, of the second segment next to the first; place (contact, 2): on both segments, 0 .. 1.
        """
        places = np.broadcast_to(place, (len(first), 2))
        found, sign = np.full(len(first), NOWHERE), np.ones(len(first))
        nearest = np.full(len(first), np.inf)
        both = np.stack([first, second], axis=1)
        for side, nodes, at in ((1.0, both, places), (-1.0, both[:, ::-1], places[:, ::-1])):
            wires = self._node_wire[nodes]
            number = nodes + at - self._first[wires]
            contact, site = self._candidates(wires, number)
            distance = self._distance(site, number[contact], side * shift[contact])
            order = np.lexsort((site, distance, contact))
            best = order[np.unique(contact[order], return_index=True)[1]]
            best = best[distance[best] < nearest[contact[best]]]
            nearest[contact[best]], found[contact[best]], sign[contact[best]] = distance[best], site[best], side
        return found, sign

    def _key(self, wires: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Numbers that order wires (any, 2) and places on the first one."""
        pair = wires[:, 0].astype(float) * len(self._first) + wires[:, 1]
        return np.asarray(pair * 4.0 * self._span + np.clip(place, -self._span, self._span))

    def _candidates(self, wires: np.ndarray, number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Contacts and sites of the same wires (contact, 2), within reach on the first wire."""
        order, key = self._order, self._keys
        if not len(order):
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
        rounds = self._wire_round[wires[:, 0]]
        low, high = float(self._low[:, 0].min()) - 1.0, float(self._high[:, 0].max()) + 1.0
        if (rounds > 0).any() and high - low >= rounds[rounds > 0].min():
            windows = [(np.full(len(number), -np.inf), np.full(len(number), np.inf))]  # any place is within reach
        else:
            turns = (-1, 0, 1) if rounds.any() else (0,)
            windows = [(number[:, 0] + turn * rounds - high, number[:, 0] + turn * rounds - low) for turn in turns]
        contacts, sites = [], []
        for begin, end in windows:
            a = np.searchsorted(key, self._key(wires, begin), side="left")
            b = np.searchsorted(key, self._key(wires, end), side="right")
            count = np.maximum(b - a, 0)
            contacts.append(np.repeat(np.arange(len(number)), count))
            sites.append(order[np.repeat(a - np.cumsum(count) + count, count) + np.arange(count.sum())])
        return np.concatenate(contacts), np.concatenate(sites)

    def _distance(self, sites: np.ndarray, number: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """[candidate] distance of a contact from the seeds of a site, over the reach; infinite beyond it or of other images.

        sites [candidate]; number (candidate, 2): places along both wires, in nodes; shift (candidate, 3) [m] of the second.
        """
        low, high, rounds = self._low[sites], self._high[sites], self._round[sites]
        offset = number - self._seed[sites]
        turns = np.floor_divide(offset - low, np.maximum(rounds, 1)) * (rounds > 0)
        distance = np.full(len(sites), np.inf)
        again = np.divide(high - low, rounds, out=np.zeros(low.shape), where=rounds > 0).max(axis=0, initial=0.0).astype(int)
        for more in itertools.product(*(range(n + 1) for n in again)):
            turned = turns - np.array(more) * (rounds > 0)
            along = offset - rounds * turned
            period = turned[:, :, None] * self._period[sites]
            is_image = np.abs(shift - self.shift[sites] - period[:, 0] + period[:, 1]) <= SAME_SHIFT * self._tile
            inside = ((along >= low) & (along <= high)).all(axis=1) & is_image.all(axis=1)
            span = (high - low + 1.0).clip(1.0)
            distance = np.minimum(distance, np.where(inside, np.abs(along / span).sum(axis=1), np.inf))
        return distance


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
    """Midpoints of `_nearest` for a few sites."""
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
