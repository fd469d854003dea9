"""Sums over a mesh of rods from rows of blocks of nodes, wire by wire: the same however threads and ranks share the wires."""

from __future__ import annotations

import numpy as np

from .rods import Rods
from .strip import RodStrip


class WireSums:
    """Adds up rows [block, ...] of the own blocks of a strip over all ranks: collective calls."""

    def __init__(self, strip: RodStrip, rods: Rods, block_wire: np.ndarray, blocks: range) -> None:
        """block_wire: wire of each block of nodes; blocks: those of the own wires."""
        self._ranks, self._wires, self._blocks = strip.ranks, strip.wires, blocks
        self._begin = np.searchsorted(block_wire[self._own], np.arange(strip.wires.start, strip.wires.stop))
        self._count, self._first_node = len(rods.wire_first), rods.wire_first

    @property
    def _own(self) -> slice:
        return slice(self._blocks.start, self._blocks.stop)

    def of_wires(self, rows: np.ndarray) -> np.ndarray:
        """[wire, ...] sums of the own wires; of the others zero."""
        sums = np.zeros((self._count, *rows.shape[1:]))
        sums[self._wires.start : self._wires.stop] = np.add.reduceat(rows[self._own], self._begin)
        return sums

    def total(self, rows: np.ndarray) -> np.ndarray:
        """(n,) sum of rows (block, n) over the mesh."""
        return self._ranks.exact_sum(self.of_wires(rows)[self._wires.start : self._wires.stop])

    def of_nodes(self, values: np.ndarray) -> float:
        """The sum of values [node] over the mesh."""
        own = slice(self._wires.start, self._wires.stop)
        return float(self._ranks.exact_sum(np.add.reduceat(values, self._first_node)[own, None])[0])

    def largest(self, rows: np.ndarray) -> np.ndarray:
        """(n,) the largest of each column (block, n) over the mesh."""
        return self._ranks.largest(rows[self._own].max(axis=0))
