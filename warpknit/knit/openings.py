"""Openings: the faces that the wires leave free in plan view, and the rhombus.

The wires of one repeat are a graph on a torus: crossings are its vertices, stretches of wire between crossings its
edges.  Walking along an edge and turning left at every crossing goes once round a face; a face whose walk comes back to
the crossing it left (not to a copy of it) is an opening.

A wire turns at its closed laps.  What lies between two turns is a primary portion (Guglielmini, Marotta, Salvini 2022,
section 2.5: a circular loop and an oval one along the wire), and its open laps are the edge of an opening: "primary
portion could be associated to a single edge, or element, that subsequently generate a structure made by rhombus".  The
rhombus is the largest opening bounded by the open laps of exactly four portions; its bodies are all clasps with an arm
on one of these laps, and each of them has both its pairs there.  The double atlas has 4 portions with 3 clasps each:
the 12 bodies and 24 pairs of the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .centreline import Thread
from .clasps import Arm, Clasp, polygon_area
from .crossings import Crossings
from .lapping import Stitch

StitchCopy = tuple[int, int, int]  # (stitch, column, row)


@dataclass(frozen=True)
class Opening:
    """One face of the plan view."""

    outline: NDArray[np.float64]  # (k, 2) [m] anticlockwise
    area: float  # [m2]
    centre: NDArray[np.float64]  # (2,) [m] centre of area
    stitches: frozenset[StitchCopy]  # stitches on its edge, as (stitch, column, row)


@dataclass(frozen=True)
class Rhombus:
    """One complete opening with the clasps on its four edges."""

    clasps: NDArray[np.intp]  # (k, 3) index of the clasp, and the copy (column, row) of the repeat it lies in
    centre: NDArray[np.float64]  # (2,) [m]
    opening: Opening


def find_openings(threads: Sequence[Thread], crossings: Crossings, size: NDArray[np.float64]) -> list[Opening]:
    """All openings of one repeat, each once, the largest first."""
    edges = _Edges(threads, crossings)
    openings = []
    unvisited = set(range(2 * edges.count))
    while unvisited:
        first = half_edge = min(unvisited)
        cell = np.zeros(2, dtype=int)
        walk = []
        while True:
            unvisited.discard(half_edge)
            walk.append((half_edge, cell))
            cell = cell + edges.offset(half_edge)
            half_edge = edges.left_turn(half_edge)
            if half_edge == first:
                break
        if np.any(cell != 0):
            continue
        pieces, stitches = zip(*(edges.piece(h, c, size) for h, c in walk), strict=True)
        outline = np.concatenate(pieces)
        area = polygon_area(outline)
        if area > 0.0:
            openings.append(Opening(outline, area, _centroid(outline), frozenset().union(*stitches)))
    return sorted(openings, key=lambda opening: -opening.area)


class _Edges:
    """Half-edges of the graph: 2 e runs along the wire from visit e to the next visit of a crossing, 2 e + 1 back."""

    def __init__(self, threads: Sequence[Thread], crossings: Crossings) -> None:
        self.threads = threads
        lengths = np.array([t.length for t in threads])
        wire = crossings.thread.ravel()
        row = np.floor(crossings.arc / lengths[crossings.thread]).astype(int).ravel()
        arc = crossings.arc.ravel() - row * lengths[wire]
        order = np.lexsort((arc, wire))
        self.count = len(order)
        self.thread, self.arc = wire[order], arc[order]
        self.vertex = order // 2
        role = order % 2
        # cell of the thread's own frame in which the crossing's repeat lies
        self.cell = -np.stack([crossings.column.ravel()[order], row[order]], axis=1)
        self.visit = np.empty((len(crossings), 2), dtype=int)
        self.visit[self.vertex, role] = np.arange(self.count)
        self.role = role
        self.turn = crossings.turn
        last = np.append(self.thread[1:] != self.thread[:-1], True)
        starts = np.nonzero(np.insert(last[:-1], 0, True))[0]
        self.after = np.arange(self.count) + 1
        self.after[last] = starts
        self.before = np.empty(self.count, dtype=int)
        self.before[self.after] = np.arange(self.count)
        self.wraps = last

    def offset(self, half_edge: int) -> NDArray[np.intp]:
        """Repeats (columns, rows) between the crossing copies at both ends."""
        e, backward = divmod(half_edge, 2)
        step = self.cell[self.after[e]] - self.cell[e] + [0, int(self.wraps[e])]
        return -step if backward else step

    def left_turn(self, half_edge: int) -> int:
        """The half-edge that goes on round the face to the left."""
        e, backward = divmod(half_edge, 2)
        visit = e if backward else int(self.after[e])
        vertex, role = self.vertex[visit], int(self.role[visit])
        other = int(self.visit[vertex, 1 - role])
        onward_is_left = (self.turn[vertex] > 0) == (role == 0)  # the other wire runs on to the left of this one
        onward = onward_is_left != bool(backward)
        return 2 * other if onward else 2 * int(self.before[other]) + 1

    def piece(
        self, half_edge: int, cell: NDArray[np.intp], size: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], set[StitchCopy]]:
        """Points (k, 2) [m] of a half-edge from a crossing in `cell`, without the last; its stitches."""
        e, backward = divmod(half_edge, 2)
        thread = self.threads[self.thread[e]]
        leaving = self.after[e] if backward else e
        lift = int(self.wraps[e])
        frame = cell - self.cell[leaving] - ([0, lift] if backward else [0, 0])
        high = self.arc[self.after[e]] + lift * thread.length
        line = thread.stretch(self.arc[e], high, size[1])[:, :2] + frame * size
        step = thread.spacing
        sample = np.arange(int(self.arc[e] // step), int(high // step) + 1)
        period, within = np.divmod(sample, len(thread.points))
        copies = {(int(s), int(frame[0]), int(frame[1] + p)) for s, p in zip(thread.stitch[within], period, strict=True)}
        return (line[:0:-1] if backward else line[:-1]), copies


def _centroid(outline: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centre of area (2,) of a closed outline."""
    shifted = outline - outline[0]
    after = np.roll(shifted, -1, axis=0)
    cross = shifted[:, 0] * after[:, 1] - after[:, 0] * shifted[:, 1]
    return outline[0] + np.sum((shifted + after) * cross[:, None], axis=0) / (3.0 * np.sum(cross))


