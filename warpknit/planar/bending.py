"""Bending moments of the wires by statics: at the nodes, and under the bodies that push between them.

A body's force f acts at its contact point p, but the wire carries it on the four nodes around, as f_-1, f_0, f_1, f_2. Both
have the same resultant and moment, so beyond the four nodes the wire feels the same, and between them the moments of a force at
p follow exactly. With n the force in the wire (segment_force), M at node j and the cross product a x b = a_x b_y - a_y b_x,

    M_(j+1) = M_j - e_j x n_j            a stretch of wire without loads, whatever its shape
    M_j    -> M_j - e_(j-1) x f_-1                           at the node before p
    M(p)    = M_j - (p - x_j) x (n_j + f_-1 + f_0)           there, with this M_j
    M_(j+1) -> M_(j+1) - e_(j+1) x f_2                       at the node behind p

The moment peaks at p: nodes at a distance h from each other miss up to F h/4 of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .host_state import HostState, friction_force, pair_distances


@dataclass(frozen=True)
class BendingMoments:
    """Bending moments [N m], positive to the left of the knitted shape."""

    node: np.ndarray  # [node]
    contact: np.ndarray  # [touching pair] under the body


def bending_moments(r: HostState) -> BendingMoments:
    """Moments at the nodes, and under bodies of closed pairs, in order."""
    model, panel = r.model, r.model.panel
    moment = r.moment + r.bow_moment
    pair = np.nonzero(r.pair_force > 0)[0]
    if not len(pair):
        return BendingMoments(moment, np.zeros(0))
    first, count, closed = (values[panel.pair_wire[pair]] for values in (panel.wire_first, panel.wire_count, panel.wire_closed))
    local = r.pair_node[pair][:, None] + np.arange(-1, 3) - first[:, None]
    local = np.where(closed[:, None], local % count[:, None], np.clip(local, 0, count[:, None] - 1))
    nodes = first[:, None] + local  # (pair, 4)
    force = normal_forces(r, pair)
    node, after = nodes[:, 1], nodes[:, 2]
    # vectors from the contact point: p = c - n (gap + reach), n from the wire to the body
    normal = -force.sum(axis=1)
    normal /= np.hypot(normal[:, 0], normal[:, 1])[:, None]
    body = normal * (r.pair_gap[pair] + model.contact_reach * r.length_factor)[:, None]
    place = body[:, None, :] - pair_distances(r, pair, nodes)
    begin, end = place[:, 1], place[:, 2]
    if model.is_gripped:  # the segment next to a clamp begins, or ends, at the clamp
        at_low = ~closed & (local[:, 1] == 1)
        at_high = ~closed & (local[:, 1] == count - 3)
        begin = np.where(at_low[:, None], end - r.edge[node], begin)
        end = np.where(at_high[:, None], begin + r.edge[node], end)
    pulled = r.segment_force[node] + force[:, 0] + force[:, 1]  # in the wire before p
    under = moment[after] - cross(place[:, 3] - place[:, 2], force[:, 3]) + cross(end, pulled - force.sum(axis=1))
    if model.is_gripped:  # loads on held nodes do not act on the wire
        by_low = moment[node] - cross(place[:, 1] - place[:, 0], force[:, 0]) + cross(begin, pulled)
        under = np.where(at_high, by_low, under)
    here, there = moment[node], moment[after]
    np.add.at(moment, node, under - cross(begin, pulled) - here)
    np.add.at(moment, after, under - cross(end, pulled - force.sum(axis=1)) - there)
    return BendingMoments(moment, under)


def normal_forces(r: HostState, pair: np.ndarray) -> np.ndarray:
    """(pair, 4, 2) [N] normal contact forces on the nodes.

    Friction acts at the two nodes beside the contact point (kernels/contact_friction.py). The force on the body is N n + T t,
    with t the normal n turned by -90 degrees times the side.
    """
    force = r.pair_nodal[pair]
    if not len(r.pair_stuck):
        return force
    tangential = r.model.panel.pair_side[pair] * friction_force(r)[pair]
    both, pushed = -force.sum(axis=1), r.pair_force[pair]
    normal = np.stack([pushed * both[:, 0] - tangential * both[:, 1], tangential * both[:, 0] + pushed * both[:, 1]], axis=1)
    normal /= (pushed**2 + tangential**2)[:, None]
    friction = tangential[:, None] * np.stack([normal[:, 1], -normal[:, 0]], axis=1)
    share = np.stack([0.0 * tangential, 1.0 - r.pair_u[pair], r.pair_u[pair], 0.0 * tangential], axis=1)
    return force + share[:, :, None] * friction[:, None, :]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a_x b_y - a_y b_x of vectors (n, 2)."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
