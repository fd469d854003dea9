"""Augmented Lagrangian multipliers of contact between wires, and the penalty that follows the contact force.

A contact pushes with N = k (overlap + offset); at each convergence check the offsets at its nodes take up a share of its overlap,
until it carries its force without overlap. The penalty may then be soft: it follows the force, k = FORCE_PENALTY N/d, and is at
least `floor`. A soft contact is about as stiff as the loops that it connects, so it does not make the masses heavy. Contacts that
share nodes share offsets: where their overlaps stall above the tolerance, the penalty is raised.
"""

from __future__ import annotations

import numpy as np

from ..host import fetch, store
from ..kernels import control as c
from .contacts import Contacts
from .search_cells import MAX_OFFSET
from .stalled import Stalled
from .wire_contact import WireContact

OVERLAP_ERROR = 0.004  # of the thickness: allowed overlap of a contact
FORCE_PENALTY = 20.0  # penalty over N/d: a twentieth of the thickness is the overlap of a force without offset
GROWTH, DECAY = 8.0, 0.5  # largest changes of a penalty at a check
WITHOUT_CONTACT = 0.5  # share of the offset that is left after a check without contact
LOADED, SLOW = 0.2, 0.01  # share of the floor that is kept once the load is applied and no wire moves faster [thicknesses a step]
NEIGHBOUR = 0.1  # weight of a contact at the two nodes beyond its segment
LEAST_WEIGHT = 0.3  # the same at the two nodes of its segment, at least
RAISED, MOST_RAISED = 2.0, 64.0  # factor of the penalty where overlaps stall, and the most that it comes to