def find_rhombus(
    threads: Sequence[Thread],
    stitches: Sequence[Stitch],
    crossings: Crossings,
    clasps: Sequence[Clasp],
    size: NDArray[np.float64],
    alike: float = 0.999,
) -> Rhombus | None:
    """The largest opening bounded by four primary portions, with its clasps; None where a knit has none.

    Of openings with more than `alike` of the largest area the one nearest to the middle of the repeat.
    """
    if len(crossings) == 0 or not {"open", "closed"} <= {stitch.kind for stitch in stitches}:
        return None
    courses = 1 + max(stitch.course for stitch in stitches)
    openings = find_openings(threads, crossings, size)
    centre = 0.5 * size
    candidates = []
    for opening in openings:
        if opening.area < 0.5 * openings[0].area:
            break
        portions = {_portion(copy, stitches, courses) for copy in opening.stitches if stitches[copy[0]].kind == "open"}
        if len(portions) == 4:
            candidates.append((opening, portions))
    if not candidates:
        return None
    largest = candidates[0][0].area
    equal = [c for c in candidates if c[0].area > alike * largest]
    opening, portions = min(equal, key=lambda c: _base_distance(c[0].centre, centre, size))
    cell = np.floor(opening.centre / size).astype(int)
    found = []
    for index, clasp in enumerate(clasps):
        for column in range(cell[0] - 2, cell[0] + 3):
            for row in range(cell[1] - 2, cell[1] + 3):
                if any(_on(arm, column, row, threads, stitches, courses, portions) for arm in clasp.arms):
                    found.append((index, column - cell[0], row - cell[1]))
    if not found:
        return None
    moved = Opening(
        opening.outline - cell * size,
        opening.area,
        opening.centre - cell * size,
        frozenset((s, column - int(cell[0]), row - int(cell[1])) for s, column, row in opening.stitches),
    )
    return Rhombus(np.array(sorted(found)), moved.centre, moved)


def _base_distance(point: NDArray[np.float64], centre: NDArray[np.float64], size: NDArray[np.float64]) -> float:
    """Distance [m] from `centre` to a point's copy in the base repeat."""
    return float(np.hypot(*(point - np.floor(point / size) * size - centre)))


def _portion(copy: StitchCopy, stitches: Sequence[Stitch], courses: int) -> tuple[int, int, int]:
    """The primary portion of an open lap: (thread, column, unwrapped course of its first open lap)."""
    stitch, column, row = copy
    base = stitch - stitches[stitch].course
    course = stitches[stitch].course
    while stitches[base + (course - 1) % courses].kind == "open" and course > stitches[stitch].course - courses:
        course -= 1
    return stitches[stitch].thread, column, course + row * courses


def _on(
    arm: Arm,
    column: int,
    row: int,
    threads: Sequence[Thread],
    stitches: Sequence[Stitch],
    courses: int,
    portions: set[tuple[int, int, int]],
) -> bool:
    """Whether an arm of a clasp in the copy (column, row) lies on an open lap."""
    thread = threads[arm.thread]
    stitch = thread.stitch_at(arm.arc)
    if stitches[stitch].kind != "open":
        return False
    copy = (stitch, arm.column + column, int(np.floor(arm.arc / thread.length)) + row)
    return _portion(copy, stitches, courses) in portions
