"""The branches and contacts of a recorded equilibrium.

The drawn curve of each wire is divided at its contacts, and between them into branches of about equal length. Contacts of one
wire within a diameter share a node. A gap below the radius between two wires that do not touch is a contact without force: a
capacitor. Gaps come from the spatial model; the planar model does not solve for heights.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..measure.network import holm_resistance, surface
from ..results.frame import Frame, WireLayout
from ..scene import Wire
from .currents import ThinWires
from .curves import Meeting, Polyline, find_gaps
from .impedance import gap_capacitance, yarn_radius

OPEN, COMPUTED, CLOSED = "open", "computed", "closed"  # contacts: none conducts, as computed, all and the gaps are perfect
BRANCHES = 72  # of the wire of a loop by default (docs/studies/reflection.md)
LEAST = 4.0  # radii of the default, at least
WINDOW = 2.0  # diameters along both wires around a contact within which no gap is counted


@dataclass(frozen=True, eq=False)
class Repeat:
    """One repeat of an equilibrium, as the field solver needs it."""

    wires: ThinWires
    force: np.ndarray  # [place] [N]; 0 for a gap
    gap: np.ndarray  # [place] [m] between the surfaces; 0 for a contact
    row: np.ndarray  # [place] contact of `wires`; -1 for a place that joins a node to itself

    def contacts(self, wire: Wire, frequency: float, state: str, film: float = 0.0) -> np.ndarray:
        """[contact] [S] admittances at a frequency [Hz]; 0: open, inf: perfect. film: [Ohm] in series with each that touches."""
        rows = len(self.wires.contact_node)
        if state != COMPUTED:
            return np.full(rows, np.inf if state == CLOSED else 0.0)
        admittance = 2j * np.pi * frequency * gap_capacitance(self.wires.radius, self.gap)
        touches = self.force > 0.0
        admittance[touches] += 1.0 / (holm_resistance(surface(wire), self.force[touches]) + film)
        total = np.zeros(rows, dtype=complex)
        np.add.at(total, self.row[self.row >= 0], admittance[self.row >= 0])
        return total


def repeat_of(layout: WireLayout, frame: Frame, wire: Wire, longest: float) -> Repeat:
    """The repeat of a recorded state with branches of at most `longest` [m]."""
    cell = (frame.deformation @ np.diag(layout.period)).T
    curves, radius = list(_curves(layout, frame, cell)), yarn_radius(wire)
    thickness = layout.diameter
    pairs = zip(frame.contact_wires.tolist(), (frame.contact_share % 1.0).tolist(), strict=True)
    places = [Meeting(thickness, tuple(wires), tuple(share)) for wires, share in pairs]
    touching = len(places)
    if layout.in_space:
        places += find_gaps(curves, cell, thickness + radius, WINDOW * thickness, places)
    node, branch, branch_shift, middle, end, turn = _divided(curves, places, longest, 2.0 * radius)
    shift = _nearest_image(curves, places, cell) + turn[:, 1] - turn[:, 0]
    ends = np.concatenate([end, shift], axis=1)
    joins_itself = (ends[:, 0] == ends[:, 1]) & ~ends[:, 2:].any(axis=1)
    rows, found = np.unique(ends[~joins_itself], axis=0, return_inverse=True)
    row = np.full(len(ends), -1)
    row[~joins_itself] = found.ravel()
    return Repeat(
        wires=ThinWires(cell, radius, node, branch, branch_shift, rows[:, :2], rows[:, 2:], middle),
        force=np.concatenate([frame.contact_force, np.zeros(len(places) - touching)]),
        gap=np.array([max(place.distance - thickness, 0.0) for place in places]),
        row=row,
    )


def _curves(layout: WireLayout, frame: Frame, cell: np.ndarray) -> Iterator[Polyline]:
    between = np.asarray(frame.between, dtype=float)
    for start, end, rest in zip(layout.wire_start[:-1], layout.wire_start[1:], layout.wire_closing, strict=True):
        points = np.asarray(frame.node_position, dtype=float)[start:end, None]
        if between.size:
            points = np.concatenate([points, points + between[start:end]], axis=1)
        closing, points = np.array([*(frame.deformation @ rest), 0.0]), points.reshape(-1, 3)
        yield Polyline(np.concatenate([points, points[:1] + closing]), closing, cell)


def _nearest_image(curves: Sequence[Polyline], places: Sequence[Meeting], cell: np.ndarray) -> np.ndarray:
    """Periods (place, 2) that move the second wire, as drawn, beside the first."""

    def place(wire: int, share: float) -> np.ndarray:
        return curves[wire].at(np.array(share * curves[wire].length))

    drawn = np.array([[*map(place, one.wire, one.share)] for one in places]).reshape(-1, 2, 3)
    return np.asarray(np.rint((drawn[:, 0] - drawn[:, 1])[:, :2] @ np.linalg.inv(cell)).astype(np.int64))


def _divided(curves: Sequence[Polyline], places: Sequence[Meeting], longest: float, least: float) -> tuple[np.ndarray, ...]:
    """Divide wires at places; those within `least` [m] of a wire share a node.

    Returns nodes (node, 3) [m], branches (branch, 2) by their nodes, periods (branch, 2) from first node to second, places
    (branch, 3) [m] where their halves meet, nodes (place, 2) at a place, and periods (place, 2, 2) from these to the place.
    """
    parts_of: list[tuple[np.ndarray, ...]] = []  # nodes, branches, periods, middles of each wire
    count = 0
    wire, share = (np.array([getattr(one, name) for one in places]).reshape(-1, 2) for name in ("wire", "share"))
    end, turn = np.zeros((len(places), 2), dtype=np.int64), np.zeros((len(places), 2, 2), dtype=np.int64)
    for number, curve in enumerate(curves):
        where = np.argwhere(wire == number)
        stops = _stops(share[tuple(where.T)] * curve.length, curve.length, least)
        begins = [arc for arc, _ in stops] or [0.0]
        parts = [_parts(*span, longest) for span in zip(begins, [*begins[1:], begins[0] + curve.length], strict=True)]
        first = count + np.cumsum([0, *(len(part) for part in parts)])
        for (_, members), drawn in zip(stops, first, strict=False):
            for member, turns in members:
                end[tuple(where[member])], turn[tuple(where[member])] = drawn, turns * curve.lattice
        size = int(first[-1]) - count
        step = np.arange(size)
        corner = _polygon(curve, np.concatenate(parts))
        shift = np.where((step == size - 1)[:, None], curve.lattice, 0)
        parts_of.append((corner[::2], count + np.stack([step, (step + 1) % size], axis=1), shift, corner[1::2]))
        count += size
    return *map(np.concatenate, zip(*parts_of, strict=True)), end, turn


def _polygon(curve: Polyline, begin: np.ndarray) -> np.ndarray:
    """Corners (corner, 3) [m] of straight pieces, two a branch, at arcs `begin` [m].

    A chord of the length h is h^2 / 12 R inside a curve of the radius R in the mean. Corners lie outside by as much, so the
    inductance of loops converges with few branches.
    """
    half = 0.5 * np.diff(begin, append=begin[0] + curve.length)
    arc, size = np.stack([begin, begin + half], axis=1).ravel(), np.repeat(half, 2)
    size = 0.5 * (size + np.roll(size, 1))
    return (14.0 * curve.at(arc) - curve.at(arc + size) - curve.at(arc - size)) / 12.0


def _stops(arcs: np.ndarray, length: float, least: float) -> list[tuple[float, list[tuple[int, int]]]]:
    """Places of one wire in order; those within `least` [m] of the first one are one stop at their mean.

    Of each stop the arc [m] in 0 .. length, and its places with the periods from the stop to them.
    """
    groups: list[list[tuple[int, int]]] = []
    for place in np.argsort(arcs).tolist():
        if groups and arcs[place] - arcs[groups[-1][0][0]] < least:
            groups[-1].append((place, 0))
        else:
            groups.append([(place, 0)])
    if len(groups) > 1 and arcs[groups[0][0][0]] + length - arcs[groups[-1][0][0]] < least:  # across the end of the wire
        groups[-1] += [(place, 1) for place, _ in groups.pop(0)]
    stops = []
    for group in groups:
        over, arc = divmod(float(np.mean([arcs[place] + turn * length for place, turn in group])), length)
        stops.append((arc, [(place, int(over) - turn) for place, turn in group]))
    return sorted(stops)


def _parts(begin: float, end: float, longest: float) -> np.ndarray:
    """[m] arcs at which the branches between two stops begin."""
    count = max(1, int(np.ceil((end - begin) / longest)))
    return begin + (end - begin) * np.arange(count) / count
