"""Wires as discrete elastic rods: nodes in space, a round section on each segment, and what it is free of stress.

A closed wire continues at its first node, shifted by its period (zero for a ring). Segment i goes from node i to the next
node of its wire; the last node of an open wire has none, and its entries of segments mean nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..kernels.rod_step import HELD_NODE, HELD_TURN


@dataclass(frozen=True)
class Section:
    """What a wire resists with; of an isotropic round section, sums over the ends of a yarn."""

    axial_stiffness: float  # [N] EA
    bending_stiffness: float  # [N m2] EI
    twist_stiffness: float  # [N m2] GJ
    linear_density: float  # [kg/m]
    rotary_inertia: float  # [kg m] of a length about its axis
    thickness: float  # [m] diameter where it touches
    yield_curvature: float = 0.0  # [1/m] change of curvature from which on it yields in bending; 0: never
    hardening: float = 1.0  # bending stiffness beyond, over the elastic one


@dataclass(frozen=True)
class Rods:
    """Wires of one section. Arrays run over the nodes of all wires, wire after wire, those of segments too."""

    section: Section
    wire_first: np.ndarray  # [wire] first node
    wire_count: np.ndarray  # [wire] nodes
    wire_closed: np.ndarray  # [wire] bool
    wire_period: np.ndarray  # (wire, 3) [m] from the first node of a closed wire to where it comes back to it
    position: np.ndarray  # (node, 3) [m] at rest
    director: np.ndarray  # (node, 3) across the segment, unit vectors: how its section stands at rest
    held: np.ndarray  # [node] int, HELD_NODE | HELD_TURN of kernels/rod_step.py
    natural_length: np.ndarray  # [node] [m] of the segment
    natural_curvature: np.ndarray | None = None  # (node, 2) [rad] in the directions of the section; None: as at rest
    natural_twist: np.ndarray | None = None  # [node] [rad]; None: as at rest
    set_fraction: float = 1.0  # natural over rest curvature and twist, where these are taken as at rest
    thicker: np.ndarray | None = None  # [wire] [m] radius where it touches, where that is not half the section's thickness
    tile: np.ndarray = field(default_factory=lambda: np.zeros(3))  # [m] periods of the world along x, y, z; 0: none

    @property
    def node_count(self) -> int:
        return len(self.position)

    @property
    def following(self) -> np.ndarray:
        """[node] the next node of its wire, -1 behind an open wire's last."""
        after = np.arange(self.node_count) + 1
        last = self.wire_first + self.wire_count - 1
        after[last] = np.where(self.wire_closed, self.wire_first, -1)
        return after

    @property
    def previous(self) -> np.ndarray:
        """[node] the node before it, -1 before an open wire's first."""
        before = np.arange(self.node_count) - 1
        before[self.wire_first] = np.where(self.wire_closed, self.wire_first + self.wire_count - 1, -1)
        return before

    @property
    def wire_of(self) -> np.ndarray:
        """[node] its wire."""
        return np.repeat(np.arange(len(self.wire_first)), self.wire_count)

    @property
    def wire_radius(self) -> np.ndarray:
        """[wire] [m] where it touches."""
        return np.full(len(self.wire_first), 0.5 * self.section.thickness) if self.thicker is None else self.thicker

    @property
    def rest_edge(self) -> np.ndarray:
        """(node, 3) [m] to the next node; along the segment before, where there is none."""
        after = self.following
        edge = self.position[after] - self.position
        last = self.wire_first + self.wire_count - 1
        edge[last] += self.wire_period
        edge[after < 0] = edge[self.previous[after < 0]]
        return edge

    @property
    def rest_turning(self) -> np.ndarray:
        """[node] [rad] the angle between its two segments at rest, 0 at the ends of wires."""
        edge = self.rest_edge
        before = edge[self.previous]
        angle = np.arctan2(np.linalg.norm(np.cross(before, edge), axis=1), np.sum(before * edge, axis=1))
        return np.where((self.following >= 0) & (self.previous >= 0), angle, 0.0)

    def widest_turn(self, angle: np.ndarray) -> np.ndarray:
        """[node] the largest of the angles [node] at a node and its neighbours."""
        after = np.where(self.following >= 0, angle[self.following], 0.0)
        before = np.where(self.previous >= 0, angle[self.previous], 0.0)
        return np.maximum(angle, np.maximum(after, before))

    @property
    def node_length(self) -> np.ndarray:
        """[node] [m] of wire that belongs to a node: half of either segment."""
        own = np.where(self.following >= 0, self.natural_length, 0.0)
        before = np.where(self.previous >= 0, self.natural_length[self.previous], 0.0)
        return 0.5 * (own + before)

    @property
    def arc(self) -> np.ndarray:
        """[node] [m] of natural length from the first node of its wire."""
        total = np.concatenate([[0.0], np.cumsum(self.natural_length)[:-1]])
        return total - np.repeat(total[self.wire_first], self.wire_count)

    @property
    def wire_length(self) -> np.ndarray:
        """[wire] [m] natural length, all round where it is closed."""
        return np.add.reduceat(np.where(self.following >= 0, self.natural_length, 0.0), self.wire_first)

    def holding(self, nodes: np.ndarray | Sequence[int] = (), sections: np.ndarray | Sequence[int] = ()) -> Rods:
        """The same with nodes held in place and sections of segments held against turning."""
        held = self.held.copy()
        held[list(nodes)] |= int(HELD_NODE)
        held[list(sections)] |= int(HELD_TURN)
        return replace(self, held=held)


