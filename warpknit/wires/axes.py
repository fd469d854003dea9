"""Turning what a file calls up into z, which is across the mesh."""

from __future__ import annotations

import numpy as np

_UPRIGHT = {
    0: np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),  # x up: y, z, x
    1: np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),  # y up: x, -z, y, as tools with z up read such files
    2: np.eye(3),
}


def upright(points: np.ndarray, up: int) -> np.ndarray:
    """Points (..., 3) turned so that their axis `up` (0, 1 or 2) is z; a rotation, so nothing is mirrored."""
    return points @ _UPRIGHT[up].T
