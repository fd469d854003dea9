"""Work of what differs from place to place: clamps that leave the affinely mapped outline, and temperatures that are not even.

Added up from one recorded state to the next by the mean of the forces at both (the trapezoidal rule).
"""

from __future__ import annotations

import numpy as np


class EdgeWork:
    """Keeps the account over the records of a run."""

    def __init__(self) -> None:
        self._work = 0.0
        self._last: list[np.ndarray] = []  # forces [N], displacements [m], forces [J] on thermal strains, thermal strains

    def account(self, *pushed: tuple[np.ndarray, np.ndarray]) -> float:
        """[J] since the first record, this one included: by forces and what they move, such as [N] and [m], of equal shapes."""
        now = [values for pair in pushed for values in pair]
        if self._last:
            for force in range(0, len(now), 2):
                mean = 0.5 * (now[force] + self._last[force])
                self._work += float(np.sum(mean * (now[force + 1] - self._last[force + 1])))
        self._last = now
        return self._work

    def state_dict(self) -> dict[str, np.ndarray]:
        """What a checkpoint keeps."""
        return {"edge_work": np.array(self._work)} | {f"edge_work_{k}": value for k, value in enumerate(self._last)}

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `state_dict` returned."""
        self._work = float(kept["edge_work"])
        self._last = [kept[f"edge_work_{k}"] for k in range(len(kept)) if f"edge_work_{k}" in kept]
