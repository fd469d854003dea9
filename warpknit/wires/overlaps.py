"""Overlaps of wires, from distances of segments, across repeats too.

Two places of one wire that are D apart are neighbours, and left out, if the wire between them is at most half a turn of that
width, pi D/2, or of the thickness: a bend without a fold can be that tight.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from warpknit.base.text import engineering
from warpknit.knit.crossings import candidate_pairs
from warpknit.wires.centre_lines import Wires, dot

CLOSEST = 1e-3  # of the thickness: smaller overlaps, and smaller distances of centre lines, count as zero
REACH = 2.0  # thicknesses up to which the closest places are found
MOST_PAIRS = 200_000_000  # of segments within reach of each other
MOST_TOUCHING = 2_000_000  # of these that overlap
BLOCK_PAIRS = 1_000_000  # looked at at once
SAME_PLACE = 2  # segments: overlaps no farther apart on both wires are one


@dataclass(frozen=True)
class Overlaps:
    """Overlaps among segments that are no neighbours."""

    thickness: float  # [m] distance of centre lines at which the closest wires touch
    closest: float | None  # [m] distance of the closest centre lines; None: farther than REACH thicknesses everywhere
    wires: tuple[int, int] | None  # that are closest, counted from 0
    arcs: tuple[float, float] | None  # [m] where, along them
    places: int  # where wires overlap
    crowded: bool = False  # too much overlaps to look at it pair by pair: the unit or the thickness is wrong

    def line(self) -> str:
        """The same in words."""
        if self.crowded:
            return f"wires of {engineering(self.thickness, 'm')} overlap nearly everywhere: is the unit right?"
        if self.closest is None or self.wires is None or self.arcs is None:
            return f"no wires nearer than {REACH:g} diameters of {engineering(self.thickness, 'm')}"
        (first, second), (here, there) = self.wires, (engineering(arc, "m", 4) for arc in self.arcs)
        pair = f"wires {first} at {here} and {second} at {there}" if first != second else f"wire {first} at {here} and {there}"
        where = f"closest centre lines {self.closest / self.thickness:.3g} diameters apart, of {pair}"
        return f"{self.places:,} overlaps; {where}" if self.places else f"no overlaps; {where}"


@dataclass(frozen=True)
class Segments:
    """The segments of all wires, each moved into the first repeat."""

    begin: np.ndarray  # (segment, 3) [m]
    end: np.ndarray  # (segment, 3) [m]
    wire: np.ndarray  # (segment,)
    arc: np.ndarray  # (segment,) [m] of their beginning, along the wire
    length: np.ndarray  # (segment,) [m]
    moved: np.ndarray  # (segment, 2) repeats by which they were moved


@dataclass
class NearPairs:
    """Pairs of segments that are no neighbours along one wire; each once."""

    segment: np.ndarray  # (pair, 2)
    repeat: np.ndarray  # (pair, 2) that the second lies in
    distance: np.ndarray  # (pair,) [m] of their centre lines
    touch: np.ndarray  # (pair,) [m] the same where they touch
    place: np.ndarray  # (pair, 2) of the least distance, from 0 to 1 along either segment
    between: np.ndarray  # (pair,) [m] of wire between the segments; infinite between two wires

    def taken(self, kept: np.ndarray) -> Any:
        """The pairs with these numbers, or of this mask."""
        return type(self)(*(getattr(self, one.name)[kept] for one in fields(self)))

    @property
    def share(self) -> np.ndarray:
        """(pair,) distance over that at which they touch."""
        return self.distance / self.touch


def find_overlaps(wires: Wires, thickness: float | np.ndarray) -> Overlaps:
    """Overlaps of wires of `thickness` [m], one or (wire,). The closest wires are closest by distance over contact distance."""
    segments, thickest = segments_of(wires), float(np.max(thickness))
    closest, touching, count = None, [], 0
    for near in near_pairs(segments, wires, thickness):
        if near is None or count > MOST_TOUCHING:
            return Overlaps(thickest, None, None, None, 0, crowded=True)
        touching.append(near.taken(near.share < 1.0 - CLOSEST))
        count += len(touching[-1].distance)
        if len(near.distance):
            least = near.taken(np.argmin(near.share, keepdims=True))
            closest = least if closest is None or least.share < closest.share else closest
    if closest is None or not closest.share <= REACH:
        return Overlaps(thickest, None, None, None, 0)
    first, second = closest.segment[0].tolist()
    arcs = segments.arc[closest.segment[0]] + closest.place[0] * segments.length[closest.segment[0]]
    return Overlaps(
        float(closest.touch[0]),
        float(closest.distance[0]),
        (int(segments.wire[first]), int(segments.wire[second])),
        (float(arcs[0]), float(arcs[1])),
        len(np.unique(_place_numbers(segments, wires, joined(touching)))),
    )


@dataclass(frozen=True)
class ClosePlaces:
    """Places [place] where two wires come nearer than REACH thicknesses."""

    wire: np.ndarray  # (place, 2)
    segment: np.ndarray  # (place, 2) of the closest points, counted along either wire
    on: np.ndarray  # (place, 2) of the closest points, from 0 to 1 along these segments
    repeat: np.ndarray  # (place, 2) of the second wire seen from the first, as they are drawn
    segments: np.ndarray  # (place, 2) segments of either wire that are so near


def close_places(wires: Wires, thickness: float | np.ndarray) -> ClosePlaces | None:
    """The places where wires of `thickness` [m], one or (wire,), are near each other; None where they are too many."""
    segments = segments_of(wires)
    pairs = kept_pairs(near_pairs(segments, wires, thickness), lambda near: near.share < REACH)
    if pairs is None:
        return None
    place = _place_numbers(segments, wires, pairs)
    order = np.lexsort((pairs.share, place))
    closest = pairs.taken(order[np.unique(place[order], return_index=True)[1]])
    first = np.searchsorted(segments.wire, np.arange(len(wires.points)))
    wire = segments.wire[closest.segment]
    along = [np.unique(np.stack([place, side]), axis=1)[0] for side in pairs.segment.T]
    return ClosePlaces(
        wire,
        closest.segment - first[wire],
        closest.place,
        closest.repeat + segments.moved[closest.segment[:, 1]] - segments.moved[closest.segment[:, 0]],
        np.stack([np.bincount(numbers, minlength=len(wire)) for numbers in along], axis=1),
    )


def joined(parts: list[NearPairs]) -> NearPairs:
    """Pairs of all parts."""
    return NearPairs(*(np.concatenate([getattr(part, one.name) for part in parts]) for one in fields(NearPairs)))


def kept_pairs(
    blocks: Iterator[NearPairs | None], is_kept: Callable[[NearPairs], np.ndarray], most: float = MOST_TOUCHING
) -> NearPairs | None:
    """Pairs of all blocks that are kept (pair,); None where there are more than `most`."""
    found: list[NearPairs] = []
    for near in blocks:
        if near is None or sum(len(part.distance) for part in found) > most:
            return None
        found.append(near.taken(is_kept(near)))
    return joined(found)


def near_pairs(
    segments: Segments, wires: Wires, thickness: float | np.ndarray, *, reach: float = REACH, with_neighbours: bool = False
) -> Iterator[NearPairs | None]:
    """Pairs nearer than `reach` thicknesses and some farther ones, in blocks; None where there are too many.

    with_neighbours: along one wire, too.
    """
    of_wires = np.broadcast_to(thickness, len(wires.points))
    radius = reach * float(of_wires.max()) + float(segments.length.max())
    middle = 0.5 * (segments.begin + segments.end)
    for candidates in candidate_pairs(middle, wires.period, radius, MOST_PAIRS, BLOCK_PAIRS):
        if candidates is None:
            yield None
            return
        a, b, repeat = candidates
        shift = wires.shift(repeat)
        distance, *place = segment_distances(
            segments.begin[a], segments.end[a], segments.begin[b] + shift, segments.end[b] + shift
        )
        touch = 0.5 * (of_wires[segments.wire[a]] + of_wires[segments.wire[b]])
        between = _wire_between(segments, wires, a, b, repeat)
        near = NearPairs(np.stack([a, b], axis=1), repeat, distance, touch, np.stack(place, axis=1), between)
        yield near if with_neighbours else near.taken(between > 0.5 * np.pi * np.maximum(distance, touch))


def segment_distances(
    begin_a: np.ndarray, end_a: np.ndarray, begin_b: np.ndarray, end_b: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance (pair,) [m] of two segments, and places on them, from 0 to 1. Segments are given by their ends (pair, 3) [m].

    C. Ericson, Real-Time Collision Detection, section 5.1.9.
    """
    along_a, along_b, between = end_a - begin_a, end_b - begin_b, begin_a - begin_b
    a, e = dot(along_a, along_a), dot(along_b, along_b)
    b, c, f = dot(along_a, along_b), dot(along_a, between), dot(along_b, between)
    across = a * e - b * b
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.where(across > 1e-12 * a * e, np.clip((b * f - c * e) / across, 0.0, 1.0), 0.0)
        t = np.where(e > 0.0, (b * s + f) / e, 0.0)
        s = np.where(t < 0.0, np.clip(-c / a, 0.0, 1.0), np.where(t > 1.0, np.clip((b - c) / a, 0.0, 1.0), s))
    s, t = np.where(a > 0.0, s, 0.0), np.clip(t, 0.0, 1.0)
    gap = between + s[:, None] * along_a - t[:, None] * along_b
    return np.sqrt(dot(gap, gap)), s, t


