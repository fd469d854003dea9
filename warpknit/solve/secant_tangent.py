"""The tangent of the tensions of a mesh by its strains, from a sequence of equilibria: Broyden's method."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

STEP_LIMIT = 0.02  # strain


@dataclass
class SecantTangent:
    """Secant tangent in weft and warp, as plain numbers for a checkpoint."""

    stiffness: list[list[float]] = field(default_factory=list)  # [N/m] change of tension by strain, (2, 2)
    strain: list[float] | None = None  # of the last state
    tension: list[float] | None = None  # [N/m] of the last state

    def predicted_strain(self, target: np.ndarray, driven: np.ndarray) -> np.ndarray | None:
        """Strain (2,) at which the tension `target` [N/m] is expected; None before there is a tangent."""
        if not self.stiffness:
            return None
        return np.array(self.strain) + self.step(target - np.array(self.tension), driven)

    def step(self, miss: np.ndarray, driven: np.ndarray) -> np.ndarray:
        """Strain step (2,) of the `driven` directions for a change of tension `miss` [N/m], at most STEP_LIMIT."""
        k, step, index = np.array(self.stiffness), np.zeros(2), np.nonzero(driven)[0]
        step[index] = np.linalg.lstsq(k[np.ix_(index, index)], miss[index], rcond=None)[0]
        if step @ miss <= 0.0:  # of a stable mesh it is positive, as its tangent is: go on, past the snap
            step[index] = miss[index] / np.diag(k)[index]
        return np.asarray(step * min(1.0, STEP_LIMIT / max(float(np.abs(step).max()), 1e-300)))

    def renew(self, strain: np.ndarray, tension: np.ndarray, driven: np.ndarray, significant: float, least: float) -> bool:
        """Take a change of tension, if it is `significant` [N/m], into the tangent; its diagonal is at least `least` [N/m].

        Returns whether the tangent is renewed.
        """
        if self.strain is None or self.tension is None:
            self.strain, self.tension = strain.tolist(), tension.tolist()
            return False
        moved, pulled = strain - np.array(self.strain), tension - np.array(self.tension)
        if not moved.any():
            return False
        if not self.stiffness:
            ratio = np.divide(pulled, moved, out=np.zeros(2), where=moved != 0.0)
            k = np.diag(np.where(driven & (ratio > 0.0), ratio, ratio.max()))
        else:
            k = np.array(self.stiffness)
            if max(np.abs(pulled).max(), np.abs(k @ moved).max()) < significant:
                return False
            k = k + np.outer(pulled - k @ moved, moved) / (moved @ moved)
        k[np.diag_indices(2)] = np.maximum(np.diag(k), least)
        self.stiffness, self.strain, self.tension = k.tolist(), strain.tolist(), tension.tolist()
        return True
