"""A point in load space: deformation, temperature and pulls that the boundary imposes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

PATH_STRAIN = 0.005  # between equilibria where the state depends on the load history, at most


@dataclass(frozen=True)
class LoadPoint:
    """A deformation gradient, temperatures and pulls."""

    gradient: np.ndarray  # (2, 2)
    temperature: float  # [K] in the middle
    temperature_gradient: tuple[float, float] = (0.0, 0.0)  # [K/m]
    stations: np.ndarray | None = None  # (station, 2) [m] displacement of the rim (rim.py) from the affinely mapped outline

    def is_as_knitted(self, reference_temperature: float) -> bool:
        """Whether this is the unloaded state at a temperature [K]."""
        moved = self.stations is not None and bool(self.stations.any())
        even = not any(self.temperature_gradient) and self.temperature == reference_temperature
        return np.array_equal(self.gradient, np.eye(2)) and even and not moved

    def strained(self, gradient: np.ndarray) -> LoadPoint:
        """The same at another deformation gradient (2, 2)."""
        return replace(self, gradient=gradient)
