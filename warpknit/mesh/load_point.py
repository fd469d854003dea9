"""A point in the space of loads: what a boundary imposes on a mesh."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

PATH_STRAIN = 0.005  # between equilibria where the state depends on the load history, at most


@dataclass(frozen=True)
class LoadPoint:
    """A deformation gradient and what goes with it."""

    gradient: np.ndarray  # (2, 2)
    temperature: float  # [K] in the middle
    temperature_gradient: tuple[float, float] = (0.0, 0.0)  # [K/m]
    stations: np.ndarray | None = None  # (station, 2) [m] displacement of the rim (rim.py) from the affinely mapped outline

    def strained(self, gradient: np.ndarray) -> LoadPoint:
        """The same at another deformation gradient (2, 2)."""
        return replace(self, gradient=gradient)
