"""Hooks of wires, from crossings in plan view as for clasps (knit/clasps.py).

Two neighbouring crossings of the same two wires bound a lens. The wires hook in it where the sign alternates: one lies over the
other at one corner and under it at the other. Periodic wires continue: what hooks a copy of itself, or of another, hooks it once
a repeat. Nested lenses count one by one, as in a knit with `model.merge_lenses = false`.

A knit has contact at its clasps. Wires from a file need not be knitted: in a weave every crossing carries a force. So each
crossing that bounds no hook is a place of its own. Wires that cross farther apart than the thickness of a layer are in different
layers, which in-plane strains do not bring together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from warpknit.base.text import counted
from warpknit.wires.centre_lines import Wires
from warpknit.wires.overlaps import MOST_IMAGES, images_of, segments_of

LONGEST = 0.5  # of the wire of a loop: arcs of a lens at most
MOST_PAIRS = 50_000_000  # of segments near each other in plan view
SAME = 1e-6  # segments: crossings no farther apart are one that two segments have found


@dataclass(frozen=True)
class Hooks:
    """Places where two wires hook each other; [hook]."""

    wire: np.ndarray  # (hook, 2) from 0
    low: np.ndarray  # (hook, 2) [m] where the lens begins along either wire; of a wire that goes on it may be beyond its end
    high: np.ndarray  # (hook, 2) [m]
    position: np.ndarray  # (hook, 2) [m] its middle in plan view
    corner: np.ndarray  # (hook, 2) numbers of the crossings that bound the lens

    def __len__(self) -> int:
        return len(self.wire)


@dataclass(frozen=True)
class PlanCrossings:
    """Crossings [crossing], each once; of a wire with itself or a copy once from either side."""

    number: np.ndarray  # what is the same from both sides has one number
    wire: np.ndarray  # (crossing, 2)
    arc: np.ndarray  # (crossing, 2) [m]
    repeat: np.ndarray  # (crossing, 2) of the second wire seen from the first, as they are drawn
    over: np.ndarray  # +1 where the first wire is above
    turn: np.ndarray  # sign of (direction of first) x (direction of second)
    gap: np.ndarray  # [m] distance of the centre lines across the mesh
    position: np.ndarray  # (crossing, 2) [m] in plan view, where the first wire is drawn


@dataclass(frozen=True)
class _Lens:
    wire: tuple[int, int]
    repeat: tuple[int, int]
    low: np.ndarray  # (2,) [m]
    high: np.ndarray
    corner: tuple[int, int]  # numbers of the crossings

    @property
    def size(self) -> float:
        return float(np.sum(self.high - self.low))


def find_hooks(wires: Wires, loop_length: float) -> Hooks:
    """The hooks of wires with about so much wire [m] in a loop; each place once."""
    return hooks_of(wires, find_crossings(wires), loop_length)


def hooks_of(wires: Wires, crossings: PlanCrossings | None, loop_length: float) -> Hooks:
    """The same from the crossings of the wires; None: too much crosses."""
    lenses = [] if crossings is None else _lenses(wires, crossings, LONGEST * loop_length)
    return Hooks(
        wire=np.array([lens.wire for lens in lenses], dtype=np.int64).reshape(-1, 2),
        low=np.array([lens.low for lens in lenses]).reshape(-1, 2),
        high=np.array([lens.high for lens in lenses]).reshape(-1, 2),
        position=_middles(wires, lenses),
        corner=np.array([lens.corner for lens in lenses], dtype=np.int64).reshape(-1, 2),
    )


def _middles(wires: Wires, lenses: list[_Lens]) -> np.ndarray:
    """(lens, 2) [m] in plan view, half way between the middles of the two arcs of each."""
    wire = np.array([lens.wire for lens in lenses], dtype=np.int64).reshape(-1, 2)
    arc = np.array([0.5 * (lens.low + lens.high) for lens in lenses]).reshape(-1, 2)
    place = np.zeros((*arc.shape, 2))
    for w in np.unique(wire).tolist():
        place[wire == w] = _places(wires, w, arc[wire == w])
    repeat = np.array([lens.repeat for lens in lenses]).reshape(-1, 2)
    return np.asarray(0.5 * (place.sum(axis=1) + (0.0 if wires.period is None else repeat * wires.period)))


def _places(wires: Wires, wire: int, arc: np.ndarray) -> np.ndarray:
    """Places (place, 2) [m] in plan view, at arc lengths [m] of a wire, also beyond its ends."""
    begin, end = wires.ends(wire)
    rounds = np.zeros(arc.shape) if wires.kinds[wire] == "open" else np.floor(arc / wires.lengths[wire])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(end - begin, axis=1))])
    points = np.concatenate([begin, end[-1:]])
    s = arc - rounds * wires.lengths[wire]
    return np.stack([np.interp(s, along, points[:, k]) for k in (0, 1)], axis=-1) + rounds[:, None] * wires.closing(wire)[:2]


def find_crossings(wires: Wires) -> PlanCrossings | None:
    """All crossings of the wires in plan view, with their copies too; None where there is too much to look at."""
    flat = replace(wires, points=tuple(points * [1.0, 1.0, 0.0] for points in wires.points))
    segments, plan = segments_of(wires), segments_of(flat)
    longest = float(plan.length.max())
    if wires.period is not None and math.prod(2.0 * np.ceil(longest / wires.period) + 1.0) > MOST_IMAGES:
        return None
    images = images_of(plan, wires.period, longest)
    own = np.flatnonzero(~images.offset.any(axis=1))
    all_of_them, own_ones = cKDTree(images.middle), cKDTree(images.middle[own])
    if own_ones.count_neighbors(all_of_them, longest) > MOST_PAIRS:
        return None
    near = own_ones.sparse_distance_matrix(all_of_them, longest, output_type="ndarray")
    a, image = images.owner[own[near["i"]]], near["j"]
    b, offset = images.owner[image], images.offset[image]
    later = (offset[:, 0] > 0) | ((offset[:, 0] == 0) & (offset[:, 1] > 0))
    beside = (segments.wire[a] == segments.wire[b]) & (np.abs(a - b) <= 1) & ~offset.any(axis=1)
    kept = ((a < b) | ((a == b) & later)) & ~beside
    a, b, offset = a[kept], b[kept], offset[kept]
    shift = np.zeros((len(a), 3))
    if wires.period is not None:
        shift[:, :2] = offset * wires.period
    u, v = segments.end[a] - segments.begin[a], segments.end[b] - segments.begin[b]
    between = segments.begin[b] + shift - segments.begin[a]
    across = _cross(u, v)
    with np.errstate(divide="ignore", invalid="ignore"):
        t, s = _cross(between, v) / across, _cross(between, u) / across
    hit = (t >= -SAME) & (t < 1.0 - SAME) & (s >= -SAME) & (s < 1.0 - SAME)
    a, b, t, s, u, v, between, across, offset = (x[hit] for x in (a, b, t, s, u, v, between, across, offset))
    wire = np.stack([segments.wire[a], segments.wire[b]], axis=1)
    arc = np.stack([segments.arc[a] + t * segments.length[a], segments.arc[b] + s * segments.length[b]], axis=1)
    repeat = offset + segments.moved[b] - segments.moved[a]
    height = t * u[:, 2] - between[:, 2] - s * v[:, 2]  # of the first above the second
    over = np.where(height >= 0.0, 1, -1)
    turn = np.sign(across).astype(int)
    position = (segments.begin[a] + t[:, None] * u)[:, :2]
    if wires.period is not None:
        position -= segments.moved[a] * wires.period
    flip = np.concatenate([wire[:, 0] > wire[:, 1], np.ones(np.count_nonzero(wire[:, 0] == wire[:, 1]), dtype=bool)])
    again = np.concatenate([np.arange(len(wire)), np.flatnonzero(wire[:, 0] == wire[:, 1])])
    wire, arc, repeat, over, turn, position = (x[again] for x in (wire, arc, repeat, over, turn, position))
    if wires.period is not None:
        position[flip] -= repeat[flip] * wires.period
    wire[flip], arc[flip] = wire[flip, ::-1], arc[flip, ::-1]
    repeat[flip], over[flip], turn[flip] = -repeat[flip], -over[flip], -turn[flip]
    return PlanCrossings(again, wire, arc, repeat, over, turn, np.abs(height)[again], position)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _lenses(wires: Wires, c: PlanCrossings, longest: float) -> list[_Lens]:
    """Hooked lenses; those that share a corner: the one with the shorter arcs."""
    found: list[_Lens] = []
    order = np.lexsort(c.wire.T[::-1])
    begins = np.flatnonzero(np.diff(c.wire[order], axis=0, prepend=-1).any(axis=1))
    for member in np.split(order, begins)[1:]:
        pair = (int(c.wire[member[0], 0]), int(c.wire[member[0], 1]))
        images = _Images(wires, c, member, longest)
        for p in member.tolist() if images.several else ():
            number, arcs = images.beside(p)
            inside = (arcs[:, 0] > c.arc[p, 0]) & (np.abs(arcs[:, 1] - c.arc[p, 1]) <= longest)
            for k in np.flatnonzero(inside & (c.over[number] == -c.over[p]) & (c.turn[number] == -c.turn[p])):
                low, high = np.minimum(c.arc[p], arcs[k]), np.maximum(c.arc[p], arcs[k])
                if not ((arcs > low) & (arcs < high)).all(axis=1).any():
                    corner = (int(c.number[p]), int(c.number[number[k]]))
                    found.append(
                        _Lens((int(pair[0]), int(pair[1])), (int(c.repeat[p, 0]), int(c.repeat[p, 1])), low, high, corner)
                    )
    taken: set[int] = set()
    kept = []
    for lens in sorted(found, key=lambda lens: lens.size):
        if taken.isdisjoint(lens.corner):
            taken.update(lens.corner)
            kept.append(lens)
    return kept


class _Images:
    """Crossings of two wires, and their images further along the first one."""

    def __init__(self, wires: Wires, c: PlanCrossings, member: np.ndarray, longest: float) -> None:
        """member: numbers of all crossings of the two wires."""
        self.crossings, self.longest = c, longest
        first, second = c.wire[member[0]].tolist()
        self._shift, self._length = wires.shifts[second], float(wires.lengths[second])
        self._rounds = _rounds(wires, second, longest)
        rounds = np.repeat(_rounds(wires, first, longest), len(member))
        number = np.tile(member, len(rounds) // len(member))
        arc = c.arc[number, 0] + rounds * wires.lengths[first]
        self.several = len(arc) * len(self._rounds) > 1
        order = np.argsort(arc, kind="stable")
        self._number, self._first = number[order], arc[order]
        self._repeat = (c.repeat[number] + rounds[:, None] * wires.shifts[first])[order]

    def beside(self, p: int) -> tuple[np.ndarray, np.ndarray]:
        """Crossings of the same two wires near p on the first: numbers, and arcs (k, 2) [m] from p."""
        c = self.crossings
        here = slice(*np.searchsorted(self._first, [c.arc[p, 0] - self.longest, c.arc[p, 0] + self.longest]).tolist())
        away = self._repeat[here] - c.repeat[p]
        numbers, arcs = [], []
        for n in self._rounds:
            same = (away == n * self._shift).all(axis=1)
            number = self._number[here][same]
            numbers.append(number)
            arcs.append(np.stack([self._first[here][same], c.arc[number, 1] + n * self._length], axis=1))
        return np.concatenate(numbers), np.concatenate(arcs)


def _rounds(wires: Wires, wire: int, longest: float) -> np.ndarray:
    """By which a wire is looked at again; none where it is open."""
    most = 0 if wires.kinds[wire] == "open" else 1 + int(longest // wires.lengths[wire])
    return np.arange(-most, most + 1)


LAYER = 0.15  # of the wire of a loop, half the size of a loop: wires that cross farther apart are in different layers


@dataclass(frozen=True)
class Places:
    """Hooks first, then the other crossings; [place]."""

    wire: np.ndarray  # (place, 2) from 0
    low: np.ndarray  # (place, 2) [m] where the lens of a hook begins along either wire; of a crossing where it is
    high: np.ndarray  # (place, 2) [m]
    position: np.ndarray  # (place, 2) [m] in plan view
    hooks: int
    crowded: bool = False  # too many crossings to search

    def __len__(self) -> int:
        return len(self.wire)

    def line(self) -> str:
        """The same in words."""
        if self.crowded:
            return "not searched: too many crossings in plan view"
        crossings = len(self) - self.hooks
        others = counted(crossings, f"{'other ' * (self.hooks > 0)}crossing")
        if not self.hooks:
            return f"no wires hook each other; {others}"
        hooks = f"{counted(self.hooks, 'clasp')}, where two wires hook each other"
        return f"{hooks}; {others}" if crossings else hooks


@lru_cache(maxsize=1)
def find_places(wires: Wires, loop_length: float) -> Places:
    """The places of wires with about so much wire [m] in a loop, each once; found once for the same wires."""
    crossings = find_crossings(wires)
    hooks = hooks_of(wires, crossings, loop_length)
    if crossings is None:
        return Places(hooks.wire, hooks.low, hooks.high, hooks.position, 0, crowded=True)
    number, first = np.unique(crossings.number, return_index=True)
    is_place = ~np.isin(number, hooks.corner) & (crossings.gap[first] <= LAYER * loop_length)
    other = first[is_place]
    return Places(
        np.concatenate([hooks.wire, crossings.wire[other]]),
        np.concatenate([hooks.low, crossings.arc[other]]),
        np.concatenate([hooks.high, crossings.arc[other]]),
        np.concatenate([hooks.position, crossings.position[other]]),
        len(hooks),
    )
