"""Copies of the threads of a repeat, and the wires on them: closed, or cut along an outline.

Cuts are arc lengths on the true centre lines of the threads: the same wires come out however finely they are divided.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..knit.cloth import Cloth
from ..scene.outline import Outline
from .rest_table import Table, ThreadCurve

PARALLEL = 1e-12  # direction cosines below which an edge runs along weft or warp
SAME = 1e-9  # of a thread's period: crossings nearer than this are one, as at a corner of the outline


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
        """Wire (...) with the segment from arc `low` to `high` [m] of strands (thread, column); else -1."""
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
    arc_end = np.array([t.length for t in cloth.threads])[thread] * repeats[1]
    begin = np.zeros(len(thread), dtype=np.int64)
    column, count = np.repeat(columns, threads), table.nodes[thread] * repeats[1]
    return Strands(columns, np.arange(repeats[1]), True, thread, column, begin, count, np.zeros(len(thread)), arc_end)


def cut_strands(cloth: Cloth, spacing: np.ndarray, outline: Outline) -> Strands:
    """Wires inside the outline, sorted by thread, column and arc; spacing [thread] [m]: of the nodes.

    At either end two nodes are held, the inner one next to the clamp, before or behind it.
    """
    width, height = cloth.size
    low, high = outline.low, outline.low + outline.size
    columns = np.arange(int(np.floor(low[0] / width)) - 2, int(np.ceil(high[0] / width)) + 2)
    rows = np.arange(int(np.floor(low[1] / height)) - 1, int(np.ceil(high[1] / height)) + 1)
    found: list[tuple[np.ndarray, ...]] = []
    for t, thread in enumerate(cloth.threads):
        curve = ThreadCurve(thread, height)
        column, arc = _crossings(curve, width, outline)
        order = np.lexsort((arc, column))
        column, arc = column[order], arc[order]
        distinct = (np.diff(column, prepend=np.iinfo(np.int64).min) != 0) | (np.diff(arc, prepend=0.0) > SAME * curve.length)
        column, arc = column[distinct], arc[distinct]
        # stretches between successive crossings of one strand
        here = np.nonzero(column[:-1] == column[1:])[0]
        middle = curve(0.5 * (arc[here] + arc[here + 1]))[:, :2]
        middle[:, 0] += column[here] * width
        inside = np.zeros(len(column), dtype=bool)
        inside[here] = outline.contains(middle)
        # a run of stretches inside is one wire: crossings that only touch the outline do not end it
        first = np.nonzero(inside & ~np.concatenate([[False], inside[:-1]]))[0]
        last = np.nonzero(inside & ~np.concatenate([inside[1:], [False]]))[0]
        found.append((np.full(len(first), t), column[first], arc[first], arc[last + 1]))
    wire, column, arc_begin, arc_end = (np.concatenate(part) for part in zip(*found, strict=True))
    begin = np.ceil(arc_begin / spacing[wire] + NEAREST).astype(np.int64) - 2
    count = np.floor(arc_end / spacing[wire] - NEAREST).astype(np.int64) + 3 - begin
    return Strands(columns, rows, False, wire, column, begin, count, arc_begin, arc_end)


def _crossings(curve: ThreadCurve, width: float, outline: Outline) -> tuple[np.ndarray, np.ndarray]:
    """Columns of the strands of a thread that meet the outline; arc lengths [m] there."""
    (x_low, x_high), (y_low, y_high) = curve.reach
    columns, arcs = [], []
    for corner, edge, length in zip(outline.corners, outline.edges, outline.lengths, strict=True):
        normal = np.array([edge[1], -edge[0]]) / length
        normal[np.abs(normal) < PARALLEL] = 0.0
        normal /= normal[np.flatnonzero(normal)[0]] if np.count_nonzero(normal) == 1 else 1.0
        x_ends, y_ends = np.sort([corner[0], corner[0] + edge[0]]), np.sort([corner[1], corner[1] + edge[1]])
        column = np.arange(np.floor((x_ends[0] - x_high) / width), np.ceil((x_ends[1] - x_low) / width) + 1).astype(np.int64)
        # the part of the edge that lies within the reach of each column, and from it the rows
        y_first, y_last = np.full(len(column), y_ends[0]), np.full(len(column), y_ends[1])
        if normal[1] != 0.0:
            ends = [np.clip(column * width + x, *x_ends) for x in (x_low, x_high)]
            y_there = np.sort([corner[1] + (x - corner[0]) * edge[1] / edge[0] for x in ends], axis=0)
            y_first, y_last = y_there
        row_first = np.floor((y_first - y_high) / curve.height).astype(np.int64)
        rows = np.ceil((y_last - y_low) / curve.height).astype(np.int64) + 1 - row_first
        place = np.repeat(np.arange(len(column)), rows)
        column = column[place]
        row = np.repeat(row_first, rows) + np.arange(len(place)) - np.repeat(np.cumsum(rows) - rows, rows)
        arcs_at = curve.across(normal)
        level = corner @ normal - normal[0] * width * column - normal[1] * curve.height * row
        for value, group in _groups(level):
            root = arcs_at(value)
            if not len(root):
                continue
            point = curve(root)[:, None, :2] + np.stack([column[group] * width, row[group] * curve.height], axis=1)
            share = (point - corner) @ edge / length**2
            on_edge = np.nonzero((share >= 0.0) & (share <= 1.0))
            columns.append(column[group][on_edge[1]])
            arcs.append(root[on_edge[0]] + row[group][on_edge[1]] * curve.length)
    return np.concatenate(columns), np.concatenate(arcs)


def _groups(values: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Each distinct value with the indices where it stands."""
    distinct, index = np.unique(values, return_inverse=True)
    order = np.argsort(index, kind="stable")
    return list(zip(distinct.tolist(), np.split(order, np.cumsum(np.bincount(index))[:-1]), strict=True))
