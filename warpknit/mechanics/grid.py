"""The coarse grid of a membrane over a mesh: forces gathered onto it, displacements spread from it."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
import warp as wp

from ..compute.ranks import Ranks
from ..kernels.membrane_transfer import Grid
from .response import Response

COUNT = 2.0**-52  # of EA: sums of out-of-balance forces stay far below 2^63 of them


def grid_of(low: np.ndarray, cell: np.ndarray, cells: np.ndarray) -> Grid:
    """A grid of `cells` (2,) from `low` (2,) [m], each of size `cell` (2,) [m] (kernels/membrane_transfer.py)."""
    grid = Grid()
    grid.low, grid.cell, grid.cells = wp.vec2d(*low), wp.vec2d(*cell), wp.vec2i(*map(int, cells))
    return grid


class CountedForces:
    """Forces (grid node, 2) on the device as whole counts of `unit` [N]: their sums do not depend on the order of the threads."""

    def __init__(self, grid_nodes: int, axial_stiffness: float, device: str) -> None:
        self.unit = wp.float64(COUNT * axial_stiffness)
        self.counts = wp.zeros((grid_nodes, 2), dtype=wp.int64, device=device)

    def read(self, ranks: Ranks) -> np.ndarray:
        """(grid node, 2) [N], over all ranks."""
        return float(self.unit) * ranks.sum(self.counts.numpy())


class MembraneGrid(ABC):
    """A grid that balances the mesh of a model as a membrane; see `grid_of`."""

    max_strain: float  # largest strain of one correction
    least_lift = 0.0  # [m] smallest useful displacement out of the plane

    @abstractmethod
    def gather(self) -> np.ndarray:
        """Out-of-balance forces (grid node, 2) [N], in the state last evaluated."""

    def gather_across(self) -> np.ndarray | None:
        """The same out of the plane [grid node] [N], from the last `gather`; None in a planar model."""
        return None

    @abstractmethod
    def spread(self, displacement: np.ndarray, response: Response, stations: np.ndarray | None = None) -> None:
        """Move the mesh with the grid (grid node, 2) [m], its repeats as endless cloth answers.

        Clamps on a rim of the mechanics follow its stations (station, 3) [m]; others stay.
        """

    def spread_across(self, displacement: np.ndarray, stations: np.ndarray | None = None) -> None:
        """Move the mesh out of its plane with the grid [grid node] [m], and stop it; clamps as of `spread`."""
        raise NotImplementedError
