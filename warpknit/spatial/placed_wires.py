"""Nodes of the wires of a panel (mesh/panel.py) in space, closed or clamped at both ends.

A closed wire has as many nodes as the panel, at other places (node_places.py). On a clamped wire each clamp sits in the middle of
the first or last segment, half as long as its neighbours, and holds its two nodes and its section.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..knit.cloth import Cloth
from ..mesh.panel import Panel
from ..mesh.rest_table import Table
from ..mesh.thread_curve import ThreadCurve
from .node_places import SpacedThread
from .rest_curve import FIT_PLACES, CentreLine

MIN_SEGMENTS = 3  # between two clamps
HELD = 0.25  # node spacings that a clamp holds on either side: the error of a clamp goes with their square
SAME = 1e-10  # of a thread's period: wires that are cut at places nearer than this have one form


class Curve(Protocol):
    """A centre line by its arc length [m]."""

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Points (m, 3) [m]."""

    def slope(self, s: np.ndarray) -> np.ndarray:
        """(m, 3) of any length, along the line."""


@dataclass(frozen=True)
class WireForms:
    """Wires at rest as copies of a few forms, equal but for a shift."""

    points: tuple[np.ndarray, ...]  # for each form (n, 3) [m]
    line: CentreLine  # of the forms, one after the other
    form: np.ndarray  # [wire]
    origin: np.ndarray  # (wire, 3) [m] shift of a wire from its form


@dataclass(frozen=True)
class SpatialWires:
    """The wires at rest, their clamps, and the sites of the panel's bodies.

    Places along a wire are in nodes from its first one; arrays of sites are (site, 2), for their two wires.
    """

    tile: np.ndarray  # (3,) [m] periods in space; 0: none
    held_node: np.ndarray  # [held] nodes, counted over all wires
    held_lever: np.ndarray  # (held, 2) [m] at rest, from the clamp that holds the node
    held_section: np.ndarray  # [held segment] first nodes of segments whose sections are held
    site_wire: np.ndarray
    site_seed: np.ndarray  # place nearest to the body at rest
    site_low: np.ndarray  # reach before it, negative
    site_high: np.ndarray  # and behind
    forms: WireForms | None = None  # None: of wires from a file, and once the rods are made
    # [wire] place of the node with the number of the panel's first one, counted along the thread; None: the nodes are the panel's
    panel_begin: np.ndarray | None = None
    panel_step: np.ndarray | None = None  # [wire] nodes for each node of the panel
    sliding_clamp: np.ndarray | None = None  # clamps, of two held nodes each, that slide along the warp; None: none


@dataclass(frozen=True)
class _FormNodes:
    """Nodes of a form along its thread: node i has the number begin + i step of the thread, which need not be whole."""

    arcs: np.ndarray  # [node] [m]
    segment: np.ndarray  # [node] [m] of arc to the next node
    begin: float
    step: float


