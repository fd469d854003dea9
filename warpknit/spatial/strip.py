"""The part of a mesh of rods that a rank steps: its own wires, beside copies of the wires of others that they may touch.

Wires run along the warp and stand in memory side by side, so a strip is a range of whole wires. Copies are not stepped here:
after every step their ranks send what contact reads (strip_step.py). So each rank finds the contacts of its own wires from the
same numbers and in the same order as in the mesh on one rank.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ..compute.ranks import Ranks
from ..mesh.panel import Panel
from ..mesh.strip import wires_of_ranks
from .contact_arrays import Contacts
from .rods import Rods

LEFT_OUT = 1e-3  # of the blocks: in a large mesh some loops still snap while nothing else changes


@dataclass(frozen=True)
class BorderWires:
    """Wires that are here and on another rank; both list them in the same order."""

    rank: int
    sent: np.ndarray  # own wires with copies there
    received: np.ndarray  # copies of wires of that rank


@dataclass(frozen=True)
class RodStrip:
    """Wires of a rank among its rods; numbers refer to these rods unless noted."""

    ranks: Ranks
    whole: Rods  # of all ranks
    wire: np.ndarray  # [wire] its number in the mesh, rising
    wires: range  # own
    nodes: range
    neighbours: tuple[BorderWires, ...] = ()

    @staticmethod
    def alone(rods: Rods) -> RodStrip:
        """All wires on one rank."""
        wires = len(rods.wire_first)
        return RodStrip(Ranks(), rods, np.arange(wires), range(wires), range(rods.node_count))

    @property
    def is_alone(self) -> bool:
        return self.ranks.count == 1

    @property
    def own(self) -> slice:
        """The own nodes."""
        return slice(self.nodes.start, self.nodes.stop)

    @cached_property
    def nodes_of_mesh(self) -> np.ndarray:
        """[node] its number in the mesh."""
        return self.whole.nodes_of(self.wire)

    def largest_of_nodes(self, values: np.ndarray) -> float:
        """Largest of values [node] over the mesh, at least 0."""
        return float(self.ranks.largest(np.array([np.max(values[self.own], initial=0.0)]))[0])

    def gathered(self, values: np.ndarray) -> np.ndarray:
        """[node of the mesh, ...] copied to the first rank, from values [node, ...]; on the others a copy of them."""
        parts = [] if self.is_alone else self.ranks.gather(np.ascontiguousarray(values[self.own]))
        return np.concatenate(parts) if parts else values.copy()

    def gathered_contacts(self, contacts: Contacts) -> Contacts:
        """Contacts of all ranks on the first one; elsewhere the strip's."""
        if self.is_alone:
            return contacts
        number = self.nodes_of_mesh
        own = vars(contacts) | {"first": number[contacts.first], "second": number[contacts.second]}
        parts = {name: self.ranks.gather(np.ascontiguousarray(values)) for name, values in own.items()}
        if not self.ranks.is_first:
            return contacts
        return Contacts(**{name: np.concatenate(values) for name, values in parts.items()})


def cut_rods(panel: Panel, rods: Rods, ranks: Ranks, reach: float) -> RodStrip:
    """Strip of this rank; its border has other wires within `reach` [m] along the weft.

    Raises `ModelError` where there are fewer wires than ranks.
    """
    first = wires_of_ranks(panel, ranks.count)
    low, high = weft_range(rods, rods.position[:, 0])
    held = []  # wires of the mesh on each rank
    for a, b in pairwise(first):
        is_near = within(low, high, low[a:b].min() - reach, high[a:b].max() + reach, float(rods.tile[0]))
        is_near[a:b] = True
        held.append(np.flatnonzero(is_near))
    here, begin, end = held[ranks.rank], int(first[ranks.rank]), int(first[ranks.rank + 1])
    own = np.arange(begin, end)
    neighbours = []
    for rank, there in enumerate(held):
        sent, received = np.intersect1d(own, there), np.intersect1d(np.arange(first[rank], first[rank + 1]), here)
        if rank != ranks.rank and (len(sent) or len(received)):
            neighbours.append(BorderWires(rank, *(np.searchsorted(here, wires) for wires in (sent, received))))
    count = rods.wire_count[here]
    node = np.append(0, np.cumsum(count))
    at = int(np.searchsorted(here, begin))
    wires = range(at, at + len(own))
    return RodStrip(ranks, rods, here, wires, range(int(node[wires.start]), int(node[wires.stop])), tuple(neighbours))


