"""A bound on the highest frequency of a mesh as it stands, from the gradients of what its wires and contacts are strained by.

Every term of the energy is k_e q_e^2/2 with a gradient g_e over the nodes it touches, so the stiffness is K = B^T B with the rows
sqrt(k_e) g_e of B, and M^-1 K has the same largest eigenvalue as the Gram matrix

    G = B M^-1 B^T        G_ef = sum over shared nodes i of sqrt(k_e k_f) g_e(i) . g_f(i)/m_i

For any positive numbers d (Collatz and Wielandt),

    w^2 <= max over e of (sum over f of |G_ef| d_f)/d_e

Highest modes alternate from node to node, where the terms of a row all add up: with d the row sums themselves, the bound is
within a few percent of w^2. On a straight wire of even nodes it is 4 K/(h m) or 16 EI/(h^3 m), as it should be.

| term | q | k |
|---|---|---|
| stretch of a segment | its length | K/L + abs(S)/h |
| swing of a segment | its end across it | max(T, 0)/h + abs(S)/h |
| bend at a node | turning angle | EI/l |
| contact, closed or about to close | gap | penalty |

T is the tension, S the shear force of a segment of length h: what a turning segment feels of it is indefinite, and no more than
S/h both along and across. Compression only lowers frequencies and is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ..kernels import control as c
from ..measure import Reading

PASSES = 2  # of the bound: the second one with the row sums of the first
LEAST_WEIGHT = 1e-3  # of the largest: terms that hardly count are not divided by next to nothing
CHUNK = 32_768  # nodes that are looked at together: what is worked out for them stays in the cache


@dataclass(frozen=True)
class Terms:
    """Terms of the energy of the wires, and which of them every node takes part in.

    `kind` 0 stretches and 1 swings the segment that starts at a node, 2 bends the wire there. A node takes part in seven: its own
    three, the two of the segment before, and the bends at its neighbours.
    """

    before: np.ndarray  # [node] the node before, around closed wires
    after: np.ndarray
    along: np.ndarray  # [node, 2] sqrt(k) g of the stretch at the node after; minus it at the node itself
    across: np.ndarray  # [node, 2] the same of the swing
    hinge: np.ndarray  # [node] sqrt(k) of the bend; 0 where there is none
    turn: np.ndarray  # [node, 2] normal over length of the segment: what its end turns it by
    inverse_mass: np.ndarray  # [node] [1/kg], 0 where held

    def at(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gradients (7, node, 2) of the terms at nodes, and the node (7, node) and kind (7,) that each term belongs to."""
        before, after = self.before[nodes], self.after[nodes]
        own, last = self.turn[nodes], self.turn[before]
        gradients = np.stack([
            self.along[before], -self.along[nodes], self.across[before], -self.across[nodes],
            self.hinge[before, None] * last, -self.hinge[nodes, None] * (own + last), self.hinge[after, None] * own,
        ])  # fmt: skip
        return gradients, np.stack([before, nodes, before, nodes, before, nodes, after]), KINDS


KINDS = np.array([0, 0, 1, 1, 2, 2, 2])  # of the seven terms at a node


@dataclass(frozen=True)
class Contacts:
    """Contacts that are closed, or may be before the next look."""

    node: np.ndarray  # [contact, 4] nodes that it pushes
    push: np.ndarray  # [contact, 4, 2] sqrt(k) g there
    body: np.ndarray  # [contact]
    body_push: np.ndarray  # [contact, 2]


def frequency_square(reading: Reading, approach: float = 0.0) -> float:
    """Bound on w^2 [1/s2] of the mesh as it stands.

    `approach` [m]: how much closer a body and a wire may come before the next look. A body that is not free (treatment.py)
    counts as one whose contacts push at one node each, apart from the wires.
    """
    model = reading.model
    terms = wire_terms(reading)
    free = model.treatment.is_free
    contacts = near_contacts(reading, approach) if free else None
    square = collatz_bound(terms, contacts, float(reading.control[int(c.BODY_INVERSE_MASS)]))
    if not free:
        penalty = float(reading.control[int(c.CONTACT_STIFFNESS)])
        inverse = float(reading.control[int(c.BODY_INVERSE_MASS)])
        square += 2.0 * penalty * (inverse + float(terms.inverse_mass.max()))
    return square


