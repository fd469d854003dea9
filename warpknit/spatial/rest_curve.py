"""Rest-shape correction that makes the curve between the nodes the true centre line at rest (kernels/wire_curve.py).

Slopes at the nodes are corrected to point along the centre line. The remaining error between two nodes is fitted normal to the
curve by s^2 (1 - s)^2 (B0 + s B1). Open wires keep straight ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.legendre import leggauss

from ..frame import WireLayout
from ..hermite import hermite
from ..measure.drawn_curve import WireCurve, curve_of, edges_of
from .rods import Rods

FITTED = 4096  # segments fitted at a time
FIT_PLACES = 0.5 * (leggauss(12)[0] + 1.0)  # places 0 .. 1 on a segment where the centre line is sampled


@dataclass(frozen=True)
class CentreLine:
    """The true centre line of the wires at rest, at the nodes and between them."""

    slope: np.ndarray  # (node, 3) of any length, along the line
    between: np.ndarray  # (node, place, 3) [m] at FIT_PLACES of the segment behind a node, relative to that node


@dataclass(frozen=True)
class RestCurve:
    """Arrays [node], those of segments too."""

    slope: np.ndarray  # (node, 2) [m] along the directors of the mean section at a node
    bump: np.ndarray  # (node, 4) [m] along the directors of a segment: two of s^2 (1 - s)^2, two of s^3 (1 - s)^2
    bulge: np.ndarray  # [m] largest correction of the curve of a segment by both
    fit_error: float  # [m] largest distance of the curve from the centre line
    weight_square: float = 1.0  # largest sum of squared weights of a force on the curve, couples on sections taken as forces
    lever: float = 0.0  # [m] largest part of the curve that rotates with one section


def catmull_rom(rods: Rods) -> RestCurve:
    """The Catmull-Rom curve: no correction."""
    none = np.zeros(rods.node_count)
    return RestCurve(
        slope=np.zeros((rods.node_count, 2)),
        bump=np.zeros((rods.node_count, 4)),
        bulge=none,
        fit_error=0.0,
    )


def spatial_curve(
    layout: WireLayout, position: np.ndarray, deformation: np.ndarray, director: np.ndarray, rest: RestCurve, length_factor: float
) -> WireCurve:
    """The curve on which wires touch, through nodes at `position` (node, 3) [m] with directors `director` (node, 3).

    length_factor: thermal length over that at rest.
    """
    edges = edges_of(layout, position, deformation)
    tangent = edges.behind / np.linalg.norm(edges.behind, axis=1, keepdims=True)
    section = np.stack([director, np.cross(tangent, director)], axis=2)  # (node, 3, 2)
    previous = np.arange(len(position)) - 1
    previous[edges.following[edges.has_segment]] = np.flatnonzero(edges.has_segment)
    rise = np.einsum("nac,nc->na", 0.5 * length_factor * (section[previous] + section), rest.slope)
    return curve_of(edges, rise, np.einsum("nac,npc->npa", length_factor * section, rest.bump.reshape(-1, 2, 2)))


def offsets_at(
    rods: Rods, curve: RestCurve, tangent: np.ndarray, director: np.ndarray, node: np.ndarray, place: np.ndarray
) -> np.ndarray:
    """(contact, 3) [m] part of the curve that rotates with sections, at places 0 .. 1 on the segments behind nodes.

    tangent, director (node, 3): orientation of the sections.
    """
    before, after = rods.previous[node], rods.following[node]
    has_before, has_more = (before >= 0)[:, None], (rods.following[after] >= 0)[:, None]

    def across(section: np.ndarray, one: np.ndarray) -> np.ndarray:
        d1 = director[section]
        return one[:, :1] * d1 + one[:, 1:] * np.cross(tangent[section], d1)

    first, second, bump = 0.5 * curve.slope[node], 0.5 * curve.slope[after], curve.bump[node]
    begin = across(node, first) + np.where(has_before, across(before, first), 0.0)
    end = across(node, second) + np.where(has_more, across(after, second), 0.0)
    s = place[:, None]
    own = across(node, bump[:, :2]) + s * across(node, bump[:, 2:])
    h10, _, h11 = hermite(s)
    return h10 * begin + h11 * end + (s * (1 - s)) ** 2 * own


def fit_rest_curve(rods: Rods, line: CentreLine) -> RestCurve:
    """The curve fitted to the centre line at rest."""
    before, after, edge = rods.previous, rods.following, rods.rest_edge
    is_inside = ((after >= 0) & (before >= 0))[:, None]
    section = np.stack([rods.director, np.cross(_unit(edge), rods.director)], axis=2)  # (node, 3, 2)
    mean = np.where(is_inside, 0.5 * (edge[before] + edge), edge)
    slope, rise = _slopes(0.5 * (section[before] + section), mean, line.slope, is_inside[:, 0])
    ends = _Ends(section, edge, mean + rise, rise)
    bump, bulge = np.zeros((rods.node_count, 4)), np.zeros(rods.node_count)
    error, weight_square, lever = 0.0, 1.0, 0.0
    for first in range(0, rods.node_count, FITTED):
        node = np.arange(first, min(first + FITTED, rods.node_count))
        bump[node], correction, own, miss = _fit_bumps(ends, node, after[node], line.between[node])
        has_segment = after[node] >= 0
        bulge[node] = np.where(has_segment, np.linalg.norm(correction, axis=2).max(axis=1), 0.0)
        error = max(error, float(np.linalg.norm(miss, axis=2).max()))
        bounds = _weight_bounds(slope, own, np.linalg.norm(edge, axis=1), node, before[node], after[node])
        weight_square, lever = max(weight_square, bounds[0]), max(lever, bounds[1])
    return RestCurve(slope=slope, bump=bump, bulge=bulge, fit_error=error, weight_square=weight_square, lever=lever)


@dataclass(frozen=True)
class _Ends:
    """What a segment takes from its nodes: sections (node, 3, 2), edges, and slopes with their corrections (node, 3) [m]."""

    section: np.ndarray
    edge: np.ndarray
    slope: np.ndarray
    rise: np.ndarray


def _fit_bumps(ends: _Ends, node: np.ndarray, after: np.ndarray, between: np.ndarray) -> tuple[np.ndarray, ...]:
    """Bumps (n, 4) [m] of the segments from nodes to those after, the correction of the curve, the part of it by bumps, and what
    the curve misses, (n, place, 3) [m]; between (n, place, 3) [m]: the centre line."""
    edge = ends.edge[node]
    one, two = ends.slope[node][:, None], ends.slope[after][:, None]
    s = FIT_PLACES[:, None]
    h10, h01, h11 = hermite(s)
    along = _unit((1 - s) * (1 - 3 * s) * one + 6 * s * (1 - s) * edge[:, None] + s * (3 * s - 2) * two)
    missed = _across(between - (h10 * one + h01 * edge[:, None] + h11 * two), along)
    missed[after < 0] = 0.0
    basis = (s * (1 - s)) ** 2 * np.hstack([np.ones_like(s), s])  # (place, power)
    moves = np.einsum("nac,sp->nspca", ends.section[node], basis).reshape(*missed.shape[:2], 4, 3)
    system = np.swapaxes(_across(moves, along[:, :, None]), 2, 3).reshape(len(node), -1, 4)
    bump = (np.linalg.pinv(system) @ missed.reshape(len(node), -1, 1))[..., 0]
    own = np.einsum("nspa,np->nsa", moves, bump)
    correction = h10 * ends.rise[node][:, None] + h11 * ends.rise[after][:, None] + own
    return bump, correction, own, missed - np.einsum("nkc,nc->nk", system, bump).reshape(missed.shape)


def _unit(vector: np.ndarray) -> np.ndarray:
    """Unit vectors (..., 3)."""
    return np.asarray(vector / np.linalg.norm(vector, axis=-1, keepdims=True))


def _slopes(frame: np.ndarray, mean: np.ndarray, wanted: np.ndarray, is_inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corrections of mean slopes (node, 3) that make them parallel to `wanted`: in the frames, (node, 2) [m], and in space (node,
    3).

    frame (node, 3, 2): directors at the nodes. No correction at the ends of wires.
    """
    system = np.concatenate([frame, -_unit(wanted)[:, :, None]], axis=2)
    system[~is_inside] = np.eye(3)
    slope = np.where(is_inside[:, None], np.linalg.solve(system, -mean[:, :, None])[:, :2, 0], 0.0)
    return slope, np.einsum("nac,nc->na", frame, slope)


