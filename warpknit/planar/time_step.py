"""Largest stable time step, from an upper bound on the highest frequency. By gradients of the strain measures.

Every term of the energy is k_e q_e^2/2 with a gradient g_e over the nodes it touches, so the stiffness is K = B^T B with the rows
sqrt(k_e) g_e of B, and M^-1 K has the same largest eigenvalue as the Gram matrix

    G = B M^-1 B^T        G_ef = sum over shared nodes i of sqrt(k_e k_f) g_e(i) . g_f(i)/m_i

For any positive numbers d (Collatz and Wielandt),

    w^2 <= max over e of (sum over f of |G_ef| d_f)/d_e

The highest modes alternate from node to node, where all terms of a row add up. With the row sums as d the bound is within a few
percent of w^2. On a straight wire of equal spacing it is exact: 4 K/(h m) or 80/3 EI/(h^3 m).

| term | q | k |
|---|---|---|
| stretch of a segment | its length | K/L + abs(S)/h |
| swing of a segment | its end across it | max(T, 0)/h + abs(S)/h |
| bend at a node | turning angle | EI/l (1 + sum over both segments of L (1/l + 1/l_neighbour)/6) |
| contact, closed or about to close | gap | penalty |

T is the tension, S the shear force of a segment of length h: its geometric stiffness in a rotating segment is indefinite, at
most S/h along and across. Compression lowers frequencies and is neglected. The slope of the moment (kernels/bend.py) couples
the bends of neighbours, q_a q_b, which is at most (q_a^2 + q_b^2)/2 and is added to both.

Central differences are stable up to w dt = 2, with w bounded so. Contacts that may close before the next check count
as closed. A light body that bounces between its wires gains energy where its own frequency, w_body^2 = 2 k/m_body, is near that
limit, as contacts that open and close within a step are not linear. So w_body dt <= 1 as well, which matters only for bodies
lighter than two or three nodes. The step is STEP_MARGIN times the bound: the margin of 10 % covers a rise of w^2 by 23 % between
two checks, and avoids energy gain of strongly excited nodes near the limit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..base.hermite import hermite
from ..mechanics.numerics import STEP_MARGIN
from .host_state import HostState
from .model import Model
from .observables import PlanarObservables, read
from .state import State

PASSES = 2  # iterations of the bound, each with the row sums of the last one
LEAST_WEIGHT = 1e-3  # smallest weight over the largest
BOUNCING = 4.0  # lower bound of w^2 over w_body^2
FASTER = 2.0  # largest speed before the next check over the current one
NEAR = 0.02  # of the reach of a contact: smaller gaps count as closed


class Terms(NamedTuple):
    """Gradients of terms at their nodes and bodies, one entry for each."""

    place: np.ndarray  # [entry] node; behind all nodes, bodies
    number: np.ndarray  # [entry] of the term
    gradient: np.ndarray  # (entry, 2) [1/s] sqrt(k/m) g there


def frequency_square(host: HostState, approach: float = 0.0) -> float:
    """Upper bound on w^2 [1/s2] of the mesh.

    `approach` [m]: largest approach of a body and a wire before the next check. Contacts of a body that is not free
    (mesh/hook_mesh.py) are bounded separately from the wires, with one node each.
    """
    inverse_mass = host.model.rest.inverse_mass.numpy().astype(float)[host.entry]
    inverse_mass[host.model.panel.held_node] = 0.0
    wires = wire_terms(host, inverse_mass)
    if host.model.treatment.is_free:
        return collatz_bound(wires, contact_terms(host, inverse_mass, approach))
    penalty = float(host.control.contact_stiffness)
    return collatz_bound(wires) + 2.0 * penalty * (float(host.control.body_inverse_mass) + float(inverse_mass.max()))


def wire_terms(host: HostState, inverse_mass: np.ndarray) -> Terms:
    """Terms of the wires, with stiffnesses and masses of the run: of n nodes n stretches, n swings and n bends.

    A segment stands at the node that starts it. Its stretch acts along its tangent t, its swing along its normal n; the bend of a
    node acts along n'/h' and n/h on its neighbours, with the segment ' before, and along their sum on itself.
    inverse_mass [node] [1/kg]: 0 where held.
    """
    model, panel = host.model, host.model.panel
    count = panel.node_count
    nodes = np.arange(count)
    last = panel.wire_first + panel.wire_count - 1
    before, after = nodes - 1, nodes + 1  # around closed wires
    before[panel.wire_first], after[last] = last, panel.wire_first
    length = np.hypot(host.edge[:, 0], host.edge[:, 1])
    per_length = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
    moment = host.moment + host.bow_moment
    shear = np.abs(moment - moment[after]) * per_length**2
    stretch = np.repeat(host.wire_axial, panel.wire_count) / (host.natural_length * host.length_factor) + shear
    swing = np.maximum(host.tension, 0.0) * per_length + shear
    bend = model.bending_stiffness / (host.hinge_length * host.length_factor)
    hinges = 1.0 / host.hinge_length
    missing = last[~panel.wire_closed]  # segments and hinges beyond the ends of open wires
    if model.is_gripped:
        missing = np.concatenate([missing, panel.wire_first, last - 1])  # and rigid segments inside the clamps
    stretch[missing] = swing[missing] = 0.0
    no_hinge = np.concatenate([panel.wire_first, last])[~np.tile(panel.wire_closed, 2)]
    bend[no_hinge] = hinges[no_hinge] = 0.0
    sloped = host.natural_length * (hinges + hinges[after])
    sloped[missing] = 0.0
    bend *= 1.0 + float(host.control.slope_factor) * model.bending_stiffness * (sloped + sloped[before])
    stretch, swing, bend = (np.sqrt(stiffness)[:, None] for stiffness in (stretch, swing, bend))
    tangent = host.edge * per_length[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    turn = normal * per_length[:, None]
    along, across = stretch * tangent, swing * normal
    bent = bend[before] * turn[before], bend * (turn[before] + turn), bend[after] * turn
    gradient = np.stack([along[before], along, across[before], across, *bent], axis=1)
    segments, bends = np.stack([before, nodes], axis=1), np.stack([before, nodes, after], axis=1)
    number = np.concatenate([segments, count + segments, 2 * count + bends], axis=1)
    gradient *= np.sqrt(inverse_mass)[:, None, None]
    return Terms(np.repeat(nodes, 7), number.ravel(), gradient.reshape(-1, 2))


def contact_terms(host: HostState, inverse_mass: np.ndarray, approach: float) -> Terms:
    """Closed contacts with nodal weights; contacts about to close with smooth-curve weights."""
    panel, control = host.model.panel, host.control
    closed = host.pair_force > 0.0
    # the gap of a sleeping pair is out of date; its remaining travel is a lower bound
    asleep = 2.0 * (host.pair_wake - control.travel)
    near = closed | ((approach > 0.0) & (np.where(asleep > 0.0, asleep, host.pair_gap) < approach))
    pair = np.nonzero(near)[0]
    first, count = (of_wire[panel.pair_wire[pair], None] for of_wire in (panel.wire_first, panel.wire_count))
    begin = panel.pair_seed[pair, None] + host.pair_slide[pair, None]  # also for pairs that were never closed
    node = first + np.mod(begin + np.arange(-1, 3) - first, count)
    push = np.zeros((len(pair), 4, 2))
    push[closed[pair]] = host.pair_nodal[closed] / host.pair_force[closed, None, None]
    there = np.nonzero(~closed[pair])[0]
    edge = host.edge[node[there, 1]]
    normal = np.stack([-edge[:, 1], edge[:, 0]], axis=1) / np.maximum(np.hypot(edge[:, 0], edge[:, 1]), 1e-300)[:, None]
    push[there] = _curve_weights(host.pair_u[pair[there]])[:, :, None] * normal[:, None, :]
    push *= np.sqrt(control.contact_stiffness)
    on_nodes, on_body = push * np.sqrt(inverse_mass)[node][:, :, None], push.sum(axis=1) * math.sqrt(control.body_inverse_mass)
    place, number = np.column_stack([node, panel.node_count + pair // 2]), 3 * panel.node_count + np.arange(len(pair))
    gradient = np.concatenate([on_nodes, on_body[:, None]], axis=1)
    return Terms(place.ravel(), np.repeat(number, 5), gradient.reshape(-1, 2))


def _curve_weights(u: np.ndarray) -> np.ndarray:
    """Weights (contact, 4) of the nodes in p(u) of kernels/contact.py, uncorrected."""
    h10, h01, h11 = hermite(u)
    return np.stack([-0.5 * h10, 1.0 - h01 - 0.5 * h11, h01 + 0.5 * h10, 0.5 * h11], axis=1)


def collatz_bound(*terms: Terms) -> float:
    """Upper bound by Collatz: the largest (|G| d)_e/d_e.

    d are the row sums of |G|, with absolute values taken place by place.
    """
    place, number, gradient = (np.concatenate(parts) for parts in zip(*terms, strict=True))
    order = np.argsort(place, kind="stable")
    place, number, gradient = place[order], number[order], gradient[order]
    square, entries, offset = np.einsum("na,na->n", gradient, gradient), [], 1
    while len(one := np.nonzero(place[offset:] == place[:-offset])[0]):
        other = one + offset
        entries.append((number[one], number[other], np.abs(np.einsum("na,na->n", gradient[one], gradient[other]))))
        offset += 1
    first, second, value = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    bound, weight = np.inf, np.ones(int(number.max()) + 1)
    for _ in range(PASSES):
        rows = np.bincount(number, square * weight[number], len(weight))
        rows += np.bincount(first, value * weight[second], len(weight)) + np.bincount(second, value * weight[first], len(weight))
        bound = min(bound, float((rows / weight).max()))
        weight = np.maximum(rows, LEAST_WEIGHT * rows.max())
    return bound


def largest_step(host: PlanarObservables, steps: int) -> float:
    """Largest stable step [s] of the next `steps` steps."""
    model, control = host.model, host.control
    move = FASTER * float(control.speed_max * control.time_step)
    approach = NEAR * abs(model.contact_reach) + 2.0 * steps * move
    body = 2.0 * float(control.contact_stiffness * control.body_inverse_mass)
    square = max(frequency_square(host, approach), BOUNCING * body * (model.pair_count > 0))
    return 2.0 / math.sqrt(square)


def stable_step(model: Model, state: State, steps: int) -> float:
    """Time step [s] of a ramp for the next `steps` steps."""
    host = read(model, state)
    return STEP_MARGIN * model.ranks.from_first(lambda: largest_step(host, steps))
