"""Nodes of the spatial wires of a panel (mesh/panel.py), closed or clamped.

The knit describes threads by their arc length in plan view. Where a thread climbs steeply between the layers of a mesh it turns
sharply, within a thickness or less, and is long but short in plan view. Half of the nodes follow the length and half the turns:
with a thread of length S that turns by T, and k the mean curvature over three thicknesses, the spacing is in proportion to

    1/(1/S + k/T)

and changes by at most GRADING along the thread, so that neighbouring segments have similar lengths.

A closed wire has the panel's number of nodes, at these places. On a clamped wire each clamp sits in the middle of the first or
last segment, half as long as its neighbours, and holds its two nodes and its section.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..knit.cloth import Cloth
from ..mesh.hook_mesh import LEFT, LEFT_TOP, RIGHT, RIGHT_TOP, Arc
from ..mesh.panel import Panel
from ..mesh.rest_table import Table, ThreadCurve
from ..scene import Hook
from .rest_curve import FIT_PLACES, CentreLine

MIN_SEGMENTS = 3  # between two clamps
HELD = 0.25  # node spacings that a clamp holds on either side: the error of a clamp goes with their square
SAME = 1e-10  # of a thread's period: wires that are cut at places nearer than this have one form
GRADING = 0.5  # largest change of the spacing over the distance along the thread
MEAN_OVER = 3.0  # thicknesses, of the curvature
SAMPLES = 12  # a thickness of plan length
LEAST_SHARE = 0.5  # smallest spacing over the mean one, and
BETWEEN = 0.5  # segments from the planar nodes of a hook to the nodes here, with the clamp midway between two
LEAST_SPACING = 1.5  # in thicknesses: the smaller one of both


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

    tile: np.ndarray  # (3,) [m] spatial periods; 0: none
    held_node: np.ndarray  # [held] nodes, counted over all wires
    held_lever: np.ndarray  # (held, 2) [m] at rest, from the clamp that holds the node
    site_wire: np.ndarray
    site_seed: np.ndarray  # place nearest to the body at rest
    site_low: np.ndarray  # reach before it, negative
    site_high: np.ndarray  # and behind
    forms: WireForms | None = None  # None: of wires from a file, and once the rods are made
    # [wire] place of the node with the number of the panel's first one, counted along the thread; None: the nodes are the panel's
    panel_begin: np.ndarray | None = None
    panel_step: np.ndarray | None = None  # [wire] nodes for each node of the panel
    sliding_clamp: np.ndarray | None = None  # clamps, of two held nodes each, that slide along the warp; None: none

    @property
    def held_section(self) -> np.ndarray:
        """[clamp] first nodes of the segments that clamps hold, with their sections."""
        return self.held_node[::2]


class SpacedThread:
    """A thread by its spatial arc length s [m], with its nodes. Both continue beyond a period."""

    def __init__(self, curve: ThreadCurve, nodes: int, thickness: float, *, evenly: bool = False) -> None:
        """nodes: of a period; evenly: at equal arc lengths, as the true masses of a ramp need."""
        self._curve, self.nodes, self.evenly = curve, nodes, evenly
        self._plan = np.linspace(0.0, curve.length, int(np.ceil(SAMPLES * curve.length / thickness)) + 1)
        step = np.diff(curve(self._plan), axis=0)
        size = np.linalg.norm(step, axis=1)
        self._arc = np.concatenate([[0.0], np.cumsum(size)])
        self.length = float(self._arc[-1])  # [m] of a period
        if evenly:
            self._count = self._arc * (nodes / self.length)
        else:
            self._count = self._counted(step / size[:, None], size, thickness)

    def _counted(self, tangent: np.ndarray, size: np.ndarray, thickness: float) -> np.ndarray:
        """Number of nodes up to each sample, from directions (m, 3) and lengths [m] of the steps."""
        before = np.roll(tangent, 1, axis=0)
        angle = np.arctan2(np.linalg.norm(np.cross(before, tangent), axis=1), np.sum(before * tangent, axis=1))
        turn = np.concatenate([[0.0], np.cumsum(angle)])
        arc, middle = self._around(self._arc, self.length), 0.5 * (self._arc[1:] + self._arc[:-1])
        turns = self._around(turn, float(turn[-1]))
        width = MEAN_OVER * thickness
        bent = np.interp(middle + 0.5 * width, arc, turns) - np.interp(middle - 0.5 * width, arc, turns)
        wanted = 2.0 / (1.0 / self.length + bent / (width * turn[-1])) / self.nodes
        mean = self.length / self.nodes
        least = min(LEAST_SHARE * mean, LEAST_SPACING * thickness)
        low, high = 0.1, 10.0  # factor on the spacing
        for _ in range(40):
            factor = np.sqrt(low * high)
            count = np.cumsum(size / np.maximum(self._graded(factor * wanted), least))
            low, high = (factor, high) if count[-1] > self.nodes else (low, factor)
        return np.concatenate([[0.0], count * (self.nodes / count[-1])])

    def _graded(self, spacing: np.ndarray) -> np.ndarray:
        """Spacing [m] at the samples, reduced to the largest allowed change."""
        rise = GRADING * np.concatenate([self._arc[:-1] + k * self.length for k in range(3)])
        around = np.tile(spacing, 3)
        ahead = np.minimum.accumulate(around - rise) + rise
        both = np.minimum.accumulate((ahead + rise)[::-1])[::-1] - rise
        return both[len(spacing) : 2 * len(spacing)]

    @staticmethod
    def _around(values: np.ndarray, period: float) -> np.ndarray:
        """Values along three periods, the first a period back."""
        return np.concatenate([values[:-1] - period, values[:-1], values + period])

    def _along(self, x: np.ndarray, given: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Linear interpolation from one measure along the thread to another."""
        rounds = np.floor(x / given[-1])
        return rounds * wanted[-1] + np.interp(x - rounds * given[-1], given, wanted)

    def at_plan(self, plan: np.ndarray) -> np.ndarray:
        """Arc lengths [m] at plan arc lengths [m]."""
        return self._along(plan, self._plan, self._arc)

    def at_node(self, number: np.ndarray) -> np.ndarray:
        """Arc lengths [m] of nodes, which need not be whole."""
        return self._along(number, self._count, self._arc)

    def number(self, arc: np.ndarray) -> np.ndarray:
        """Nodes, not whole, at arc lengths [m]."""
        return self._along(arc, self._arc, self._count)

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Points (m, 3) [m]."""
        return self._curve(self._along(s, self._arc, self._plan))

    def slope(self, s: np.ndarray) -> np.ndarray:
        """Unit vectors (m, 3) along it."""
        slope = self._curve.slope(self._along(s, self._arc, self._plan))
        return slope / np.linalg.norm(slope, axis=1, keepdims=True)


def place_wires(cloth: Cloth, table: Table, panel: Panel, thickness: float, *, evenly: bool = False) -> SpatialWires:
    """Place the spatial wires of a panel. thickness [m] of the wire; evenly: with nodes at equal distances."""
    threads = [
        SpacedThread(ThreadCurve(thread, cloth.size[1]), int(nodes), thickness, evenly=evenly)
        for thread, nodes in zip(cloth.threads, table.nodes, strict=True)
    ]
    closed = panel.boundary == "periodic"
    block = np.searchsorted(panel.block_first, panel.wire_first)  # [wire] its first one
    entry = panel.block_table[block] - table.start[panel.wire_thread]  # node of its thread with which a wire of the panel begins
    # [form] a wire of each form, and [wire] the form of each wire
    key = [panel.wire_thread]
    if not closed:
        same = SAME * np.array([t.length for t in cloth.threads])[panel.wire_thread]
        key += [np.rint(panel.wire_begin / same), np.rint(panel.wire_length / same)]
    _, example, form = np.unique(np.stack(key), axis=1, return_index=True, return_inverse=True)
    form = form.reshape(-1)
    points, lines, begins, steps = [], [], [], []  # of each form; its node i has the number begin + i step of the thread
    for w in example:
        thread = threads[panel.wire_thread[w]]
        if closed:
            arcs = thread.at_node(int(entry[w]) + np.arange(int(panel.wire_count[w]) + 1))
            arcs, segment, begin, step = arcs[:-1], np.diff(arcs), float(entry[w]), 1.0
        else:
            arcs, segment, begin, step = _clamped_nodes(thread, float(panel.wire_begin[w]), float(panel.wire_length[w]))
        begins.append(begin)
        steps.append(step)
        points.append(thread(arcs))
        lines.append(line_along(thread, thread.slope(arcs), arcs, segment))
    origin = np.column_stack([panel.block_origin[block], np.zeros(len(block))])
    begin_of, step_of = np.array(begins)[form], np.array(steps)[form]
    wire = panel.pair_wire.reshape(-1, 2)
    number = panel.pair_seed.reshape(-1, 2) - panel.wire_first[wire] + entry[wire]

    def place(number: np.ndarray) -> np.ndarray:
        """(site, 2) places of nodes of the panel, counted along the threads."""
        found = np.zeros(number.shape)
        for t, thread in enumerate(threads):
            here = panel.wire_thread[wire] == t
            found[here] = thread.number(thread.at_plan(number[here] * table.spacing[t]))
        return (found - begin_of[wire]) / step_of[wire]

    seed = place(number)
    wires = SpatialWires(
        tile=np.array([*panel.size, 0.0]) if closed else np.zeros(3),
        held_node=np.zeros(0, dtype=np.int64),
        held_lever=np.zeros((0, 2)),
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
        panel_begin=(entry - begin_of) / step_of,
        panel_step=1.0 / step_of,
    )


def line_along(
    curve: Callable[[np.ndarray], np.ndarray], slope: np.ndarray, arcs: np.ndarray, step: np.ndarray | float
) -> CentreLine:
    """Centre line at nodes at arc lengths `arcs` [m], and on segments of lengths `step` [m].

    curve: points (m, 3) [m] at arc lengths [m]; slope (node, 3) of any length, along it at the nodes.
    """
    step = np.broadcast_to(step, arcs.shape)
    places = curve((arcs[:, None] + FIT_PLACES * step[:, None]).ravel()).reshape(len(arcs), len(FIT_PLACES), 3)
    return CentreLine(slope, places - curve(arcs)[:, None], step)


def _clamped_nodes(thread: SpacedThread, begin: float, length: float) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Nodes of a wire with clamps at plan arc lengths `begin` and begin + `length` [m].

    Arc lengths [m] of nodes and of segments, then first and step: node i is at first + i step, counted in nodes of the thread.
    """
    ends = thread.at_plan(np.array([begin, begin + length]))
    low, high = thread.number(ends)
    segments = max(MIN_SEGMENTS, round(float(high - low)))
    held = 0.5 if thread.evenly else HELD
    step = float(high - low) / (segments - 1 + 2.0 * held)
    first = float(low) - (1.0 - held) * step
    arcs = thread.at_node(first + np.arange(segments + 2) * step)
    arcs[[0, -1]] = 2.0 * ends - arcs[[1, -2]]
    return arcs, np.append(np.diff(arcs), arcs[-1] - arcs[-2]), first, step


