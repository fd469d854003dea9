"""Smooth curve of the wires between nodes, on the host. Device: kernels/contact.py, kernels/wire_curve.py.

On the segment behind a node and relative to it, for s in 0 .. 1,

    p(s) = h10 M1 + h01 e + h11 M2 + s^2 (1 - s)^2 (B0 + s B1 + ...)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..base.hermite import hermite
from ..results.frame import WireLayout

AT_ONCE = 65536  # points


@dataclass(frozen=True)
class Segments:
    """Segments of a curve; arrays [segment], zero behind the last node of an open wire."""

    edge: np.ndarray  # (segment, 3) [m] to the next node
    begin: np.ndarray  # (segment, 3) [m] slope dp/ds at its first node
    end: np.ndarray  # (segment, 3) [m] and at its second
    bump: np.ndarray  # (segment, power, 3) [m]

    def at(self, segment: np.ndarray) -> Segments:
        """Those with these numbers."""
        return Segments(self.edge[segment], self.begin[segment], self.end[segment], self.bump[segment])

    def offset(self, s: np.ndarray | float) -> np.ndarray:
        """(segment, 3) [m] from the first node to the point at s, one or [segment]."""
        s = np.broadcast_to(s, len(self.edge))[:, None]
        h10, h01, h11 = hermite(s)
        smooth = h10 * self.begin + h01 * self.edge + h11 * self.end
        powers = s ** np.arange(self.bump.shape[1])
        return np.asarray(smooth + (s * (1 - s)) ** 2 * np.einsum("mp,mpa->ma", powers, self.bump))

    def derivative(self, s: np.ndarray | float) -> np.ndarray:
        """(segment, 3) [m] dp/ds at s, one or [segment]."""
        s = np.broadcast_to(s, len(self.edge))[:, None]
        smooth = (1 - s) * (1 - 3 * s) * self.begin + 6 * s * (1 - s) * self.edge + s * (3 * s - 2) * self.end
        power = np.arange(self.bump.shape[1])
        shape = (s * (1 - s)) * (2 * (1 - 2 * s) * s**power + (1 - s) * power * s**power)
        return np.asarray(smooth + np.einsum("mp,mpa->ma", shape, self.bump))


def parts_of(count: int) -> Iterator[slice]:
    """Parts of `count` points: a large mesh has no memory for all at once."""
    return (slice(begin, min(begin + AT_ONCE, count)) for begin in range(0, count, AT_ONCE))


class WireCurve(ABC):
    """The curve through the nodes of a mesh; segments are found on request."""

    edges: Edges

    @abstractmethod
    def behind(self, node: np.ndarray) -> Segments:
        """The segments behind nodes (m,)."""

    def offset(self, node: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Offset (m, 3) [m] from the node, at s (m,) on the segments behind nodes (m,)."""
        every = np.empty((len(node), 3))
        for part in parts_of(len(node)):
            every[part] = self.behind(node[part]).offset(s[part])
        return every

    def between(self, parts: int) -> np.ndarray:
        """(node, parts - 1, 3) [m] the same at equal steps of s (`Frame.between`)."""
        nodes = np.arange(len(self.edges.behind) if parts > 1 else 0)
        every = np.empty((len(nodes), parts - 1, 3), dtype=np.float32)
        for part in parts_of(len(nodes)):
            segments = self.behind(nodes[part])
            for k in range(1, parts):
                every[part, k - 1] = segments.offset(k / parts)
        return every


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


@dataclass(frozen=True)
class PlanarCurve(WireCurve):
    """Curve of the planar model; `shape` (node, CURVE_COEFFICIENTS) as in kernels/contact.py. Heights are Catmull-Rom."""

    edges: Edges
    shape: np.ndarray

    def behind(self, node: np.ndarray) -> Segments:
        edge, shape = self.edges.behind[node], self.shape[node]
        along, across = shape[:, 2:6, None], shape[:, 6:10, None]
        bump = along * _flat(edge)[:, None] + across * _turned(edge)[:, None]
        has = self.edges.has_segment[node][:, None]
        begin, end = self._slope(node), self._slope(self.edges.following[node])
        edge, begin, end = (np.where(has, vector, 0.0) for vector in (edge, begin, end))
        return Segments(edge, begin, end, np.where(has[:, None], bump, 0.0))

    def _slope(self, node: np.ndarray) -> np.ndarray:
        """(m, 3) [m] at nodes: (e_before + e)/2, turned by the shape."""
        mean, shape = 0.5 * (self.edges.before[node] + self.edges.behind[node]), self.shape[node]
        return np.asarray(mean + shape[:, :1] * _flat(mean) + shape[:, 1:2] * _turned(mean))


def planar_curve(layout: WireLayout, position: np.ndarray, deformation: np.ndarray, shape: np.ndarray) -> PlanarCurve:
    """The curve through nodes at `position` (node, 3) [m]."""
    return PlanarCurve(edges_of(layout, position, deformation), shape)


def _flat(vector: np.ndarray) -> np.ndarray:
    """(x, y, 0)."""
    return vector * (1.0, 1.0, 0.0)


def _turned(vector: np.ndarray) -> np.ndarray:
    """(-y, x, 0)."""
    return np.stack([-vector[:, 1], vector[:, 0], np.zeros(len(vector))], axis=1)
