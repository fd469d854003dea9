"""Between a planar mesh and the coarse grid of a membrane: forces gathered onto it, displacements spread from it."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.launch import bind
from ..kernels.membrane_transfer import gather_body_forces, gather_node_forces
from ..mechanics.grid import CountedForces, RepeatGrid
from ..mechanics.response import Response
from .model import Model, block_threads
from .state import State
from .step import ForceProbe


class MembraneGrid:
    """A grid of `cells` (2,) from `low` (2,) [m] on, each of size `cell` (2,) [m], over a mesh."""

    max_strain = 0.02
    least_lift = 0.0

    def __init__(
        self, model: Model, state: State, probe: ForceProbe, low: np.ndarray, cell: np.ndarray, cells: np.ndarray
    ) -> None:
        self.model, self.state, self._probe = model, state, probe
        self._repeats = RepeatGrid(model, low, cell, cells, model.mesh, model.rest, model.constants)
        self._force = CountedForces(int(np.prod(cells + 1)), model.axial_stiffness, model.device)
        self._body_clasp: wp.array = wp.array(model.panel.body_clasp, dtype=wp.int32, device=model.device)
        self._one = wp.full(len(model.panel.wire_first), 1.0, dtype=model.precision.real, device=model.device)

    def gather(self) -> np.ndarray:
        """Out-of-balance forces (grid node, 2) [N], from the accelerations that the probe holds."""
        model, mesh, state, repeats = self.model, self.model.mesh, self.state, self._repeats
        self._force.counts.zero_()
        onto = {"grid": repeats.grid, "force": self._force.counts, "force_unit": self._force.unit}
        nodes = (model.rest, mesh, state, model.constants, self._probe)
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
