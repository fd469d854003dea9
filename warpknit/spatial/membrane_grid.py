"""Between a spatial mesh and the coarse grid of a membrane: forces gathered onto it, displacements spread from it.

Displacements are cubic splines over the grid, whose slopes have no jumps: a jump would bend the wires that cross it. Wires rotate
with the membrane.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from scipy.interpolate import RectBivariateSpline

from ..host import fetch, store
from ..kernels.membrane_transfer import Grid, gather_forces
from ..launch import bind
from ..transfer.grid import CountedForces
from ..transfer.response import Response
from .fields import Fields

MAX_SHIFT = 0.25  # of the thickness: by which a correction moves a loop against its neighbour, so that no wire passes another


class MembraneGrid:
    """A grid of `cells` (2,) from `low` (2,) [m] on, each of size `cell` (2,) [m], over a mesh."""

    def __init__(self, fields: Fields, low: np.ndarray, cell: np.ndarray, cells: np.ndarray) -> None:
        self.fields, self.model = fields, fields.model
        self.max_strain = MAX_SHIFT * self.model.rods.section.thickness / self.model.scene.knit.wale_spacing
        self._grid = Grid()
        self._grid.low, self._grid.cell, self._grid.cells = wp.vec2d(*low), wp.vec2d(*cell), wp.vec2i(*map(int, cells))
        count = int(np.prod(cells + 1))
        stiffness = self.model.rods.section.axial_stiffness
        self._force, self._across_force = (CountedForces(count, stiffness, self.model.device) for _ in range(2))
        self._axes = [begin + size * np.arange(count + 1) for begin, size, count in zip(low, cell, cells, strict=True)]

    def gather(self) -> np.ndarray:
        """Out-of-balance forces (grid node, 2) [N], in the state last evaluated."""
        stepper = self.fields.stepper
        self._force.counts.zero_()
        self._across_force.counts.zero_()
        bind(
            gather_forces, self.model.node_count, stepper.arrays, stepper.state, grid=self._grid, grid_force=self._force.counts,
            across_force=self._across_force.counts, force_unit=self._force.unit,
        ).run(self.model.device)  # fmt: skip
        return self._force.read()

    def gather_across(self) -> np.ndarray:
        """[grid node] [N] the same out of the plane of the mesh, as the last `gather` found them."""
        return self._across_force.read()[:, 0]

    def spread(self, displacement: np.ndarray, response: Response) -> None:
        """Move the mesh with the grid (grid node, 2) [m]; the clamps stay."""
        x, along_x = self._surface(displacement[:, 0])
        y, along_y = self._surface(displacement[:, 1])
        turn = 0.5 * (along_y[:, 0] - along_x[:, 1]) * fetch(self.fields.stepper.state.tangent)[:, 2]
        self.fields.move(np.stack([x, y, np.zeros_like(x)], axis=1), turn)

    def spread_across(self, displacement: np.ndarray) -> None:
        """Move the mesh out of its plane with the grid [grid node] [m], and stop it in that direction; the clamps stay."""
        stepper, rods = self.fields.stepper, self.model.rods
        lift, slope = self._surface(displacement)
        height = rods.position[:, 2:] - rods.position[:, 2].mean()
        rotation = np.stack([slope[:, 1], -slope[:, 0]], axis=1)
        turn = np.sum(rotation * fetch(stepper.state.tangent)[:, :2], axis=1)
        self.fields.move(np.column_stack([-slope * height, lift]), turn)
        velocity = stepper.state.velocity
        store(velocity, fetch(velocity) * np.array([1.0, 1.0, 0.0]))

    def _surface(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """[node] values [grid node] at the rest places of the nodes, and their slope (node, 2) on the deformed mesh."""
        x, y = self.model.rods.position[:, :2].T
        counts = [len(axis) for axis in self._axes]
        if not values.any():  # so for a single cell, whose edge is held
            return np.zeros(len(x)), np.zeros((len(x), 2))
        surface = RectBivariateSpline(*self._axes, values.reshape(counts), kx=min(3, counts[0] - 1), ky=min(3, counts[1] - 1))
        slope = np.stack([surface.ev(x, y, dx=1), surface.ev(x, y, dy=1)], axis=1)
        return surface.ev(x, y), slope @ np.linalg.inv(self.fields.stepper.state.gradient)
