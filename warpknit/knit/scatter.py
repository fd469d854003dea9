"""Scattered loops: the loops of every needle and course have proportions of their own, and hook as equal ones do.

The rules are in docs/theory/knit.md. In plan view lenses of scattered loops are longer or shorter, and the rules that separate or
merge lenses would decide differently from loop to loop. So the lenses come from one repeat of equal loops. Each corner is the
nearest crossing along both wires, in courses, with the same two wires and signs.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .centreline import Thread
from .clasps import Lens, lens_outline
from .crossings import Crossings
from .lapping import Lapping
from .loops import RANGES, LoopProportions

Key = tuple[int, int, int, int, int, int]  # threads of the repeat, columns between them, over, turn, column of the first


@dataclass(frozen=True)
class Knitted:
    """The wires of a cloth and their crossings."""

    lapping: Lapping
    threads: tuple[Thread, ...]
    size: NDArray[np.float64]  # (2,) [m]
    crossings: Crossings

    @cached_property
    def lengths(self) -> NDArray[np.float64]:
        """[thread] [m] plan arc length of a period."""
        return np.array([thread.length for thread in self.threads])

    def courses_at(self, thread: int, arcs: NDArray[np.float64]) -> NDArray[np.float64]:
        """[arc] courses along a thread at unwrapped plan arcs [m]; the wire of a stitch is one course."""
        line = self.threads[thread]
        turns, place = np.divmod(arcs / line.spacing, len(line.stitch))
        starts = np.flatnonzero(np.diff(line.stitch)) + 1 if self.lapping.courses > 1 else np.zeros(1)
        begins = np.concatenate([starts[-1:] - len(line.stitch), starts, starts[:1] + len(line.stitch)])
        return np.asarray(np.interp(place, begins, np.arange(len(begins))) + turns * self.lapping.courses)


def lenses_of_scattered(scattered: Knitted, repeat: Knitted, bunches: Sequence[Sequence[Lens]]) -> list[list[Lens]] | None:
    """Lenses of each clasp of scattered loops; bunches: of one repeat of equal loops.

    None where a corner has no counterpart of its own: the loops hook otherwise.
    """
    crossings, (wales, courses) = scattered.crossings, (repeat.lapping.wales, repeat.lapping.courses)
    columns, rows, period = scattered.lapping.wales // wales, scattered.lapping.courses // courses, scattered.lapping.courses
    first = [stitches[0] for stitches in repeat.lapping.threads]
    homes = {(stitch.bar, stitch.needle % wales): number for number, stitch in enumerate(first)}
    copies = []  # of each thread: thread of the repeat, and repeats to its right
    places = np.empty(crossings.arc.shape)  # (crossing, 2) courses along the first and the second wire of the repeat
    for number, (stitch, *_) in enumerate(scattered.lapping.threads):
        home = homes[stitch.bar, stitch.needle % wales]
        copies.append((home, (stitch.needle - first[home].needle) // wales))
        here = crossings.thread == number
        places[here] = scattered.courses_at(number, crossings.arc[here])
    known: dict[Key, list[int]] = defaultdict(list)
    swapped = np.zeros(len(crossings), dtype=bool)  # whether the crossing has the wires of the repeat in the other order
    for number in range(len(crossings)):
        column = crossings.column[number]
        (one, left), (two, right) = (copies[thread] for thread in crossings.thread[number])
        left, right = left + columns * int(column[0]), right + columns * int(column[1])
        signs = int(crossings.over[number]), int(crossings.turn[number])
        if (one, 0) > (two, right - left):
            one, two, left, right, signs = two, one, right, left, (-signs[0], -signs[1])
            swapped[number], places[number] = True, places[number, ::-1].copy()
        key = (one, two, right - left, *signs, left % columns)
        known[key].append(number)

    def counterpart(lens: Lens, column: int, row: int) -> Lens | None:
        """Lens of scattered loops for a lens moved by repeats."""
        low, high = (
            np.concatenate([repeat.courses_at(t, ends[w : w + 1]) for w, t in enumerate(lens.thread)])
            for ends in (lens.low, lens.high)
        )
        ends = [low, high] if not lens.opposed else [np.array([low[0], high[1]]), np.array([high[0], low[1]])]
        numbers, arcs = [], []
        for end, corner in zip(ends, lens.corners, strict=True):
            signs = int(repeat.crossings.over[corner]), int(repeat.crossings.turn[corner])
            alike = known.get((*lens.thread, lens.column, *signs, column))
            if alike is None:
                return None
            apart = places[alike] - end - row * courses
            turns = np.round(apart.mean(axis=1) / period)
            nearest = int(np.argmin(np.linalg.norm(apart - period * turns[:, None], axis=1)))
            numbers.append(alike[nearest])
            lengths = scattered.lengths[crossings.thread[alike[nearest]]]
            arcs.append(crossings.arc[alike[nearest]] - turns[nearest] * lengths)
        threads = tuple(crossings.thread[numbers[0]].tolist())
        across = int(np.diff(crossings.column[numbers[0]])[0])
        low, high = np.minimum(*arcs), np.maximum(*arcs)
        outline = lens_outline(scattered.threads, threads, across, low, high, lens.opposed, scattered.size)
        side = lens.sides[int(swapped[numbers[0]])]
        return Lens(threads, across, low, high, side, lens.opposed, outline, (numbers[0], numbers[1]))

    found = []
    for column, row, bunch in itertools.product(range(columns), range(rows), bunches):
        lenses = [counterpart(lens, column, row) for lens in bunch]
        found.append([lens for lens in lenses if lens is not None])
        if len(found[-1]) < len(lenses):
            return None
    taken = [corner for lenses in found for lens in lenses for corner in lens.corners]
    return found if len(set(taken)) == len(taken) else None


PARTS = 4  # of the reach, between samples: distances are too large by up to 2 %
OWN_REACH = 4.0  # places of one wire that are nearer along it, over the reach, are neighbours


def near_wires(
    threads: Sequence[Thread], size: NDArray[np.float64], reach: float
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Distances (pair,) [m] of places within reach [m] of each other, and their stitches (pair, 2)."""
    parts = []
    for number, thread in enumerate(threads):
        sample = np.arange(0, len(thread.points), max(1, int(reach / (PARTS * thread.spacing))))
        parts.append((thread.points[sample], thread.stitch[sample], np.full(len(sample), number), thread.spacing * sample))
    points, stitch, wire, arc = (np.concatenate(part) for part in zip(*parts, strict=True))
    lowest, height = points[:, 2].min(), np.ptp(points[:, 2])
    box = np.array([*size, 2.0 * (height + reach)])
    placed = np.mod(points - [0.0, 0.0, lowest], box)
    tree = cKDTree(np.where(placed < box, placed, 0.0), boxsize=box)  # rounding may place a point at the far side
    first, second = tree.query_pairs(reach, output_type="ndarray").T
    along = np.abs(arc[first] - arc[second])
    along = np.minimum(along, np.array([thread.length for thread in threads])[wire[first]] - along)
    apart = (wire[first] != wire[second]) | (along > OWN_REACH * reach)
    first, second = first[apart], second[apart]
    offset = np.abs(points[first] - points[second])
    offset[:, :2] = np.abs(offset[:, :2] - np.round(offset[:, :2] / size) * size)
    return np.linalg.norm(offset, axis=1), np.stack([stitch[first], stitch[second]], axis=1)


MOST = 2.5  # standard deviations: loops farther off would be faults of the machine


def scattered_proportions(
    means: Sequence[LoopProportions],
    scatter: float | NDArray[np.float64],
    seed: int,
    formed_together: Sequence[int] | NDArray[np.intp] | None = None,
) -> tuple[LoopProportions, ...]:
    """Proportions of loops about their means. The same seed gives the same loops.

    scatter: relative standard deviation, also [loop].
    formed_together: [loop] number of the loop whose relative deviations it shares.
    """
    count, shape = len(means), means[0].shape
    names = list(RANGES)
    random = np.random.default_rng(seed)
    draws = random.standard_normal((count, len(names)))
    while (beyond := np.abs(draws) > MOST).any():
        draws[beyond] = random.standard_normal(int(beyond.sum()))
    if formed_together is not None:
        draws = draws[formed_together]
    low, high = np.array([RANGES[name] for name in names]).T
    values = np.array([[getattr(mean, name) for name in names] for mean in means]) * (1.0 + np.reshape(scatter, (-1, 1)) * draws)
    # the mean may stand at an end of its range
    values = np.clip(values, low, high)
    return tuple(LoopProportions(**dict(zip(names, row, strict=True)), shape=shape) for row in values.tolist())
