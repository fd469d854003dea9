"""Between a planar mesh and the coarse grid of a membrane: forces gathered onto it, displacements spread from it."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..kernels.membrane_transfer import Grid, gather_body_forces, gather_node_forces, spread_to_bodies, spread_to_nodes
from ..launch import bind
from .model import Model, block_threads
from .response import Response
from .state import State
from .step import ForceProbe


class MembraneGrid:
    """A grid of `cells` (2,) from `low` (2,) [m] on, each of size `cell` (2,) [m], over a mesh (kernels/membrane_transfer.py)."""

    def __init__(
        self, model: Model, state: State, probe: ForceProbe, low: np.ndarray, cell: np.ndarray, cells: np.ndarray
    ) -> None:
        self.model, self.state, self._probe = model, state, probe
        grid = Grid()
        grid.low, grid.cell, grid.cells = wp.vec2d(*low), wp.vec2d(*cell), wp.vec2i(*map(int, cells))
        self._grid = grid
        count = int(np.prod(cells + 1))
        self._force = wp.zeros((count, 2), dtype=wp.float64, device=model.device)
        self._displacement = wp.zeros((count, 2), dtype=wp.float64, device=model.device)
        self._body_clasp: wp.array = wp.array(model.panel.body_clasp, dtype=wp.int32, device=model.device)

    def gather(self) -> np.ndarray:
        """Out-of-balance forces (grid node, 2) [N], from the accelerations that the probe holds."""
        model, mesh, state = self.model, self.model.mesh, self.state
        self._force.zero_()
        onto = {"grid": self._grid, "force": self._force}
        nodes = (model.rest, mesh, state, model.constants, self._probe)
        bind(gather_node_forces, block_threads(model), *nodes, **onto).run(model.device)
        if model.owned_bodies:
            bind(gather_body_forces, model.owned_bodies, mesh, state, **onto).run(model.device)
        return model.ranks.sum(self._force.numpy())

    def spread(self, displacement: np.ndarray, response: Response) -> None:
        """Move the mesh with the grid (grid node, 2) [m], its repeats as endless cloth answers; the clamps stay."""
        model, mesh, state = self.model, self.model.mesh, self.state
        self._displacement.assign(displacement)
        now = state.parity
        sources = (mesh, state, model.constants)
        moved = {"grid": self._grid, "displacement": self._displacement}
        bind(
            spread_to_nodes, block_threads(model), *sources, model.rest, response, ux=state.node_ux[now], uy=state.node_uy[now],
            **moved, **response.of_nodes,
        ).run(model.device)  # fmt: skip
        if model.panel.body_count:
            bind(
                spread_to_bodies, model.panel.body_count, *sources, body_clasp=self._body_clasp,
                ux=state.body_ux, uy=state.body_uy, **moved, **response.of_bodies,
            ).run(model.device)  # fmt: skip
