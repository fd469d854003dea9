"""Wires as discrete elastic rods: nodes, round sections on segments, natural (stress-free) shape.

A closed wire continues at its first node, shifted by its period (zero for a ring). Segment i goes from node i to the next
node of its wire. The last node of an open wire has no segment; its segment entries are unused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..base.text import short_repr
from ..kernels.banded_mass import CLAMPED, HELD_NODE, HELD_TURN
from ..kernels.bend import BOW
from ..wires.centre_lines import even_directors, twist

BENT_SHARE = 1.0 / 3.0  # of the compliance of a wire in bending, which its neighbours hinder


@dataclass(frozen=True)
class Section:
    """Stiffness and mass of an isotropic round section, for all ends of a yarn."""

    axial_stiffness: float  # [N] EA
    bending_stiffness: float  # [N m2] EI
    twist_stiffness: float  # [N m2] GJ
    linear_density: float  # [kg/m]
    rotary_inertia: float  # [kg m] of a length about its axis
    thickness: float  # [m] diameter where it touches
    radius: float = 0.0  # [m] of one end without its plating, for stresses
    yield_curvature: float = 0.0  # [1/m] change of curvature at first yield in bending; 0: no yield
    hardening: float = 1.0  # tangent bending stiffness beyond yield, over the elastic one

    @property
    def yields(self) -> bool:
        """Whether the section yields in bending."""
        return self.yield_curvature > 0.0 and self.hardening < 1.0


@dataclass(frozen=True)
class Rods:
    """Wires, each with one section. All arrays [node], segment data included, run over the nodes wire by wire."""

    __repr__ = short_repr

    section: Section  # of all wires; where they differ, of the thinnest one, by which motions and gaps are bounded
    wire_first: np.ndarray  # [wire] first node
    wire_count: np.ndarray  # [wire] nodes
    wire_closed: np.ndarray  # [wire] bool
    wire_period: np.ndarray  # (wire, 3) [m] shift of a closed wire from its first node to the node after its last
    position: np.ndarray  # (node, 3) [m] at rest
    director: np.ndarray  # (node, 3) unit vectors normal to the segment: orientation of its section at rest
    held: np.ndarray  # [node] int, HELD_NODE | HELD_TURN | CLAMPED of kernels/banded_mass.py
    natural_length: np.ndarray  # [node] [m] of the segment, a chord
    natural_arc: np.ndarray  # [node] [m] of the wire along the segment
    row: np.ndarray  # [node] int32: of copies the node of `forms`, else the node itself
    natural_curvature: np.ndarray | None = None  # (node, 2) [rad] along the section directors; None: as at rest
    natural_twist: np.ndarray | None = None  # [node] [rad]; None: as at rest
    set_fraction: float = 1.0  # natural over rest curvature and twist, where these are None
    node_stiffness: np.ndarray | None = None  # (node, 6) [N m], see node_stiffness.py; None: of the polygon
    sections: tuple[Section, ...] = ()  # [wire] where they differ
    radius_beside: float = 0.0  # [m] bound on the contact radius of worlds beside these
    tile: np.ndarray = field(default_factory=lambda: np.zeros(3))  # [m] periods of the world along x, y, z; 0: none
    forms: Rods | None = None  # the wires that these are copies of; None: each is its own

    @property
    def of_rows(self) -> Rods:
        """The wires whose nodes are the rows."""
        return self if self.forms is None else self.forms

    @property
    def node_count(self) -> int:
        return len(self.position)

    @cached_property
    def following(self) -> np.ndarray:
        """[node] next node of the wire; -1 at the end of an open wire."""
        after = np.arange(1, self.node_count + 1, dtype=np.int32)
        last = self.wire_first + self.wire_count - 1
        after[last] = np.where(self.wire_closed, self.wire_first, -1)
        return after

    @cached_property
    def previous(self) -> np.ndarray:
        """[node] previous node of the wire; -1 at the start of an open wire."""
        before = np.arange(-1, self.node_count - 1, dtype=np.int32)
        before[self.wire_first] = np.where(self.wire_closed, self.wire_first + self.wire_count - 1, -1)
        return before

    @cached_property
    def wire_of(self) -> np.ndarray:
        """[node] wire of each node."""
        return np.repeat(np.arange(len(self.wire_first), dtype=np.int32), self.wire_count)

    @cached_property
    def wire_radius(self) -> np.ndarray:
        """[wire] [m] contact radius."""
        return 0.5 * self.of_wires("thickness")

    @property
    def largest_radius(self) -> float:
        """[m] bound on the contact radius over all worlds."""
        return max(self.radius_beside, float(self.wire_radius.max()))

    def of_wires(self, constant: str) -> np.ndarray:
        """[wire] a field of the sections."""
        if not self.sections:
            return np.full(len(self.wire_first), getattr(self.section, constant))
        return np.array([getattr(section, constant) for section in self.sections])

    def of_nodes(self, constant: str) -> np.ndarray:
        """[node] a field of the sections."""
        return self.of_wires(constant)[self.wire_of]

    def touch_distance(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """[contact] [m] distance at which wires touch, by the nodes before their segments."""
        return self.wire_radius[self.wire_of[first]] + self.wire_radius[self.wire_of[second]]

    @property
    def rest_edge(self) -> np.ndarray:
        """(node, 3) [m] edge to the next node; at the end of an open wire, the previous edge."""
        return self.edge_after()

    def edge_after(self, nodes: np.ndarray | slice = slice(None)) -> np.ndarray:
        """(node, 3) [m] `rest_edge` of some nodes."""
        return np.asarray(self.of_rows._edge_of_row[self.row[nodes]])

    @cached_property
    def _edge_of_row(self) -> np.ndarray:
        after = self.following
        edge = self.position[after] - self.position
        last = self.wire_first + self.wire_count - 1
        edge[last] += self.wire_period
        edge[after < 0] = edge[self.previous[after < 0]]
        return edge

    @cached_property
    def rest_turning(self) -> np.ndarray:
        """[node] [rad] turning angle between the two segments at rest; 0 at the ends of wires."""
        edge = self.rest_edge
        before = edge[self.previous]
        angle = np.arctan2(np.linalg.norm(np.cross(before, edge), axis=1), np.sum(before * edge, axis=1))
        return np.where((self.following >= 0) & (self.previous >= 0), angle, 0.0)

    @cached_property
    def rest_twist(self) -> np.ndarray:
        """[node] [rad] twist of the directors at rest; 0 at the ends of wires."""
        before, tangent = self.previous, self.rest_edge / np.linalg.norm(self.rest_edge, axis=1)[:, None]
        angle = twist(self.director[before], self.director, tangent[before], tangent)
        return np.where((self.following >= 0) & (before >= 0), angle, 0.0)

    @property
    def bow_weights(self) -> tuple[np.ndarray, np.ndarray]:
        """Weights [node] of squared turns in the bow of a segment (kernels/rod_forces.py)."""
        node = np.maximum(self.node_length, 1e-300)
        return (self.slope_length / node) ** 2, (self.slope_length / node[self.following]) ** 2

    def widest_turn(self, angle: np.ndarray) -> np.ndarray:
        """[node] largest of the angles [node] at each node and its two neighbours."""
        after = np.where(self.following >= 0, angle[self.following], 0.0)
        before = np.where(self.previous >= 0, angle[self.previous], 0.0)
        return np.maximum(angle, np.maximum(after, before))

    @cached_property
    def node_length(self) -> np.ndarray:
        """[node] [m] natural length of wire that belongs to a node: half of both segments."""
        own = np.where(self.following >= 0, self.natural_arc, 0.0)
        before = np.where(self.previous >= 0, self.natural_arc[self.previous], 0.0)
        return 0.5 * (own + before)

    @cached_property
    def is_free(self) -> np.ndarray:
        """[node] whether a node moves."""
        return (self.held & int(HELD_NODE)) == 0

    @cached_property
    def can_stretch(self) -> np.ndarray:
        """[node] whether there is a segment that can stretch; between two held nodes it is rigid, whatever its tension."""
        return (self.following >= 0) & (self.is_free | self.is_free[self.following])

    @cached_property
    def can_turn(self) -> np.ndarray:
        """[node] whether there is a section that can turn."""
        return (self.following >= 0) & ((self.held & int(HELD_TURN)) == 0)

    @cached_property
    def is_clamped(self) -> np.ndarray:
        """[node] whether a clamp holds the segment, its nodes and its section; True where there is no segment."""
        return ~(self.can_stretch | self.can_turn)

    @cached_property
    def slope_length(self) -> np.ndarray:
        """[node] [m] natural arc of a segment along which the moment varies; 0 where a clamp holds it or there is none."""
        return np.where(self.is_clamped, 0.0, self.natural_arc)

    @cached_property
    def half_in_clamp(self) -> np.ndarray:
        """Natural length [node] [m] inside neighbouring clamps that stretches with a segment.

        A clamp ends in the middle of the segment that it holds: the half outside is part of the wire between the clamps.
        """
        half = np.where(self.is_clamped & (self.following >= 0), 0.5 * self.natural_length, 0.0)
        before, behind = self.previous, self.following
        beside = np.where(before >= 0, half[before], 0.0) + np.where(behind >= 0, half[behind], 0.0)
        return np.where(self.is_clamped, 0.0, beside)

    @cached_property
    def arc(self) -> np.ndarray:
        """[node] [m] natural arc length from the first node of the wire."""
        forms = self.of_rows
        begins = zip(forms.wire_first.tolist(), forms.wire_count.tolist(), strict=True)
        arcs = [np.cumsum(np.append(0.0, forms.natural_arc[first : first + count - 1])) for first, count in begins]
        return np.concatenate(arcs)[self.row]

    @cached_property
    def wire_length(self) -> np.ndarray:
        """[wire] [m] natural length; of a closed wire, once around."""
        return np.add.reduceat(np.where(self.following >= 0, self.natural_arc, 0.0), self.wire_first)

    @cached_property
    def wire_stiffness(self) -> np.ndarray:
        """[wire] [N] tension over strain of each wire as a bent spring: 1/(1/EA + BENT_SHARE <y^2>/EI).

        y: distance of its nodes at rest from the line along the wire. A straight wire has EA.
        """
        count = self.wire_count[:, None]
        first, last = self.position[self.wire_first], self.position[self.wire_first + self.wire_count - 1]
        along = np.where(self.wire_closed[:, None], self.wire_period, last - first)
        along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]  # a ring has none
        offset = self.position - (np.add.reduceat(self.position, self.wire_first) / count)[self.wire_of]
        square = np.sum(offset**2, axis=1) - np.einsum("na,na->n", offset, along[self.wire_of]) ** 2
        compliance = BENT_SHARE * np.add.reduceat(square, self.wire_first) / self.wire_count / self.of_wires("bending_stiffness")
        return np.asarray(1.0 / (1.0 / self.of_wires("axial_stiffness") + compliance))

    def nodes_of(self, wires: np.ndarray) -> np.ndarray:
        """[node] nodes of these wires, one wire after the other."""
        count = self.wire_count[wires]
        return np.repeat(self.wire_first[wires] - (np.cumsum(count) - count), count) + np.arange(count.sum())

    def copied(self, wires: np.ndarray, shift: np.ndarray) -> Rods:
        """Copies of these wires, moved by shift (copy, 3) [m]; a wire may be copied more than once."""
        node, count = self.nodes_of(wires), self.wire_count[wires]
        parts = {name: getattr(self, name)[node] for name in OF_NODES if getattr(self, name) is not None}
        parts["node_stiffness"] = None  # of the forms
        parts |= {name: getattr(self, name)[wires] for name in OF_WIRES}
        parts["position"] += np.repeat(shift, count, axis=0)
        sections = tuple(self.sections[wire] for wire in wires) if self.sections else ()
        first, row = np.cumsum(count) - count, self.row[node]
        return replace(self, wire_first=first, row=row, sections=sections, forms=self.of_rows, **parts)

    def holding(
        self,
        nodes: np.ndarray | Sequence[int] = (),
        sections: np.ndarray | Sequence[int] = (),
        clamped: np.ndarray | Sequence[int] = (),
    ) -> Rods:
        """A copy with nodes fixed, and sections fixed against rotation; `clamped`: segments in clamps of a knit."""
        held = self.held.copy()
        held[np.asarray(nodes, dtype=np.int64)] |= int(HELD_NODE)
        held[np.asarray(sections, dtype=np.int64)] |= int(HELD_TURN)
        held[np.asarray(clamped, dtype=np.int64)] |= int(CLAMPED)
        return replace(self, held=held)


def rods_of(
    section: Section,
    points: Sequence[np.ndarray],
    periods: Sequence[np.ndarray | None] | None = None,
    tile: np.ndarray | None = None,
) -> Rods:
    """Stress-free rods through node positions (n, 3) [m].

    periods: for each wire None where it is open, else its period (3,) [m]. The directors of an open wire have no twist. Along a
    closed wire the closing angle is distributed evenly over all nodes as natural twist.
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
        natural_arc=np.ones(len(position)),
        row=np.arange(len(position), dtype=np.int32),
        tile=np.zeros(3) if tile is None else np.asarray(tile, dtype=float),
    )
    edge = rods.rest_edge
    length = np.linalg.norm(edge, axis=1)
    square = rods.rest_turning**2
    arc = length * (1.0 + float(BOW) * (square + square[rods.following]))
    return replace(
        rods,
        natural_length=length,
        natural_arc=arc,
        director=even_directors(edge / length[:, None], first, count, rods.wire_closed),
    )


OF_WIRES = ("wire_count", "wire_closed", "wire_period")
OF_NODES = (
    "position", "director", "held", "natural_length", "natural_arc", "natural_curvature", "natural_twist", "node_stiffness"
)  # fmt: skip


def joined(worlds: Sequence[Rods]) -> Rods:
    """The rods of several worlds, one after the other: the same wires, of any shape and section."""
    first = worlds[0]
    if len(worlds) == 1:
        return first

    sections = [rods.sections or (rods.section,) * len(rods.wire_first) for rods in worlds]
    is_same = all(rods.section == first.section and not rods.sections for rods in worlds)
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(rods, name) for rods in worlds])
        for name in (*OF_WIRES, *OF_NODES)
        if getattr(first, name) is not None
    }
    for name, step in (("wire_first", first.node_count), ("row", first.of_rows.node_count)):
        arrays[name] = np.concatenate([getattr(rods, name) + k * step for k, rods in enumerate(worlds)]).astype(np.int32)
    return replace(
        first,
        sections=() if is_same else tuple(section for each in sections for section in each),
        forms=None if first.forms is None else joined([rods.of_rows for rods in worlds]),
        **arrays,
    )
