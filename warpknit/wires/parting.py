"""Drawn wires that overlap, pushed apart into a stress-free shape: `wires.overlaps = "at rest"`.

The thickness grows from what fits, so that the deepest overlaps are undone first. Where two curves are nearer than that, either
side moves by half of what is missing, along the line between both. Moves are spread along the wire as a beam on springs spreads a
force, u + LENGTH^4 u'''' = f, so that no wire gets a kink. The curve is the Catmull-Rom one on which wires of a file touch
(kernels/wire_curve.py). Wires keep the side on which they are drawn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from warpknit.base.hermite import hermite
from warpknit.base.text import engineering, short_percent
from warpknit.wires.centre_lines import Wires, dot
from warpknit.wires.overlaps import CLOSEST, NearPairs, kept_pairs, near_pairs, segments_of

LENGTH = 1.5  # thicknesses
GAIN = 1.5  # of moves before they are spread
GROWTH = 0.1  # of the thickness, by which it grows at once
APART = 1.005  # distance in the end over the thickness: no contact has a force
FOUND, ROUGHLY = 0.003, 0.05  # of the thickness: overlaps left in the end, and before the thickness grows
STEPS = 400  # at most
# thicknesses beyond the present one: up to which pairs are listed, and up to which they are known before they are listed anew
NEAR, KNOWN = 0.4, 0.1
LARGEST = 0.1  # of the thickness: most that a node moves at once
ALONG = 2.0  # thicknesses along a wire, below which it does not touch itself (spatial/pair_search.py)
SAMPLES = 3  # of a segment: the nearest are the first places
DAMPED = 1.0  # share by which steps to the closest points are damped, as curvature is left out
LONGEST = 0.25  # of a segment: longest step to the closest points
AROUND = 16  # LENGTHs of a wire that goes on, beyond either end: moves decay by exp(-AROUND/sqrt(2))
STIFF = 1e6  # of the springs of nodes that clamps hold


@dataclass
class _Pairs(NearPairs):
    """Segments near each other, with the closest points of their curves as places."""

    shift: np.ndarray  # (pair, 3) [m] of the second
    length: np.ndarray  # (pair, 2) [m] of the segments
    is_ahead: np.ndarray  # (pair,) whether the second is behind the first along one wire, not before it

    def without_neighbours(self, distance: np.ndarray) -> np.ndarray:
        """Distances (pair,) [m], infinite where the places are neighbours along one wire, without contact."""
        near = np.flatnonzero(self.between < ALONG * self.touch)
        inner = np.where(self.is_ahead[near][:, None], [1.0, 0.0], [0.0, 1.0])  # the ends that face each other along the wire
        beyond = dot(np.abs(self.place[near] - inner), self.length[near])
        distance[near[self.between[near] + beyond < ALONG * self.touch[near]]] = np.inf
        return distance


class _Nodes:
    """Nodes of all wires in sequence, and four for the curve of each segment."""

    def __init__(self, wires: Wires, thickness: np.ndarray) -> None:
        """thickness (wire,) [m]."""
        self.count = np.array([len(points) for points in wires.points])
        self.first = np.cumsum(self.count) - self.count
        spacing = wires.lengths / wires.segment_counts
        length = LENGTH * thickness / spacing  # (wire,) nodes
        numbers, shifts, around = [], [], []
        for wire, (first, count) in enumerate(zip(self.first.tolist(), self.count.tolist(), strict=True)):
            is_open = wires.kinds[wire] == "open"
            number = np.arange(count - is_open)[:, None] + np.arange(-1, 3)
            rounds = 0 * number if is_open else number // count
            numbers.append(first + (np.clip(number, 0, count - 1) if is_open else number % count))
            shifts.append(rounds[..., None] * wires.closing(wire))
            beyond = 0 if is_open else math.ceil(AROUND * length[wire])
            around.append(first + np.arange(-beyond, count + beyond) % count)
        self.number, self.shift = np.concatenate(numbers), np.concatenate(shifts)  # (segment, 4), and (segment, 4, 3) [m]
        self._around = np.concatenate(around)  # nodes of all wires, those that go on with AROUND more
        size = np.array([len(one) for one in around])
        begin = np.cumsum(size) - size
        self._own = np.concatenate([b + (s - n) // 2 + np.arange(n) for b, s, n in zip(begin, size, self.count, strict=True)])
        held = [begin[w] + k for w, kind in enumerate(wires.kinds) if kind == "open" for k in (0, 1, size[w] - 2, size[w] - 1)]
        self._beam = cholesky_banded(self._bands(begin, size, np.array(held, dtype=np.int64), np.repeat(length, size)))

    @staticmethod
    def _bands(begin: np.ndarray, size: np.ndarray, held: np.ndarray, length: np.ndarray) -> np.ndarray:
        """(3, node) bands of 1 + D2^T L^4 D2 of wires with these nodes; those held have stiff springs. length (node,) [nodes]."""
        bend = np.ones(size.sum())  # of the difference at a node; none at the ends of a wire
        bend[begin], bend[begin + size - 1] = 0.0, 0.0
        bend *= length**4
        before, after = np.roll(bend, 1), np.roll(bend, -1)
        bands = np.stack([after, -2.0 * (bend + after), 1.0 + before + 4.0 * bend + after])
        bands[2, held] += STIFF
        bands[0, 2:], bands[1, 1:] = bands[0, :-2].copy(), bands[1, :-1].copy()
        return bands

    def spread(self, move: np.ndarray) -> np.ndarray:
        """(node, 3) [m] moves, spread along the wires."""
        return np.asarray(cho_solve_banded((self._beam, False), move[self._around])[self._own])

    def cubics(self, points: np.ndarray) -> np.ndarray:
        """Coefficients (4, 3, segment) [m] of the curves through nodes.

        They are c0 + c1 s + c2 s^2 + c3 s^3, with the nodes at `points` (node, 3) [m].
        """
        p0, p1, p2, p3 = (points[number] + shift for number, shift in zip(self.number.T, self.shift.swapaxes(0, 1), strict=True))
        slope, slope_after, chord = 0.5 * (p2 - p0), 0.5 * (p3 - p1), p2 - p1
        cubics = [p1, slope, 3.0 * chord - 2.0 * slope - slope_after, slope + slope_after - 2.0 * chord]
        return np.ascontiguousarray(np.stack(cubics).swapaxes(1, 2))


def _weights(s: np.ndarray) -> np.ndarray:
    """(..., 4) weights of the nodes of a segment in its curve at places s."""
    h10, h01, h11 = hermite(s)
    return np.stack([-0.5 * h10, 1.0 - h01 - 0.5 * h11, h01 + 0.5 * h10, 0.5 * h11], axis=-1)


def pushed_apart(wires: Wires, thickness: np.ndarray) -> Wires:
    """The wires of `thickness` (wire,) [m] without overlaps, where they can part; with a note of how far they moved.

    Lengths free of stress keep their ratio to the segments.
    """
    thickness = np.broadcast_to(thickness, len(wires.points))
    nodes, thickest = _Nodes(wires, thickness), float(np.max(thickness))
    drawn = points = np.concatenate(wires.points)
    reach = 1.0 + NEAR  # thicknesses up to which pairs are listed
    pairs = _listed(wires, nodes, thickness, reach)
    share, deepest, travel = 0.0, 0.0, 0.0
    left = 0.0  # of the thickness: deepest overlap now
    for _ in range(STEPS):
        if pairs is None or not len(pairs.touch):
            break
        place = pairs.place
        normal, distance = _closest(nodes.cubics(points), pairs)
        left = float(1.0 - (distance / pairs.touch).min())
        if share == 0.0:
            deepest = left
            if not CLOSEST < deepest <= 1.0 - CLOSEST:  # nothing to undo, or centre lines that intersect, which are refused
                break
            share = 1.0 - deepest
        missing = APART * share - distance / pairs.touch
        if missing.max() >= (FOUND if share == 1.0 else ROUGHLY):
            move = nodes.spread(_moves(nodes, pairs, np.maximum(missing, 0.0) * pairs.touch, normal, place, len(points)))
            size = np.linalg.norm(move, axis=1, keepdims=True)
            move *= np.minimum(1.0, LARGEST * thickest / np.maximum(size, 1e-300))
            points, travel = points + move, travel + float(size.max())
        elif share == 1.0 and travel == 0.0:
            break
        elif share == 1.0:  # are there others?
            travel = np.inf
        share = share if missing.max() >= ROUGHLY else min(1.0, share + GROWTH)
        if share + 2.0 * travel / thickest > reach - KNOWN:
            reach, travel = share + NEAR, 0.0
            pairs = _listed(_at(wires, nodes, points), nodes, thickness, reach)
    if share == 0.0:
        return wires
    farthest = engineering(float(np.linalg.norm(points - drawn, axis=1).max()), "m")
    still = f", but still overlap by up to {short_percent(left)}, which prestresses the mesh" if left >= FOUND else ""
    note = (
        f"wires overlapped as drawn by up to {short_percent(deepest)} of their thickness; they were moved apart by up to"
        f" {farthest}{still or ', and are free of stress there'} (wires.overlaps)"
    )
    return replace(_at(wires, nodes, points), notes=(*wires.notes, note))


def _at(wires: Wires, nodes: _Nodes, points: np.ndarray) -> Wires:
    """The wires with their nodes at other points (node, 3) [m]."""
    there = replace(wires, points=tuple(np.split(points, nodes.first[1:])))
    if wires.rest_lengths is None:
        return there
    kept = (rest * there.segment_lengths(wire) / wires.segment_lengths(wire) for wire, rest in enumerate(wires.rest_lengths))
    return replace(there, rest_lengths=tuple(kept))


def _listed(wires: Wires, nodes: _Nodes, thickness: np.ndarray, reach: float) -> _Pairs | None:
    """Pairs of segments nearer than `reach` thicknesses that are no neighbours; None where they are too many."""
    segments = segments_of(wires)

    def is_listed(near: NearPairs) -> np.ndarray:
        longest = near.between + segments.length[near.segment].sum(axis=1)
        return np.asarray((near.share < reach) & (longest >= ALONG * near.touch))

    pairs = kept_pairs(near_pairs(segments, wires, thickness, reach=reach, with_neighbours=True), is_listed, np.inf)
    if pairs is None:
        return None
    first, second = pairs.segment.T
    shift = wires.shift(pairs.repeat + segments.moved[second] - segments.moved[first])
    found = _Pairs(**vars(pairs), shift=shift, length=segments.length[pairs.segment], is_ahead=first < 0)
    cubics, samples = nodes.cubics(np.concatenate(wires.points)), np.linspace(0.0, 1.0, SAMPLES + 1)
    curves = [_on_curve(cubics, s) for s in samples]
    of_first, of_second = ([np.take(curve, side, axis=1) for curve in curves] for side in (first, second))
    of_second = [one + shift.T for one in of_second]
    distance = np.stack([_length(a - b) for a in of_first for b in of_second])
    found.is_ahead = distance[-1 - SAMPLES] <= distance[SAMPLES]  # at (1, 0) and (0, 1)
    places = np.stack(np.meshgrid(samples, samples, indexing="ij"), axis=-1).reshape(-1, 2)
    for number, place in enumerate(places):
        found.place = np.broadcast_to(place, (len(first), 2))
        found.without_neighbours(distance[number])
    found.place = places[np.argmin(distance, axis=0)]
    found = found.taken(distance.min(axis=0) < reach * found.touch)
    _closest(cubics, found)
    return found


def _closest(cubics: np.ndarray, pairs: _Pairs) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (3, pair) from second to first curve, and distances (pair,) [m].

    Both are at the places, which then move by a damped step of Gauss and Newton. cubics: of all segments.
    """
    (p, along_p), (q, along_q) = (
        _on_curve_with_slope(np.take(cubics, segment, axis=2), place)
        for segment, place in zip(pairs.segment.T, pairs.place.T, strict=True)
    )
    between = p - q - pairs.shift.T
    distance = _length(between)
    normal = between / np.maximum(distance, 1e-300)
    distance = pairs.without_neighbours(distance)
    a, c = ((1.0 + DAMPED) * _dot(along, along) for along in (along_p, along_q))
    b, f, g = _dot(along_p, along_q), _dot(between, along_p), _dot(between, along_q)
    step = np.stack([b * g - c * f, a * g - b * f], axis=1) / (a * c - b * b)[:, None]
    pairs.place = np.clip(pairs.place + np.clip(step, -LONGEST, LONGEST), 0.0, 1.0)
    return normal, distance


