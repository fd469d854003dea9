"""Rest-shape correction: the curve between nodes is the true centre line (kernels/wire_curve.py).

Slopes at the nodes are corrected to point along the centre line. The remaining error between two nodes is fitted normal to the
curve by s^2 (1 - s)^2 (B0 + s B1 + s^2 B2 + s^3 B3). Open wires keep straight ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial.legendre import leggauss

from ..base.hermite import hermite
from ..measure.drawn_curve import Edges, Segments, WireCurve, edges_of
from ..results.frame import WireLayout
from .node_stiffness import node_stiffness
from .rods import Rods

BUMPS = 4  # B0 .. B3
FITTED = 4096  # segments fitted at a time
FIT_PLACES = 0.5 * (leggauss(12)[0] + 1.0)  # places 0 .. 1 on a segment where the centre line is sampled


@dataclass(frozen=True)
class CentreLine:
    """True centre line of the wires at rest, at and between nodes."""

    slope: np.ndarray  # (node, 3) derivative by a parameter along the line
    between: np.ndarray  # (node, place, 3) [m] at FIT_PLACES of the segment behind a node, relative to that node
    step: np.ndarray  # [node] change of the parameter along the segment

    @staticmethod
    def joined(lines: Sequence[CentreLine]) -> CentreLine:
        """Centre lines of several wires in sequence."""
        return CentreLine(*(np.concatenate([getattr(one, name) for one in lines]) for name in ("slope", "between", "step")))


def along_centre_line(rods: Rods, line: CentreLine) -> Rods:
    """Rods with natural arcs and stiffnesses of the centre line."""
    pieces = np.diff(line.between, axis=1, prepend=0.0, append=rods.rest_edge[:, None])
    rods = replace(rods, natural_arc=np.linalg.norm(pieces, axis=2).sum(axis=1))
    return replace(rods, node_stiffness=node_stiffness(rods, pieces, np.concatenate([[0.0], FIT_PLACES, [1.0]])))


@dataclass(frozen=True)
class RestCurve:
    """Arrays [row], also for segments: wires of one shape share their rows."""

    row: np.ndarray  # [node] int32, row of a node and of the segment behind it: the rods' row
    slope: np.ndarray  # (row, 2) correction of the direction at a node, along the directors of the sections there
    slope_weight: np.ndarray  # (row, 4) weights of the edges in the slopes at both ends of a segment
    length: np.ndarray  # [m] of the segments, by which slopes are multiplied
    bump: np.ndarray  # (row, 2 BUMPS) [m] along the directors of a segment: two of s^2 (1 - s)^2, two of s^3 (1 - s)^2 ..
    bulge: np.ndarray  # [m] largest correction of the curve of a segment by both
    fit_error: float  # [m] largest distance of the curve from the centre line
    weight_square: float = 1.0  # largest sum of squared weights of a force on the curve, couples on sections taken as forces
    lever: float = 0.0  # [m] largest part of the curve that rotates with one section


def joined_curves(curves: Sequence[RestCurve], rods: Rods) -> RestCurve:
    """The curves of several worlds, on their joined rods."""
    if len(curves) == 1:
        return curves[0]
    names = ("slope", "slope_weight", "length", "bump", "bulge")
    arrays: dict[str, Any] = {name: np.concatenate([getattr(curve, name) for curve in curves]) for name in names}
    arrays |= {name: np.array([getattr(curve, name) for curve in curves]) for name in ("weight_square", "lever")}
    return replace(curves[0], row=rods.row, fit_error=max(curve.fit_error for curve in curves), **arrays)


def catmull_rom(rods: Rods) -> RestCurve:
    """The Catmull-Rom curve: no correction."""
    rows = rods.of_rows.node_count
    return RestCurve(
        row=rods.row,
        slope=np.zeros((rows, 2)),
        slope_weight=np.full((rows, 4), 0.5),
        length=rods.of_rows.natural_length,
        bump=np.zeros((rows, 2 * BUMPS)),
        bulge=np.zeros(rows),
        fit_error=0.0,
    )


@dataclass(frozen=True)
class SpatialCurve(WireCurve):
    """The curve on which wires touch, through nodes with directors `director` (node, 3).

    length_factor: thermal length over length at rest.
    """

    edges: Edges
    previous: np.ndarray  # [node]
    director: np.ndarray
    rest: RestCurve
    length_factor: float

    def behind(self, node: np.ndarray) -> Segments:
        edges, rest, after = self.edges, self.rest, self.edges.following[node]
        row, edge, section = rest.row[node], edges.behind[node], self._section(node)
        slope, next_slope, m = rest.slope[row], rest.slope[rest.row[after]], rest.slope_weight[row][:, :, None]
        length_before, length, length_after = (self._length(segment) for segment in (self.previous[node], node, after))
        begin = m[:, 0] * _edge_slope(edges.before[node], length_before, self._section(self.previous[node]), slope)
        begin += m[:, 1] * _edge_slope(edge, length, section, slope)
        end = m[:, 2] * _edge_slope(edge, length, section, next_slope)
        end += m[:, 3] * _edge_slope(edges.behind[after], length_after, self._section(after), next_slope)
        bump = np.einsum("nac,npc->npa", self.length_factor * section, rest.bump[row].reshape(-1, BUMPS, 2))
        has, zero = edges.has_segment[node][:, None], np.zeros(3)
        begin, end, edge = (np.where(has, vector, zero) for vector in (begin, end, edge))
        return Segments(edge, begin, end, np.where(has[:, None], bump, zero))

    def _section(self, node: np.ndarray) -> np.ndarray:
        """(m, 3, 2) directors of the sections of segments."""
        edge, director = self.edges.behind[node], self.director[node]
        return np.stack([director, np.cross(edge / np.linalg.norm(edge, axis=1, keepdims=True), director)], axis=2)

    def _length(self, node: np.ndarray) -> np.ndarray:
        """(m, 1) [m] of segments."""
        return np.asarray(self.length_factor * self.rest.length[self.rest.row[node]][:, None])


def _edge_slope(edge: np.ndarray, length: np.ndarray, section: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """(m, 3) [m] edges with the corrections of their direction."""
    return np.asarray(edge + length * np.einsum("nac,nc->na", section, slope))


def spatial_curve(
    layout: WireLayout, position: np.ndarray, deformation: np.ndarray, director: np.ndarray, rest: RestCurve, length_factor: float
) -> SpatialCurve:
    """The curve through nodes at `position` (node, 3) [m]."""
    edges = edges_of(layout, position, deformation)
    previous = np.arange(len(position)) - 1
    previous[edges.following[edges.has_segment]] = np.flatnonzero(edges.has_segment)
    return SpatialCurve(edges, previous, director, rest, length_factor)


def rest_place(rods: Rods, curve: RestCurve, node: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Rest position (contact, 3) [m] of a place behind a node, by kernels/wire_curve.py."""
    edge = rods.rest_edge
    after = rods.following[node]
    here = edge[node]
    before = np.where((rods.previous[node] >= 0)[:, None], edge[rods.previous[node]], here)
    behind = np.where((rods.following[after] >= 0)[:, None], edge[after], here)
    s = place[:, None]
    h10, h01, h11 = s * (1 - s) ** 2, s * s * (3 - 2 * s), s * s * (s - 1)
    m = curve.slope_weight[curve.row[node]][:, :, None]
    begin, end = m[:, 0] * before + m[:, 1] * here, m[:, 2] * here + m[:, 3] * behind
    return np.asarray(rods.position[node] + h10 * begin + h01 * here + h11 * end)


