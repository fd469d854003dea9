"""Sums over a mesh of rods from rows of blocks. Wire by wire: independent of threads and ranks."""

from __future__ import annotations

import numpy as np

from .rods import Rods
from .strip import RodStrip

LEFT_OUT = 1e-3  # of the blocks: in a large mesh some loops still snap while nothing else changes


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
        sums[self._own_wires] = self._of_own(rows)
        return sums

    def _of_own(self, rows: np.ndarray) -> np.ndarray:
        """[own wire, ...] sums."""
        return np.asarray(np.add.reduceat(rows[self._own], self._begin))

    def _of_worlds(self, of_wires: np.ndarray, worlds: np.ndarray | None) -> np.ndarray:
        """(world, n) exact sums of values (own wire, n), of all worlds or of some."""
        if self._worlds == 1:
            return np.asarray(self._ranks.exact_sum(of_wires))[None]
        by_world = of_wires.reshape(self._worlds, -1, of_wires.shape[1])
        return twofold_sum(by_world if worlds is None else by_world[worlds])

    def total(self, rows: np.ndarray, worlds: np.ndarray | None = None) -> np.ndarray:
        """(world, n) sums of rows (block, n), of all worlds or of some."""
        return self._of_worlds(self._of_own(rows), worlds)

    def of_nodes(self, values: np.ndarray, worlds: np.ndarray | None = None) -> np.ndarray:
        """[world] sums of values [node], of all worlds or of some."""
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
