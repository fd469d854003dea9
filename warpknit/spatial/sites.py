"""Which contacts between wires belong to which place where the knit hooks two wires into each other.

A planar model has one body at each such place (a clasp of the knit, nested lenses merged) with a pair for each of the two wires;
a pair may slide along its wire within a reach. Here a contact between two wires belongs to a site where both wires are the site's
and the contact lies within that reach on either; to the nearest one, where several qualify. What belongs to none is a contact
elsewhere.
"""

from __future__ import annotations

import numpy as np

from .placed_wires import SpatialWires
from .rods import Rods

NOWHERE = -1


class Sites:
    """The sites of a mesh, by the wires and the nodes that they reach over."""

    def __init__(self, wires: SpatialWires, rods: Rods) -> None:
        self.count = len(wires.site_wire)
        self._wire, self._seed = wires.site_wire, wires.site_seed
        self._low, self._high = wires.site_low, wires.site_high
        self._round = np.where(rods.wire_closed, rods.wire_count, 0)[self._wire]
        self._node_wire, self._first = rods.wire_of, rods.wire_first

    def of(self, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """[contact] the site of contacts between segments that begin at these nodes, NOWHERE for one elsewhere; and +1 where the
        first node is on the first wire of the site, -1 where it is on the second."""
        found, sign = np.full(len(first), NOWHERE), np.ones(len(first))
        least = np.full(len(first), np.inf)
        for side, nodes in ((1.0, np.stack([first, second], axis=1)), (-1.0, np.stack([second, first], axis=1))):
            wires = self._node_wire[nodes]
            for k in range(len(nodes)):
                fits = np.flatnonzero((self._wire == wires[k]).all(axis=1))
                way = nodes[k] - self._first[wires[k]] - self._seed[fits]
                rounds, low = self._round[fits], self._low[fits]
                turns = np.floor_divide(way - low, np.maximum(rounds, 1))
                way = np.where(rounds > 0, way - rounds * turns, way)
                inside = ((way >= low) & (way <= self._high[fits])).all(axis=1)
                span = (self._high[fits] - low + 1.0).clip(1.0)
                off = np.where(inside, np.abs(way / span).sum(axis=1), np.inf)
                if len(off) and off.min() < least[k]:
                    least[k], found[k], sign[k] = off.min(), fits[np.argmin(off)], side
        return found, sign
