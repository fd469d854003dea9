"""Largest stable time step, from an upper bound on the highest frequency (docs/theory/stepping.md).

Every term of the energy is k_e q_e^2/2 with a gradient g_e over the nodes it touches. The bound is the largest (|G| d)_e/d_e of
the Gram matrix G, with its row sums as d. The highest modes alternate from node to node, where all terms of a row add up, so it
is within a few percent of w^2.

The geometric stiffness of the shear force S in a rotating segment is indefinite, at most S/h along and across. The slope of the
moment (kernels/bend.py) couples the bends of neighbours, q_a q_b, which is at most (q_a^2 + q_b^2)/2 and is added to both.

Central differences are stable up to w dt = 2, with w bounded so. Contacts that may close before the next check count
as closed. A light body that bounces between its wires gains energy where its own frequency, w_body^2 = 2 k/m_body, is near that
limit, as contacts that open and close within a step are not linear. So w_body dt <= 1 as well, which matters only for bodies
lighter than two or three nodes. The step is STEP_MARGIN times the bound: the margin of 10 % covers a rise of w^2 by 23 % between
two checks, and avoids energy gain of strongly excited nodes near the limit.
"""

from __future__ import annotations

import math

import numpy as np

from ..base.hermite import hermite
from ..knit.crossings import plan_cross
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


def frequency_square(host: HostState, approach: float = 0.0) -> float:
    """Upper bound on w^2 [1/s2] of the mesh.

    `approach` [m]: largest approach of a body and a wire before the next check. Contacts of a body that is not free
    (mesh/hook_mesh.py) are bounded separately from the wires, with one node each.
    """
    couplings, at_contacts = Couplings(host), 0.0
    if host.model.treatment.is_free:
        couplings.add_contacts(host, approach)
    else:
        penalty, body_inverse_mass = host.control.contact_stiffness, host.control.body_inverse_mass
        at_contacts = 2.0 * penalty * (body_inverse_mass + float(couplings.inverse_mass.max()))
    weights = [np.ones(len(couplings.before)) for _ in range(3)] + [np.ones(couplings.contact_count)]
    bound = np.inf
    for _ in range(PASSES):
        rows = couplings.row_sums(*weights)
        bound = min(bound, max((row / weight).max(initial=0.0) for row, weight in zip(rows, weights, strict=True)))
        largest = max(row.max(initial=0.0) for row in rows)
        weights = [np.maximum(row, LEAST_WEIGHT * largest) for row in rows]
    return float(bound) + at_contacts


