"""Bending of spatial wires: moments by statics, at the nodes, under the contacts and between; energy, and plastic turns.

A contact pushes with the force F at the point p of a segment. The model puts this force on the four nodes around, with the
weights w_0 .. w_3. Parts c of the curve rotate with the sections of the segments before, at and behind p, so there are couples
on these sections (kernels/wire_curve.py). Both systems have the same resultant and moment, so they are equivalent beyond the
four nodes. Between them the moment M of a force at p follows from the moments of the model. With the force n of a segment on
its first node j, summed over contacts,

    M_j     += (w_0 (x_(j-1) - x_j) + c_before) x F        M_(j+1) -= (w_3 (x_(j+2) - x_(j+1)) + c_behind) x F
    n_(j-1) += w_0 F       n_j += (w_0 + w_1) F       n_(j+1) -= w_3 F
    M(r)     = M_j - (r - x_j) x n_j + sum over contacts between x_j and r of (r - p) x F

A node with the turn p has, with n the axis of the turn, b the direction of the node and c = b x n,

    M = g_along n + g_across (p/2)/sin(p/2) c + g_twist/cos(p/2) b

from the moments g that its turn and twist work against (node_stiffness.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..compute.host import fetch, store
from ..compute.steering import Steering
from ..measure.drawn_curve import parts_of
from .node_stiffness import node_frame
from .rest_curve import node_weights, section_offsets
from .rod_arrays import RodArrays, RodState
from .rods import Rods
from .strip import WireSums

BETWEEN = np.array([0.25, 0.5, 0.75])  # places on a segment where moments are taken too
STRAIGHT = 1e-9  # [rad] turn whose axis does not matter


@dataclass(frozen=True)
class _Pushes:
    """Contact forces on wires; two for each contact, sorted along the wires."""

    node: np.ndarray  # the segment's
    place: np.ndarray  # 0 .. 1
    force: np.ndarray  # (push, 3) [N]


def bending_moments(r: Any) -> tuple[np.ndarray, ...]:
    """Magnitudes of bending moments [N m] of a state; r: `SpatialObservables`.

    [node] at the nodes, of a clamp at the outer node of its segment; (node, BETWEEN) on the segments; [pushed place] under the
    contacts, and the segment of each.
    """
    rods, curve = r.model.rods, r.curve
    before, after, edge = rods.previous, rods.following, curve.edges.behind
    at = _pushes(r)
    weights = _weights(r, at)
    parts = r.length_factor * section_offsets(rods, r.model.curve, r.segment_tangent, r.director, at.node, at.place)
    force, moment = r.segment_force.copy(), np.empty((rods.node_count, 3))
    for part in parts_of(rods.node_count):
        moment[part] = _node_moments(r, np.arange(part.start, part.stop))
    behind = after[at.node]
    np.add.at(moment, at.node, np.cross(-weights[:, :1] * edge[before[at.node]] + parts[:, 0], at.force))
    np.add.at(moment, behind, -np.cross(weights[:, 3:] * edge[behind] + parts[:, 2], at.force))
    # of the segment before p, of its own up to p, and of the next one
    np.add.at(force, before[at.node], weights[:, :1] * at.force)
    np.add.at(force, at.node, (weights[:, :1] + weights[:, 1:2]) * at.force)
    np.add.at(force, behind, -weights[:, 3:] * at.force)
    elastic, along = rods.slope_length > 0.0, np.empty_like(moment)
    sizes, peak = np.empty((rods.node_count, len(BETWEEN))), np.empty(len(at.node))
    for part in parts_of(rods.node_count):
        segments, own = curve.behind(np.arange(part.start, part.stop)), slice(*np.searchsorted(at.node, [part.start, part.stop]))
        along[part] = segments.begin
        node, place, push = at.node[own] - part.start, at.place[own], at.force[own]
        pushed = segments.at(node)
        reach = pushed.offset(place)
        for k, s in enumerate(BETWEEN):
            end = segments.offset(s)
            found = moment[part] - np.cross(end, force[part])
            passed = place < s
            np.add.at(found, node[passed], np.cross(end[node] - reach, push)[passed])
            sizes[part, k] = np.where(elastic[part], _bending(found, segments.derivative(s)), 0.0)
        under = moment[part][node] - np.cross(reach, force[part][node])
        largest = int(np.unique(node, return_counts=True)[1].max(initial=0))  # number of pushes on a segment
        for lag in range(1, largest):
            same = node[lag:] == node[:-lag]
            under[lag:] += np.where(same[:, None], np.cross(reach[lag:] - reach[:-lag], push[:-lag]), 0.0)
        peak[own] = np.where(elastic[part][node], _bending(under, pushed.derivative(place)), 0.0)
    # a clamp in the middle of a rigid segment: at the outer one of its nodes
    first, last = clamped_ends(rods)
    moment[first] = moment[after[first]] + np.cross(0.5 * edge[first], force[after[first]])
    moment[after[last]] = moment[last] - np.cross(0.5 * edge[last], force[before[last]])
    along[after[last]] = edge[last]
    return _bending(moment, along), sizes, peak, at.node


def clamped_ends(rods: Rods) -> tuple[np.ndarray, np.ndarray]:
    """Rigid segments at both ends of wires, between the two nodes of a clamp."""
    rigid = np.flatnonzero((rods.slope_length == 0.0) & (rods.following >= 0))
    begins = rods.previous[rigid] < 0
    return rigid[begins], rigid[~begins & (rods.following[rods.following[rigid]] < 0)]


def _pushes(r: Any) -> _Pushes:
    t = r.touching
    node, place = np.concatenate([t.first, t.second]), np.concatenate([t.place[:, 0], t.place[:, 1]])
    order = np.lexsort((place, node))
    return _Pushes(node[order], place[order], np.concatenate([t.push, -t.push])[order])


def _weights(r: Any, at: _Pushes) -> np.ndarray:
    """(push, 4) weights on the four nodes around; beyond its ends a wire is straight."""
    rods, w = r.model.rods, node_weights(r.model.curve, at.node, at.place).T
    begins, ends = rods.previous[at.node] < 0, rods.following[rods.following[at.node]] < 0
    w[1] += np.where(begins, 2 * w[0], 0.0) - np.where(ends, w[3], 0.0)
    w[2] += np.where(ends, 2 * w[3], 0.0) - np.where(begins, w[0], 0.0)
    w[0], w[3] = np.where(begins, 0.0, w[0]), np.where(ends, 0.0, w[3])
    return np.asarray(w.T)


def _node_moments(r: Any, node: np.ndarray) -> np.ndarray:
    """(m, 3) [N m] at nodes (m,), from the moments along the directors."""
    before, d = r.model.rods.previous[node], r.director
    inside = ((before >= 0) & (r.model.rods.following[node] >= 0))[:, None]
    e, f = r.segment_tangent[before], r.segment_tangent[node]
    cosine = np.clip(np.sum(e * f, axis=1), -1.0, 1.0)
    half = 0.5 * np.arctan2(np.linalg.norm(np.cross(e, f), axis=1), cosine)
    n, b, along = node_frame(e, f, d[before], d[node], half > STRAIGHT)
    g1, g2, twist = r.moment[node].T
    in_plane, across = g1 * along[:, 0] + g2 * along[:, 1], g2 * along[:, 0] - g1 * along[:, 1]
    total = in_plane[:, None] * n + (across / np.sinc(half / np.pi))[:, None] * np.cross(b, n)
    return np.where(inside, total + (twist / np.cos(half))[:, None] * b, 0.0)


def _bending(moment: np.ndarray, along: np.ndarray) -> np.ndarray:
    """[N m] magnitudes of the parts of moments (n, 3) across a direction (n, 3)."""
    square = np.maximum(np.sum(along**2, axis=1), 1e-300)
    return np.asarray(np.linalg.norm(moment - (np.sum(moment * along, axis=1) / square)[:, None] * along, axis=1))


class Yielding:
    """Plastic bending of rods in the state last evaluated: backward Euler of the flow rule of kernels/rod_forces.py.

    Plastic turns are updated from one equilibrium to the next; twist and tension stay elastic. Arrays run over the nodes; turns
    [rad] are along the section directors, and 0 at the ends of wires.
    """

    KEPT = ("dissipated",)

    def __init__(self, rods: Rods, arrays: RodArrays, state: RodState, sums: WireSums, worlds: int = 1) -> None:
        self.rods, self.arrays, self.state, self._sums = rods, arrays, state, sums
        self._inside = (rods.following >= 0) & (rods.previous >= 0)
        section = rods.section
        self._kept = section.hardening
        self.yields = section.yields
        self._steering = Steering(state.control)
        self.dissipated = np.zeros(worlds)  # [world] [J] over all ranks

    @property
    def length(self) -> np.ndarray:
        """[node] [m] natural length of a node at the current temperature."""
        factor = self._steering.length_factor
        return self.rods.node_length * (factor[0] if len(factor) == 1 else np.repeat(factor, self.arrays.world_nodes))

    @property
    def plastic(self) -> np.ndarray:
        """(node, 2) [rad] plastic turn; one row of zeros where the section does not yield."""
        return fetch(self.state.plastic_turn)

    @property
    def back(self) -> np.ndarray:
        """(node, 2) [rad] back turn: centre of the yield surface."""
        return self._kept / (1.0 - self._kept) * self.plastic if self.yields else np.zeros_like(self.plastic)

    def _elastic_predictor(self) -> np.ndarray:
        turn = fetch(self.state.curvature) - fetch(self.arrays.natural_curvature)[self.rods.row] - self.plastic
        return np.where(self._inside[:, None], turn, 0.0)

    def _beyond(self) -> tuple[np.ndarray, np.ndarray]:
        """Excess of the elastic turns over the yield surface (node, 2); distance from the back turns [node]."""
        beyond = self._elastic_predictor() - self.back
        size = np.linalg.norm(beyond, axis=1)
        over = np.maximum(size - self.rods.of_nodes("yield_curvature") * self.length, 0.0) * self.yields
        return beyond * np.divide(over, size, out=np.zeros_like(size), where=size > 0.0)[:, None], size

    @property
    def elastic(self) -> np.ndarray:
        """(node, 2) [rad] elastic turn; the moment is EI over the length times it."""
        return self._elastic_predictor() - (1.0 - self._kept) * self._beyond()[0] if self.yields else self._elastic_predictor()

    @property
    def hardened_energy(self) -> np.ndarray:
        """[world] [J] stored by hardening: H kappa_p^2/2 per length, H = EI kept/(1 - kept)."""
        return self._energy(0.5 * np.sum(self.back * self.plastic, axis=1)) if self.yields else np.zeros(len(self.dissipated))

    def plastic_potential(self) -> np.ndarray:
        """Incremental potential of bending and twist [world] [J] beyond the elastic energy; its gradient are moments of turns."""
        if not self.yields:
            return np.zeros(len(self.dissipated))
        over, size = self._beyond()
        passed = np.linalg.norm(over, axis=1)
        limit = size - passed
        bent = 0.5 * limit**2 + limit * passed + 0.5 * self._kept * passed**2
        bent += np.sum(self.back * (self._elastic_predictor() - self.back), axis=1)
        return self._energy(bent - 0.5 * np.sum(self.elastic**2, axis=1))

    @property
    def elastic_energy(self) -> np.ndarray:
        """[world] [J] of elastic turns and twists and of the slopes of moments along the segments (kernels/rod_forces.py)."""
        return self._sums.of_nodes(fetch(self.state.bend_energy))

    def _energy(self, square: np.ndarray) -> np.ndarray:
        """[world] sum over the mesh of EI/l times squared turns [rad^2]."""
        bending = self.rods.of_nodes("bending_stiffness")
        stiffness = np.divide(bending, self.length, out=np.zeros(len(square)), where=self._inside)
        return self._sums.of_nodes(stiffness * square)

    def advance(self, world: int = 0) -> None:
        """Accept the equilibrium of a world as a step of its load history: update the plastic turns."""
        if not self.yields:
            return
        change = (1.0 - self._kept) * self._beyond()[0]
        moment = self.rods.of_nodes("bending_stiffness") * self.rods.of_nodes("yield_curvature")
        self.dissipated[world] += self._sums.of_nodes(moment * np.linalg.norm(change, axis=1))[world]
        nodes = slice(world * self.arrays.world_nodes, (world + 1) * self.arrays.world_nodes)
        store(self.state.plastic_turn[nodes], (self.plastic + change)[nodes])
