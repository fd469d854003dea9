"""Drawn curves of the wires of a periodic mesh, and their gaps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ..wires.overlaps import segment_distances

AROUND = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]


class Polyline:
    """Drawn curve of one wire over a repeat; it continues a closing further."""

    def __init__(self, points: np.ndarray, closing: np.ndarray, cell: np.ndarray) -> None:
        """points: (point, 3) [m], the last one being the first of the next repeat; closing: (3,) [m] to it."""
        self.points, self.closing = points, closing
        self.arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        self.lattice = np.rint(closing[:2] @ np.linalg.inv(cell)).astype(np.int64)  # periods of the closing

    @property
    def length(self) -> float:
        """[m] over a repeat."""
        return float(self.arc[-1])

    def at(self, arc: np.ndarray) -> np.ndarray:
        """(place, 3) [m] places at arcs [m]; beyond a repeat the curve goes on."""
        turns = np.floor(arc / self.length)
        inside = arc - turns * self.length
        place = np.stack([np.interp(inside, self.arc, self.points[:, axis]) for axis in range(3)], axis=-1)
        return np.asarray(place + turns[..., None] * self.closing)


@dataclass(frozen=True)
class Meeting:
    """A place where two wires touch or come near each other."""

    distance: float  # [m] between the axes
    wire: tuple[int, int]
    share: tuple[float, float]  # of the length of each wire, in 0 .. 1

    def is_beside(self, other: Meeting, lengths: np.ndarray, window: float) -> bool:
        """Whether both are within `window` [m] along both wires."""
        for wire, share in ((other.wire, other.share), (other.wire[::-1], other.share[::-1])):
            away = [_arc_between(self.share[side] - share[side], lengths[wire[side]]) for side in (0, 1)]
            if wire == self.wire and max(away) < window:
                return True
        return False


def find_gaps(
    curves: Sequence[Polyline], cell: np.ndarray, reach: float, window: float, contacts: Sequence[Meeting]
) -> list[Meeting]:
    """Places of least distance, below `reach` [m]. Along the wires they are `window` [m] from contacts and each other."""
    segments = _Segments(curves)
    first, second, image, _ = near_images(0.5 * (segments.begin + segments.end), cell, reach + segments.size.max())
    is_other = (first != second) | image.any(axis=1)
    first, second, image = first[is_other], second[is_other], image[is_other]
    away = np.concatenate([image @ cell, np.zeros((len(image), 1))], axis=1)
    begin, end = segments.begin, segments.end
    distance, *places = segment_distances(begin[first], end[first], begin[second] + away, end[second] + away)
    pair, lengths = np.stack([first, second], axis=1), np.array([curve.length for curve in curves])
    wire = segments.wire[pair]
    share = (segments.arc[pair] + np.stack(places, axis=1) * segments.size[pair]) / lengths[wire]
    is_own = (wire[:, 0] == wire[:, 1]) & (_arc_between(share[:, 0] - share[:, 1], lengths[wire[:, 0]]) < window)
    near = np.flatnonzero((distance < reach) & ~is_own)
    known = {key: distance[k] for k in near for key in segments.keys(first[k], second[k], image[k])}
    taken, found = list(contacts), []
    for k in near[np.argsort(distance[near])]:
        here = Meeting(float(distance[k]), tuple(wire[k].tolist()), tuple((share[k] % 1.0).tolist()))
        nearest_beside = min(known.get(key, np.inf) for key in segments.beside(first[k], second[k], image[k]))
        if nearest_beside >= distance[k] and not any(here.is_beside(one, lengths, window) for one in taken):
            taken.append(here)
            found.append(here)
    return found


def _arc_between(share: Any, length: Any) -> Any:
    """Shortest distance [m] along a wire between places a share of its length apart."""
    return abs((share + 0.5) % 1.0 - 0.5) * length


Key = tuple[int, int, int, int]  # two segments, and the periods from the first to the second


class _Segments:
    """The straight pieces of all curves."""

    def __init__(self, curves: Sequence[Polyline]) -> None:
        counts = [len(curve.points) - 1 for curve in curves]
        self.curves, self.start = curves, np.concatenate([[0], np.cumsum(counts)])
        self.wire = np.repeat(np.arange(len(curves)), counts)
        self.begin, self.end = (np.concatenate([curve.points[part] for curve in curves]) for part in (slice(-1), slice(1, None)))
        self.arc = np.concatenate([curve.arc[:-1] for curve in curves])
        self.size = np.linalg.norm(self.end - self.begin, axis=1)

    def keys(self, first: int, second: int, image: np.ndarray) -> Iterator[Key]:
        """A pair in either order."""
        i, j = image.tolist()
        yield int(first), int(second), i, j
        yield int(second), int(first), -i, -j

    def beside(self, first: int, second: int, image: np.ndarray) -> Iterator[Key]:
        """The pairs of neighbouring segments."""
        for step in AROUND:
            (one, before), (other, after) = self._next(first, step[0]), self._next(second, step[1])
            yield one, other, *(image + after - before).tolist()

    def _next(self, segment: int, step: int) -> tuple[int, np.ndarray]:
        """The segment a step further along its wire, and the periods between."""
        wire = self.wire[segment]
        low, high = self.start[wire], self.start[wire + 1]
        turns, place = divmod(segment - low + step, high - low)
        return int(low + place), turns * self.curves[wire].lattice


def near_images(points: np.ndarray, cell: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of points (point, 3) [m] within `reach` [m] in a periodic cell, each once.

    First and second, periods (pair, 2) from the first to the second, distance [m]. A point is a pair with itself too.
    """
    inverse = np.linalg.inv(cell)
    home = np.floor(points[:, :2] @ inverse).astype(np.int64)
    inside = points.copy()
    inside[:, :2] -= home @ cell
    most = np.ceil(reach * np.linalg.norm(inverse, axis=0)).astype(int)
    steps = np.array(list(np.ndindex(*(2 * most + 1)))) - most
    images = cKDTree(np.concatenate([inside + [*(step @ cell), 0.0] for step in steps]))
    near = cKDTree(inside).sparse_distance_matrix(images, reach, output_type="ndarray")
    step, second = np.divmod(near["j"], len(points))
    first, image = near["i"], home[near["i"]] - home[second] + steps[step]
    once = (first < second) | ((first == second) & (image @ [2 * most[1] + 1, 1] >= 0))
    return first[once], second[once], image[once], near["v"][once]