def segments_of(wires: Wires) -> Segments:
    ends = [wires.ends(number) for number in range(len(wires.points))]
    arcs = [np.concatenate([[0.0], np.cumsum(np.linalg.norm(end - begin, axis=1))[:-1]]) for begin, end in ends]
    wire = np.repeat(np.arange(len(ends)), [len(arc) for arc in arcs])
    begin, end = (np.concatenate(part) for part in zip(*ends, strict=True))
    moved = np.zeros((len(begin), 2)) if wires.period is None else -np.floor(0.5 * (begin + end)[:, :2] / wires.period)
    begin, end = begin + wires.shift(moved), end + wires.shift(moved)
    length = np.linalg.norm(end - begin, axis=1)
    return Segments(begin, end, wire, np.concatenate(arcs), length, moved.astype(np.int64))


def _wire_between(segments: Segments, wires: Wires, a: np.ndarray, b: np.ndarray, repeat: np.ndarray) -> np.ndarray:
    """(pair,) [m] of wire between two segments, the second in the repeat `repeat` (pair, 2); infinite between two wires."""
    wire = segments.wire[a]
    round_length = wires.lengths[wire]
    apart = segments.arc[b] - segments.arc[a]
    # repeats from the one to the other along the wire as it is drawn, not as its segments were moved
    repeats = repeat + segments.moved[b] - segments.moved[a]
    shift = wires.shifts[wire]
    size = (shift**2).sum(axis=1)
    turns = np.divide((repeats * shift).sum(axis=1), size, out=np.zeros(len(a)), where=size > 0)
    on_it = (repeats == np.round(turns)[:, None] * shift).all(axis=1)
    away = np.abs(apart + np.round(turns) * round_length)
    closed = np.array([kind == "closed" for kind in wires.kinds])[wire]
    away = np.where(closed, np.minimum(away, round_length - away), away)
    is_one = (wire == segments.wire[b]) & on_it
    return np.where(is_one, np.maximum(away - segments.length[a] - segments.length[b], 0.0), np.inf)


