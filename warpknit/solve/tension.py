"""The strain at which the mesh carries a prescribed tension, by Broyden's method over equilibria.

Only tension-driven directions are unknowns. The mesh stiffens with strain, so steps are bounded and the diagonal of the
tangent is kept positive.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

STEP_LIMIT = 0.02  # strain
TOLERANCE = 2e-3  # relative to the target
MAX_STATES = 60  # equilibria tried for one load level


@dataclass
class TensionSearch:
    """Secant tangent of the search, as plain numbers for a checkpoint."""

    stiffness: list[list[float]] = field(default_factory=list)  # [N/m] change of tension by strain, (2, 2)
    strain: list[float] | None = None  # of the last state
    tension: list[float] | None = None  # [N/m] of the last state
    states: int = 0  # of this level

    def begin_level(self) -> None:
        self.states = 0

    def next_strain(
        self, strain: np.ndarray, tension: np.ndarray, target: np.ndarray, driven: np.ndarray, scale: float
    ) -> np.ndarray | None:
        """Strain (2,) to try next, or None where the tension is reached.

        strain, tension [N/m], target [N/m] are (weft, warp); `driven` marks the directions driven by tension; `scale`
        [N/m] is EI/C^3, the first guess of the stiffness.
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