def weft_range(rods: Rods, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[wire] least and largest of the places along the weft [node] [m] of a wire."""
    return np.minimum.reduceat(x, rods.wire_first), np.maximum.reduceat(x, rods.wire_first)


def within(low: np.ndarray, high: np.ndarray, begin: float, end: float, period: float) -> np.ndarray:
    """Whether a range from `low` to `high` [m], or an image, overlaps `begin` to `end` [wire]."""
    images = (-period, 0.0, period) if period > 0.0 else (0.0,)
    return np.logical_or.reduce([(low + shift <= end) & (high + shift >= begin) for shift in images])


class WireSums:
    """Sums rows [block, ...] of own blocks over all ranks, world by world: collective calls."""

    def __init__(self, strip: RodStrip, rods: Rods, block_wire: np.ndarray, blocks: range, worlds: int = 1) -> None:
        """block_wire: wire of each block of nodes; blocks: of the own wires."""
        self._ranks, self._wires, self._worlds = strip.ranks, strip.wires, worlds
        self._own, self._own_wires = slice(blocks.start, blocks.stop), slice(strip.wires.start, strip.wires.stop)
        self._begin = np.searchsorted(block_wire[self._own], np.arange(strip.wires.start, strip.wires.stop))
        self._count, self._first_node = len(rods.wire_first), rods.wire_first
        of_mesh = float(strip.ranks.sum(np.array([len(blocks)]))[0])
        self._left_out = int(LEFT_OUT * of_mesh / worlds)  # blocks of a world

    def of_wires(self, rows: np.ndarray) -> np.ndarray:
        """[wire, ...] sums of the own wires; of the others zero."""
        sums = np.zeros((self._count, *rows.shape[1:]))
        sums[self._own_wires] = np.add.reduceat(rows[self._own], self._begin)
        return sums

    def _of_worlds(self, of_wires: np.ndarray, worlds: np.ndarray | None) -> np.ndarray:
        """(world, n) exact sums of values (own wire, n), of all worlds or of some."""
        if self._worlds == 1:
            return np.asarray(self._ranks.exact_sum(of_wires))[None]
        by_world = of_wires.reshape(self._worlds, -1, of_wires.shape[1])
        return twofold_sum(by_world if worlds is None else by_world[worlds])

    def total(self, rows: np.ndarray, worlds: np.ndarray | None = None) -> np.ndarray:
        """(world, n) sums of rows (block, n), of all worlds or of some."""
        return self._of_worlds(np.add.reduceat(rows[self._own], self._begin), worlds)

    def of_nodes(self, values: np.ndarray, worlds: np.ndarray | None = None) -> np.ndarray:
        """[world] sums of values [node], of all or some worlds."""
        return self._of_worlds(np.add.reduceat(values, self._first_node)[self._own_wires, None], worlds)[:, 0]

    def largest(self, rows: np.ndarray, worlds: np.ndarray | None = None) -> np.ndarray:
        """(world, n) the largest of each column (block, n), apart from LEFT_OUT of the blocks; of all worlds or of some."""
        own = rows[self._own].reshape(self._worlds, -1, rows.shape[1])
        own = own if worlds is None else own[worlds]
        first = max(own.shape[1] - self._left_out - 1, 0)
        if first > 0:
            own = np.partition(own, first, axis=1)[:, first:]
        largest = np.concatenate(self._ranks.everyone(own), axis=1)
        return np.asarray(np.sort(largest, axis=1)[:, -1 - self._left_out])


def twofold_sum(values: np.ndarray) -> np.ndarray:
    """Sums (world, n) of values (world, wire, n), as rounded from twofold precision. Equal to `Ranks.exact_sum`.

    Knuth's exact error of a sum; Ogita, Rump and Oishi 2005, SIAM J. Sci. Comput. 26, 1955.
    """
    total = np.add.accumulate(values, axis=1)
    before = np.zeros_like(total)
    before[:, 1:] = total[:, :-1]
    part = total - before
    error = (before - (total - part)) + (values - part)
    return np.asarray(total[:, -1] + np.add.accumulate(error, axis=1)[:, -1])