def wire_terms(reading: Reading) -> Terms:
    """The terms of the wires, with the stiffnesses and masses of the run."""
    model, panel = reading.model, reading.model.panel
    nodes = np.arange(panel.node_count)
    last = panel.wire_first + panel.wire_count - 1
    before, after = nodes - 1, nodes + 1
    before[panel.wire_first], after[last] = last, panel.wire_first
    length = np.hypot(reading.edge[:, 0], reading.edge[:, 1])
    segment, hinge = length > 0.0, np.ones(len(nodes), dtype=bool)
    segment[last] &= panel.wire_closed
    hinge[panel.wire_first] = hinge[last] = panel.wire_closed
    if model.is_gripped:
        segment[panel.wire_first] = segment[last - 1] = False  # rigid, inside the clamps
    inverse = np.divide(1.0, length, out=np.zeros_like(length), where=length > 0.0)
    tangent = reading.edge * inverse[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    moment = reading.moment + reading.bow_moment
    shear = np.abs(moment - moment[after]) * inverse**2
    axial = np.repeat(reading.wire_axial, panel.wire_count) / (reading.natural_length * reading.length_factor)
    bend = model.bending_stiffness / (reading.hinge_length * reading.length_factor)
    inverse_mass = model.rest.inverse_mass.numpy().astype(float)[reading.entry]
    inverse_mass[panel.held_node] = 0.0
    return Terms(
        before=before,
        after=after,
        along=np.sqrt(np.where(segment, axial + shear, 0.0))[:, None] * tangent,
        across=np.sqrt(np.where(segment, np.maximum(reading.tension, 0.0) * inverse + shear, 0.0))[:, None] * normal,
        hinge=np.sqrt(np.where(hinge, bend, 0.0)),
        turn=normal * inverse[:, None],
        inverse_mass=inverse_mass,
    )


def near_contacts(reading: Reading, approach: float) -> Contacts:
    """Closed contacts with the weights they push with; those that are about to close as pushes at the nearest node."""
    panel, control = reading.model.panel, reading.control
    stiffness = np.sqrt(float(control[int(c.CONTACT_STIFFNESS)]))
    closed = reading.pair_force > 0.0
    # the gap of a pair that sleeps is an old one; what its wire and body must travel before it is looked at is not
    asleep = 2.0 * (reading.pair_wake - float(control[int(c.TRAVEL)]))
    near = closed | ((approach > 0.0) & (np.where(asleep > 0.0, asleep, reading.pair_gap) < approach))
    pair = np.nonzero(near)[0]
    wire = panel.wire_first[panel.pair_wire[pair]], panel.wire_count[panel.pair_wire[pair]]
    node = wire[0][:, None] + np.mod(reading.pair_node[pair, None] + np.arange(-1, 3) - wire[0][:, None], wire[1][:, None])
    push = np.zeros((len(pair), 4, 2))
    push[closed[pair]] = reading.pair_nodal[closed] / reading.pair_force[closed, None, None]
    there = np.nonzero(~closed[pair])[0]
    segment = reading.edge[node[there, 1]]
    normal = np.stack([-segment[:, 1], segment[:, 0]], axis=1) / np.maximum(np.hypot(*segment.T), 1e-300)[:, None]
    push[there, 1 + (reading.pair_u[pair[there]] > 0.5)] = normal
    push *= stiffness
    return Contacts(node, push, pair // 2, -push.sum(axis=1))


def collatz_bound(terms: Terms, contacts: Contacts | None, body_inverse_mass: float) -> float:
    """Largest (|G| d)_e/d_e, d being the row sums of |G|; `body_inverse_mass` [1/kg]."""
    count = len(terms.before)
    weight, contact_weight = np.ones((3, count)), np.ones(len(contacts.node) if contacts else 0)
    bound = np.inf
    for _ in range(PASSES):
        rows, contact_rows = _row_sums(terms, contacts, weight, contact_weight, body_inverse_mass)
        bound = min(bound, max((rows / weight).max(initial=0.0), (contact_rows / contact_weight).max(initial=0.0)))
        scale = max(rows.max(initial=0.0), contact_rows.max(initial=0.0), 1e-300)
        weight, contact_weight = np.maximum(rows / scale, LEAST_WEIGHT), np.maximum(contact_rows / scale, LEAST_WEIGHT)
    return float(bound)


def _row_sums(
    terms: Terms, contacts: Contacts | None, weight: np.ndarray, contact_weight: np.ndarray, body_inverse_mass: float
) -> tuple[np.ndarray, np.ndarray]:
    """|G| d of the wires (3, node) and of the contacts; signs are taken node by node, which no two terms that share nodes mind."""
    count = len(terms.before)
    rows, contact_rows = np.zeros((3, count)), np.zeros(len(contact_weight))
    for begin in range(0, count, CHUNK):
        nodes = np.arange(begin, min(begin + CHUNK, count))
        gradients, owner, kinds = terms.at(nodes)
        of_term = weight[kinds[:, None], owner]
        mass = terms.inverse_mass[nodes]
        for e in range(7):
            shared = np.abs(np.einsum("na,fna->fn", gradients[e], gradients))
            rows[kinds[e], owner[e]] += mass * np.einsum("fn,fn->n", shared, of_term)  # each owner is there once
    if contacts is None or not len(contacts.node):
        return rows, contact_rows
    nodes = contacts.node.ravel()
    gradients, owner, kinds = terms.at(nodes)
    push, mass = contacts.push.reshape(-1, 2), terms.inverse_mass[nodes]
    of_contact = np.repeat(contact_weight, 4)
    shared = mass * np.abs(np.einsum("na,fna->fn", push, gradients))
    for e in range(7):
        np.add.at(rows[kinds[e]], owner[e], shared[e] * of_contact)
    contact_rows += (shared * weight[kinds[:, None], owner]).sum(axis=0).reshape(-1, 4).sum(axis=1)
    contact_rows += abs(_between_contacts(contacts, terms.inverse_mass, body_inverse_mass)) @ contact_weight
    return rows, contact_rows


def _between_contacts(contacts: Contacts, inverse_mass: np.ndarray, body_inverse_mass: float) -> sparse.csr_matrix:
    """The part of G between contacts: through wires and through bodies that they share."""
    count = len(contacts.node)
    row = np.repeat(np.arange(count), 8)
    column = (2 * contacts.node[:, :, None] + np.arange(2)).ravel()
    wires = sparse.csr_matrix((contacts.push.ravel(), (row, column)), shape=(count, 2 * len(inverse_mass)))
    column = (2 * contacts.body[:, None] + np.arange(2)).ravel()
    size = 2 * (int(contacts.body.max()) + 1)
    bodies = sparse.csr_matrix((contacts.body_push.ravel(), (row[::4], column)), shape=(count, size))
    return wires @ sparse.diags(np.repeat(inverse_mass, 2)) @ wires.T + body_inverse_mass * (bodies @ bodies.T)
