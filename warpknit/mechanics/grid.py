"""The coarse grid of a membrane over a mesh of repeats: displacements spread from it onto fields of the mesh."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.launch import bind
from ..compute.ranks import Ranks
from ..kernels.membrane_transfer import Grid, spread_to_bodies, spread_to_nodes
from .protocols import Model
from .repeat_mesh import node_threads
from .response import Response

DIRECTIONS = {"x": 0, "y": 1, "body_x": 0, "body_y": 1}  # of fields that are displacements


COUNT = 2.0**-52  # of EA: sums of out-of-balance forces stay far below 2^63 of them


class CountedForces:
    """Forces (grid node, 2) on the device as whole counts of `unit` [N]: their sums do not depend on the order of the threads."""

    def __init__(self, grid_nodes: int, axial_stiffness: float, device: str) -> None:
        self.unit = wp.float64(COUNT * axial_stiffness)
        self.counts = wp.zeros((grid_nodes, 2), dtype=wp.int64, device=device)

    def read(self, ranks: Ranks | None = None) -> np.ndarray:
        """(grid node, 2) [N], over all ranks if given."""
        counts = self.counts.numpy()
        return float(self.unit) * (counts if ranks is None else ranks.sum(counts))


class RepeatGrid:
    """A grid of `cells` (2,) over a mesh, from `low` (2,) [m], each of size `cell` (2,) [m] (kernels/membrane_transfer.py)."""

    def __init__(self, model: Model, low: np.ndarray, cell: np.ndarray, cells: np.ndarray, *sources: object) -> None:
        """sources: arrays of the mesh by name, at least `RepeatArrays`."""
        self.model, self._sources = model, sources
        self.grid = Grid()
        self.grid.low, self.grid.cell, self.grid.cells = wp.vec2d(*low), wp.vec2d(*cell), wp.vec2i(*map(int, cells))
        count = int(np.prod(cells + 1))
        self._displacement = wp.zeros((count, 2), dtype=wp.float64, device=model.device)

    def set_displacement(self, displacement: np.ndarray) -> None:
        """Set the displacement (grid node, 2) [m] that `add_to_nodes` and `add_to_bodies` spread."""
        self._displacement.assign(displacement)

    def add_to_nodes(self, value: wp.array, name: str, response: Response, wire_scale: wp.array, scale: float = 1.0) -> None:
        """Add `scale` times `wire_scale` [wire] times a grid's change of a field to its value [node]."""
        bind(
            spread_to_nodes, node_threads(self.model.panel), *self._sources, response, grid=self.grid,
            displacement=self._displacement, direction=DIRECTIONS.get(name, -1), cell=response.of(name),
            scale=wp.float64(scale), wire_scale=wire_scale, value=value,
        ).run(self.model.device)  # fmt: skip

    def add_to_bodies(
        self,
        value: wp.array,
        name: str,
        response: Response,
        body_clasp: wp.array,
        scale: float = 1.0,
        *,
        per_body: int = 1,
        is_positive: bool = False,
    ) -> None:
        """The same for a field of bodies, or of their pairs: two `per_body`."""
        bodies = self.model.panel.body_count
        if not bodies:
            return
        bind(
            spread_to_bodies, per_body * bodies, *self._sources, body_clasp=body_clasp, grid=self.grid,
            displacement=self._displacement, direction=DIRECTIONS.get(name, -1), per_body=per_body,
            cell=response.of(name), scale=wp.float64(scale), is_positive=int(is_positive), value=value,
        ).run(self.model.device)  # fmt: skip
