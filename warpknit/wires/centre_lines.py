"""Centre lines of spatial wires, as nodes."""

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

    def closing(self, wire: int) -> np.ndarray:
        """Vector (3,) [m] from the first node of a wire to its continuation; 0 for a closed wire."""
        shift = np.zeros(3)
        if self.period is not None:
            shift[:2] = self.shifts[wire] * self.period
        return shift

    def ends(self, wire: int) -> tuple[np.ndarray, np.ndarray]:
        """First and last points (segment, 3) [m] of the segments of a wire."""
        points = self.points[wire]
        if self.kinds[wire] != "open":
            points = np.concatenate([points, points[:1] + self.closing(wire)])
        return points[:-1], points[1:]

    @cached_property
    def lengths(self) -> np.ndarray:
        """(wire,) [m] sums of the segments."""
        ends = (self.ends(wire) for wire in range(len(self.points)))
        return np.array([np.linalg.norm(last - first, axis=1).sum() for first, last in ends])


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
            places = np.column_stack([cells * wires.period, np.zeros(count)])
            points.append((piece + places[:, None]).reshape(-1, 3))
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
