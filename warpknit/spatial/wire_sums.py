"""Sums over a mesh of rods from rows of blocks of nodes, wire by wire: the same however threads and ranks share the wires."""

from __future__ import annotations

import numpy as np

from ..host import fetch
from .rod_step import RodStepper


class WireSums:
    """Adds up rows [block, ...] of the own blocks of a stepper, over all ranks."""

    def __init__(self, stepper: RodStepper) -> None:
        self._ranks, self._wires, self._blocks = stepper.strip.ranks, stepper.strip.wires, stepper.blocks
        self._begin = np.searchsorted(fetch(stepper.arrays.block_wire)[self._own], np.arange(self._wires.start, self._wires.stop))
        self._count = len(stepper.rods.wire_first)

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

    def largest(self, rows: np.ndarray) -> np.ndarray:
        """(n,) the largest of each column (block, n) over the mesh."""
        return self._ranks.largest(rows[self._own].max(axis=0))