def _place_numbers(segments: Segments, wires: Wires, near: NearPairs) -> np.ndarray:
    """Place number of each pair (pair,), from 0: neighbouring pairs on both wires make one.

    A pair has several names, all given to it: its two segments either way round, and on a periodic wire the segments near its
    beginning also as continuations of its end.
    """
    pairs = np.column_stack([near.segment, near.repeat])
    if not len(pairs):
        return np.zeros(0, dtype=np.int64)
    first = np.searchsorted(segments.wire, np.arange(len(wires.points)))
    wire_a, wire_b = segments.wire[pairs[:, 0]], segments.wire[pairs[:, 1]]
    repeat = pairs[:, 2:] + segments.moved[pairs[:, 1]] - segments.moved[pairs[:, 0]]
    # pair, segment along either wire, the wires, and the repeat of the second seen from the first, as the wires are drawn
    names = np.column_stack(
        [np.arange(len(pairs)), pairs[:, 0] - first[wire_a], pairs[:, 1] - first[wire_b], wire_a, wire_b, repeat]
    )
    flipped = names[wire_a == wire_b][:, [0, 2, 1, 4, 3, 5, 6]] * [1, 1, 1, 1, 1, -1, -1]
    names = np.concatenate([names, flipped])
    goes_on = np.array([kind != "open" for kind in wires.kinds])
    for side, sign in ((1, 1), (2, -1)):
        early = names[(names[:, side] < SAME_PLACE) & goes_on[names[:, side + 2]]]
        early[:, side] += wires.segment_counts[early[:, side + 2]]
        early[:, 5:] += sign * wires.shifts[early[:, side + 2]]
        names = np.concatenate([names, early])
    apart = names[:, 1:] * [1, 1, *[SAME_PLACE + 1] * 4]  # what differs in wire or repeat is not near
    adjacent = cKDTree(apart).query_pairs(SAME_PLACE, p=np.inf, output_type="ndarray")
    linked = names[adjacent, 0]
    graph = coo_matrix((np.ones(len(linked)), (linked[:, 0], linked[:, 1])), shape=(len(pairs), len(pairs)))
    return np.asarray(connected_components(graph, directed=False)[1])
