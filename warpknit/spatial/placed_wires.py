"""Nodes of the wires of a panel (mesh/panel.py) in space, closed or clamped at both ends.

A closed wire has as many nodes as the panel, at other places (node_places.py). On a clamped wire each clamp sits in the middle of
the first or last segment, half as long as its neighbours, and holds its two nodes and its section.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.optimize import minimize_scalar

from ..knit.cloth import Cloth
from ..mesh.panel import Panel
from ..mesh.rest_table import Table
from ..mesh.thread_curve import ThreadCurve
from .node_places import SpacedThread
from .rest_curve import FIT_PLACES, CentreLine

MIN_SEGMENTS = 3  # between two clamps
HELD = 0.25  # node spacings that a clamp holds on either side: the error of a clamp goes with their square
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
    # [wire] place of the node with the number of the panel's first one, counted along the thread; None: the nodes are the panel's
    panel_begin: np.ndarray | None = None
    panel_step: np.ndarray | None = None  # [wire] nodes for each node of the panel
    sliding_clamp: np.ndarray | None = None  # clamps, of two held nodes each, that slide along the warp; None: none


def place_wires(cloth: Cloth, table: Table, panel: Panel, thickness: float, *, evenly: bool = False) -> SpatialWires:
    """Place the wires of a panel in space; thickness [m] of the wire; evenly: with nodes at equal distances."""
    wire = panel.pair_wire.reshape(-1, 2)
    seed = panel.pair_seed.reshape(-1, 2) - panel.wire_first[wire]
    low, high = panel.pair_low.reshape(-1, 2), panel.pair_high.reshape(-1, 2)
    threads = [
        SpacedThread(ThreadCurve(thread, cloth.size[1]), int(nodes), thickness, evenly=evenly)
        for thread, nodes in zip(cloth.threads, table.nodes, strict=True)
    ]
    if panel.boundary == "periodic":
        return _closed_wires(threads, table, panel, wire, seed, low, high)
    points: list[np.ndarray] = []
    lines: list[CentreLine] = []
    places, starts, shares = [], [], []
    for w in range(len(panel.wire_first)):
        along, line, place, start, share = _clamped_wire(threads[int(panel.wire_thread[w])], table, panel, w)
        points.append(along)
        lines.append(line)
        places.append(place)
        starts.append(start)
        shares.append(share)
    seed, low, high = _site_places(seed, low, high, lambda number, side: _at(places, wire[:, side], number))
    count = np.array([len(p) for p in points])
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    held = np.stack([first, first + 1, first + count - 2, first + count - 1], axis=1)
    clamp = panel.clamp_position.reshape(-1, 2, 2)
    lever = np.concatenate(points)[held][..., :2] - np.repeat(clamp, 2, axis=1)
    return SpatialWires(
        points=tuple(points),
        tile=np.zeros(3),
        line=CentreLine.joined(lines),
        held_node=held.ravel(),
        held_lever=lever.reshape(-1, 2),
        held_section=held[:, [0, 2]].ravel(),
        site_wire=wire,
        site_seed=seed,
        site_low=low,
        site_high=high,
        panel_begin=np.array(starts),
        panel_step=np.array(shares),
    )


def line_along(curve: Curve, arcs: np.ndarray, step: np.ndarray | float) -> CentreLine:
    """The centre line at nodes at arc lengths `arcs` [m], and on the segments of lengths `step` [m] behind them."""
    step = np.broadcast_to(step, arcs.shape)
    places = curve((arcs[:, None] + FIT_PLACES * step[:, None]).ravel()).reshape(len(arcs), len(FIT_PLACES), 3)
    return CentreLine(curve.slope(arcs), places - curve(arcs)[:, None], step)


def _site_places(
    seed: np.ndarray, low: np.ndarray, high: np.ndarray, place: Callable[[np.ndarray, int], np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Seeds and reaches of sites in nodes of the wires, from those in nodes of the panel; `place` takes nodes and the side."""
    at = [np.stack([place(x[:, side], side) for side in (0, 1)], axis=1) for x in (seed, seed + low, seed + high)]
    return at[0], at[1] - at[0], at[2] - at[0]


