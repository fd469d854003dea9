"""Large meshes come to rest as a membrane: what is out of balance over many repeats is solved on a coarse grid.

Local motion dies out in some hundred steps; what differs slowly over the mesh would spread from repeat to repeat in a number of
steps that grows with the square of the mesh. So from time to time the out-of-balance forces are gathered onto a grid of
bilinear membrane elements (kernels/membrane.py), whose stiffness is that of endless cloth at the load: the derivative of the
nominal stress of one periodic repeat, each state of it brought to rest. The displacement that balances them moves the mesh.
The stress that goes with that displacement tells how far the mesh as a whole was from rest.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
import warp as wp
from scipy.sparse.linalg import splu

from .kernels.membrane import Grid, gather_body_forces, gather_node_forces, spread_to_bodies, spread_to_nodes
from .kernels.wires_by_block import BLOCK_SIZE
from .model import Model, block_threads
from .response import Response
from .state import State
from .step import ForceProbe

REPEATS_A_CELL = 2  # of the grid: finer ones would see the stiffness of the edges
MOST_CELLS = 96  # of the grid in a direction
MOST_STRAIN = 0.02  # of one correction


class Membrane:
    """The coarse grid over a gripped mesh."""

    def __init__(self, model: Model, state: State, probe: ForceProbe) -> None:
        self.model, self.state, self._probe = model, state, probe
        self.tangent = np.zeros((2, 2, 2, 2))
        size = np.array(model.panel.size)
        cells = np.clip(np.array(model.scene.knit.repeats) // REPEATS_A_CELL, 1, MOST_CELLS)
        self._cells, self._cell = cells, size / cells
        grid = Grid()
        grid.low, grid.cell, grid.cells = wp.vec2d(*model.panel.low), wp.vec2d(*self._cell), wp.vec2i(*map(int, cells))
        self._grid = grid
        count = int(np.prod(cells + 1))
        self._force = wp.zeros((count, 2), dtype=wp.float64, device=model.device)
        self._displacement = wp.zeros((count, 2), dtype=wp.float64, device=model.device)
        self._body_clasp = wp.array(model.panel.body_clasp, dtype=wp.int32, device=model.device)
        inside = np.zeros(cells + 1, dtype=bool)
        inside[1:-1, 1:-1] = True
        self._free = np.nonzero(np.repeat(inside.ravel(), 2))[0]

    def renew(self, response: Response) -> None:
        """Take the response of the cloth at this load."""
        self.tangent = tangent = response.tangent
        self._response = response
        if not tangent.any():  # before the first load
            return
        nx, ny = self._cells
        corner = np.array([[i % 2, i // 2] for i in range(4)])
        points = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
        element = np.zeros((4, 2, 4, 2))
        for s in points:
            for t in points:
                wx, wy = np.where(corner[:, 0], s, 1 - s), np.where(corner[:, 1], t, 1 - t)
                slope = (2 * corner - 1) * np.stack([wy, wx], axis=1) / self._cell
                element += np.einsum("ib,abcd,jd->iajc", slope, tangent, slope) * 0.25 * np.prod(self._cell)
        ix, iy = (a.ravel() for a in np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"))
        node = (ix[:, None] + corner[:, 0]) * (ny + 1) + iy[:, None] + corner[:, 1]
        number = (2 * node[:, :, None] + np.arange(2)).reshape(len(node), 8)
        rows, columns = np.repeat(number, 8, axis=1), np.tile(number, (1, 8))
        values = np.tile(element.reshape(64), len(node))
        matrix = sparse.coo_matrix((values, (rows.ravel(), columns.ravel()))).tocsc()
        self._solve = splu(matrix[self._free][:, self._free]).solve

    def imbalance(self) -> np.ndarray:
        """Out-of-balance forces [grid node, 2] [N], from the accelerations that the probe holds."""
        model, mesh, state = self.model, self.model.mesh, self.state
        self._force.zero_()
        wp.launch(
            gather_node_forces,
            dim=block_threads(model),
            inputs=[
                mesh.block_first, mesh.block_count, mesh.block_table, mesh.block_wire,
                mesh.block_origin_x, mesh.block_origin_y, BLOCK_SIZE, model.rest.place_x, model.rest.place_y, self._grid,
                state.wire_mass, model.rest.node_mass, self._probe.acceleration_x, self._probe.acceleration_y, self._force,
            ],
            device=model.device,
        )  # fmt: skip
        if model.panel.body_count:
            wp.launch(
                gather_body_forces,
                dim=model.panel.body_count,
                inputs=[
                    mesh.body_origin_x, mesh.body_origin_y, self._grid,
                    state.pair_force, state.pair_body_x, state.pair_body_y, self._force,
                ],
                device=model.device,
            )  # fmt: skip
        return self._force.numpy()

    def warm_up(self, response: Response) -> None:
        """Launch every kernel; the mesh does not move."""
        self._response = response
        self.imbalance()
        self.move(np.zeros((int(np.prod(self._cells + 1)), 2)))

    def solve(self) -> tuple[np.ndarray, float]:
        """Displacement [grid node, 2] [m] that should balance the mesh, and the stress [N/m] that goes with the whole of it,
        root mean square over the mesh."""
        force = self.imbalance().reshape(-1)[self._free]
        answer = self._solve(force)
        stress = np.einsum("abcd,xycd->xyab", self.tangent, self._gradient(self._on_grid(answer)))
        out_of_balance = float(np.sqrt(np.mean(np.sum(stress**2, axis=(2, 3)))))
        moved = self._on_grid(answer)
        steepest = float(np.abs(self._gradient(moved)).max())
        return moved.reshape(-1, 2) * min(1.0, MOST_STRAIN / max(steepest, 1e-30)), out_of_balance

    def _on_grid(self, free: np.ndarray) -> np.ndarray:
        """Values of the free grid nodes as (nodes x, nodes y, 2)."""
        values = np.zeros(2 * int(np.prod(self._cells + 1)))
        values[self._free] = free
        return values.reshape(*(self._cells + 1), 2)

    def _gradient(self, moved: np.ndarray) -> np.ndarray:
        """Displacement gradient (cells x, cells y, 2, 2) in the middle of the cells."""
        along_x, along_y = np.diff(moved, axis=0) / self._cell[0], np.diff(moved, axis=1) / self._cell[1]
        return np.stack([0.5 * (along_x[:, 1:] + along_x[:, :-1]), 0.5 * (along_y[1:] + along_y[:-1])], axis=-1)

    def move(self, displacement: np.ndarray) -> float:
        """Move the mesh by a displacement of the grid; the largest displacement gradient."""
        model, mesh, state = self.model, self.model.mesh, self.state
        self._displacement.assign(displacement)
        unit, now = model.precision.real(model.precision.unit), state.parity
        wp.launch(
            spread_to_nodes,
            dim=block_threads(model),
            inputs=[
                mesh.block_first, mesh.block_count, mesh.block_table, mesh.block_wire,
                mesh.block_origin_x, mesh.block_origin_y, BLOCK_SIZE, model.rest.place_x, model.rest.place_y, self._grid,
                state.wire_axial, self._displacement, self._response.cell_node,
                *self._response.of_nodes, unit,
                state.node_ux[now], state.node_uy[now], state.tension_offset,
            ],
            device=model.device,
        )  # fmt: skip
        if model.panel.body_count:
            wp.launch(
                spread_to_bodies,
                dim=model.panel.body_count,
                inputs=[
                    mesh.body_origin_x, mesh.body_origin_y, self._body_clasp, self._grid, self._displacement,
                    *self._response.of_bodies, unit,
                    state.body_ux, state.body_uy, state.pair_offset,
                ],
                device=model.device,
            )  # fmt: skip
        return float(np.abs(self._gradient(displacement.reshape(*(self._cells + 1), 2))).max())
