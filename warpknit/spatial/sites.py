"""Sites: the places where the knit hooks two wires into each other, and the contacts that belong to them.

The planar model has one body at each site (a clasp of the knit, nested lenses merged) with a pair for each of the two wires; a
pair may slide along its wire within a reach. In space a contact belongs to a site if it is between the wires of the site and
within the reach on both; if several sites qualify, to the nearest. Other contacts belong to no site.
"""

from __future__ import annotations

import numpy as np

from .placed_wires import SpatialWires
from .rods import Rods

NOWHERE = -1


class Sites:
    """The sites of a mesh, by their wires and reaches."""

    def __init__(self, wires: SpatialWires, rods: Rods) -> None:
        self.count = len(wires.site_wire)
        self._wire, self._seed = wires.site_wire, wires.site_seed
        self._low, self._high = wires.site_low, wires.site_high
        self._round = np.where(rods.wire_closed, rods.wire_count, 0)[self._wire]
        self._node_wire, self._first = rods.wire_of, rods.wire_first

    def of(self, first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """[contact] site of contacts between segments that begin at these nodes, NOWHERE for none; and a sign.

        The sign is +1 where the first node is on the first wire of the site, -1 where it is on the second.
        """
        found, sign = np.full(len(first), NOWHERE), np.ones(len(first))
        nearest = np.full(len(first), np.inf)
        for side, nodes in ((1.0, np.stack([first, second], axis=1)), (-1.0, np.stack([second, first], axis=1))):
            wires = self._node_wire[nodes]
            for k in range(len(nodes)):
                fits = np.flatnonzero((self._wire == wires[k]).all(axis=1))
                offset = nodes[k] - self._first[wires[k]] - self._seed[fits]
                rounds, low = self._round[fits], self._low[fits]
                turns = np.floor_divide(offset - low, np.maximum(rounds, 1))
                offset = np.where(rounds > 0, offset - rounds * turns, offset)
                inside = ((offset >= low) & (offset <= self._high[fits])).all(axis=1)
                span = (self._high[fits] - low + 1.0).clip(1.0)
                distance = np.where(inside, np.abs(offset / span).sum(axis=1), np.inf)
                if len(distance) and distance.min() < nearest[k]:
                    nearest[k], found[k], sign[k] = distance.min(), fits[np.argmin(distance)], side
        return found, sign
