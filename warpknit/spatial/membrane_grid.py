"""Between a spatial mesh and the coarse grid of a membrane: forces gathered onto it, displacements spread from it."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..host import fetch, store
from ..kernels.membrane_transfer import gather_forces
from ..launch import bind
from ..transfer.grid import RepeatGrid
from ..transfer.repeat_mesh import RepeatArrays
from ..transfer.response import Response
from .fields import Fields


class MembraneGrid:
    """A grid of `cells` (2,) from `low` (2,) [m] on, each of size `cell` (2,) [m], over a mesh."""

    def __init__(self, fields: Fields, arrays: RepeatArrays, low: np.ndarray, cell: np.ndarray, cells: np.ndarray) -> None:
        self.fields, self.model = fields, fields.model
        self._repeats = RepeatGrid(self.model, low, cell, cells, arrays)
        self._across_force = wp.zeros_like(self._repeats.force)
        self._one = wp.full(len(self.model.panel.wire_first), 1.0, dtype=wp.float64, device=self.model.device)

    def gather(self) -> np.ndarray:
        """Out-of-balance forces (grid node, 2) [N], in the state last evaluated."""
        stepper, repeats = self.fields.stepper, self._repeats
        repeats.force.zero_()
        self._across_force.zero_()
        bind(
            gather_forces, self.model.node_count, stepper.arrays, stepper.state, grid=repeats.grid, grid_force=repeats.force,
            across_force=self._across_force,
        ).run(self.model.device)  # fmt: skip
        return np.asarray(repeats.force.numpy())

    def gather_across(self) -> np.ndarray:
        """[grid node] [N] the same out of the plane of the mesh, as the last `gather` found them."""
        return np.asarray(self._across_force.numpy()[:, 0])

    def spread(self, displacement: np.ndarray, response: Response) -> None:
        """Move the mesh with the grid (grid node, 2) [m]; the clamps stay."""
        self._repeats.set_displacement(displacement)
        self.fields.add({name: self._spread(name, response) for name in ("x", "y")})

    def spread_across(self, displacement: np.ndarray, response: Response) -> None:
        """Move the mesh out of its plane with the grid [grid node] [m], and stop it in that direction."""
        self._repeats.set_displacement(np.stack([displacement, np.zeros_like(displacement)], axis=1))
        self.fields.add({"z": self._spread("x", response)})
        velocity = self.fields.stepper.state.velocity
        store(velocity, fetch(velocity) * np.array([1.0, 1.0, 0.0]))

    def _spread(self, name: str, response: Response) -> np.ndarray:
        """[panel node] [m] displacement of the grid along x or y."""
        value = wp.zeros(self.model.panel.node_count, dtype=wp.float64, device=self.model.device)
        self._repeats.add_to_nodes(value, name, response, self._one)
        return np.asarray(value.numpy())