def section_offsets(
    rods: Rods, curve: RestCurve, tangent: np.ndarray, director: np.ndarray, node: np.ndarray, place: np.ndarray
) -> np.ndarray:
    """Parts of the curve (contact, 3, 3) [m] that rotate with sections. Rows: previous, own, next.

    At places 0 .. 1 on the segments behind nodes.

    tangent, director (node, 3): orientation of the sections.
    """
    before, after = rods.previous[node], rods.following[node]
    has_before, has_more = (before >= 0)[:, None], (rods.following[after] >= 0)[:, None]

    def across(axes: tuple[np.ndarray, np.ndarray], one: np.ndarray) -> np.ndarray:
        return one[:, :1] * axes[0] + one[:, 1:] * axes[1]

    of_before, of_own, of_after = ((director[n], np.cross(tangent[n], director[n])) for n in (before, node, after))
    here, there = curve.row[node], curve.row[after]
    length, m = curve.length[:, None], curve.slope_weight[here][:, :, None]
    first, second, bump = curve.slope[here], curve.slope[there], curve.bump[here]
    begin = np.where(has_before, m[:, 0] * length[curve.row[before]] * across(of_before, first), 0.0)
    end = np.where(has_more, m[:, 3] * length[there] * across(of_after, second), 0.0)
    s = place[:, None]
    own = sum(s**k * across(of_own, bump[:, 2 * k : 2 * k + 2]) for k in range(BUMPS))
    h10, _, h11 = hermite(s)
    middle = length[here] * (m[:, 1] * h10 * across(of_own, first) + m[:, 2] * h11 * across(of_own, second))
    return np.stack([h10 * begin, middle + (s * (1 - s)) ** 2 * own, h11 * end], axis=1)