class Couplings:
    """The entries of |G|, with absolute values taken node by node (an upper bound).

    A segment stands at the node that starts it. At a node the previous segment and the next meet, with tangents t', t and
    normals n', n. The stretches act along t' and t. The swings and the bends of the two neighbours act across, along n' and n,
    and the node's own bend along n'/h' + n/h. `stretch`, `swing` and `bend` are square roots of stiffnesses.
    """

    def __init__(self, host: HostState) -> None:
        """The terms of the wires, with stiffnesses and masses of the run."""
        model, panel = host.model, host.model.panel
        nodes = np.arange(panel.node_count)
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
        slope_share = host.control.slope_factor * model.bending_stiffness
        bend *= 1.0 + slope_share * (sloped + sloped[before])
        self.inverse_mass = model.rest.inverse_mass.numpy().astype(float)[host.entry]  # [node] [1/kg], 0 where held
        self.inverse_mass[panel.held_node] = 0.0
        self.before, self.after = before, after
        self.stretch, self.swing, self.bend = np.sqrt(stretch), np.sqrt(swing), np.sqrt(bend)
        self._first, self._h = per_length[before], per_length  # 1/h' and 1/h
        self._tangent = host.edge * per_length[:, None]  # (node, 2) of the segment
        ended, started = self._tangent[before], self._tangent
        cosine = np.einsum("na,na->n", ended, started)
        self._cosine = np.abs(cosine)
        self._sine = np.abs(plan_cross(ended, started))
        self._across_ended = np.abs(self._first + cosine * self._h)  # n' and n on n'/h' + n/h
        self._across_started = np.abs(self._h + cosine * self._first)
        self._own = self._first**2 + self._h**2 + 2.0 * cosine * self._first * self._h
        self.contact_count = 0

    def add_contacts(self, host: HostState, approach: float) -> None:
        """Closed contacts with nodal weights; contacts about to close with smooth-curve weights."""
        panel, control = host.model.panel, host.control
        closed = host.pair_force > 0.0
        # the gap of a sleeping pair is out of date; its remaining travel is a lower bound
        asleep = 2.0 * (host.pair_wake - control.travel)
        near = closed | ((approach > 0.0) & (np.where(asleep > 0.0, asleep, host.pair_gap) < approach))
        pair = np.nonzero(near)[0]
        first, count = (of_wire[panel.pair_wire[pair], None] for of_wire in (panel.wire_first, panel.wire_count))
        begin = panel.pair_seed[pair, None] + host.pair_slide[pair, None]  # also for pairs that were never closed
        nodes = first + np.mod(begin + np.arange(-1, 3) - first, count)
        pushes = np.zeros((len(pair), 4, 2))  # sqrt(k) g
        pushes[closed[pair]] = host.pair_nodal[closed] / host.pair_force[closed, None, None]
        there = np.nonzero(~closed[pair])[0]
        edge = host.edge[nodes[there, 1]]
        normal = np.stack([-edge[:, 1], edge[:, 0]], axis=1) / np.maximum(np.hypot(edge[:, 0], edge[:, 1]), 1e-300)[:, None]
        h10, h01, h11 = hermite(host.pair_u[pair[there]])  # weights of the nodes in p(u) of kernels/contact.py, uncorrected
        weights = np.stack([-0.5 * h10, 1.0 - h01 - 0.5 * h11, h01 + 0.5 * h10, 0.5 * h11], axis=1)
        pushes[there] = weights[:, :, None] * normal[:, None, :]
        pushes *= np.sqrt(control.contact_stiffness)

        self.contact_count, self._node = len(pair), nodes.ravel()
        push, node = pushes.reshape(-1, 2), self._node
        turned = np.stack([push[:, 1], -push[:, 0]], axis=1)  # tangential components of the push
        ended, started = self._tangent[self.before[node]], self._tangent[node]
        n_ended, n_started = (np.einsum("na,na->n", turned, t) for t in (ended, started))
        self._pushed = np.abs([
            np.einsum("na,na->n", push, ended), np.einsum("na,na->n", push, started), n_ended, n_started,
            n_ended * self._first[node] + n_started * self._h[node],
        ])  # fmt: skip
        contact, body_mass = np.arange(len(pair)), np.full(len(pair), control.body_inverse_mass)
        through_wires = _sharing(node, np.repeat(contact, 4), push, self.inverse_mass[node])
        through_bodies = _sharing(pair // 2, contact, -pushes.sum(axis=1), body_mass)
        self._between = [np.concatenate(parts) for parts in zip(through_wires, through_bodies, strict=True)]

    def row_sums(self, stretch: np.ndarray, swing: np.ndarray, bend: np.ndarray, contact: np.ndarray) -> list[np.ndarray]:
        """|G| d of stretches, swings and bends, each [node], and of the contacts."""
        before, after, sine, cosine = self.before, self.after, self._sine, self._cosine
        # weighted terms at a node: along t' and t, along n' and n, and its own bend
        along, across, turn = self.stretch * stretch, self.swing * swing, self.bend * bend
        ended, started = along[before], along
        across_ended = across[before] + turn[before] * self._first
        across_started = across + turn[after] * self._h
        did = [ended, started, across_ended, across_started, turn]
        # sums in each direction
        felt = [
            ended + cosine * started + sine * (across_started + self._h * turn),
            started + cosine * ended + sine * (across_ended + self._first * turn),
            across_ended + cosine * across_started + sine * started + self._across_ended * turn,
            across_started + cosine * across_ended + sine * ended + self._across_started * turn,
            sine * (self._h * ended + self._first * started) + self._across_ended * across_ended
            + self._across_started * across_started + self._own * turn,
        ]  # fmt: skip
        contact_rows = np.zeros(self.contact_count)
        if self.contact_count:
            heavy = np.repeat(contact, 4)
            for direction, pushed in zip(felt, self._pushed, strict=True):
                np.add.at(direction, self._node, pushed * heavy)
            works = np.einsum("dn,dn->n", self._pushed, np.stack(did)[:, self._node]) * self.inverse_mass[self._node]
            contact_rows += works.reshape(-1, 4).sum(axis=1)
            first, second, value = self._between
            np.add.at(contact_rows, first, value * contact[second])
        along_ended, along_started, by_ended, by_started, own = (self.inverse_mass * f for f in felt)
        return [
            self.stretch * (along_started + along_ended[after]),
            self.swing * (by_started + by_ended[after]),
            self.bend * (own + (by_ended * self._first)[after] + (by_started * self._h)[before]),
            contact_rows,
        ]


def _sharing(place: np.ndarray, contact: np.ndarray, push: np.ndarray, mass: np.ndarray) -> tuple[np.ndarray, ...]:
    """Contacts at the same node or body: first contact, second contact and their entry of G [1/s2].

    `place`, `contact`, `push` (entry, 2) and `mass` [1/kg] are parallel arrays.
    """
    order = np.argsort(place, kind="stable")
    place, contact, push, mass = place[order], contact[order], push[order], mass[order]
    entries = [(contact, contact, mass * np.einsum("na,na->n", push, push))]
    offset = 1
    while True:
        one = np.nonzero(place[offset:] == place[:-offset])[0]
        if not len(one):
            break
        other = one + offset
        value = mass[one] * np.abs(np.einsum("na,na->n", push[one], push[other]))
        entries += [(contact[one], contact[other], value), (contact[other], contact[one], value)]
        offset += 1
    first, second, value = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    return first, second, value


def largest_step(host: PlanarObservables, steps: int) -> float:
    """Largest stable step [s] of the next `steps` steps."""
    model, control = host.model, host.control
    move = FASTER * control.speed_max * control.time_step
    approach = NEAR * abs(model.treatment.reach) + 2.0 * steps * move
    body = 2.0 * control.contact_stiffness * control.body_inverse_mass
    square = max(frequency_square(host, approach), BOUNCING * body * (model.pair_count > 0))
    return 2.0 / math.sqrt(square)


def stable_step(model: Model, state: State, steps: int) -> float:
    """Time step [s] of a ramp for the next `steps` steps."""
    host = read(model, state)
    return STEP_MARGIN * model.ranks.from_first(lambda: largest_step(host, steps))
