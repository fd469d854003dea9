"""Clamps of a spatial mesh: moved with the load, pulled, on cords, or on a paraboloid.

Stations of an edge stand along the outline (mesh/rim.py). The displacement q of a clamp is interpolated between the two stations
around it: from rest position c it moves to F c + q. Given stations are pulled, and raised to the height r^2/(4 f) of a
paraboloid. Free stations are raised with the straight lines between given ones. A thin-plate spline through the clamps moves
the whole mesh with the stations, so that the strain of the wires is smooth, as under a change of load. It lays the mesh on the
facets between raised net nodes. Free stations hang on the cord, and move with the membrane (solve/multilevel.py). Clamps keep
their direction.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from scipy.interpolate import RBFInterpolator, RectBivariateSpline, interpn

from ..compute.host import Entries, take
from ..compute.launch import Launch, bind
from ..kernels.membrane_transfer import spread_surface
from ..kernels.rod_clamps import move_clamps
from ..mechanics.grid import grid_of
from ..mesh.rim import LoadPoint, Rim, build_rim
from .model import SpatialModel
from .rod_step import RodStepper

LEAST_CELLS = 4  # of the grid on which the thin-plate spline is evaluated, in each direction
SMOOTHING = 1e-8  # of the thin-plate spline, over the mesh size: keeps it regular where clamps coincide
HEIGHT_ERROR = 1e-3  # of the thickness: largest distance of given stations from the paraboloid


class Surface:
    """Cubic splines through the nodes of a grid.

    The grid has `cells` (2,) from `low` (2,) [m] on, each of size `cell` (2,) [m]. Slopes have no jumps: a jump would
    bend the wires that cross it.
    """

    def __init__(self, low: np.ndarray, cell: np.ndarray, cells: np.ndarray, rest_position: wp.array, device: str) -> None:
        """rest_position: [node] [m] of the nodes."""
        self.grid, self._rest_position, self._device = grid_of(low, cell, cells), rest_position, device
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


class MovingClamps:
    """Clamps that follow the load step by step, two held nodes each. Some slide along the warp, as for two hooked wires.

    Sets itself as the stepper's clamps.
    """

    KEPT = ("velocity",)

    def __init__(self, stepper: RodStepper, node: np.ndarray, lever: np.ndarray, sliding: np.ndarray) -> None:
        """node (clamp, 2); lever (clamp, 2, 2) [m] of the nodes at rest, from the clamp; sliding: their indices."""
        device = stepper.device
        self.stepper = stepper
        self.count, self.sliding = len(node), sliding
        self.sliding_node = node[sliding]
        self._entries = Entries(self.sliding_node.ravel(), device)
        slides = np.zeros(self.count, dtype=np.int32)
        slides[sliding] = 1
        self._clamps: dict[str, wp.array] = {
            "clamp_node": wp.array(node, dtype=wp.int32, device=device),
            "clamp_lever": wp.array(lever, dtype=wp.vec2d, device=device),
            "clamp_slides": wp.array(slides, dtype=wp.int32, device=device),
        }
        self.velocity = wp.zeros(self.count, dtype=wp.float64, device=device)  # [m/s] along the warp
        stepper.clamps = self

    @property
    def need_forces(self) -> bool:
        """Whether some clamps slide, by their forces."""
        return len(self.sliding) > 0

    def launches(self, worlds: range) -> list[Launch]:
        """Launches that move the clamps of some worlds after the step of the rods."""
        each = self.count // self.stepper.worlds
        sources = (self.stepper.arrays, self.stepper.state)
        own = {"first_clamp": worlds.start * each, "clamp_velocity": self.velocity}
        return [bind(move_clamps, len(worlds) * each, *sources, **own, **self._clamps)]

    # --- sliding clamps, in the state last evaluated

    @property
    def place(self) -> np.ndarray:
        """[sliding clamp] [m] displacement from the affine position of its first node."""
        return self._of_nodes(self.stepper.state.displacement)[:, 0, 1]

    @property
    def force(self) -> np.ndarray:
        """(sliding clamp, 3) [N] unbalanced force, along the warp."""
        return self._of_nodes(self.stepper.state.force).sum(axis=1) * np.array([0.0, 1.0, 0.0])

    def _of_nodes(self, array: wp.array) -> np.ndarray:
        """(sliding clamp, 2, 3) vectors of both nodes of each clamp."""
        return self._entries.fetch(array).reshape(-1, 2, 3) if self.need_forces else np.zeros((0, 2, 3))


class Edge:
    """Stations of a gripped spatial mesh: pulled, raised or on cords."""

    KEPT = ("station_displacement", "start", "target", "_raised")

    def __init__(self, model: SpatialModel, rest_position: wp.array) -> None:
        """rest_position: [node] [m] of the nodes."""
        self.model, mesh = model, model.global_model
        self.rim: Rim = build_rim(mesh.panel, model.scene)  # with the clamps of all ranks
        held, nodes = mesh.wires.held_node, model.wires.held_node
        own = np.searchsorted(held, nodes if model.strip is None else model.strip.nodes_of_mesh[nodes])[::2] // 2
        self._own_clamps = self.rim.clamps[own]
        self.station_displacement = np.zeros((len(self.rim.arc), 3))  # [station, 3] [m] in addition to the load
        self.start, self.target = self.station_displacement, self.station_displacement  # of given stations, over a load level
        self._raised = 0.0  # share of the height of the paraboloid
        size, place = float(mesh.panel.size.max()), mesh.rods.position[:, :2]
        plate = RBFInterpolator(
            mesh.panel.clamp_position / size, self.rim.clamps.toarray(), kernel="thin_plate_spline", smoothing=SMOOTHING
        )
        low, high, spacing = place.min(axis=0), place.max(axis=0), self.rim.outline.length / len(self.rim.arc)
        counts = np.maximum(np.ceil((high - low) / spacing).astype(int), LEAST_CELLS)
        self._surface = Surface(low, (high - low) / counts, counts, rest_position, model.device)
        grid = np.stack(np.meshgrid(*self._surface.axes, indexing="ij"), axis=-1).reshape(-1, 2)
        self._on_grid = plate(grid / size)  # (grid node, station)

    def set_target(self, load: LoadPoint) -> None:
        """Set the place of given stations at the end of the load level."""
        self.start, self.target, self._raised = self.station_displacement, self.target_of(load), load.raised

    def target_of(self, load: LoadPoint) -> np.ndarray:
        """(station, 3) [m] displacement of given stations under a load."""
        assert load.stations is not None
        return np.column_stack([load.stations, self._height(load.gradient, load.stations, load.raised)])

    def strain_to(self, load: LoadPoint) -> float:
        """Mean strain of the remaining motion of given stations along x and y."""
        left = (self.target_of(load) - self.station_displacement)[self.rim.given, :2]
        return float(np.abs(left).max(initial=0.0) / np.min(self.model.panel.size))

    def _height(self, gradient: np.ndarray, moved: np.ndarray, raised: float) -> np.ndarray:
        """[station] [m] height of the paraboloid, times `raised`, at stations displaced by (station, 2) [m]."""
        focal_length, panel = self.model.scene.panel.focal_length, self.model.panel
        if focal_length is None:
            return np.zeros(len(moved))
        place = (self.rim.place - panel.low - 0.5 * panel.size) @ gradient.T + moved
        return raised * np.sum(place**2, axis=1) / (4.0 * focal_length)

    def follow(self, gradient: np.ndarray) -> None:
        """Raise the target to the paraboloid at another deformation gradient (2, 2)."""
        height = self._height(gradient, self.target[:, :2], self._raised)
        if np.abs(height - self.target[:, 2]).max() > HEIGHT_ERROR * self.model.rods.section.thickness:
            self.target = np.column_stack([self.target[:, :2], height])

    def mesh_displacement(self, station_displacement: np.ndarray) -> np.ndarray:
        """(node, 3) [m] interpolated from stations (station, 3) [m]; held nodes move with their clamps."""
        moved = np.stack([self._surface.at_nodes(values)[0] for values in (self._on_grid @ station_displacement).T], axis=1)
        moved[self.model.wires.held_node] = np.repeat(self._own_clamps @ station_displacement, 2, axis=0)
        return moved

    def grip_forces(self, force: np.ndarray) -> np.ndarray:
        """Forces (clamp, 3) [N] of clamps on wires, from the forces (node, 3) [N] of the wires of all ranks."""
        return -force[self.model.global_model.wires.held_node].reshape(-1, 2, 3).sum(axis=1)

    def move_given(self, share: float) -> np.ndarray:
        """Move given stations to `share` of the load level; returns the displacement (node, 3) [m] of the mesh.

        Free stations are raised with the straight lines between given ones.
        """
        before, given = self.station_displacement, self.rim.given
        there = self.start + share * (self.target - self.start) if share < 1.0 else self.target
        self.station_displacement = np.where(given[:, None], there, before)
        raised = self.rim.chords @ (self.station_displacement - before)[given, 2]
        self.station_displacement[~given, 2] += raised[~given]
        return self.mesh_displacement(self.station_displacement - before)

    def move(self, change: np.ndarray) -> np.ndarray:
        """Move stations by (station, 3) [m]; returns the displacement (held node, 3) [m] of their clamps."""
        self.station_displacement = self.station_displacement + change
        return np.asarray(np.repeat(self._own_clamps @ change, 2, axis=0))
