"""Large planar meshes: fields that are transferred between meshes of one knit, and to and from the grid of a membrane."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import warp as wp

from ..compute.launch import bind
from ..kernels.membrane_transfer import gather_body_forces, gather_node_forces, spread_to_bodies, spread_to_nodes
from ..mechanics.grid import CountedForces, MembraneGrid, grid_of
from ..mechanics.prolongation import RepeatProlongation, node_threads
from ..mechanics.response import Response
from .host_state import Join, read_strip
from .model import Model
from .state import State
from .world_step import Accelerations

DIRECTIONS = {"x": 0, "y": 1, "body_x": 0, "body_y": 1}  # of fields that are displacements


def add_to_state(model: Model, state: State, add_to_nodes: Callable[..., None], add_to_bodies: Callable[..., None]) -> None:
    """Change all fields of a state by functions of nodes and of bodies."""
    one, counts = wp.float64(1.0), wp.float64(1.0 / model.precision.unit)
    ones: wp.array = wp.full(len(model.panel.wire_first), 1.0, dtype=model.precision.real, device=model.device)
    add_to_nodes("x", state.node_ux[state.parity], wire_scale=ones, scale=counts)
    add_to_nodes("y", state.node_uy[state.parity], wire_scale=ones, scale=counts)
    add_to_nodes("tension", state.tension_offset, wire_scale=ones, scale=one)
    add_to_nodes("strain", state.tension_offset, wire_scale=state.wire_axial, scale=wp.float64(-1.0))
    if model.panel.body_count:
        add_to_bodies("body_x", state.body_ux, per_body=1, scale=counts, is_positive=0)
        add_to_bodies("body_y", state.body_uy, per_body=1, scale=counts, is_positive=0)
        add_to_bodies("body_offset", state.pair_offset, per_body=2, scale=one, is_positive=1)


class Prolongation(RepeatProlongation):
    """Brings a large mesh to the state of a small one."""

    def __init__(self, large: Model, large_state: State, small: Model, small_state: State) -> None:
        super().__init__(large, small, lambda: state_variables(small, small_state))
        self._model, self._state, self._small, self._small_state = large, large_state, small, small_state

    def carry(self, response: Response) -> bool:
        self._follow_stiffness()
        state, taken = self._state, self.taken()
        if taken is None:
            return True
        if self.replaces:
            now = state.parity
            own = (state.node_ux[now], state.node_uy[now], state.tension_offset, state.body_ux, state.body_uy, state.pair_offset)
            for array in own:
                array.zero_()
        change = self.changes(taken, self._model.precision.real)
        add_to_nodes, add_to_bodies = (partial(add, change, response) for add in (self.add_to_nodes, self.add_to_bodies))
        add_to_state(self._model, state, add_to_nodes, add_to_bodies)
        return True

    def _follow_stiffness(self) -> None:
        """Raise stiffness and mass of each wire to the largest of its sources."""
        large, small, state, before = self._model.panel, self.small.panel, self._state, self._small_state
        join = Join(self._small, everywhere=True)
        source = self.source_of_blocks()
        wire = np.searchsorted(small.wire_first, np.maximum(source, 0), side="right") - 1
        starts = np.searchsorted(large.block_wire, np.arange(len(large.wire_first)))
        for name in ("wire_axial", "wire_mass"):
            array = getattr(state, name)
            there = np.where(source >= 0, join.wires(getattr(before, name).numpy())[wire], 0.0)
            array.assign(np.maximum(array.numpy(), np.maximum.reduceat(there, starts)))
        penalty = before.steering.contact_stiffness
        if penalty > state.steering.contact_stiffness:
            state.stiffen_contact(penalty)


class PlanarGrid(MembraneGrid):
    """A grid of `cells` (2,) over a mesh, from `low` (2,) [m], each of size `cell` (2,) [m]."""

    max_strain = 0.02

    def __init__(
        self, model: Model, state: State, found: Accelerations, low: np.ndarray, cell: np.ndarray, cells: np.ndarray
    ) -> None:
        self.model, self.state, self._accelerations = model, state, found
        self._grid, count = grid_of(low, cell, cells), int(np.prod(cells + 1))
        self._force = CountedForces(count, model.axial_stiffness, model.device)
        self._displacement = wp.zeros((count, 2), dtype=wp.float64, device=model.device)
        self._body_clasp: wp.array = wp.array(model.panel.body_clasp, dtype=wp.int32, device=model.device)

    def gather(self) -> np.ndarray:
        model, state = self.model, self.state
        self._force.counts.zero_()
        onto = {"grid": self._grid, "force": self._force.counts, "force_unit": self._force.unit}
        nodes = (model.rest, model.mesh, state, model.constants, self._accelerations)
        bind(gather_node_forces, node_threads(model.panel), *nodes, **onto).run(model.device)
        bind(gather_body_forces, model.owned_bodies, model.mesh, state, **onto).run(model.device)
        return self._force.read(model.ranks)

    def spread(self, displacement: np.ndarray, response: Response, stations: np.ndarray | None = None) -> None:
        model = self.model
        self._displacement.assign(displacement)

        def field(name: str) -> dict[str, object]:
            on_grid = {"grid": self._grid, "displacement": self._displacement}
            return {"cell": response.of(name), "direction": DIRECTIONS.get(name, -1), **on_grid}

        def add_to_nodes(name: str, value: wp.array, **scales: object) -> None:
            sources = (model.rest, model.mesh, model.constants, response)
            bind(spread_to_nodes, node_threads(model.panel), *sources, value=value, **field(name), **scales).run(model.device)

        def add_to_bodies(name: str, value: wp.array, **how: object) -> None:
            sources = {"body_clasp": self._body_clasp, **field(name)}
            bind(spread_to_bodies, len(value), model.mesh, value=value, **sources, **how).run(model.device)

        add_to_state(model, self.state, add_to_nodes, add_to_bodies)


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
