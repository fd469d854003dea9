"""One repeat of thin wires: branches between nodes, each of two straight halves, and contacts between nodes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


def _none() -> np.ndarray:
    return np.zeros((0, 2), dtype=np.int64)


@dataclass(frozen=True, eq=False)
class ThinWires:
    """Branches and contacts of a periodic mesh. A shift counts the periods from the first end to the second."""

    cell: np.ndarray  # (2, 2) [m] rows are the periods, at any angle
    radius: float  # [m] equivalent radius of the yarn
    node: np.ndarray  # (node, 3) [m]
    branch_node: np.ndarray  # (branch, 2)
    branch_shift: np.ndarray  # (branch, 2)
    contact_node: np.ndarray = field(default_factory=_none)  # (contact, 2)
    contact_shift: np.ndarray = field(default_factory=_none)  # (contact, 2)
    branch_middle: np.ndarray | None = None  # (branch, 3) [m] where the halves meet, as drawn from the first end; None: straight

    @property
    def branches(self) -> np.ndarray:
        """(branch, 3) [m] from the first end to the second."""
        return self._span(self.branch_node, self.branch_shift)

    @property
    def halves(self) -> tuple[np.ndarray, np.ndarray]:
        """(branch, 3) [m] of the first halves and of the second ones."""
        branch = self.branches
        first = 0.5 * branch if self.branch_middle is None else self.branch_middle - self.node[self.branch_node[:, 0]]
        return first, branch - first

    @property
    def contacts(self) -> np.ndarray:
        """(contact, 3) [m] from axis to axis."""
        return self._span(self.contact_node, self.contact_shift)

    def _span(self, ends: np.ndarray, shift: np.ndarray) -> np.ndarray:
        span = self.node[ends[:, 1]] - self.node[ends[:, 0]]
        span[:, :2] += shift @ self.cell
        return np.asarray(span)
