"""Sliding of wires along each other."""

from __future__ import annotations

import numpy as np


def wires_slid(displacement: np.ndarray, wire_start: np.ndarray) -> float:
    """[m] largest difference between the mean displacements of two wires along one axis.

    displacement: (node, 2 or 3) [m] from the place to which the load carries a node by itself; wire_start: [wire] first nodes.
    """
    total = np.add.reduceat(displacement, wire_start, axis=0)
    count = np.diff(np.append(wire_start, len(displacement)))
    return float(np.ptp(total / count[:, None], axis=0).max())
