"""Smooth curve of the wires between nodes, on the host. Device: kernels/contact.py, kernels/wire_curve.py.

On the segment behind a node and relative to it, for s in 0 .. 1,

    p(s) = h10 M1 + h01 e + h11 M2 + s^2 (1 - s)^2 (B0 + s B1 + ...)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps

import numpy as np

from ..base.hermite import hermite
from ..results.frame import WireLayout

AT_ONCE = 65536  # points


def _in_parts(points: Callable[[WireCurve, np.ndarray, np.ndarray], np.ndarray]) -> Callable[..., np.ndarray]:
    """(m, 3) points, some at a time: a large mesh has no memory for all at once."""

    @wraps(points)
    def found(curve: WireCurve, node: np.ndarray, s: np.ndarray) -> np.ndarray:
        every = np.empty((len(node), 3))
        for begin in range(0, len(node), AT_ONCE):
            part = slice(begin, begin + AT_ONCE)
            every[part] = points(curve, node[part], s[part])
        return every

    return found


@dataclass(frozen=True)
class WireCurve:
    """Arrays [node], of the segment behind it; zero behind the last node of an open wire."""

    edge: np.ndarray  # (node, 3) [m] to the next node
    begin: np.ndarray  # (node, 3) [m] slope dp/ds at its first node
    end: np.ndarray  # (node, 3) [m] and at its second
    bump: np.ndarray  # (node, power, 3) [m]

    @_in_parts
    def offset(self, node: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Offset (m, 3) [m] from the node, at s (m,) on the segments behind nodes (m,)."""
        s = s[:, None]
        h10, h01, h11 = hermite(s)
        smooth = h10 * self.begin[node] + h01 * self.edge[node] + h11 * self.end[node]
        powers = s ** np.arange(self.bump.shape[1])
        return smooth + (s * (1 - s)) ** 2 * np.einsum("mp,mpa->ma", powers, self.bump[node])

    @_in_parts
    def derivative(self, node: np.ndarray, s: np.ndarray) -> np.ndarray:
        """(m, 3) [m] dp/ds at s (m,) on the segments behind nodes (m,)."""
        s = s[:, None]
        smooth = (1 - s) * (1 - 3 * s) * self.begin[node] + 6 * s * (1 - s) * self.edge[node] + s * (3 * s - 2) * self.end[node]
        power = np.arange(self.bump.shape[1])
        shape = (s * (1 - s)) * (2 * (1 - 2 * s) * s**power + (1 - s) * power * s**power)
        return smooth + np.einsum("mp,mpa->ma", shape, self.bump[node])

    def between(self, parts: int) -> np.ndarray:
        """(node, parts - 1, 3) [m] the same at equal steps of s (`Frame.between`)."""
        nodes = np.arange(len(self.edge))
        places = [self.offset(nodes, np.full(len(nodes), k / parts)) for k in range(1, parts)]
        return np.stack(places, axis=1).astype(np.float32) if places else np.zeros((0, 0, 3), dtype=np.float32)


@dataclass(frozen=True)
class Edges:
    """Edges before and after each node, (node, 3) [m]; ends are continued straight."""

    before: np.ndarray
    behind: np.ndarray
    following: np.ndarray  # [node] the next node; at the end of an open wire the node itself
    has_segment: np.ndarray  # [node]


def edges_of(layout: WireLayout, position: np.ndarray, deformation: np.ndarray) -> Edges:
    """Edges of wires at `position` (node, 3) [m], with the deformation gradient `deformation` (2, 2)."""
    first, last, closed = layout.wire_start[:-1], layout.wire_start[1:] - 1, layout.wire_closed
    following, previous = np.arange(len(position)) + 1, np.arange(len(position)) - 1
    following[last], previous[first] = np.where(closed, first, last), np.where(closed, last, first)
    behind = position[following] - position
    behind[last, :2] += layout.wire_closing @ deformation.T * closed[:, None]
    ends = last[~closed]
    behind[ends] = behind[np.maximum(ends - 1, first[~closed])]
    before = behind[previous]
    begins = first[~closed]
    before[begins] = behind[begins]
    has_segment = np.ones(len(position), dtype=bool)
    has_segment[ends] = False
    return Edges(before, behind, following, has_segment)


def curve_of(edges: Edges, rise: np.ndarray, bump: np.ndarray) -> WireCurve:
    """The curve with slopes (e_before + e)/2 + `rise` (node, 3) [m] at the nodes."""
    slope = 0.5 * (edges.before + edges.behind) + rise
    has = edges.has_segment[:, None]
    zero = np.zeros(3)
    return WireCurve(
        np.where(has, edges.behind, zero),
        np.where(has, slope, zero),
        np.where(has, slope[edges.following], zero),
        np.where(has[:, None], bump, zero),
    )


def planar_curve(layout: WireLayout, position: np.ndarray, deformation: np.ndarray, shape: np.ndarray) -> WireCurve:
    """Curve of the planar model; `shape` (node, CURVE_COEFFICIENTS) as in kernels/contact.py. Heights are Catmull-Rom."""
    edges = edges_of(layout, position, deformation)
    mean = 0.5 * (edges.before + edges.behind)
    rise = shape[:, :1] * _flat(mean) + shape[:, 1:2] * _turned(mean)
    along, across = shape[:, 2:6, None], shape[:, 6:10, None]
    return curve_of(edges, rise, along * _flat(edges.behind)[:, None] + across * _turned(edges.behind)[:, None])


def _flat(vector: np.ndarray) -> np.ndarray:
    """(x, y, 0)."""
    return vector * (1.0, 1.0, 0.0)


def _turned(vector: np.ndarray) -> np.ndarray:
    """(-y, x, 0)."""
    return np.stack([-vector[:, 1], vector[:, 0], np.zeros(len(vector))], axis=1)
