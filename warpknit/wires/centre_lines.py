"""Centre lines of spatial wires, as nodes, and directors across wires: parallel transport, frames without twist, twist."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from warpknit.results.finding import ResultWarning


@dataclass(frozen=True, eq=False)
class Wires:
    """Wires at rest. z is across the mesh, x along weft, y along warp.

    An open wire ends at its first and last node. A closed one continues from the last node to the first. A periodic one continues
    to the first node of another repeat: its own moved by shifts * period.
    """

    points: tuple[np.ndarray, ...]  # of each wire (node, 3) [m]
    kinds: tuple[str, ...]  # open | closed | periodic
    shifts: np.ndarray  # (wire, 2) repeats along x and y by which a wire goes on; 0 but for periodic ones
    period: np.ndarray | None  # (2,) [m] width and height of a repeat; None: the wires do not repeat
    radius: np.ndarray | None  # (wire,) [m] where the file says it
    rest_lengths: tuple[np.ndarray, ...] | None  # of each wire (segment,) [m] straight, free of stress, where the file says it
    natural_turns: tuple[np.ndarray, ...] | None = None  # of each wire (node, 3) [rad], see read.py; None: as at rest
    twist_strains: tuple[np.ndarray, ...] | None = None  # of each wire (node,) [rad], see read.py; None: 0
    notes: tuple[str, ...] = ()  # what the file states and is not used

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """The notes as warnings."""
        return tuple(ResultWarning("W03", f"Wire file: {note}.") for note in self.notes)

    @property
    def node_count(self) -> int:
        return sum(len(points) for points in self.points)

    @property
    def segment_counts(self) -> np.ndarray:
        """(wire,) an open wire has one segment fewer than nodes."""
        return np.array([len(points) - (kind == "open") for points, kind in zip(self.points, self.kinds, strict=True)], dtype=int)

    def shift(self, repeats: np.ndarray) -> np.ndarray:
        """Vectors (..., 3) [m] by repeats (..., 2) along x and y; 0 where wires do not repeat."""
        vectors = np.zeros((*repeats.shape[:-1], 3))
        if self.period is not None:
            vectors[..., :2] = repeats * self.period
        return vectors

    def closing(self, wire: int) -> np.ndarray:
        """Vector (3,) [m] from the first node of a wire to its continuation; 0 for a closed wire."""
        return self.shift(self.shifts[wire])

    def ends(self, wire: int) -> tuple[np.ndarray, np.ndarray]:
        """First and last points (segment, 3) [m] of the segments of a wire."""
        points = self.points[wire]
        if self.kinds[wire] != "open":
            points = np.concatenate([points, points[:1] + self.closing(wire)])
        return points[:-1], points[1:]

    def segment_lengths(self, wire: int) -> np.ndarray:
        """(segment,) [m] of a wire."""
        first, last = self.ends(wire)
        return np.linalg.norm(last - first, axis=1)

    @cached_property
    def lengths(self) -> np.ndarray:
        """(wire,) [m] sums of the segments."""
        return np.array([self.segment_lengths(wire).sum() for wire in range(len(self.points))])


def repeated(wires: Wires, repeats: tuple[int, int]) -> Wires:
    """The wires of `repeats` along x and y as one new repeat.

    A periodic wire with the shift (i, j) passes through n = lcm(a/gcd(a, i), b/gcd(b, j)) of the a x b repeats before it closes.
    So it becomes a b/n wires of n pieces, each with the shift (n i/a, n j/b) of the larger repeats.
    """
    if wires.period is None or repeats == (1, 1):
        return wires
    points, kinds, shifts, origin, counts = [], [], [], [], []
    for number, (piece, kind) in enumerate(zip(wires.points, wires.kinds, strict=True)):
        shift = wires.shifts[number]
        count = math.lcm(*(side // math.gcd(side, int(step)) for side, step in zip(repeats, shift, strict=True)))
        taken = np.zeros(repeats, dtype=bool)
        for start in np.ndindex(*repeats):
            if taken[start]:
                continue
            cells = np.array(start) + np.arange(count)[:, None] * shift
            taken[tuple((cells % repeats).T)] = True
            points.append((piece + wires.shift(cells)[:, None]).reshape(-1, 3))
            kinds.append(kind)
            shifts.append(count * shift // repeats)
            origin.append(number)
            counts.append(count)

    def of_copies(values: tuple[np.ndarray, ...] | None) -> tuple[np.ndarray, ...] | None:
        if values is None:
            return None
        pieces = zip(origin, counts, strict=True)
        return tuple(np.concatenate([values[number]] * count) for number, count in pieces)

    return replace(
        wires,
        points=tuple(points),
        kinds=tuple(kinds),
        shifts=np.array(shifts, dtype=np.int64),
        period=wires.period * repeats,
        radius=None if wires.radius is None else wires.radius[origin],
        rest_lengths=of_copies(wires.rest_lengths),
        natural_turns=of_copies(wires.natural_turns),
        twist_strains=of_copies(wires.twist_strains),
    )


def even_directors(tangent: np.ndarray, first: np.ndarray, count: np.ndarray, closed: np.ndarray) -> np.ndarray:
    """Directors (n, 3) normal to unit tangents (n, 3): without twist, or with the closing angle distributed evenly.

    first, count, closed [wire]: segments of each wire, and whether it goes on at its first one.

    Any unit vectors across the tangents are references. Parallel transport along the wire turns them against each other; the
    directors are the references turned back by the sum of these angles, as a product of complex numbers.
    """
    side = np.zeros_like(tangent)
    side[np.arange(len(tangent)), np.argmin(np.abs(tangent), axis=1)] = 1.0
    reference = across(side, tangent)
    before = np.arange(len(tangent)) - 1
    before[first] = np.where(closed, first + count - 1, first)
    back = transported(reference[before], tangent[before], tangent)
    jump = dot(back, reference) + 1j * dot(np.cross(back, reference), tangent)
    closing = np.where(closed, jump[first], 1.0)
    jump[first] = 1.0
    total = np.cumprod(jump / np.abs(jump))
    turn = np.repeat(total[first], count) / total
    share = np.where(closed, np.angle(closing / turn[first + count - 1]) / count, 0.0)
    turn *= np.exp(1j * np.repeat(share, count) * (np.arange(len(tangent)) - np.repeat(first, count)))
    turn /= np.abs(turn)
    return turn.real[:, None] * reference + turn.imag[:, None] * np.cross(tangent, reference)


def twist(before: np.ndarray, now: np.ndarray, tangent_before: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """[n] [rad] angle from directors `before` (n, 3), transported to the tangents (n, 3), to directors `now` (n, 3)."""
    moved = transported(before, tangent_before, tangent)
    return np.arctan2(dot(np.cross(moved, now), tangent), dot(moved, now))


def transported(vector: np.ndarray, before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Parallel transport of vectors (n, 3), normal to unit tangents `before` (n, 3), to the tangents `now` (n, 3)."""
    axis, cosine = np.cross(before, now), dot(before, now)[:, None]
    moved = cosine * vector + np.cross(axis, vector) + axis * dot(axis, vector)[:, None] / (1.0 + cosine)
    return moved - dot(moved, now)[:, None] * now


def across(vector: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 3) along the parts of vectors (n, 3) normal to unit tangents (n, 3)."""
    part = vector - dot(vector, tangent)[:, None] * tangent
    return part / np.linalg.norm(part, axis=1, keepdims=True)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """[n] scalar products of vectors (n, 3)."""
    return np.einsum("nc,nc->n", a, b)
