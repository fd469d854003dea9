"""Cubic splines over a mesh, at the rest places of its nodes."""

from __future__ import annotations

import numpy as np
import warp as wp
from scipy.interpolate import RectBivariateSpline, interpn

from ..compute.host import take
from ..compute.launch import bind
from ..kernels.membrane_transfer import Grid, spread_surface


class Surface:
    """Cubic splines through the nodes of a grid.

    The grid has `cells` (2,) from `low` (2,) [m] on, each of size `cell` (2,) [m]. Slopes have no jumps: a jump would
    bend the wires that cross it.
    """

    def __init__(self, low: np.ndarray, cell: np.ndarray, cells: np.ndarray, rest_position: wp.array, device: str) -> None:
        """rest_position: [node] [m] of the nodes."""
        self.grid, self._rest_position, self._device = Grid(), rest_position, device
        self.grid.low, self.grid.cell, self.grid.cells = wp.vec2d(*low), wp.vec2d(*cell), wp.vec2i(*map(int, cells))
        self.axes = [begin + size * np.arange(count + 1) for begin, size, count in zip(low, cell, cells, strict=True)]

    def at_nodes(self, values: np.ndarray) -> tuple[np.ndarray, ...]:
        """Value [node] and slopes along x and y [node] [1/m] of the spline through values [grid node]."""
        nodes, device, counts = len(self._rest_position), self._device, [len(axis) for axis in self.axes]
        if not values.any():
            return np.zeros(nodes), np.zeros(nodes), np.zeros(nodes)
        places, through = self.axes, values.reshape(counts)
        if min(counts) < 3:  # a spline has slopes from three places on
            places = [axis if len(axis) > 2 else np.linspace(axis[0], axis[1], 3) for axis in self.axes]
            through = interpn(self.axes, through, np.stack(np.meshgrid(*places, indexing="ij"), axis=-1))
        degree_x, degree_y = (min(3, len(place) - 1) for place in places)
        spline = RectBivariateSpline(*places, through, kx=degree_x, ky=degree_y)
        cell = [axis[1] - axis[0] for axis in self.axes]
        known = [spline(*self.axes, dx=a, dy=b).ravel() * cell[0] ** a * cell[1] ** b for b in (0, 1) for a in (0, 1)]
        surface: wp.array = wp.array(np.ascontiguousarray(np.transpose(known)), dtype=wp.float64, device=device)
        value, slope_x, slope_y = (wp.zeros(nodes, dtype=wp.float64, device=device) for _ in range(3))
        bind(
            spread_surface, nodes, rest_position=self._rest_position, grid=self.grid, surface=surface, value=value,
            slope_x=slope_x, slope_y=slope_y,
        ).run(device)  # fmt: skip
        return take(value), take(slope_x), take(slope_y)