def fit_rest_curve(rods: Rods, line: CentreLine) -> RestCurve:
    """The curve fitted to the centre line at rest; each node of the rods has a row of its own."""
    before, after, edge = rods.previous, rods.following, rods.rest_edge
    has_segment, is_inside = after >= 0, (after >= 0) & (before >= 0)
    length = np.linalg.norm(edge, axis=1)
    section = np.stack([rods.director, np.cross(edge / length[:, None], rods.director)], axis=2)  # (node, 3, 2)
    weight = slope_weights(rods)
    share, ratio = weight[:, 1:2], weight[:, :1]
    frame = (1.0 - share[:, :, None]) * section[before] + share[:, :, None] * section
    direction = np.where(is_inside[:, None], ratio * edge[before] + share * edge, edge) / length[:, None]
    slope, rise = _slopes(frame, direction, line.slope, is_inside)
    # speeds at both ends of a segment are the line's
    speed = np.linalg.norm(line.slope, axis=1) / np.linalg.norm(direction + rise, axis=1)
    faster = np.stack([line.step * speed, line.step * speed[after]], axis=1) / length[:, None]
    faster = np.where(np.stack([is_inside, is_inside[after]], axis=1), faster, 1.0)
    weight = np.repeat(faster, 2, axis=1) * weight
    scale = (length[:, None] * faster)[:, :, None, None]
    tangent = direction + rise
    bump, bulge = np.zeros((rods.node_count, 2 * BUMPS)), np.zeros(rods.node_count)
    error, weight_square, lever = 0.0, 1.0, 0.0
    s = FIT_PLACES[:, None]
    h10, h01, h11 = hermite(s)
    basis = (s * (1 - s)) ** 2 * s ** np.arange(BUMPS)  # (place, power)
    for first in range(0, rods.node_count, FITTED):
        node = np.arange(first, min(first + FITTED, rods.node_count))
        end, own_edge, sizes = after[node], edge[node][:, None], scale[node]
        one, two = sizes[:, 0] * tangent[node][:, None], sizes[:, 1] * tangent[end][:, None]
        along = (1 - s) * (1 - 3 * s) * one + 6 * s * (1 - s) * own_edge + s * (3 * s - 2) * two
        along /= np.linalg.norm(along, axis=2, keepdims=True)
        missed = _across(line.between[node] - (h10 * one + h01 * own_edge + h11 * two), along)
        missed[~has_segment[node]] = 0.0
        moves = np.einsum("nac,sp->nspca", section[node], basis).reshape(*missed.shape[:2], 2 * BUMPS, 3)
        system = np.swapaxes(_across(moves, along[:, :, None]), 2, 3).reshape(len(node), -1, 2 * BUMPS)
        bump[node] = (np.linalg.pinv(system) @ missed.reshape(len(node), -1, 1))[..., 0]
        remainder = missed.reshape(len(node), -1) - np.einsum("nkc,nc->nk", system, bump[node])
        own = np.einsum("nspa,np->nsa", moves, bump[node])
        correction = sizes[:, 0] * h10 * rise[node][:, None] + sizes[:, 1] * h11 * rise[end][:, None] + own
        bulge[node] = np.where(has_segment[node], np.linalg.norm(correction, axis=2).max(axis=1), 0.0)
        error = max(error, float(np.linalg.norm(remainder.reshape(missed.shape), axis=2).max()))
        bounds = _weight_bounds(slope, weight, own, length, node, before[node], end)
        weight_square, lever = max(weight_square, bounds[0]), max(lever, bounds[1])
    return RestCurve(
        row=rods.row,
        slope=slope,
        slope_weight=weight,
        length=length,
        bump=bump,
        bulge=bulge,
        fit_error=error,
        weight_square=weight_square,
        lever=lever,
    )


