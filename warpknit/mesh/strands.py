"""Copies of the threads of a repeat, and the wires on them: closed, or cut along an outline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..knit.cloth import Cloth
from ..scene.outline import Outline
from .cut import cut_cloth
from .rest_table import Table

NEAREST = 0.75  # node spacings from a clamp to the first free node, at least: nearer ones would need smaller steps


@dataclass(frozen=True)
class Strands:
    """Copies of the threads and the wires on them.

    A strand is thread t in column c of repeats; its nodes are counted by K = row * nodes[t] + k with k in one period.
    """

    columns: np.ndarray  # [column] columns of repeats that are kept
    rows: np.ndarray  # [row]
    closed: bool
    thread: np.ndarray  # [wire]
    column: np.ndarray  # [wire]
    begin: np.ndarray  # [wire] K of its first node
    count: np.ndarray  # [wire] nodes
    arc_begin: np.ndarray  # [wire] [m] where the wire begins and ends on its strand
    arc_end: np.ndarray  # [wire] [m]

    def wire(self, thread: np.ndarray, column: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """Wire (...) that holds the stretch from arc `low` to `high` [m] of strands (thread, column), -1 where none does."""
        if self.closed:
            return np.mod(column, len(self.columns)) * (self.thread.max() + 1) + thread
        # wires and stretches on one line: strand after strand, farther apart than any strand is long
        apart = 4.0 * max(np.abs(self.arc_begin).max(), np.abs(self.arc_end).max(), np.abs(low).max(), np.abs(high).max())
        first = self.columns[0]
        span = len(self.columns) + 4 * (1 + np.abs(column).max())

        def place(t: np.ndarray, c: np.ndarray) -> np.ndarray:
            return (t * span + c - first) * apart

        starts = place(self.thread, self.column) + self.arc_begin
        here = place(thread, column)
        found = np.searchsorted(starts, here + low, side="right") - 1
        ends = place(self.thread, self.column) + self.arc_end
        return np.where((found >= 0) & (here + high <= ends[found]), found, -1)


def closed_strands(cloth: Cloth, table: Table, repeats: tuple[int, int]) -> Strands:
    """Endless wires of a tile of `repeats` (weft, warp)."""
    threads = len(table.nodes)
    columns = np.arange(repeats[0])
    thread = np.tile(np.arange(threads), repeats[0])
    length = np.array([t.length for t in cloth.threads])[thread]
    return Strands(
        columns=columns,
        rows=np.arange(repeats[1]),
        closed=True,
        thread=thread,
        column=np.repeat(columns, threads),
        begin=np.zeros(len(thread), dtype=np.int64),
        count=table.nodes[thread] * repeats[1],
        arc_begin=np.zeros(len(thread)),
        arc_end=length * repeats[1],
    )


def cut_strands(cloth: Cloth, table: Table, outline: Outline) -> Strands:
    """Wires inside the outline: at either end two held nodes, the inner one next to the clamp, before or behind it."""
    cut = cut_cloth(cloth, outline)
    spacing = table.spacing[cut.thread]
    begin = np.ceil(cut.begin / spacing + NEAREST).astype(np.int64) - 2
    last = np.floor(cut.end / spacing - NEAREST).astype(np.int64) + 2
    return Strands(
        columns=cut.columns,
        rows=cut.rows,
        closed=False,
        thread=cut.thread,
        column=cut.column,
        begin=begin,
        count=last - begin + 1,
        arc_begin=cut.begin,
        arc_end=cut.end,
    )
