"""Friction between bodies and wires, as a state at rest or a step on the way has it (kernels/friction.py)."""

from __future__ import annotations

import numpy as np

from ..kernels import control as c
from ..kernels.friction import LOOSE, TANGENTIAL
from .host_state import HostState


def friction_stiffness(r: HostState) -> float:
    """[N/m] of the spring by which a contact sticks to its wire."""
    return float(TANGENTIAL) * float(r.control[int(c.CONTACT_STIFFNESS)])


def friction_pull(r: HostState) -> np.ndarray:
    """[pair] [N] by which friction draws contact points back along their wires."""
    pull = np.zeros(len(r.pair_force))
    if not len(r.pair_stuck):
        return pull
    sticks = np.flatnonzero((r.pair_stuck != float(LOOSE)) & (r.pair_force > 0))
    moved = (r.pair_slide + r.pair_u - r.pair_stuck)[sticks] * r.model.table.rest_length[r.model.panel.pair_table[sticks]]
    most = r.model.scene.contact.friction * r.pair_force[sticks]
    pull[sticks] = np.clip(-friction_stiffness(r) * moved, -most, most)
    return pull


def friction_energy(r: HostState) -> float:
    """[J] of the springs by which contacts stick to their wires: F_t^2/(2 k_t) each."""
    if not len(r.pair_stuck):
        return 0.0
    pull = friction_pull(r)
    return float(np.sum(0.5 * pull**2) / friction_stiffness(r))
