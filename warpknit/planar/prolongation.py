"""Prolongation of a planar mesh from a smaller one (warpknit/mechanics/prolongation.py)."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..mechanics.prolongation import RepeatProlongation
from ..mechanics.response import Response
from .join import Join
from .model import Model
from .state import State
from .state_variables import state_variables


class Prolongation:
    """Brings a large mesh to the state of a small one."""

    KEPT = ("_last",)

    def __init__(self, large: Model, large_state: State, small: Model, small_state: State) -> None:
        self.large, self.large_state = large, large_state
        self.small, self.small_state = small, small_state
        self._last = state_variables(small, small_state)
        self._repeats = RepeatProlongation(large, small, large.mesh, large.rest, large.constants)
        self._one = wp.full(len(large.panel.wire_first), 1.0, dtype=large.precision.real, device=large.device)

    def carry(self, response: Response) -> bool:
        """Bring the large mesh to the state of the small one; update its stiffnesses and masses.

        `response`: of the cloth at the load. True: bodies of a plane take any displacement.
        """
        large, state, repeats = self.large, self.large_state, self._repeats
        self._follow_stiffness()
        last, self._last = self._last, state_variables(self.small, self.small_state)
        now, counts = state.parity, 1.0 / large.precision.unit
        taken = repeats.taken(self._last, last)
        if taken is None:
            return True
        if repeats.replaces:
            own = (state.node_ux[now], state.node_uy[now], state.tension_offset, state.body_ux, state.body_uy, state.pair_offset)
            for array in own:
                array.zero_()
        change: dict[str, wp.array] = {
            name: wp.array(value, dtype=large.precision.real, device=large.device) for name, value in taken.items()
        }
        repeats.add_to_nodes(state.node_ux[now], "x", change, response, self._one, counts)
        repeats.add_to_nodes(state.node_uy[now], "y", change, response, self._one, counts)
        repeats.add_to_nodes(state.tension_offset, "tension", change, response, self._one)
        repeats.add_to_nodes(state.tension_offset, "strain", change, response, state.wire_axial, -1.0)
        repeats.add_to_bodies(state.body_ux, "body_x", change, response, counts)
        repeats.add_to_bodies(state.body_uy, "body_y", change, response, counts)
        repeats.add_to_bodies(state.pair_offset, "body_offset", change, response, per_body=2, is_positive=True)
        return True

    def _follow_stiffness(self) -> None:
        """Raise stiffness and mass of each wire to the largest of its source wires on the small mesh."""
        large, small = self.large.panel, self.small.global_model.panel
        join = Join(self.small, everywhere=True)
        source = self._repeats.source_of_blocks()
        wire = np.searchsorted(small.wire_first, np.maximum(source, 0), side="right") - 1
        starts = np.searchsorted(large.block_wire, np.arange(len(large.wire_first)))
        for name in ("wire_axial", "wire_mass"):
            array = getattr(self.large_state, name)
            there = np.where(source >= 0, join.wires(getattr(self.small_state, name).numpy())[wire], 0.0)
            array.assign(np.maximum(array.numpy(), np.maximum.reduceat(there, starts)))
        penalty = self.small_state.steering.contact_stiffness
        if penalty > self.large_state.steering.contact_stiffness:
            self.large_state.stiffen_contact(penalty)