def tilt(hook: Hook) -> float:
    """[rad] tilt of each arc out of the plane."""
    assert hook.crossing_distance is not None
    half = hook.radius * math.sin(math.acos(1.0 - 0.5 * hook.overlap / hook.radius))
    return math.asin(0.5 * hook.crossing_distance / half)


class TiltedArc:
    """Centre line of a wire by its arc length s [m] from the lower clamp."""

    def __init__(self, hook: Hook, wire: int, angle: float) -> None:
        """angle [rad]: tilt of the upper end out of the plane."""
        self._arc, self._half, self._middle = Arc(hook, wire), 0.5 * hook.length, 0.5 * hook.height
        self._bulge, self._radius = self._arc.bulge, hook.radius
        self._up = np.array([math.cos(angle), math.sin(angle)])

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Points (m, 3) [m]."""
        place = self._arc(s)
        tilted = self._up * (place[:, 1:2] - self._middle)
        return np.column_stack([place[:, 0], self._middle + tilted[:, 0], tilted[:, 1]])

    def slope(self, s: np.ndarray) -> np.ndarray:
        """Unit vectors (m, 3) along it."""
        t = (np.asarray(s) - self._half) / self._radius
        return np.column_stack([-self._bulge * np.sin(t), np.cos(t)[:, None] * self._up])


def hook_wires(hook: Hook, panel: Panel, segments: int) -> SpatialWires:
    """Both wires with `segments` equal segments; each clamp is in the middle of one more segment.

    In the planar model both arcs lie in one plane and cross twice. Here each arc is tilted about the horizontal axis through the
    middle of the hook, the two in opposite directions: at the lower crossing the left wire lies `hook.crossing_distance` above
    the right one, at the upper crossing as much below it. With the same order at both crossings the wires would not be hooked.
    """
    step = hook.length / segments
    along = (np.arange(segments + 2) - 0.5) * step
    arcs = (TiltedArc(hook, LEFT, -tilt(hook)), TiltedArc(hook, RIGHT, tilt(hook)))
    lines = [line_along(arc, arc.slope(along), along, step) for arc in arcs]
    count = segments + 2
    held = np.array([[0, 1, count - 2, count - 1], [count, count + 1, 2 * count - 2, 2 * count - 1]])
    points = tuple(arc(along) for arc in arcs)
    lever = np.concatenate(points)[held.ravel(), :2] - np.repeat(panel.clamp_position, 2, axis=0)
    return SpatialWires(
        tile=np.zeros(3),
        forms=WireForms(points, CentreLine.joined(lines), np.arange(2), np.zeros((2, 3))),
        held_node=held.ravel(),
        held_lever=lever,
        site_wire=np.array([[LEFT, RIGHT]]),
        site_seed=(panel.pair_seed - panel.wire_first[panel.pair_wire] - BETWEEN)[None],
        site_low=panel.pair_low[None].astype(float),
        site_high=panel.pair_high[None].astype(float),
        sliding_clamp=np.array([LEFT_TOP, RIGHT_TOP]),
    )
