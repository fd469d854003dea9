"""Clasps: lenses in plan view where two wires hook each other (docs/theory/knit.md).

Two crossings of the same two wire copies bound a lens if the arcs between them are short, no third crossing of the two lies
within both arcs, and the second wire crosses the first in opposite senses (turn). A crossing is the corner of one lens only, the
tightest. The wires hook in it where over * turn is the same at both corners. The rule holds for any knit. (Guglielmini, Marotta,
Salvini 2022, section 2: "a couple of wires crosses in two points".) A loop may hook one head by two nested lenses; such lenses
are merged into one clasp when `merge` is set.

The body of a clasp is at the deepest point (pole of inaccessibility): its distance to the nearest outline, inside all of them, is
largest. A grid over the smallest outline's box is refined round it until the grid is finer than 1e-3 of the box.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .centreline import Thread
from .crossings import Crossings

GRID = 17


def polygon_area(outline: NDArray[np.float64]) -> float:
    """Signed area [m2] of a closed outline (k, 2), positive anticlockwise."""
    x, y = (outline - outline[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def is_inside(points: NDArray[np.float64], outline: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether points (n, 2) lie inside a closed outline (k, 2), by the even-odd rule."""
    x, y = points[:, :1], points[:, 1:]
    x0, y0 = outline.T
    x1, y1 = np.roll(outline, -1, axis=0).T
    spans = (y0 > y) != (y1 > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        right = x < x0 + (y - y0) * (x1 - x0) / (y1 - y0)
    return np.count_nonzero(spans & right, axis=1) % 2 == 1


def deepest_point(outlines: Sequence[NDArray[np.float64]]) -> NDArray[np.float64] | None:
    """Point (2,) deepest inside all outlines, the first the smallest; None where they have no common inside."""
    thin = [outline[:: max(1, len(outline) // 160)] for outline in outlines]
    low, high = thin[0].min(axis=0), thin[0].max(axis=0)
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    edge = cKDTree(np.concatenate(thin))
    best, best_depth = None, 0.0
    for _ in range(6):
        ticks = np.linspace(-1.0, 1.0, GRID)
        grid = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2) * half + centre
        inside = np.all([is_inside(grid, outline) for outline in thin], axis=0)
        if np.any(inside):
            grid = grid[inside]
            depth = edge.query(grid)[0]
            k = int(np.argmax(depth))
            if depth[k] > best_depth:
                best, best_depth = grid[k], float(depth[k])
        if best is None:
            return None
        centre, half = best, half * (3.0 / GRID)
    return best


ARC_LIMIT = 0.5  # longest arc of a lens, in wire lengths of a stitch: a leg and its foot, not a whole loop


@dataclass(frozen=True)
class Arm:
    """One of the two wires of a clasp."""

    thread: int
    column: int  # copy of the repeat, `column` repeats to the right of the clasp's
    arc: float  # [m] unwrapped plan arc length of the point nearest to the body
    arc_low: float  # [m] the lens on this wire; when merged: with the arcs of the other lenses that it meets
    arc_high: float  # [m]
    side: int  # +1 the body lies to the left of the wire's direction, -1 to the right
    clearance: float  # [m] distance of the body from the wire's centre line


@dataclass(frozen=True)
class Clasp:
    """Two hooked wires, and the place of their contact body."""

    position: NDArray[np.float64]  # (2,) [m] in [0, width) x [0, height)
    arms: tuple[Arm, Arm]
    lenses: int  # nested lenses merged into this clasp


@dataclass(frozen=True, eq=False)
class Lens:
    """A bigon between wire (thread[0], column 0) and wire (thread[1], column)."""

    thread: tuple[int, int]
    column: int
    low: NDArray[np.float64]  # (2,) [m] arcs where the lens begins on each wire
    high: NDArray[np.float64]  # (2,) [m]
    side: int  # +1 the lens lies to the left of the first wire
    opposed: bool  # the two wires run in opposite directions round the lens
    outline: NDArray[np.float64]  # (k, 2) [m]
    corners: tuple[int, int]  # crossings, the same for all copies

    @property
    def sides(self) -> tuple[int, int]:
        """Side of each wire on which the lens lies."""
        return self.side, self.side if self.opposed else -self.side


def find_lenses(threads: Sequence[Thread], crossings: Crossings, size: NDArray[np.float64], stitch_length: float) -> list[Lens]:
    """All hooked lenses of one repeat; stitch_length: mean wire length of a stitch [m]."""
    lengths = np.array([t.length for t in threads])
    limit = ARC_LIMIT * stitch_length
    step = crossings.column[:, 1] - crossings.column[:, 0]
    group = np.stack([crossings.thread[:, 0], crossings.thread[:, 1], step], axis=1)
    lenses = []
    for first, second, column in np.unique(group, axis=0):
        member = np.nonzero(np.all(group == [first, second, column], axis=1))[0]
        period = lengths[[first, second]]
        copies = np.arange(-1 - int(limit // period.min()), 2 + int(limit // period.min()))
        base = crossings.arc[member] - np.floor(crossings.arc[member, :1] / period[0]) * period
        arcs = (base + copies[:, None, None] * period).reshape(-1, 2)
        over, turn = (np.tile(sign[member], len(copies)) for sign in (crossings.over, crossings.turn))
        for p in range(len(member)):
            is_opposite = (over == -crossings.over[member[p]]) & (turn == -crossings.turn[member[p]])
            for q, low, high in lens_ends(base[p], arcs, is_opposite, limit):
                if first == second and column == 0 and high[0] > low[1]:
                    continue
                opposed = bool(arcs[q, 1] < base[p, 1])
                side = int(crossings.turn[member[p]]) * (-1 if opposed else 1)
                outline = lens_outline(threads, (first, second), column, low, high, opposed, size)
                if polygon_area(outline) * side > 0.0:
                    corners = (int(member[p]), int(member[q % len(member)]))
                    lenses.append(Lens((int(first), int(second)), int(column), low, high, side, opposed, outline, corners))
    return tightest(lenses)


def lens_ends(
    start: NDArray[np.float64], arcs: NDArray[np.float64], is_opposite: NDArray[np.bool_], longest: float
) -> Iterator[tuple[int, NDArray[np.float64], NDArray[np.float64]]]:
    """Hooked lenses from the crossing at arcs `start` (2,) [m] onwards: number of the other corner, low and high arcs (2,).

    arcs (k, 2) [m]: of crossings of the same two wires; is_opposite (k,): whether over and turn differ from those at `start`.
    """
    advance = arcs - start
    is_near = (advance[:, 0] > 0.0) & (advance[:, 0] <= longest) & (np.abs(advance[:, 1]) <= longest)
    for k in np.flatnonzero(is_opposite & is_near).tolist():
        low, high = np.minimum(start, arcs[k]), np.maximum(start, arcs[k])
        if not ((arcs > low) & (arcs < high)).all(axis=1).any():
            yield k, low, high


def tightest(lenses: list[Any]) -> list[Any]:
    """Lenses that share no corner: where two would, as along a twist, the one with the shorter arcs stays."""
    taken: set[int] = set()
    kept = []
    for lens in sorted(lenses, key=lambda lens: float(np.sum(lens.high - lens.low))):
        if taken.isdisjoint(lens.corners):
            taken.update(lens.corners)
            kept.append(lens)
    return kept


def lens_outline(
    threads: Sequence[Thread],
    pair: tuple[int, int],
    column: int,
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    opposed: bool,
    size: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Closed outline (k, 2) of a lens: along the first wire, back along the second."""
    along = threads[pair[0]].stretch(low[0], high[0], size[1])[:, :2]
    back = threads[pair[1]].stretch(low[1], high[1], size[1])[:, :2] + [column * size[0], 0.0]
    return np.concatenate([along[:-1], back[:-1] if opposed else back[:0:-1]])


def make_clasps(threads: Sequence[Thread], bunches: Sequence[list[Lens]], size: NDArray[np.float64]) -> tuple[Clasp, ...]:
    """One clasp for each bunch of lenses; from bottom to top and left to right."""
    clasps = [_clasp(threads, bunch, size) for bunch in bunches]
    return tuple(sorted(clasps, key=lambda c: tuple(np.round(c.position[::-1] / size[::-1], 6))))


def nested_lenses(threads: Sequence[Thread], lenses: Sequence[Lens], size: NDArray[np.float64]) -> list[list[Lens]]:
    """Lenses gathered by the head that they hold.

    The nearest are joined first. Two bunches with a lens of one kind each, of wires alike or opposed, hold two heads, unless
    these lenses belong together themselves. So symmetry of the knit is kept.
    """
    ordered = sorted(lenses, key=lambda lens: abs(polygon_area(lens.outline)))
    bunches = {number: [lens] for number, lens in enumerate(ordered)}
    home = {number: (number, 0) for number in bunches}  # bunch of each lens, and the row of its copy there
    near = []
    for i, lens in enumerate(ordered):
        for j, other in enumerate(ordered[:i]):
            for row in (0, 1, -1):
                gap = _gap(_moved(lens, row, threads, size), other)
                if gap is not None:
                    near.append((gap, i, j, row))
    for _, i, j, row in sorted(near):
        (leaving, row_i), (staying, row_j) = home[i], home[j]
        if leaving == staying:
            continue
        shift = row_j + row - row_i
        joining = [_moved(lens, shift, threads, size) for lens in bunches[leaving]]
        alike = [(a, b) for a in joining for b in bunches[staying] if a.opposed == b.opposed]
        if any(_gap(a, b) is None for a, b in alike):
            continue
        bunches[staying] += joining
        del bunches[leaving]
        home |= {k: (staying, r + shift) for k, (bunch, r) in home.items() if bunch == leaving}
    return list(bunches.values())


def _moved(lens: Lens, row: int, threads: Sequence[Thread], size: NDArray[np.float64]) -> Lens:
    """The copy of a lens `row` repeats up."""
    shift = row * np.array([threads[t].length for t in lens.thread])
    return replace(lens, low=lens.low + shift, high=lens.high + shift, outline=lens.outline + [0.0, row * size[1]])


def _gap(lens: Lens, other: Lens) -> float | None:
    """Arc [m] between two lenses around the same head, negative if they overlap; else None.

    Either they share a stretch of one wire on the same side of it, or they follow each other closely along one wire while the
    other wire passes through both.
    """
    if lens.thread != other.thread or lens.column != other.column:
        return None
    gap = np.maximum(lens.low, other.low) - np.minimum(lens.high, other.high)
    room = np.minimum(lens.high - lens.low, other.high - other.low) if lens.opposed != other.opposed else np.zeros(2)
    return min((float(gap[w]) for w in (0, 1) if gap[w] < room[w] and lens.sides[w] == other.sides[w]), default=None)


def _clasp(threads: Sequence[Thread], bunch: list[Lens], size: NDArray[np.float64]) -> Clasp:
    """The clasp of a bunch of lenses: its body lies deepest within all of them, else within the smallest."""
    bunch = sorted(bunch, key=lambda lens: abs(polygon_area(lens.outline)))
    inner = bunch[0]
    position = deepest_point([lens.outline for lens in bunch])
    if position is None:
        position = deepest_point([inner.outline])
    assert position is not None
    cell = np.floor(position / size + 1e-9).astype(int)
    arms = []
    for w in (0, 1):
        low, high = _joined(inner.low[w], inner.high[w], [(lens.low[w], lens.high[w]) for lens in bunch])
        thread = threads[inner.thread[w]]
        column = w * inner.column
        arc, side, distance = _nearest(thread, inner.low[w], inner.high[w], position - [column * size[0], 0.0], size[1])
        back = cell[1] * thread.length
        arms.append(Arm(inner.thread[w], int(column - cell[0]), arc - back, low - back, high - back, side, distance))
    return Clasp(position - cell * size, (arms[0], arms[1]), len(bunch))


def _joined(low: float, high: float, stretches: list[tuple[float, float]]) -> tuple[float, float]:
    """Union of [low, high] with all stretches that it meets."""
    for _ in stretches:
        for other_low, other_high in stretches:
            if other_low <= high and other_high >= low:
                low, high = min(low, other_low), max(high, other_high)
    return float(low), float(high)


def _nearest(thread: Thread, low: float, high: float, point: NDArray[np.float64], height: float) -> tuple[float, int, float]:
    """Arc [m] of the nearest point of a segment, its side, its distance [m] from `point`."""
    line = thread.stretch(low, high, height)[:, :2]
    arcs = np.concatenate([[low], (np.floor(low / thread.spacing) + 1 + np.arange(len(line) - 2)) * thread.spacing, [high]])
    direction = np.diff(line, axis=0)
    length = np.maximum(np.hypot(direction[:, 0], direction[:, 1]), 1e-300)
    along = np.clip(np.sum((point - line[:-1]) * direction, axis=1) / length**2, 0.0, 1.0)
    away = point - (line[:-1] + along[:, None] * direction)
    distance = np.hypot(away[:, 0], away[:, 1])
    k = int(np.argmin(distance))
    side = 1 if direction[k, 0] * away[k, 1] - direction[k, 1] * away[k, 0] > 0.0 else -1
    return float(arcs[k] + along[k] * (arcs[k + 1] - arcs[k])), side, float(distance[k])