def _at(places: list[Callable[[np.ndarray], np.ndarray]], wire: np.ndarray, number: np.ndarray) -> np.ndarray:
    """[site] nodes of the wires for nodes of the panel."""
    return np.array([float(places[w](np.array([x]))[0]) for w, x in zip(wire, number, strict=True)])


def _closed_wires(
    threads: list[SpacedThread], table: Table, panel: Panel, wire: np.ndarray, seed: np.ndarray, low: np.ndarray, high: np.ndarray
) -> SpatialWires:
    """The wires of a periodic panel."""
    thread = np.repeat(panel.wire_thread, panel.wire_count)
    origin = np.column_stack([np.repeat(panel.block_origin, panel.block_count, axis=0), np.zeros(panel.node_count)])
    position = np.zeros((panel.node_count, 3))
    lines = []
    for t, start in enumerate(table.start):
        nodes = np.flatnonzero(thread == t)
        number = panel.node_entry[nodes] - start
        arc = threads[t].at_node(number)
        position[nodes] = threads[t](arc) + origin[nodes]
        lines.append(line_along(threads[t], arc, threads[t].at_node(number + 1) - arc))
    order = np.argsort(np.concatenate([np.flatnonzero(thread == t) for t in range(len(threads))]))
    line = CentreLine.joined(lines)
    first = panel.node_entry[panel.wire_first] - table.start[panel.wire_thread]  # node of its thread with which a wire begins

    def place(number: np.ndarray, side: int) -> np.ndarray:
        found = np.zeros(len(number))
        for t, one in enumerate(threads):
            of = wire[:, side]
            here = panel.wire_thread[of] == t
            plan = (number + first[of])[here] * table.spacing[t]
            found[here] = one.number(one.at_plan(plan)) - first[of][here]
        return found

    none = np.zeros(0, dtype=np.int64)
    return SpatialWires(
        tuple(np.split(position, panel.wire_first[1:])), np.array([*panel.size, 0.0]),
        CentreLine(line.slope[order], line.between[order], line.step[order]),
        none, np.zeros((0, 2)), none, wire, *_site_places(seed, low, high, place),
    )  # fmt: skip


def _clamped_wire(
    thread: SpacedThread, table: Table, panel: Panel, wire: int
) -> tuple[np.ndarray, CentreLine, Callable[[np.ndarray], np.ndarray], float, float]:
    """Points (n, 3) [m] of a clamped wire, its centre line, its nodes at places of the panel's nodes, and `panel_begin` and
    `panel_step` of SpatialWires."""
    number = int(panel.wire_thread[wire])
    spacing = float(table.spacing[number])
    block = int(np.searchsorted(panel.block_first, panel.wire_first[wire]))
    plan = (int(panel.block_table[block]) - int(table.start[number])) * spacing
    origin = np.append(panel.block_origin[block], 0.0)
    clamp = panel.clamp_position[2 * wire]

    def miss(s: float) -> float:
        return float(np.linalg.norm(thread(thread.at_plan(np.array([s])))[0, :2] + origin[:2] - clamp))

    tries = plan + np.linspace(0.0, SEARCHED, 61) * spacing
    near = tries[int(np.argmin([miss(s) for s in tries]))]
    room = 0.06 * spacing
    found = minimize_scalar(miss, bounds=(near - room, near + room), method="bounded", options={"xatol": 1e-9 * spacing})
    ends = thread.at_plan(np.array([found.x, found.x + float(panel.wire_length[wire])]))
    low, high = thread.number(ends)
    segments = max(MIN_SEGMENTS, round(float(high - low)))
    held = 0.5 if thread.evenly else HELD
    step = (high - low) / (segments - 1 + 2.0 * held)
    arcs = thread.at_node(low + (np.arange(segments + 2) - 1.0 + held) * step)
    arcs[[0, -1]] = 2.0 * ends - arcs[[1, -2]]
    line = line_along(thread, arcs, np.append(np.diff(arcs), arcs[-1] - arcs[-2]))
    begin = float((plan / spacing - low) / step) + 1.0 - held

    def at(q: np.ndarray) -> np.ndarray:
        return (thread.number(thread.at_plan(plan + q * spacing)) - low) / step + 1.0 - held

    return thread(arcs) + origin, line, at, begin, float(1.0 / step)