def rods_of(
    section: Section,
    points: Sequence[np.ndarray],
    periods: Sequence[np.ndarray | None] | None = None,
    tile: np.ndarray | None = None,
) -> Rods:
    """Rods through node positions (n, 3) [m], free of stress as they are.

    `periods`: for each wire None where it is open, else the shift (3,) [m] with which it comes back to its first node. The
    sections of an open wire stand without twist from one segment to the next; along a closed one that would leave a jump at
    its end, which is spread over all its nodes as natural twist.
    """
    count = np.array([len(p) for p in points])
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    shifts = [None] * len(points) if periods is None else list(periods)
    position = np.concatenate(points).astype(float)
    rods = Rods(
        section=section,
        wire_first=first,
        wire_count=count,
        wire_closed=np.array([shift is not None for shift in shifts]),
        wire_period=np.array([np.zeros(3) if shift is None else shift for shift in shifts], dtype=float),
        position=position,
        director=np.zeros_like(position),
        held=np.zeros(len(position), dtype=np.int32),
        natural_length=np.ones(len(position)),
        tile=np.zeros(3) if tile is None else np.asarray(tile, dtype=float),
    )
    edge = rods.rest_edge
    length = np.linalg.norm(edge, axis=1)
    tangent = edge / length[:, None]
    director = np.concatenate([
        _evenly_twisted(tangent[f : f + n]) if closed else _without_twist(tangent[f : f + n])
        for f, n, closed in zip(first, count, rods.wire_closed, strict=True)
    ])  # fmt: skip
    return replace(rods, natural_length=length, director=director)


def straight(rods: Rods) -> Rods:
    """The same wires, naturally straight and without twist."""
    return replace(rods, natural_curvature=np.zeros((rods.node_count, 2)), natural_twist=np.zeros(rods.node_count))


def _without_twist(tangent: np.ndarray) -> np.ndarray:
    """Directors (n, 3) across unit tangents (n, 3), each the one before it carried along by the least rotation."""
    first = np.eye(3)[np.argmin(np.abs(tangent[0]))]
    director = np.empty_like(tangent)
    director[0] = _across(first, tangent[0])
    for k in range(1, len(tangent)):
        director[k] = _carried(director[k - 1], tangent[k - 1], tangent[k])
    return director


def _evenly_twisted(tangent: np.ndarray) -> np.ndarray:
    """The same for a closed wire, turned section by section so that the first comes next after the last."""
    director = _without_twist(tangent)
    back = _carried(director[-1], tangent[-1], tangent[0])
    jump = np.arctan2(np.cross(back, director[0]) @ tangent[0], back @ director[0])
    angle = (jump / len(tangent) * np.arange(len(tangent)))[:, None]
    return np.cos(angle) * director + np.sin(angle) * np.cross(tangent, director)


def _carried(vector: np.ndarray, before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """`vector` across `before` after the least rotation to `now`."""
    axis, cosine = np.cross(before, now), before @ now
    return _across(cosine * vector + np.cross(axis, vector) + axis * (axis @ vector) / (1.0 + cosine), now)


def _across(vector: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    across = vector - (vector @ tangent) * tangent
    return across / np.linalg.norm(across)