def _across(vector: np.ndarray, along: np.ndarray) -> np.ndarray:
    """The part of vectors (..., 3) normal to unit vectors."""
    return vector - np.sum(vector * along, axis=-1, keepdims=True) * along


def _weight_bounds(
    slope: np.ndarray, own: np.ndarray, length: np.ndarray, node: np.ndarray, before: np.ndarray, after: np.ndarray
) -> tuple[float, float]:
    """`weight_square` and `lever` of a RestCurve, of segments behind some nodes; own (n, place, 3) [m]: correction by bumps."""
    h10, h01, h11 = hermite(FIT_PLACES)
    h11 = -h11
    half = 0.5 * np.linalg.norm(slope, axis=1)
    first, last = h10 * half[node][:, None], h11 * half[after][:, None]  # of the previous and of the next section
    middle = first + last + np.linalg.norm(own, axis=2)
    a, b, c = first / length[before][:, None], middle / length[node][:, None], last / length[after][:, None]
    total = (0.5 * h10 + a) ** 2 + (1 - h01 + 0.5 * h11 + a + b) ** 2 + (h01 + 0.5 * h10 + b + c) ** 2 + (0.5 * h11 + c) ** 2
    return max(1.0, float(total.max())), float(max(first.max(), middle.max(), last.max()))
