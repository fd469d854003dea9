"""Large planar meshes: fields that are transferred between meshes of one knit, and to and from the grid of a membrane."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.launch import bind
from ..kernels.membrane_transfer import gather_body_forces, gather_node_forces
from ..mechanics.grid import CountedForces, RepeatGrid
from ..mechanics.prolongation import RepeatProlongation
from ..mechanics.response import Response
from .host_state import Join, read_strip
from .model import Model, block_threads
from .state import State
from .world_step import Accelerations


class Prolongation:
    """Brings a large mesh to the state of a small one."""

    KEPT = ("_last",)

    def __init__(self, large: Model, large_state: State, small: Model, small_state: State) -> None:
        self.large, self.large_state = large, large_state
        self.small, self.small_state = small, small_state
        self._last = state_variables(small, small_state)
        self._repeats = RepeatProlongation(large, small, large.mesh, large.rest, large.constants)
        self._one = wp.full(len(large.panel.wire_first), 1.0, dtype=large.precision.real, device=large.device)

    @property
    def replaces(self) -> bool:
        """Whether the state of the small mesh replaces the state here; else its change is added."""
        return self._repeats.replaces

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

    def put_back(self) -> None:
        """Nothing to put back: bodies of a plane take any displacement."""

    def _follow_stiffness(self) -> None:
        """Raise stiffness and mass of each wire to the largest of its sources."""
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


class MembraneGrid:
    """A grid of `cells` (2,) over a mesh, from `low` (2,) [m], each of size `cell` (2,) [m]."""

    max_strain = 0.02
    least_lift = 0.0

    def __init__(
        self, model: Model, state: State, found: Accelerations, low: np.ndarray, cell: np.ndarray, cells: np.ndarray
    ) -> None:
        self.model, self.state, self._accelerations = model, state, found
        self._repeats = RepeatGrid(model, low, cell, cells, model.mesh, model.rest, model.constants)
        self._force = CountedForces(int(np.prod(cells + 1)), model.axial_stiffness, model.device)
        self._body_clasp: wp.array = wp.array(model.panel.body_clasp, dtype=wp.int32, device=model.device)
        self._one = wp.full(len(model.panel.wire_first), 1.0, dtype=model.precision.real, device=model.device)

    def gather(self) -> np.ndarray:
        """Out-of-balance forces (grid node, 2) [N], from the accelerations last probed."""
        model, mesh, state, repeats = self.model, self.model.mesh, self.state, self._repeats
        self._force.counts.zero_()
        onto = {"grid": repeats.grid, "force": self._force.counts, "force_unit": self._force.unit}
        nodes = (model.rest, mesh, state, model.constants, self._accelerations)
        bind(gather_node_forces, block_threads(model), *nodes, **onto).run(model.device)
        if model.owned_bodies:
            bind(gather_body_forces, model.owned_bodies, mesh, state, **onto).run(model.device)
        return self._force.read(model.ranks)

    def gather_across(self) -> None:
        """None: nothing moves out of the plane."""

    def spread_across(self, displacement: np.ndarray) -> None:
        """Nothing."""

    def spread(self, displacement: np.ndarray, response: Response) -> None:
        """Move the mesh with the grid (grid node, 2) [m], its repeats as endless cloth answers; the clamps stay."""
        state, repeats, one = self.state, self._repeats, self._one
        repeats.set_displacement(displacement)
        now, counts, clasp = state.parity, 1.0 / self.model.precision.unit, self._body_clasp
        repeats.add_to_nodes(state.node_ux[now], "x", response, one, counts)
        repeats.add_to_nodes(state.node_uy[now], "y", response, one, counts)
        repeats.add_to_nodes(state.tension_offset, "tension", response, one)
        repeats.add_to_nodes(state.tension_offset, "strain", response, state.wire_axial, -1.0)
        repeats.add_to_bodies(state.body_ux, "body_x", response, clasp, counts)
        repeats.add_to_bodies(state.body_uy, "body_y", response, clasp, counts)
        repeats.add_to_bodies(state.pair_offset, "body_offset", response, clasp, per_body=2, is_positive=True)


def state_variables(model: Model, state: State) -> dict[str, np.ndarray]:
    """Variables of a state of the global mesh, on all ranks.

    [node] and [body] displacements [m], [node] tension [N] and softened strain, [pair] offset [N].
    """
    host = read_strip(model, state)
    offset = state.tension_offset.numpy().astype(np.float64)
    strain = (host.tension - offset) / np.repeat(host.wire_axial, model.panel.wire_count)
    join = Join(model, everywhere=True)
    of_nodes = {"x": host.u[:, 0], "y": host.u[:, 1], "tension": host.tension, "strain": strain}
    of_bodies = {"body_x": host.body_u[:, 0], "body_y": host.body_u[:, 1]}
    return {
        **{name: join.nodes(values) for name, values in of_nodes.items()},
        **{name: join.bodies(values) for name, values in of_bodies.items()},
        "body_offset": join.pairs(host.pair_offset),
    }
