"""Centre lines of wires in space, as nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class Wires:
    """Wires at rest. z is across the mesh, x along weft, y along warp.

    An open wire ends at its first and last node. A closed one goes on from the last node to the first. A periodic one goes on
    from the last node to the first of the repeat that `shifts` says: its first node moved by shifts * period.
    """

    points: tuple[np.ndarray, ...]  # of each wire (node, 3) [m]
    kinds: tuple[str, ...]  # open | closed | periodic
    shifts: np.ndarray  # (wire, 2) repeats along x and y by which a wire goes on; 0 but for periodic ones
    period: np.ndarray | None  # (2,) [m] width and height of a repeat; None: the wires do not repeat
    radius: np.ndarray | None  # (wire,) [m] where the file says it
    rest_lengths: tuple[np.ndarray, ...] | None  # of each wire (segment,) [m] straight, free of stress, where the file says it
    natural_turns: tuple[np.ndarray, ...] | None = None  # of each wire (node, 3) [rad], see natural_shape.py; None: as at rest
    twist_strains: tuple[np.ndarray, ...] | None = None  # of each wire (node,) [rad], see natural_shape.py; None: 0
    notes: tuple[str, ...] = ()  # what the file states and is not used

    @property
    def node_count(self) -> int:
        return sum(len(points) for points in self.points)

    @property
    def segment_counts(self) -> np.ndarray:
        """(wire,) an open wire has one segment fewer than nodes."""
        return np.array([len(points) - (kind == "open") for points, kind in zip(self.points, self.kinds, strict=True)], dtype=int)

    def closing(self, wire: int) -> np.ndarray:
        """(3,) [m] from the first node of a wire to where it goes on behind its last one; 0 for a closed wire."""
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
