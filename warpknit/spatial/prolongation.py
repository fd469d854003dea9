"""Prolongation of a spatial mesh from a smaller one (warpknit/transfer/prolongation.py).

A gripped mesh takes the fields of a smaller gripped one, edges and corners included, in place of its own: contacts close together
only where wires lie as they do on the smaller mesh, and at small strain either mesh may have settled in another of many nearly
equal states. A periodic smaller mesh does not know the edges: its change is added.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ..transfer.prolongation import RepeatProlongation
from ..transfer.repeat_mesh import RepeatArrays
from ..transfer.response import Response
from .fields import Fields


class Prolongation:
    """Brings a large mesh to the state of a small one."""

    def __init__(self, large: Fields, small: Fields, arrays: RepeatArrays) -> None:
        """arrays: of the large mesh."""
        self.large, self.small = large, small
        self._repeats = RepeatProlongation(large.model, small.model, arrays)
        self._adds = self._repeats.is_periodic
        self._last = small.read()
        self._nodes = large.model.panel.node_count
        self._one = wp.full(len(large.model.panel.wire_first), 1.0, dtype=wp.float64, device=large.model.device)

    def state_dict(self) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint."""
        return {f"prolonged_{name}": value for name, value in self._last.items()}

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        self._last = {name: kept[f"prolonged_{name}"] for name in self._last}

    def carry(self, response: Response) -> None:
        """Bring the large mesh to the state of the small one, and raise its stiffnesses to those of the small one.

        `response`: of the cloth at the load.
        """
        values, stiffness, device = self.small.read(), self.small.read_stiffness(), self.large.model.device
        last, self._last = self._last, values
        moved = any(np.any(values[name] != last[name]) for name in values)
        taken = {name: value - last[name] for name, value in values.items()} if self._adds else values
        change: dict[str, wp.array] = {
            name: wp.array(value, dtype=wp.float64, device=device) for name, value in (stiffness | taken).items()
        }
        stiffness = {name: self._prolonged(name, change, response) for name in stiffness}
        self.large.stiffen(stiffness, self.small.multipliers.mean_force)
        if self._adds:
            self.large.add({name: self._prolonged(name, change, response) for name in values})
        elif moved:
            self.large.replace({name: self._prolonged(name, change, response) for name in values}, self._has_source(response))

    def _has_source(self, response: Response) -> np.ndarray:
        """[panel node] of the large mesh: whether it has a source on the small one."""
        device, nodes = self.large.model.device, self.small.model.panel.node_count
        none, one = (wp.full(nodes, value, dtype=wp.float64, device=device) for value in (0.0, 1.0))
        return self._prolonged("push", {"x": none, "y": none, "push": one}, response) > 0.0

    def _prolonged(self, name: str, change: dict[str, wp.array], response: Response) -> np.ndarray:
        """[panel node] of the large mesh, from values of the small one."""
        value = wp.zeros(self._nodes, dtype=wp.float64, device=self.large.model.device)
        self._repeats.add_to_nodes(value, name, change, response, self._one)
        return np.asarray(value.numpy())