class ContactMultipliers:
    """Offsets and penalties of the contacts of rods."""

    def __init__(self, contact: WireContact, floor: float) -> None:
        """floor [N/m]: smallest penalty; it is the penalty of all contacts from now on."""
        rods = contact.stepper.rods
        self._floor, self._nodes = floor, rods.node_count
        self._state = contact.stepper.state
        self._after, self._before = rods.following, rods.previous
        self._thickness = rods.section.thickness
        self._stalled = Stalled(rods.node_count, OVERLAP_ERROR)
        self.raised = np.ones(rods.node_count)  # [node] factor of the penalty where overlaps have stalled
        self.mean_force = 0.0  # [N] of the contacts
        store(self._state.contact_penalty, floor)

    @property
    def _loading_floor(self) -> float:
        """[N/m] smallest penalty while a load is applied: new contacts may have to carry as much as others at once."""
        return max(self._floor, FORCE_PENALTY * self.mean_force / self._thickness)

    def error(self, touching: Contacts) -> float:
        """Largest of `errors`, in thicknesses."""
        return float(self._errors(touching).max(initial=0.0))

    def _errors(self, touching: Contacts) -> np.ndarray:
        """[contact] overlap or gap over the thickness; of forces below the mean, in proportion; not of saddles."""
        force = np.maximum(touching.force, 0.0)
        mean = float(force[force > 0.0].mean()) if (force > 0.0).any() else 0.0
        share = np.minimum(1.0, force / max(mean, 1e-300))
        return np.asarray(share * np.abs(touching.overlap) / self._thickness)

    def renew(self, touching: Contacts, rate: float, *, loading: bool) -> None:
        """Move the offsets by `rate` times the overlaps, and the penalties with the forces."""
        pushing = touching.force > 0.0
        force, overlap = touching.force[pushing], touching.overlap[pushing]
        node, weight, which = self._spread(touching, pushing)
        nodes = self._nodes
        weight = weight * force[which]
        total = np.bincount(node, weight, nodes)
        mean_overlap = np.bincount(node, weight * overlap[which], nodes) / np.maximum(total, 1e-300)
        largest = np.zeros(nodes)
        np.maximum.at(largest, node, force[which])
        is_touched = total > 0.0
        state = self._state
        before, offset = fetch(state.contact_penalty), fetch(state.contact_offset)
        if len(force):
            self.mean_force = float(force.mean())
        is_fast = loading or float(state.read_control()[int(c.SPEED_MAX)]) > SLOW * self._thickness
        floor = self._loading_floor if is_fast else LOADED * self._floor
        if not loading:
            self._raise_stalled(touching)
        wanted = np.maximum(floor, FORCE_PENALTY * self.raised * largest / self._thickness)
        penalty = np.where(is_touched, np.clip(wanted, DECAY * before, GROWTH * before), floor)
        penalty = np.maximum(penalty, floor)
        # the force of the offset is kept
        moved = offset * before / penalty + 0.5 * rate * mean_overlap
        offset = np.where(is_touched, moved, WITHOUT_CONTACT * offset)
        store(state.contact_penalty, penalty)
        store(state.contact_offset, np.clip(offset, 0.0, MAX_OFFSET * self._thickness))

    def _raise_stalled(self, touching: Contacts) -> None:
        """Raise the penalty at the nodes of contacts whose overlaps have stalled."""
        everywhere = np.ones(len(touching.force), dtype=bool)
        node, weight, which = self._spread(touching, everywhere)
        inside = weight > NEIGHBOUR
        error = np.zeros(self._nodes)
        np.maximum.at(error, node[inside], self._errors(touching)[which[inside]])
        stalled = self._stalled.after(error)
        self.raised[stalled] = np.minimum(RAISED * self.raised[stalled], MOST_RAISED)

    def state_dict(self) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint, beside the state of the rods."""
        return {
            "penalty_raised": self.raised.copy(),
            "mean_contact_force": np.array(self.mean_force),
            **self._stalled.state_dict("overlap"),
        }

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Restore what `state_dict` returned."""
        self.raised, self.mean_force = kept["penalty_raised"].copy(), float(kept["mean_contact_force"])
        self._stalled.load_state_dict("overlap", kept)

    def stiffen(self) -> None:
        """Raise the penalties to the floor for a load to come; the forces of the offsets are kept."""
        self.raised[:] = 1.0
        self._stalled.reset()
        state = self._state
        before = fetch(state.contact_penalty)
        penalty = np.maximum(before, self._loading_floor)
        store(state.contact_offset, fetch(state.contact_offset) * before / penalty)
        store(state.contact_penalty, penalty)

    @property
    def push(self) -> np.ndarray:
        """[node] [N] force of the offsets: what the contacts at a node push with, without overlap."""
        return np.asarray(fetch(self._state.contact_offset) * fetch(self._state.contact_penalty))

    def add_push(self, push: np.ndarray) -> None:
        """Add to the forces [node] [N] of the offsets."""
        penalty = np.maximum(fetch(self._state.contact_penalty), 1e-300)
        store(self._state.contact_offset, np.clip((self.push + push) / penalty, 0.0, MAX_OFFSET * self._thickness))

    def raise_to(self, penalty: np.ndarray, raised: np.ndarray, mean_force: float) -> None:
        """Raise penalties [node] [N/m] and their factors to at least these; the forces of the offsets are kept."""
        state, push = self._state, self.push
        store(state.contact_penalty, np.maximum(fetch(state.contact_penalty), penalty))
        self.raised = np.clip(raised, self.raised, MOST_RAISED)
        self.mean_force = max(self.mean_force, mean_force)
        self.add_push(push - self.push)

    def _spread(self, contacts: Contacts, which: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Nodes of contacts with their weights, and the contact among `which` that each belongs to."""
        nodes, weights = [], []
        for first, place in ((contacts.first, contacts.place[:, 0]), (contacts.second, contacts.place[:, 1])):
            node, s = first[which], place[which]
            after = self._after[node]
            beyond = np.full(len(node), NEIGHBOUR)
            nodes += [self._before[node], node, after, self._after[after]]
            weights += [beyond, np.maximum(1.0 - s, LEAST_WEIGHT), np.maximum(s, LEAST_WEIGHT), beyond]
        node, weight = np.concatenate(nodes), np.concatenate(weights)
        contact = np.tile(np.arange(int(np.count_nonzero(which))), len(nodes))
        there = node >= 0
        return node[there], weight[there], contact[there]