def node_weights(curve: RestCurve, node: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(contact, 4) weights of a force at places 0 .. 1 on the segments behind nodes (kernels/wire_curve.py)."""
    m = curve.slope_weight[curve.row[node]].T
    h10, h01, h11 = hermite(place)
    w = -m[0] * h10, 1 - h01 + (m[0] - m[1]) * h10 - m[2] * h11, h01 + m[1] * h10 + (m[2] - m[3]) * h11, m[3] * h11
    return np.stack(w, axis=1)


def slope_weights(rods: Rods) -> np.ndarray:
    """(node, 4) weights m0 .. m3 of the edges in the slopes of a segment (kernels/wire_curve.py)."""
    before, after = rods.previous, rods.following
    own = np.linalg.norm(rods.rest_edge, axis=1)
    length = np.where(before >= 0, own[before], own)
    share = length / (length + own)  # c; 1/2 at the begin of an open wire
    next_length = np.where((after >= 0) & (after[after] >= 0), own[after], own)
    next_share = own / (own + next_length)
    return np.stack([(1.0 - share) * own / length, share, 1.0 - next_share, next_share * own / next_length], axis=1)


def _slopes(frame: np.ndarray, mean: np.ndarray, wanted: np.ndarray, is_inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corrections that make directions (node, 3) parallel to `wanted`: in the frames, (node, 2), and as vectors (node, 3).

    frame (node, 3, 2): directors at the nodes. No correction at the ends of wires.
    """
    unit = wanted / np.linalg.norm(wanted, axis=1, keepdims=True)
    system = np.concatenate([frame, -unit[:, :, None]], axis=2)
    system[~is_inside] = np.eye(3)
    slope = np.where(is_inside[:, None], np.linalg.solve(system, -mean[:, :, None])[:, :2, 0], 0.0)
    return slope, np.einsum("nac,nc->na", frame, slope)


def _across(vector: np.ndarray, along: np.ndarray) -> np.ndarray:
    """The part of vectors (..., 3) normal to unit vectors."""
    return vector - np.sum(vector * along, axis=-1, keepdims=True) * along


def _weight_bounds(
    slope: np.ndarray,
    weight: np.ndarray,
    own: np.ndarray,
    length: np.ndarray,
    node: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
) -> tuple[float, float]:
    """`weight_square` and `lever` of a RestCurve, of segments behind some nodes; own (n, place, 3) [m]: correction by bumps."""
    h10, h01, h11 = hermite(FIT_PLACES)
    h11 = -h11
    m, here = weight[node][:, :, None], length[node][:, None]
    begin, end = (h * np.linalg.norm(slope[nodes], axis=1)[:, None] for h, nodes in ((h10, node), (h11, after)))
    first = m[:, 0] * length[before][:, None] * begin  # of the previous section
    last = m[:, 3] * length[after][:, None] * end  # and of the next one
    middle = here * (m[:, 1] * begin + m[:, 2] * end) + np.linalg.norm(own, axis=2)
    a, b, c = first / length[before][:, None], middle / here, last / length[after][:, None]
    pushes = (
        m[:, 0] * h10 + a,
        np.abs(1 - h01 + (m[:, 0] - m[:, 1]) * h10 + m[:, 2] * h11) + a + b,
        np.abs(h01 + m[:, 1] * h10 + (m[:, 3] - m[:, 2]) * h11) + b + c,
        m[:, 3] * h11 + c,
    )
    total = sum(push**2 for push in pushes)
    return max(1.0, float(np.max(total))), float(max(first.max(), middle.max(), last.max()))
