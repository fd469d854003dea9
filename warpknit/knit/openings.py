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

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .centreline import Thread
from .clasps import Clasp, polygon_area
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
    """One complete opening with the clasps on its four edges; its centre lies in the base repeat."""

    clasps: NDArray[np.intp]  # (k, 3) index of the clasp, and the copy (column, row) of the repeat it lies in
    opening: Opening


def find_openings(threads: Sequence[Thread], crossings: Crossings, size: NDArray[np.float64]) -> list[Opening]:
    """All openings of one repeat, each once, the largest first.

    A wire visits a crossing; half-edge 2 e runs along the wire from visit e to its next visit, 2 e + 1 back.
    """
    lengths = np.array([t.length for t in threads])
    wire = crossings.thread.ravel()
    row = np.floor(crossings.arc / lengths[crossings.thread]).astype(int).ravel()
    arc = crossings.arc.ravel() - row * lengths[wire]
    order = np.lexsort((arc, wire))
    wire, arc, count = wire[order], arc[order], len(order)
    other = np.argsort(order)[order ^ 1]  # visit of the other wire at the same crossing
    # cell of the thread's own frame in which the crossing's repeat lies
    cell = -np.stack([crossings.column.ravel()[order], row[order]], axis=1)
    is_last = np.append(wire[1:] != wire[:-1], True)
    after = np.arange(count) + 1
    after[is_last] = np.flatnonzero(np.insert(is_last[:-1], 0, True))
    step = cell[after] - cell
    step[:, 1] += is_last
    offset = np.stack([step, -step], axis=1).reshape(-1, 2)  # repeats (columns, rows) along each half-edge
    reached = np.stack([after, np.arange(count)], axis=1)  # visit at the end of each half-edge
    is_left = (crossings.turn[order // 2] > 0) == (order % 2 == 0)  # whether the other wire runs on to the left of this one
    onward, across = is_left[reached] != [False, True], other[reached]
    left = np.where(onward, 2 * across, 2 * np.argsort(after)[across] + 1).ravel()  # half-edge that goes on round the face

    def piece(half_edge: int, at: NDArray[np.intp]) -> tuple[NDArray[np.float64], set[StitchCopy]]:
        """Points (k, 2) [m] of a half-edge from a crossing in the cell `at`, without the last; its stitches."""
        e, backward = divmod(half_edge, 2)
        thread, lift = threads[wire[e]], int(is_last[e])
        frame = at - cell[reached[e, 1 - backward]] - [0, lift * backward]
        high = arc[after[e]] + lift * thread.length
        line = thread.stretch(arc[e], high, size[1])[:, :2] + frame * size
        sample = np.arange(int(arc[e] // thread.spacing), int(high // thread.spacing) + 1)
        period, within = np.divmod(sample, len(thread.points))
        copies = {(int(s), int(frame[0]), int(frame[1] + p)) for s, p in zip(thread.stitch[within], period, strict=True)}
        return (line[:0:-1] if backward else line[:-1]), copies

    openings = []
    unvisited = set(range(2 * count))
    while unvisited:
        walk = [(min(unvisited), np.zeros(2, dtype=int))]
        while True:
            half_edge, place = walk[-1]
            unvisited.discard(half_edge)
            following = int(left[half_edge]), place + offset[half_edge]
            if following[0] == walk[0][0]:
                break
            walk.append(following)
        if np.any(following[1] != 0):
            continue
        pieces, stitches = zip(*(piece(*one) for one in walk), strict=True)
        outline = np.concatenate(pieces)
        area = polygon_area(outline)
        if area > 0.0:
            openings.append(Opening(outline, area, _centroid(outline), frozenset().union(*stitches)))
    return sorted(openings, key=lambda opening: -opening.area)


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
    alike: float,
) -> Rhombus | None:
    """The largest opening bounded by four primary portions, with its clasps; None where a knit has none.

    Of openings with more than `alike` of the largest area the one nearest to the middle of the repeat.
    """
    if len(crossings) == 0 or not {"open", "closed"} <= {stitch.kind for stitch in stitches}:
        return None
    courses = 1 + max(stitch.course for stitch in stitches)

    def portions(copies: Iterable[StitchCopy]) -> set[tuple[int, int, int]]:
        """Primary portions of the open laps among stitches: (thread, column, unwrapped course of the first open lap)."""
        found = set()
        for number, column, row in copies:
            stitch = stitches[number]
            first = stitch.course
            while stitches[number - stitch.course + (first - 1) % courses].kind == "open" and first > stitch.course - courses:
                first -= 1
            if stitch.kind == "open":
                found.add((stitch.thread, column, first + row * courses))
        return found

    def from_middle(opening: Opening) -> float:
        """[m] of the copy in the base repeat."""
        return float(np.hypot(*(opening.centre - np.floor(opening.centre / size) * size - 0.5 * size)))

    openings = find_openings(threads, crossings, size)
    large = [opening for opening in openings if opening.area >= 0.5 * openings[0].area]
    candidates = [opening for opening in large if len(portions(opening.stitches)) == 4]
    if not candidates:
        return None
    opening = min((c for c in candidates if c.area > alike * candidates[0].area), key=from_middle)
    cell = np.floor(opening.centre / size).astype(int)
    copies = frozenset((s, column - int(cell[0]), row - int(cell[1])) for s, column, row in opening.stitches)
    found = set()
    for index, clasp in enumerate(clasps):
        for arm in clasp.arms:
            thread = threads[arm.thread]
            lap = thread.stitch_at(arm.arc), arm.column, int(np.floor(arm.arc / thread.length))
            for (own, column, course), edge in itertools.product(portions([lap]), portions(copies)):
                if own == edge[0] and (edge[2] - course) % courses == 0:
                    found.add((index, edge[1] - column, (edge[2] - course) // courses))
    if not found:
        return None
    opening = replace(opening, outline=opening.outline - cell * size, centre=opening.centre - cell * size, stitches=copies)
    return Rhombus(np.array(sorted(found)), opening)
