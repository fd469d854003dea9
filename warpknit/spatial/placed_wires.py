"""Nodes of the wires of a panel (mesh/panel.py) in space, closed or clamped at both ends.

A closed wire keeps the nodes of the panel. A clamped wire is divided evenly from clamp to clamp: each clamp sits in the middle of
the first or last segment and holds its two nodes and its section.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import minimize_scalar

from ..knit.cloth import Cloth
from ..mesh.panel import Panel
from ..mesh.rest_table import Table
from ..mesh.thread_curve import ThreadCurve
from .rest_curve import FIT_PLACES, CentreLine

MIN_SEGMENTS = 3  # between two clamps
SEARCHED = 3.0  # node spacings from the panel's first node, within which the clamp is searched


class Curve(Protocol):
    """A centre line by its arc length [m]."""

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Points (m, 3) [m]."""

    def slope(self, s: np.ndarray) -> np.ndarray:
        """(m, 3) of any length, along the line."""


@dataclass(frozen=True)
class SpatialWires:
    """Nodes of the wires, their clamps, and the sites of the panel's bodies.

    Places along a wire are in nodes from its first one; arrays of sites are (site, 2), for their two wires.
    """

    points: tuple[np.ndarray, ...]  # for each wire (n, 3) [m]
    tile: np.ndarray  # (3,) [m] periods in space; 0: none
    line: CentreLine | None  # the true centre lines; None: unknown
    held_node: np.ndarray  # [held] nodes, counted over all wires
    held_lever: np.ndarray  # (held, 2) [m] at rest, from the clamp that holds the node
    held_section: np.ndarray  # [held segment] first nodes of segments whose sections are held
    site_wire: np.ndarray
    site_seed: np.ndarray  # place nearest to the body at rest
    site_low: np.ndarray  # reach before it, negative
    site_high: np.ndarray  # and behind
    panel_begin: np.ndarray | None = None  # [wire] place of the first node of the panel's wire; None: the nodes are the panel's
    panel_step: np.ndarray | None = None  # [wire] nodes for each node of the panel
    sliding_clamp: np.ndarray | None = None  # clamps, of two held nodes each, that slide along the warp; None: none


def place_wires(cloth: Cloth, table: Table, panel: Panel) -> SpatialWires:
    """Place the wires of a panel in space."""
    wire = panel.pair_wire.reshape(-1, 2)
    seed = panel.pair_seed.reshape(-1, 2) - panel.wire_first[wire]
    low, high = panel.pair_low.reshape(-1, 2), panel.pair_high.reshape(-1, 2)
    if panel.boundary == "periodic":
        entry = panel.node_entry
        origin = np.repeat(panel.block_origin, panel.block_count, axis=0)
        position = np.stack([table.x[entry] + origin[:, 0], table.y[entry] + origin[:, 1], table.z[entry]], axis=1)
        none = np.zeros(0, dtype=np.int64)
        split = tuple(np.split(position, panel.wire_first[1:]))
        line = _line_of_panel(cloth, table, panel)
        return SpatialWires(split, np.array([*panel.size, 0.0]), line, none, np.zeros((0, 2)), none, wire, seed, low, high)
    points: list[np.ndarray] = []
    lines: list[CentreLine] = []
    starts, shares = [], []
    for w in range(len(panel.wire_first)):
        along, line, place, share = _clamped_wire(cloth, table, panel, w)
        points.append(along)
        lines.append(line)
        starts.append(place)
        shares.append(share)
    start, share = np.array(starts)[wire], np.array(shares)[wire]
    count = np.array([len(p) for p in points])
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    held = np.stack([first, first + 1, first + count - 2, first + count - 1], axis=1)
    clamp = panel.clamp_position.reshape(-1, 2, 2)
    lever = np.concatenate(points)[held][..., :2] - np.repeat(clamp, 2, axis=1)
    return SpatialWires(
        points=tuple(points),
        tile=np.zeros(3),
        line=CentreLine(np.concatenate([one.slope for one in lines]), np.concatenate([one.between for one in lines])),
        held_node=held.ravel(),
        held_lever=lever.reshape(-1, 2),
        held_section=held[:, [0, 2]].ravel(),
        site_wire=wire,
        site_seed=start + share * seed,
        site_low=share * low,
        site_high=share * high,
        panel_begin=np.array(starts),
        panel_step=np.array(shares),
    )


def line_along(curve: Curve, arcs: np.ndarray, step: float) -> CentreLine:
    """The centre line at nodes at arc lengths `arcs` [m], and on the segments of `step` [m] behind them."""
    places = curve((arcs[:, None] + FIT_PLACES * step).ravel()).reshape(len(arcs), len(FIT_PLACES), 3)
    return CentreLine(curve.slope(arcs), places - curve(arcs)[:, None])


def _line_of_panel(cloth: Cloth, table: Table, panel: Panel) -> CentreLine:
    """The centre line of the wires of a periodic panel."""
    thread = np.repeat(panel.wire_thread, panel.wire_count)
    line = CentreLine(np.zeros((panel.node_count, 3)), np.zeros((panel.node_count, len(FIT_PLACES), 3)))
    for t, start in enumerate(table.start):
        nodes = np.flatnonzero(thread == t)
        found = line_along(
            ThreadCurve(cloth.threads[t], cloth.size[1]), (panel.node_entry[nodes] - start) * table.spacing[t], table.spacing[t]
        )
        line.slope[nodes], line.between[nodes] = found.slope, found.between
    return line


def _clamped_wire(cloth: Cloth, table: Table, panel: Panel, wire: int) -> tuple[np.ndarray, CentreLine, float, float]:
    """Points (n, 3) [m] of a clamped wire, its centre line, the place of the panel's first node, and the ratio of segment counts.

    The place is in segments from the first node; the ratio is segments here per segment of the panel.
    """
    thread = int(panel.wire_thread[wire])
    curve, spacing = ThreadCurve(cloth.threads[thread], cloth.size[1]), float(table.spacing[thread])
    block = int(np.searchsorted(panel.block_first, panel.wire_first[wire]))
    arc = (int(panel.block_table[block]) - int(table.start[thread])) * spacing
    origin = np.append(panel.block_origin[block], 0.0)
    clamp = panel.clamp_position[2 * wire]

    def miss(s: float) -> float:
        return float(np.linalg.norm(curve(np.array([s]))[0, :2] + origin[:2] - clamp))

    tries = arc + np.linspace(0.0, SEARCHED, 61) * spacing
    near = tries[int(np.argmin([miss(s) for s in tries]))]
    room = 0.06 * spacing
    found = minimize_scalar(miss, bounds=(near - room, near + room), method="bounded", options={"xatol": 1e-9 * spacing})
    begin, length = float(found.x), float(panel.wire_length[wire])
    segments = max(MIN_SEGMENTS, round(length / spacing))
    step = length / segments
    arcs = begin + (np.arange(segments + 2) - 0.5) * step
    return curve(arcs) + origin, line_along(curve, arcs, step), (arc - begin) / step + 0.5, spacing / step
