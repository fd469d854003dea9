"""Crossings of the wires in plan view, with their over/under sign.

A wire copy is (thread, column): the endless thread, `column` repeats to the right.  Two segments p + t u and q + s v
cross where p + t u = q + s v with t, s in [0, 1]; only segments of chunks whose boxes overlap are tried.
At a crossing over = +1 where the first wire is in front (larger z), and turn = +1 where the second wire runs to the
left of the first, turn = sign(u x v).  Their product is the sign of the crossing in the sense of knot theory.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from .centreline import Thread

CHUNK = 16  # segments to a box


@dataclass(frozen=True)
class Crossings:
    """Crossings of one repeat, each once, with copies in [0, width) x [0, height).

    The first wire is the one with the smaller thread, then column, then arc.
    """

    position: NDArray[np.float64]  # (m, 2) [m]
    thread: NDArray[np.intp]  # (m, 2)
    column: NDArray[np.intp]  # (m, 2)
    arc: NDArray[np.float64]  # (m, 2) [m] unwrapped plan arc length on each wire
    over: NDArray[np.intp]  # (m,) +1 first wire in front, -1 behind
    turn: NDArray[np.intp]  # (m,) sign of (direction of first) x (direction of second)
    gap: NDArray[np.float64]  # (m,) [m] distance in z

    def __len__(self) -> int:
        return len(self.position)


def find_crossings(threads: Sequence[Thread], size: NDArray[np.float64]) -> Crossings:
    """Crossings of the threads of one repeat of `size` (2,) [m], with all copies and themselves."""
    start = np.concatenate([t.points for t in threads])
    end = np.concatenate([np.concatenate([t.points[1:], t.points[:1] + [0.0, size[1], 0.0]]) for t in threads])
    thread = np.concatenate([np.full(len(t.points), i) for i, t in enumerate(threads)])
    number = np.concatenate([np.arange(len(t.points)) for t in threads])
    count = np.array([len(t.points) for t in threads])
    spacing = np.array([t.spacing for t in threads])

    first, second, column, row = _near_segments(start, end, size)
    near = (thread[first] == thread[second]) & (column == 0)
    apart = np.abs(number[first] - number[second] - row * count[thread[second]])
    keep = ~near | (apart > 1)
    first, second, column, row = first[keep], second[keep], column[keep], row[keep]

    shift = np.stack([column * size[0], row * size[1]], axis=1)
    u, v = (end - start)[first], (end - start)[second]
    offset = start[second, :2] + shift - start[first, :2]
    cross = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (offset[:, 0] * v[:, 1] - offset[:, 1] * v[:, 0]) / cross
        s = (offset[:, 0] * u[:, 1] - offset[:, 1] * u[:, 0]) / cross
    slack = 1e-9
    hit = (t >= -slack) & (t <= 1.0 + slack) & (s >= -slack) & (s <= 1.0 + slack)
    first, second, column, row = first[hit], second[hit], column[hit], row[hit]
    t, s, u, v, cross = t[hit], s[hit], u[hit], v[hit], cross[hit]

    position = start[first, :2] + t[:, None] * u[:, :2]
    height = np.stack([start[first, 2] + t * u[:, 2], start[second, 2] + s * v[:, 2]], axis=1)
    arcs = np.stack(
        [
            (number[first] + t) * spacing[thread[first]],
            (number[second] + s + row * count[thread[second]]) * spacing[thread[second]],
        ],
        axis=1,
    )
    pair = np.stack([thread[first], thread[second]], axis=1)
    columns = np.stack([np.zeros_like(column), column], axis=1)
    return _canonical(position, pair, columns, arcs, height, np.sign(cross).astype(int), threads, size)


def _near_segments(
    start: NDArray[np.float64], end: NDArray[np.float64], size: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Pairs of segments (first, second moved by column and row repeats) in overlapping boxes, each pair once."""
    total = len(start)
    chunks = -(-total // CHUNK)
    index = np.minimum(np.arange(chunks * CHUNK), total - 1).reshape(chunks, CHUNK)
    both = np.stack([start[index, :2], end[index, :2]])
    low, high = both.min(axis=(0, 2)), both.max(axis=(0, 2))
    reach = np.ceil((high.max(axis=0) - low.min(axis=0)) / size).astype(int)
    found = []
    middle = 0.5 * (low + high)
    tree, widest = KDTree(middle), float((high - low).max())
    for column in range(reach[0] + 1):
        for row in range(-reach[1] if column else 0, reach[1] + 1):
            shift = [column, row] * size
            # boxes that overlap have their middles within the widest of them in x and in y
            beside = tree.query_ball_point(middle - shift, widest, p=np.inf, return_sorted=True)
            a = np.repeat(np.arange(chunks), [len(others) for others in beside])
            b = np.concatenate([np.asarray(others, dtype=np.intp) for others in beside])
            meet = np.all((low[a] <= high[b] + shift) & (low[b] + shift <= high[a]), axis=1)
            if column == 0 and row == 0:
                meet &= a <= b
            a, b = a[meet], b[meet]
            found.append(np.stack([a, b, np.full_like(a, column), np.full_like(a, row)]))
    a, b, columns, rows = np.concatenate(found, axis=1)
    pick = np.arange(CHUNK)
    first = (a[:, None, None] * CHUNK + pick[:, None] + 0 * pick).ravel()
    second = (b[:, None, None] * CHUNK + pick + 0 * pick[:, None]).ravel()
    columns, rows = np.repeat(columns, CHUNK * CHUNK), np.repeat(rows, CHUNK * CHUNK)
    keep = (first < total) & (second < total) & ((columns != 0) | (rows != 0) | (first < second))
    return first[keep], second[keep], columns[keep], rows[keep]


def _canonical(
    position: NDArray[np.float64],
    thread: NDArray[np.intp],
    column: NDArray[np.intp],
    arc: NDArray[np.float64],
    height: NDArray[np.float64],
    turn: NDArray[np.intp],
    threads: Sequence[Thread],
    size: NDArray[np.float64],
) -> Crossings:
    """Order the wires of each crossing, move it to the base repeat, drop duplicates."""
    step = column[:, 1] - column[:, 0]
    swap = (thread[:, 0] > thread[:, 1]) | (
        (thread[:, 0] == thread[:, 1]) & ((step < 0) | ((step == 0) & (arc[:, 0] > arc[:, 1])))
    )
    for pair in (thread, column, arc, height):
        pair[swap] = pair[swap, ::-1]
    turn = np.where(swap, -turn, turn)

    cell = np.floor(position / size + 1e-9).astype(int)
    lengths = np.array([t.length for t in threads])
    position = position - cell * size
    column = column - cell[:, :1]
    arc = arc - cell[:, 1:] * lengths[thread]

    order = np.lexsort((arc[:, 0], column[:, 1], column[:, 0], thread[:, 1], thread[:, 0]))
    position, thread, column, arc = position[order], thread[order], column[order], arc[order]
    height, turn = height[order], turn[order]
    tolerance = 1e-3 * min(t.spacing for t in threads)
    fresh = np.ones(len(order), dtype=bool)
    same = np.all((thread[1:] == thread[:-1]) & (column[1:] == column[:-1]), axis=1)
    fresh[1:] = ~(same & np.all(np.abs(arc[1:] - arc[:-1]) < tolerance, axis=1))
    rise = (height[:, 0] - height[:, 1])[fresh]
    over = np.where(rise >= 0.0, 1, -1)
    return Crossings(position[fresh], thread[fresh], column[fresh], arc[fresh], over, turn[fresh], np.abs(rise))
