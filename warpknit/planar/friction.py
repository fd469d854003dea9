"""Friction forces between bodies and wires (kernels/contact_friction.py)."""

from __future__ import annotations

import numpy as np

from ..kernels.contact_friction import LOOSE, TANGENTIAL
from .host_state import HostState


def friction_stiffness(r: HostState) -> float:
    """[N/m] tangential stiffness of a sticking contact."""
    return float(TANGENTIAL) * float(r.control.contact_stiffness)


def friction_force(r: HostState) -> np.ndarray:
    """[pair] [N] friction force on the contact points along their wires."""
    force = np.zeros(len(r.pair_force))
    if not len(r.pair_stuck):
        return force
    sticks = np.flatnonzero((r.pair_stuck != float(LOOSE)) & (r.pair_force > 0))
    slip = (r.pair_slide + r.pair_u - r.pair_stuck)[sticks] * r.model.table.rest_length[r.model.panel.pair_table[sticks]]
    limit = r.model.scene.contact.friction * r.pair_force[sticks]
    force[sticks] = np.clip(-friction_stiffness(r) * slip, -limit, limit)
    return force


def friction_energy(r: HostState) -> float:
    """[J] elastic energy of sticking contacts: F_t^2/(2 k_t) each."""
    if not len(r.pair_stuck):
        return 0.0
    force = friction_force(r)
    return float(np.sum(0.5 * force**2) / friction_stiffness(r))
