"""Hooks of wires, from crossings in plan view as for clasps (knit/clasps.py).

Two neighbouring crossings of the same two wires bound a lens. The wires hook in it where the sign alternates: one lies over the
other at one corner and under it at the other. Periodic wires continue: what hooks a copy of itself, or of another, hooks it once
a repeat. Nested lenses count one by one, as in a knit with `model.merge_lenses = false`.

A knit has contact at its clasps. Wires from a file need not be knitted: in a weave every crossing carries a force. So each
crossing that bounds no hook is a place of its own. Wires that cross farther apart than the thickness of a layer are in different
layers, which in-plane strains do not bring together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from warpknit.base.text import counted
from warpknit.knit.clasps import lens_ends, tightest
from warpknit.knit.crossings import candidate_pairs, plan_cross
from warpknit.wires.centre_lines import Wires
from warpknit.wires.overlaps import segments_of

LONGEST = 0.5  # of the wire of a loop: arcs of a lens at most
LAYER = 0.15  # of the wire of a loop, half the size of a loop: wires that cross farther apart are in different layers
MOST_PAIRS = 50_000_000  # of segments near each other in plan view
SAME = 1e-6  # segments: crossings no farther apart are one that two segments have found


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


class _Lens(NamedTuple):
    """Where two wires hook each other."""

    wire: tuple[int, int]
    repeat: np.ndarray  # (2,) of the second wire seen from the first
    low: np.ndarray  # (2,) [m] where the lens begins along either wire; of a wire that goes on it may be beyond its end
    high: np.ndarray  # (2,) [m]
    corners: tuple[int, int]  # numbers of the crossings that bound the lens


@dataclass(frozen=True)
class Places:
    """Hooks first, then the other crossings; [place]."""

    wire: np.ndarray  # (place, 2) from 0
    low: np.ndarray  # (place, 2) [m] where the lens of a hook begins along either wire; of a crossing where it is
    high: np.ndarray  # (place, 2) [m]
    position: np.ndarray  # (place, 2) [m] in plan view; of a hook the middle of its lens
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
    if crossings is None:
        none = np.zeros((0, 2))
        return Places(none.astype(np.int64), none, none, none, 0, crowded=True)
    lenses = _lenses(wires, crossings, LONGEST * loop_length)
    number, first = np.unique(crossings.number, return_index=True)
    corners = np.array([lens.corners for lens in lenses]).ravel()
    other = first[~np.isin(number, corners) & (crossings.gap[first] <= LAYER * loop_length)]
    wire = np.array([lens.wire for lens in lenses], dtype=np.int64).reshape(-1, 2)
    low, high = (np.array([getattr(lens, end) for lens in lenses]).reshape(-1, 2) for end in ("low", "high"))
    # half way between the middles of the two arcs of each lens
    middle = np.zeros((*wire.shape, 2))
    for w in np.unique(wire).tolist():
        middle[wire == w] = _places(wires, w, 0.5 * (low + high)[wire == w])
    repeat = np.array([lens.repeat for lens in lenses]).reshape(-1, 2)
    position = 0.5 * (middle.sum(axis=1) + wires.shift(repeat)[:, :2])
    return Places(
        np.concatenate([wire, crossings.wire[other]]),
        np.concatenate([low, crossings.arc[other]]),
        np.concatenate([high, crossings.arc[other]]),
        np.concatenate([position, crossings.position[other]]),
        len(lenses),
    )


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
    (near,) = candidate_pairs(0.5 * (plan.begin + plan.end), wires.period, float(plan.length.max()), MOST_PAIRS, MOST_PAIRS)
    if near is None:
        return None
    a, b, offset = near
    apart = (segments.wire[a] != segments.wire[b]) | (np.abs(a - b) > 1) | offset.any(axis=1)
    a, b, offset = a[apart], b[apart], offset[apart]
    u, v = segments.end[a] - segments.begin[a], segments.end[b] - segments.begin[b]
    between = segments.begin[b] + wires.shift(offset) - segments.begin[a]
    across = plan_cross(u, v)
    with np.errstate(divide="ignore", invalid="ignore"):
        t, s = plan_cross(between, v) / across, plan_cross(between, u) / across
    hit = (t >= -SAME) & (t < 1.0 - SAME) & (s >= -SAME) & (s < 1.0 - SAME)
    a, b, offset = a[hit], b[hit], offset[hit]
    t, s, u, v, between, across = (x[hit] for x in (t, s, u, v, between, across))
    wire = np.stack([segments.wire[a], segments.wire[b]], axis=1)
    arc = np.stack([segments.arc[a] + t * segments.length[a], segments.arc[b] + s * segments.length[b]], axis=1)
    repeat = offset + segments.moved[b] - segments.moved[a]
    height = t * u[:, 2] - between[:, 2] - s * v[:, 2]  # of the first above the second
    over = np.where(height >= 0.0, 1, -1)
    turn = np.sign(across).astype(int)
    position = (segments.begin[a] + t[:, None] * u - wires.shift(segments.moved[a]))[:, :2]
    flip = np.concatenate([wire[:, 0] > wire[:, 1], np.ones(np.count_nonzero(wire[:, 0] == wire[:, 1]), dtype=bool)])
    again = np.concatenate([np.arange(len(wire)), np.flatnonzero(wire[:, 0] == wire[:, 1])])
    wire, arc, repeat, over, turn, position = (x[again] for x in (wire, arc, repeat, over, turn, position))
    position[flip] -= wires.shift(repeat[flip])[:, :2]
    wire[flip], arc[flip] = wire[flip, ::-1], arc[flip, ::-1]
    repeat[flip], over[flip], turn[flip] = -repeat[flip], -over[flip], -turn[flip]
    return PlanCrossings(again, wire, arc, repeat, over, turn, np.abs(height)[again], position)


def _lenses(wires: Wires, c: PlanCrossings, longest: float) -> list[_Lens]:
    """Hooked lenses; those that share a corner: the one with the shorter arcs."""
    found: list[_Lens] = []
    order = np.lexsort(c.wire.T[::-1])
    begins = np.flatnonzero(np.diff(c.wire[order], axis=0, prepend=-1).any(axis=1))
    for member in np.split(order, begins)[1:]:
        first, second = c.wire[member[0]].tolist()
        # the crossings of two wires, and their images further along the first one
        rounds = np.repeat(_rounds(wires, first, longest), len(member))
        image = np.tile(member, len(rounds) // len(member))
        along = c.arc[image, 0] + rounds * wires.lengths[first]
        sorting = np.argsort(along, kind="stable")
        repeat = (c.repeat[image] + rounds[:, None] * wires.shifts[first])[sorting]
        image, along, turns = image[sorting], along[sorting], _rounds(wires, second, longest)
        for p in member.tolist() if len(along) * len(turns) > 1 else ():
            # images of the same two wires near p on the first: numbers, and arcs (k, 2) [m]
            here = slice(*np.searchsorted(along, [c.arc[p, 0] - longest, c.arc[p, 0] + longest]).tolist())
            away = repeat[here] - c.repeat[p]
            same = [(away == n * wires.shifts[second]).all(axis=1) for n in turns]
            number = np.concatenate([image[here][kept] for kept in same])
            across = [c.arc[image[here][kept], 1] + n * wires.lengths[second] for n, kept in zip(turns, same, strict=True)]
            arcs = np.stack([np.concatenate([along[here][kept] for kept in same]), np.concatenate(across)], axis=1)
            is_opposite = (c.over[number] == -c.over[p]) & (c.turn[number] == -c.turn[p])
            for k, low, high in lens_ends(c.arc[p], arcs, is_opposite, longest):
                found.append(_Lens((first, second), c.repeat[p], low, high, (int(c.number[p]), int(c.number[number[k]]))))
    return tightest(found)


def _rounds(wires: Wires, wire: int, longest: float) -> np.ndarray:
    """By which a wire is looked at again; none where it is open."""
    most = 0 if wires.kinds[wire] == "open" else 1 + int(longest // wires.lengths[wire])
    return np.arange(-most, most + 1)
