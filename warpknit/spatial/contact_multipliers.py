"""Augmented Lagrangian multipliers of contact between wires, and the force-dependent penalty.

A contact pushes with N = k (overlap + offset). At each convergence check the offsets at its nodes grow by a share of its overlap,
until the contact carries its force without overlap. So the penalty may be soft: it follows the force, k = FORCE_PENALTY N/d, and
is at least `floor`. A soft contact is about as stiff as the loops that it connects, so it does not make the masses heavy.
Contacts that share nodes share offsets: where their overlaps stall above the tolerance, the penalty is raised.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..compute.host import fetch, store
from ..kernels.contact_checks import MOST_RAISED, renew_contact_offsets
from ..mechanics.numerics import TYPICAL_ALLOWANCE, error_ratio
from .pair_search import MAX_OFFSET
from .wire_contact import ContactSums, WireContact

OVERLAP_ERROR = 0.004  # of the thickness: allowed overlap of a contact; penalties are raised where one stalls above its rms
FORCE_PENALTY = 20.0  # penalty over N/d: a twentieth of the thickness is the overlap of a force without offset
# shares of the floor that are kept once the load is applied, by the mean force, and no wire moves faster [thicknesses a step]
SOFTEST, LOADED, SLOW = 0.02, 0.2, 0.01


@dataclass(frozen=True)
class _OverlapArrays:
    """History of the overlaps at the nodes; [node]."""

    penalty_raised: wp.array  # factor of the penalty where overlaps have stalled
    overlap_best: wp.array  # [m] at the last progress
    overlap_checks: wp.array  # int, without progress since


class ContactMultipliers:
    """Offsets and penalties of the contacts of rods (kernels/contact_checks.py)."""

    KEPT = ("_arrays", "mean_force", "loading_factor")

    def __init__(self, contact: WireContact, floor: float, softest: float = SOFTEST) -> None:
        """floor [N/m]: smallest penalty; it is the penalty of all contacts from now on; softest: see SOFTEST."""
        rods, device = contact.stepper.rods, contact.stepper.device
        nodes = rods.node_count
        self._contact, self._floor, self._softest = contact, floor, softest
        self._state = contact.stepper.state
        self._thickness = rods.section.thickness
        self._arrays = _OverlapArrays(
            wp.full(nodes, 1.0, dtype=wp.float64, device=device),
            wp.full(nodes, np.inf, dtype=wp.float64, device=device),
            wp.zeros(nodes, dtype=wp.int32, device=device),
        )
        self._constants = {
            "force_penalty": wp.float64(FORCE_PENALTY / self._thickness),
            "allowed": wp.float64(TYPICAL_ALLOWANCE * OVERLAP_ERROR * self._thickness),
            "most_offset": wp.float64(MAX_OFFSET * self._thickness),
        }
        self.mean_force = np.zeros(contact.stepper.worlds)  # [world] [N] of the contacts
        self.loading_factor = np.ones(contact.stepper.worlds)  # [world] of the penalty while a load is applied
        store(self._state.contact_penalty, floor)

    @property
    def raised(self) -> np.ndarray:
        """[node] factor of the penalty where overlaps have stalled."""
        return fetch(self._arrays.penalty_raised)

    @property
    def _loading_floor(self) -> np.ndarray:
        """[world] [N/m] smallest penalty while a load is applied: new contacts may have to carry as much as others at once."""
        return np.asarray(self.loading_factor * np.maximum(self._floor, FORCE_PENALTY * self.mean_force / self._thickness))

    def error_ratio(self, contacts: ContactSums) -> np.ndarray:
        """[row] overlaps over their tolerance."""
        allowed = OVERLAP_ERROR * self._thickness
        return error_ratio(contacts.overlap_square, contacts.pushing, contacts.overlap_max, allowed)

    def renew(self, contacts: ContactSums, rate: np.ndarray, rows: np.ndarray, *, loading: np.ndarray) -> None:
        """Move offsets by `rate` [row] times the overlaps, and penalties with the forces."""
        steering = self._contact.stepper.steering
        self.mean_force[rows] = np.where(contacts.mean_push > 0.0, contacts.mean_push, self.mean_force[rows])
        is_fast = loading | (steering.speed_max[rows] > SLOW * self._thickness)
        of_force = FORCE_PENALTY * self.mean_force[rows] / self._thickness
        soft = np.clip(of_force, self._softest * self._floor, LOADED * self._floor)
        floor = np.where(is_fast, self._loading_floor[rows], soft)
        steering.set(rows, multiplier_rate=rate, penalty_floor=floor, loading=loading)
        self._contact.launch(renew_contact_offsets, self._arrays, **self._constants)

    def stiffen(self, rows: np.ndarray | None = None) -> None:
        """Raise the penalties of worlds for the next load, and reset stalled overlaps."""
        stepper, arrays = self._contact.stepper, self._arrays
        rows = stepper.rows if rows is None else rows
        for array, value in ((arrays.penalty_raised, 1.0), (arrays.overlap_best, np.inf), (arrays.overlap_checks, 0)):
            stepper.store_rows(array, rows, value)
        self.raise_to_floor(rows)

    def raise_to_floor(self, rows: np.ndarray) -> None:
        """Raise the penalties of worlds for contacts that close fast; the forces of the offsets are kept."""
        stepper, state = self._contact.stepper, self._state
        before, offset = (stepper.by_world(array)[rows] for array in (state.contact_penalty, state.contact_offset))
        penalty = np.maximum(before, self._loading_floor[rows, None])
        stepper.store_rows(state.contact_offset, rows, offset * before / penalty)
        stepper.store_rows(state.contact_penalty, rows, penalty)

    @property
    def push(self) -> np.ndarray:
        """[node] [N] force of the contacts at a node without overlap: penalty times offset."""
        return np.asarray(fetch(self._state.contact_offset) * fetch(self._state.contact_penalty))

    def add_push(self, push: np.ndarray) -> None:
        """Add to the forces [node] [N] of the offsets."""
        penalty = np.maximum(fetch(self._state.contact_penalty), 1e-300)
        store(self._state.contact_offset, np.clip((self.push + push) / penalty, 0.0, MAX_OFFSET * self._thickness))

    def raise_to(self, penalty: np.ndarray, raised: np.ndarray, mean_force: np.ndarray) -> None:
        """Raise penalties [node] [N/m] and their factors to at least these; the forces of the offsets are kept."""
        state, push = self._state, self.push
        store(state.contact_penalty, np.maximum(fetch(state.contact_penalty), penalty))
        store(self._arrays.penalty_raised, np.clip(raised, self.raised, MOST_RAISED))
        self.mean_force = np.maximum(self.mean_force, mean_force)
        self.add_push(push - self.push)
