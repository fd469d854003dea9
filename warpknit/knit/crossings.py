"""Crossings of the wires in plan view, with their over/under sign.

A wire copy is (thread, column): the endless thread, `column` repeats to the right.  Two segments p + t u and q + s v
cross where p + t u = q + s v with t, s in [0, 1].
At a crossing over = +1 where the first wire is in front (larger z), and turn = +1 where the second wire runs to the
left of the first, turn = sign(u x v).  Their product is the sign of the crossing in the sense of knot theory.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .centreline import Thread

SLACK = 1e-9  # segments beyond the ends of a segment, where it still crosses another
MOST_IMAGES = 500  # of a repeat
ANY = 10**12


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

    middle = 0.5 * (start + end)[:, :2]
    home = np.floor(middle / size).astype(int)
    longest = float(np.linalg.norm((end - start)[:, :2], axis=1).max())
    (found,) = candidate_pairs(middle - home * size, size, (1.0 + SLACK) * longest)
    assert found is not None
    first, second, repeat = found
    column, row = (repeat + home[first] - home[second]).T
    swap = (column < 0) | ((column == 0) & (row < 0))
    first, second = np.where(swap, second, first), np.where(swap, first, second)
    column, row = np.where(swap, -column, column), np.where(swap, -row, row)
    near = (thread[first] == thread[second]) & (column == 0)
    apart = np.abs(number[first] - number[second] - row * count[thread[second]])
    keep = ~near | (apart > 1)
    first, second, column, row = first[keep], second[keep], column[keep], row[keep]

    u, v = (end - start)[first], (end - start)[second]
    offset = start[second, :2] + np.stack([column * size[0], row * size[1]], axis=1) - start[first, :2]
    cross = plan_cross(u, v)
    with np.errstate(divide="ignore", invalid="ignore"):
        t, s = plan_cross(offset, v) / cross, plan_cross(offset, u) / cross
    hit = (t >= -SLACK) & (t <= 1.0 + SLACK) & (s >= -SLACK) & (s <= 1.0 + SLACK)
    first, second, column, row = (x[hit] for x in (first, second, column, row))
    t, s, u, v, cross = (x[hit] for x in (t, s, u, v, cross))
    position = start[first, :2] + t[:, None] * u[:, :2]
    height = np.stack([start[first, 2] + t * u[:, 2], start[second, 2] + s * v[:, 2]], axis=1)
    pair = np.stack([thread[first], thread[second]], axis=1)
    place = np.stack([number[first] + t, number[second] + s + row * count[pair[:, 1]]], axis=1)
    columns, arc, turn = np.stack([0 * column, column], axis=1), place * spacing[pair], np.sign(cross).astype(int)

    # the wires of each crossing in order
    is_self = pair[:, 0] == pair[:, 1]
    swap = (pair[:, 0] > pair[:, 1]) | (is_self & ((column < 0) | ((column == 0) & (arc[:, 0] > arc[:, 1]))))
    for values in (pair, columns, arc, height):
        values[swap] = values[swap, ::-1]
    turn = np.where(swap, -turn, turn)
    # in the base repeat
    cell = np.floor(position / size + SLACK).astype(int)
    position, columns = position - cell * size, columns - cell[:, :1]
    arc = arc - cell[:, 1:] * np.array([t.length for t in threads])[pair]
    # sorted, each once
    order = np.lexsort((arc[:, 0], columns[:, 1], columns[:, 0], pair[:, 1], pair[:, 0]))
    position, pair, columns, arc, height, turn = (x[order] for x in (position, pair, columns, arc, height, turn))
    fresh = np.ones(len(order), dtype=bool)
    same = np.all((pair[1:] == pair[:-1]) & (columns[1:] == columns[:-1]), axis=1)
    fresh[1:] = ~(same & np.all(np.abs(arc[1:] - arc[:-1]) < 1e-3 * spacing.min(), axis=1))
    rise = (height[:, 0] - height[:, 1])[fresh]
    over = np.where(rise >= 0.0, 1, -1)
    return Crossings(position[fresh], pair[fresh], columns[fresh], arc[fresh], over, turn[fresh], np.abs(rise))


def plan_cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """(pair,) cross products in plan view of vectors (pair, 2 or 3)."""
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def candidate_pairs(
    middle: NDArray[np.float64], period: NDArray[np.float64] | None, radius: float, most: int = ANY, block: int = ANY
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]] | None]:
    """Pairs of segments with middles nearer than `radius` [m], in blocks of about `block` pairs; None for more than `most`.

    middle: (segment, 2 or 3) [m] in the first repeat. Yields both segments (pair,), and the repeat (pair, 2) of the second. Each
    pair once: from the segment with the smaller number, or from the previous repeat.
    """
    owner, offset = np.arange(len(middle)), np.zeros((len(middle), 2), dtype=np.int64)
    if period is not None:
        most_x, most_y = np.ceil(radius / period).tolist()
        if (2.0 * most_x + 1.0) * (2.0 * most_y + 1.0) > MOST_IMAGES:
            yield None
            return
        images = []
        for repeat in itertools.product(range(-int(most_x), int(most_x) + 1), range(-int(most_y), int(most_y) + 1)):
            place = middle + np.pad(repeat * period, (0, middle.shape[1] - 2))
            near = np.flatnonzero(((place[:, :2] >= -radius) & (place[:, :2] <= period + radius)).all(axis=1))
            images.append((near, np.broadcast_to(repeat, (len(near), 2)), place[near]))
        owner, offset, middle = (np.concatenate(part) for part in zip(*images, strict=True))
    own, tree = np.flatnonzero(~offset.any(axis=1)), cKDTree(middle)
    total = cKDTree(middle[own]).count_neighbors(tree, radius)
    if total > most:
        yield None
        return
    step = max(1, len(own) * block // total)
    for first in range(0, len(own), step):
        part = own[first : first + step]
        found = cKDTree(middle[part]).sparse_distance_matrix(tree, radius, output_type="ndarray")
        a, second = owner[part[found["i"]]], found["j"]
        b, repeat = owner[second], offset[second]
        is_later = (repeat[:, 0] > 0) | ((repeat[:, 0] == 0) & (repeat[:, 1] > 0))
        kept = (a < b) | ((a == b) & is_later)
        yield a[kept], b[kept], repeat[kept]