def _on_curve(cubics: np.ndarray, s: np.ndarray | float) -> np.ndarray:
    """Points (3, pair) [m] at places s of cubics (4, 3, pair)."""
    c0, c1, c2, c3 = cubics
    return np.asarray(c0 + s * (c1 + s * (c2 + s * c3)))


def _on_curve_with_slope(cubics: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same, and derivatives (3, pair) [m] by s."""
    _, c1, c2, c3 = cubics
    return _on_curve(cubics, s), c1 + s * (2.0 * c2 + 3.0 * s * c3)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(pair,) products of vectors (3, pair)."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def _length(a: np.ndarray) -> np.ndarray:
    """(pair,) lengths of vectors (3, pair)."""
    return np.sqrt(_dot(a, a))


def _moves(nodes: _Nodes, pairs: _Pairs, missing: np.ndarray, normal: np.ndarray, place: np.ndarray, count: int) -> np.ndarray:
    """Moves (node, 3) [m] of both sides by half of `missing` (pair,) [m] at places (pair, 2), a mean over pairs."""
    close = np.flatnonzero(missing > 0.0)
    number = nodes.number[pairs.segment[close]].ravel()
    weight = np.maximum(_weights(place[close]), 0.0)
    half = 0.5 * GAIN * missing[close] * normal[:, close]
    move = half[:, :, None, None] * np.array([1.0, -1.0])[:, None] * weight
    total = np.bincount(number, weight.ravel(), count)
    sums = np.stack([np.bincount(number, one.ravel(), count) for one in move], axis=1)
    return np.asarray(sums / np.maximum(total, 1.0)[:, None])