def place_wires(cloth: Cloth, table: Table, panel: Panel, thickness: float, *, evenly: bool = False) -> SpatialWires:
    """Place the wires of a panel in space; thickness [m] of the wire; evenly: with nodes at equal distances."""
    threads = [
        SpacedThread(ThreadCurve(thread, cloth.size[1]), int(nodes), thickness, evenly=evenly)
        for thread, nodes in zip(cloth.threads, table.nodes, strict=True)
    ]
    closed = panel.boundary == "periodic"
    block = np.searchsorted(panel.block_first, panel.wire_first)  # [wire] its first one
    entry = panel.block_table[block] - table.start[panel.wire_thread]  # node of its thread with which a wire of the panel begins
    example, form = _forms(cloth, panel, closed=closed)
    points, lines, nodes = [], [], []
    for w in example:
        thread = threads[panel.wire_thread[w]]
        if closed:
            along = _closed_nodes(thread, int(entry[w]), int(panel.wire_count[w]))
        else:
            along = _clamped_nodes(thread, float(panel.wire_begin[w]), float(panel.wire_length[w]))
        nodes.append(along)
        points.append(thread(along.arcs))
        lines.append(line_along(thread, along.arcs, along.segment))
    origin = np.column_stack([panel.block_origin[block], np.zeros(len(block))])
    begin, step = np.array([one.begin for one in nodes])[form], np.array([one.step for one in nodes])[form]
    wire = panel.pair_wire.reshape(-1, 2)
    number = panel.pair_seed.reshape(-1, 2) - panel.wire_first[wire] + entry[wire]

    def place(number: np.ndarray) -> np.ndarray:
        """(site, 2) places of nodes of the panel, counted along the threads."""
        found = np.zeros(number.shape)
        for t, thread in enumerate(threads):
            here = panel.wire_thread[wire] == t
            found[here] = thread.number(thread.at_plan(number[here] * table.spacing[t]))
        return (found - begin[wire]) / step[wire]

    seed = place(number)
    wires = SpatialWires(
        tile=np.array([*panel.size, 0.0]) if closed else np.zeros(3),
        held_node=np.zeros(0, dtype=np.int64),
        held_lever=np.zeros((0, 2)),
        held_section=np.zeros(0, dtype=np.int64),
        site_wire=wire,
        site_seed=seed,
        site_low=place(number + panel.pair_low.reshape(-1, 2)) - seed,
        site_high=place(number + panel.pair_high.reshape(-1, 2)) - seed,
        forms=WireForms(tuple(points), CentreLine.joined(lines), form, origin),
    )
    if closed:
        return wires
    count = np.array([len(p) for p in points])[form]
    first = np.cumsum(count) - count
    held = np.stack([first, first + 1, first + count - 2, first + count - 1], axis=1)
    ends = np.stack([p[[0, 1, -2, -1], :2] for p in points])[form] + origin[:, None, :2]
    lever = ends - np.repeat(panel.clamp_position.reshape(-1, 2, 2), 2, axis=1)
    return replace(
        wires,
        held_node=held.ravel(),
        held_lever=lever.reshape(-1, 2),
        held_section=held[:, [0, 2]].ravel(),
        panel_begin=(entry - begin) / step,
        panel_step=1.0 / step,
    )


def _forms(cloth: Cloth, panel: Panel, *, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """[form] a wire of each form, and [wire] the form of each wire."""
    thread = panel.wire_thread
    key = [thread]
    if not closed:
        same = SAME * np.array([t.length for t in cloth.threads])[thread]
        key += [np.rint(panel.wire_begin / same), np.rint(panel.wire_length / same)]
    _, example, form = np.unique(np.stack(key), axis=1, return_index=True, return_inverse=True)
    return example, form.reshape(-1)


def line_along(curve: Curve, arcs: np.ndarray, step: np.ndarray | float) -> CentreLine:
    """The centre line at nodes at arc lengths `arcs` [m], and on the segments of lengths `step` [m] behind them."""
    step = np.broadcast_to(step, arcs.shape)
    places = curve((arcs[:, None] + FIT_PLACES * step[:, None]).ravel()).reshape(len(arcs), len(FIT_PLACES), 3)
    return CentreLine(curve.slope(arcs), places - curve(arcs)[:, None], step)


def _closed_nodes(thread: SpacedThread, first: int, count: int) -> _FormNodes:
    """Nodes of a closed wire, from the node `first` of its thread on."""
    arcs = thread.at_node(first + np.arange(count + 1))
    return _FormNodes(arcs[:-1], np.diff(arcs), first, 1.0)


def _clamped_nodes(thread: SpacedThread, begin: float, length: float) -> _FormNodes:
    """Nodes of a wire with its clamps at plan arc lengths `begin` and begin + `length` [m] of its thread."""
    ends = thread.at_plan(np.array([begin, begin + length]))
    low, high = thread.number(ends)
    segments = max(MIN_SEGMENTS, round(float(high - low)))
    held = 0.5 if thread.evenly else HELD
    step = float(high - low) / (segments - 1 + 2.0 * held)
    first = float(low) - (1.0 - held) * step
    arcs = thread.at_node(first + np.arange(segments + 2) * step)
    arcs[[0, -1]] = 2.0 * ends - arcs[[1, -2]]
    return _FormNodes(arcs, np.append(np.diff(arcs), arcs[-1] - arcs[-2]), first, step)
