"""Finding the strain at which the mesh carries a wanted tension, one steady state after the other.

Broyden's method on the directions that are driven by tension; the mesh stiffens with strain, so steps are bounded and the
tangent kept positive.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

STEP_LIMIT = 0.02  # strain
TOLERANCE = 2e-3  # of the target
MOST_STATES = 60  # steady states tried for one load level


@dataclass
class TensionSearch:
    """What is known of the tangent; plain numbers, so that a checkpoint can hold it."""

    stiffness: list[list[float]] = field(default_factory=list)  # [N/m] change of tension by strain, (2, 2)
    strain: list[float] | None = None  # of the last state
    tension: list[float] | None = None  # [N/m] of the last state
    states: int = 0  # of this level

    def begin_level(self) -> None:
        self.states = 0

    def next_strain(
        self, strain: np.ndarray, tension: np.ndarray, target: np.ndarray, driven: np.ndarray, scale: float
    ) -> np.ndarray | None:
        """Strain (2,) to try next, or None where the tension is met.

        strain, tension [N/m], target [N/m] are (weft, warp); `driven` says which of them go by tension; `scale` [N/m] is
        EI/C^3, a first guess of the stiffness and the measure of a small tension.
        """
        if not self.stiffness:
            self.stiffness = (scale * np.eye(2)).tolist()
        k = np.array(self.stiffness)
        if self.strain is not None and self.tension is not None:
            moved = strain - np.array(self.strain)
            if moved @ moved > 1e-16:
                k = k + np.outer(tension - np.array(self.tension) - k @ moved, moved) / (moved @ moved)
        least = 0.02 * scale
        k[np.diag_indices(2)] = np.maximum(np.diag(k), least)
        self.stiffness, self.strain, self.tension = k.tolist(), strain.tolist(), tension.tolist()
        self.states += 1
        miss = np.where(driven, target - tension, 0.0)
        if np.all(np.abs(miss) <= TOLERANCE * np.maximum(np.abs(target), 0.01 * scale)):
            return None
        step = np.zeros(2)
        index = np.nonzero(driven)[0]
        step[index] = np.linalg.lstsq(k[np.ix_(index, index)], miss[index], rcond=None)[0]
        largest = np.abs(step).max()
        if largest > STEP_LIMIT:
            step *= STEP_LIMIT / largest
        return strain + step
