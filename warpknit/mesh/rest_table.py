"""Rest data of one repeat at the nodes: edges, lengths, angles, masses, and the true curve between the nodes.

Nodes lie evenly along the plan arc length of each thread. Entry k of a thread repeats with its number of nodes a period,
so the arrays hold a little more than one period and a run of nodes reads consecutive entries whatever its phase.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.interpolate import CubicSpline, PPoly

from ..base.hermite import hermite
from ..base.text import short_repr
from ..kernels.bend import BOW
from ..knit.centreline import Thread
from ..knit.cloth import Cloth
from ..knit.crossings import plan_cross

FIT_POINTS = 12  # Gauss points a segment for the fit of the rest curve
SLIDE_WEIGHT = 0.1  # of a miss along the line in that fit
SLOPE_SHARE = 1e-4  # of the node spacing, over which the slope of the centre line is taken


@dataclass(frozen=True)
class Table:
    """Rest data of one repeat, float64.

    Arrays run over the entries of all threads, thread after thread; `start[t]` is the entry of node 0 of thread t, which has
    `lead` entries before it and at least `nodes[t] + lead` behind.
    """

    __repr__ = short_repr

    start: np.ndarray  # [thread] int
    nodes: np.ndarray  # [thread] int: nodes a period
    spacing: np.ndarray  # [thread] [m] arc length between nodes
    lead: int
    x: np.ndarray  # [entry] [m] unrolled plan position in the frame of the repeat
    y: np.ndarray  # [entry] [m]
    z: np.ndarray  # [entry] [m] height of the knit's centre line
    rest_x: np.ndarray  # [entry] [m] edge to the next node
    rest_y: np.ndarray  # [entry] [m]
    rest_length: np.ndarray  # [entry] [m] its natural length
    rest_bow: np.ndarray  # [entry] [-] share by which the arc is longer, as the kernel sees it (kernels/bend.py)
    rest_turn: np.ndarray  # [entry] [rad] turning angle at the node as knitted
    rest_angle: np.ndarray  # [entry] [rad] natural turning angle: what is left of it when the wire is let free
    hinge_length: np.ndarray  # [entry] [m] wire that the hinge at the node stands for
    node_length: np.ndarray  # [entry] [m] wire that the node stands for
    curve: np.ndarray  # [entry, CURVE_COEFFICIENTS] [-] see kernels/contact.py
    curve_error: float  # [m] largest distance of the fitted rest curve from the true one


class ThreadCurve:
    """Centre line of an endless thread, a spline: (x, y, z) [m] at plan arc lengths s [m], unrolled by `height` a period."""

    def __init__(self, thread: Thread, height: float) -> None:
        self.length = thread.length
        self.height = height
        arc = np.linspace(0.0, self.length, len(thread.points) + 1)
        self._climb = np.array([0.0, height, 0.0]) / self.length
        level = np.vstack([thread.points, thread.points[:1]])
        level[-1] += self._climb * self.length
        level -= arc[:, None] * self._climb
        level[-1] = level[0]
        self._spline = CubicSpline(arc, level, bc_type="periodic")

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Points (m, 3) [m] at arc lengths (m,) [m]."""
        return self._spline(np.mod(s, self.length)) + s[:, None] * self._climb

    def slope(self, s: np.ndarray) -> np.ndarray:
        """Derivatives (m, 3) [-] of the points by arc length (m,) [m]."""
        return self._spline(np.mod(s, self.length), 1) + self._climb

    @cached_property
    def _plan(self) -> PPoly:
        """x and y [m] over the first period."""
        powers = self._spline.c[..., :2].copy()
        powers[-2, :, 1] += self._climb[1]
        powers[-1, :, 1] += self._climb[1] * self._spline.x[:-1]
        return PPoly(powers, self._spline.x)

    @cached_property
    def reach(self) -> np.ndarray:
        """(2, 2) lowest and highest weft, then warp position [m] of the first period."""
        room, at_knots = self.length / len(self._spline.x), self._plan(self._spline.x)
        return np.stack([at_knots.min(axis=0) - room, at_knots.max(axis=0) + room], axis=1)

    def across(self, normal: np.ndarray) -> Callable[[float], np.ndarray]:
        """Function of a level [m]: rising arc lengths [m] in the first period where normal . (x, y) has it; `normal` is (2,)."""
        arcs, powers = self._plan.x, normal[0] * self._plan.c[..., 0] + normal[1] * self._plan.c[..., 1]
        at_knots, step = PPoly(powers, arcs)(arcs), self.length / (len(arcs) - 1)
        low = np.minimum(at_knots[:-1], at_knots[1:]) - step  # no piece is steeper than the thread is long
        high = np.maximum(at_knots[:-1], at_knots[1:]) + step

        def arcs_at(level: float) -> np.ndarray:
            near = (low <= level) & (level <= high)
            edges = np.flatnonzero(np.diff(near.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
            pieces = (PPoly(powers[:, begin:end], arcs[begin : end + 1]) for begin, end in edges)
            roots = np.concatenate([np.zeros(0), *(piece.solve(level, extrapolate=False) for piece in pieces)])
            return np.unique(roots[np.isfinite(roots) & (roots >= 0.0) & (roots < arcs[-1])])

        return arcs_at


CentreLine = Callable[[np.ndarray], np.ndarray]  # points (m, 3) [m] at arc lengths (m,) [m]; it goes on beyond its ends


def rest_table(cloth: Cloth, *, nodes_per_loop: int, set_fraction: float, lead: int) -> Table:
    """Sample the threads of a repeat at `nodes_per_loop` nodes a stitch.

    `lead` entries are kept before and behind a period [-]; `set_fraction` scales the natural turning angles.
    """
    stitches = np.array([s.thread for s in cloth.stitches])
    lines = []
    for t, thread in enumerate(cloth.threads):
        n = nodes_per_loop * max(1, int(np.sum(stitches == t)))
        lines.append((ThreadCurve(thread, cloth.size[1]), n, thread.length / n))
    return table_of_lines(lines, set_fraction=set_fraction, lead=lead)


def table_of_lines(lines: Sequence[tuple[CentreLine, int, float]], *, set_fraction: float, lead: int) -> Table:
    """The table of lines; see `rest_table`. lines: centre line, nodes a period, and the arc length between nodes [m] of each."""
    columns: dict[str, list[np.ndarray]] = defaultdict(list)
    curves, starts, offset, error = [], [], 0, 0.0
    for centre_line, n, h in lines:
        k = np.arange(-lead - 1, n + lead + 2)
        position = centre_line(k * h)
        edge = np.diff(position[:, :2], axis=0)  # edge of entry k joins k and k + 1
        angle = np.arctan2(plan_cross(edge[:-1], edge[1:]), np.sum(edge[:-1] * edge[1:], axis=1))
        inner = slice(1, -2)  # entries -lead .. n + lead - 1
        for name, values in {
            "x": position[inner, 0],
            "y": position[inner, 1],
            "z": position[inner, 2],
            "rest_x": edge[1:-1, 0],
            "rest_y": edge[1:-1, 1],
            "rest_length": np.hypot(edge[:, 0], edge[:, 1])[1:-1],
            "rest_bow": BOW * (angle[:-1] ** 2 + angle[1:] ** 2),
            "rest_turn": angle[:-1],
            "rest_angle": angle[:-1] * set_fraction,
            "hinge_length": np.full(len(k) - 3, h),
            "node_length": np.full(len(k) - 3, h),
        }.items():
            columns[name].append(values)
        coefficients, miss = _fit_rest_curve(centre_line, n, h)
        error = max(error, miss)
        curves.append(coefficients[np.mod(k[inner], n)])
        starts.append(offset + lead)
        offset += len(k) - 3
    return Table(
        start=np.array(starts),
        nodes=np.array([nodes for _, nodes, _ in lines]),
        spacing=np.array([spacing for _, _, spacing in lines]),
        lead=lead,
        curve=np.concatenate(curves),
        curve_error=error,
        **{name: np.concatenate(parts) for name, parts in columns.items()},
    )


def _fit_rest_curve(centre_line: CentreLine, nodes: int, spacing: float) -> tuple[np.ndarray, float]:
    """Coefficients (nodes, CURVE_COEFFICIENTS) [-] of the rest curve of a period; largest deviation [m] across it.

    The slope at the nodes is the slope of the centre line. The deviation between them is fitted at Gauss points, across the line
    before along it: a shift along the line does not change the gap.
    """
    k = np.arange(nodes)
    u = 0.5 * (leggauss(FIT_POINTS)[0] + 1.0)
    corner = [centre_line((k + i) * spacing)[:, :2] for i in (-1, 0, 1, 2)]
    chord = corner[2] - corner[1]
    m0, m1 = 0.5 * (corner[2] - corner[0]), 0.5 * (corner[3] - corner[1])
    apart = SLOPE_SHARE * spacing
    slope = (centre_line(k * spacing + apart) - centre_line(k * spacing - apart))[:, :2] / (2.0 * SLOPE_SHARE)
    # a, b of slope - m0 = a m0 + b J m0, J a turn by 90 degrees
    change = slope - m0
    correction = np.stack([np.sum(change * m0, axis=1), plan_cross(m0, change)], axis=1) / np.sum(m0 * m0, axis=1)[:, None]
    a, b = np.roll(correction, -1, axis=0).T[..., None]
    next_slope = m1 + (a * m1 + b * np.stack([-m1[:, 1], m1[:, 0]], axis=1))
    h10, h01, h11 = hermite(u)
    smooth = h10[:, None] * slope[:, None] + h01[:, None] * chord[:, None] + h11[:, None] * next_slope[:, None]
    arcs = ((k[:, None] + u) * spacing).ravel()
    true = centre_line(arcs)[:, :2].reshape(nodes, len(u), 2) - corner[1][:, None]
    miss = true - smooth
    tangent = centre_line(arcs + apart)[:, :2] - centre_line(arcs - apart)[:, :2]
    tangent = (tangent / np.linalg.norm(tangent, axis=1)[:, None]).reshape(miss.shape)
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    directions = np.stack([SLIDE_WEIGHT * tangent, normal], axis=2)  # [segment, point, direction, xy]
    chord_normal = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
    sides = np.stack([chord, chord_normal], axis=1)  # [segment, side, xy]
    basis = (u * (1 - u))[:, None] ** 2 * u[:, None] ** np.arange(4)
    system = np.einsum("sudx,scx,up->sudcp", directions, sides, basis).reshape(nodes, 2 * len(u), -1)
    wanted = np.einsum("sudx,sux->sud", directions, miss).reshape(nodes, -1, 1)
    bump = np.linalg.pinv(system) @ wanted
    error = np.abs(wanted - system @ bump).reshape(miss.shape)[..., 1]
    return np.concatenate([correction, bump[..., 0]], axis=1), float(np.max(error))
