"""Sites: the places where the knit hooks two wires into each other, and the contacts that belong to them.

The planar model has one body at each site (a clasp of the knit, nested lenses merged) with a pair for each of the two wires; a
pair may slide along its wire within a reach. A spatial contact belongs to a site if it is between the wires of the site, in the
periodic images that hook there, and within the reach on both; if several sites qualify, to the nearest. Other contacts belong to
no site.
"""

from __future__ import annotations

import itertools

import numpy as np

from .placed_wires import SpatialWires
from .rods import Rods

NOWHERE = -1
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
            place.append(rods.position[node] + (seed - np.floor(seed))[:, None] * rods.rest_edge[node])
        apart = place[0] - place[1]
        self.shift = self._tile * np.rint(np.divide(apart, self._tile, out=np.zeros_like(apart), where=self._tile > 0))

    # (site, 3) [m] at rest, of the second wire next to the first

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
