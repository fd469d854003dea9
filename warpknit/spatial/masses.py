"""Masses of rods that couple neighbours along the wire (kernels/banded_mass.py), on the host."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Masses:
    """Masses [kg] and spin inertias [kg m2], arrays [node]: diagonals and couplings (kernels/banded_mass.py)."""

    node: np.ndarray  # (node, 3) along x, y and z
    next: np.ndarray
    second: np.ndarray
    spin: np.ndarray
    next_spin: np.ndarray

    @staticmethod
    def diagonal(node: np.ndarray, spin: np.ndarray) -> Masses:
        """Masses without couplings, node [node] the same along x, y and z."""
        none = np.zeros(len(node))
        return Masses(np.repeat(node[:, None], 3, axis=1), none, none, spin, none)
