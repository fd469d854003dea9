"""Prolongation of a spatial mesh from a smaller one (warpknit/mechanics/prolongation.py)."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.host import take
from ..mechanics.numerics import MAX_OVERLAP
from ..mechanics.prolongation import RepeatProlongation
from ..mechanics.repeat_mesh import RepeatArrays
from ..mechanics.response import Response
from .fields import Fields


class Prolongation:
    """Brings a large mesh to the state of a small one."""

    KEPT = ("_last",)

    def __init__(self, large: Fields, small: Fields, arrays: RepeatArrays) -> None:
        """arrays: of the large mesh."""
        self.large, self.small = large, small
        self._repeats = RepeatProlongation(large.model, small.model, arrays)
        self._last = small.read_everywhere()
        self._nodes = large.model.panel.node_count
        self._one = wp.full(len(large.model.panel.wire_first), 1.0, dtype=wp.float64, device=large.model.device)

    def carry(self, response: Response) -> bool:
        """Bring the large mesh to the state of the small one, and raise its stiffnesses to those of the small one.

        `response`: of the cloth at the load. False where wires would overlap: the large mesh keeps its own state.
        """
        last, self._last = self._last, self.small.read_everywhere()
        taken, stiffness = self._repeats.taken(self._last, last), self.small.read_stiffness()
        change: dict[str, wp.array] = {
            name: wp.array(value, dtype=wp.float64, device=self.large.model.device)
            for name, value in (stiffness | (self._last if taken is None else taken)).items()
        }
        raised = {name: self._prolonged(name, change, response) for name in stiffness}
        self.large.stiffen(raised, self.small.multipliers.mean_force)
        if taken is None:
            return True
        own = self.large.read() if self._repeats.replaces else dict.fromkeys(taken, 0.0)
        before = self.large.snapshot()
        self.large.add({name: self._prolonged(name, change, response) - own[name] for name in taken})
        if self.large.overlap() <= MAX_OVERLAP:  # else wires may push each other through
            return True
        self.large.put_back(before)
        return False

    def _prolonged(self, name: str, change: dict[str, wp.array], response: Response) -> np.ndarray:
        """[panel node] of the large mesh, from values of the small one."""
        value = wp.zeros(self._nodes, dtype=wp.float64, device=self.large.model.device)
        self._repeats.add_to_nodes(value, name, change, response, self._one)
        return take(value)
