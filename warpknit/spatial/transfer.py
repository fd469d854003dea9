"""Large spatial meshes: prolongation from smaller ones, and transfer to and from the coarse grid of a membrane.

The grid gathers forces, and spreads displacements as cubic splines, whose slopes have no jumps: a jump would bend the wires that
cross it. Wires rotate with the membrane, and repeats change by the response of endless cloth to the strain, less so within a
repeat of the edge.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from scipy.interpolate import RectBivariateSpline

from ..compute.host import fetch, store, take
from ..compute.launch import bind
from ..kernels.membrane_transfer import Grid, gather_forces, respond_to_strain, spread_surface
from ..mechanics.grid import CountedForces
from ..mechanics.numerics import MAX_OVERLAP
from ..mechanics.prolongation import RepeatProlongation
from ..mechanics.repeat_mesh import RepeatArrays
from ..mechanics.response import Response
from .fields import OF_SEGMENTS, Fields

MAX_SHIFT = 0.25  # of the thickness: by which a correction moves a loop against its neighbour, so that no wire passes another
LEAST_LIFT = 1.0  # thicknesses: over a panel, changes strains and contacts by far less than any tolerance


class Prolongation:
    """Brings a large mesh to the state of a small one (warpknit/mechanics/prolongation.py)."""

    KEPT = ("_last",)

    def __init__(self, large: Fields, small: Fields, arrays: RepeatArrays) -> None:
        """arrays: of the large mesh."""
        self.large, self.small = large, small
        self._repeats = RepeatProlongation(large.model, small.model, arrays)
        self._last = small.read_everywhere()
        self._nodes = large.model.panel.node_count
        self._one = wp.full(len(large.model.panel.wire_first), 1.0, dtype=wp.float64, device=large.model.device)

    def carry(self, response: Response) -> bool:
        """Bring the large mesh to the small one's state, and raise its stiffnesses.

        `response`: of the cloth at the load. False where wires would overlap: the large mesh keeps its own state.
        """
        last, self._last = self._last, self.small.read_everywhere()
        taken, stiffness = self._repeats.taken(self._last, last), self.small.read_stiffness()
        change: dict[str, wp.array] = {
            name: wp.array(value, dtype=wp.float64, device=self.large.model.device)
            for name, value in (stiffness | (self._last if taken is None else taken)).items()
        }
        raised = {name: self._prolonged(name, change, response) for name in stiffness}
        self.large.stiffen(raised, self.small.multipliers.mean_force)
        if taken is None:
            return True
        own = self.large.read() if self._repeats.replaces else dict.fromkeys(taken, 0.0)
        before = self.large.snapshot()
        self.large.add({name: self._prolonged(name, change, response) - own[name] for name in taken})
        if self.large.overlap() <= MAX_OVERLAP:  # else wires may push each other through
            return True
        self.large.put_back(before)
        return False

    def _prolonged(self, name: str, change: dict[str, wp.array], response: Response) -> np.ndarray:
        """[panel node] of the large mesh, from values of the small one."""
        value = wp.zeros(self._nodes, dtype=wp.float64, device=self.large.model.device)
        self._repeats.add_to_nodes(value, name, change, response, self._one)
        return take(value)


class MembraneGrid:
    """A grid of `cells` (2,) from `low` (2,) [m] on, each of size `cell` (2,) [m], over a mesh."""

    def __init__(self, fields: Fields, low: np.ndarray, cell: np.ndarray, cells: np.ndarray) -> None:
        self.fields, self.model = fields, fields.model
        self.least_lift = LEAST_LIFT * self.model.rods.section.thickness
        self.max_strain = MAX_SHIFT * self.model.rods.section.thickness / self.model.scene.knit.wale_spacing
        self._grid = Grid()
        self._grid.low, self._grid.cell, self._grid.cells = wp.vec2d(*low), wp.vec2d(*cell), wp.vec2i(*map(int, cells))
        count = int(np.prod(cells + 1))
        stiffness = self.model.rods.section.axial_stiffness
        self._force, self._across_force = (CountedForces(count, stiffness, self.model.device) for _ in range(2))
        panel, device = self.model.panel, self.model.device
        self._entry: wp.array = wp.array(panel.node_entry, dtype=wp.int32, device=device)
        # by place, not along the wires: what touches moves together
        assert panel.outline is not None
        away = panel.outline.nearest(self.model.rods.position[:, :2])[1]
        self._share = np.minimum(away / min(self.model.scene.knit.repeat), 1.0)
        self._axes = [begin + size * np.arange(count + 1) for begin, size, count in zip(low, cell, cells, strict=True)]

    def gather(self) -> np.ndarray:
        """Out-of-balance forces (grid node, 2) [N], in the state last evaluated."""
        stepper = self.fields.stepper
        self._force.counts.zero_()
        self._across_force.counts.zero_()
        own = stepper.strip.nodes
        bind(
            gather_forces, len(own), stepper.arrays, stepper.state, first_node=own.start, grid=self._grid,
            grid_force=self._force.counts, across_force=self._across_force.counts, force_unit=self._force.unit,
        ).run(self.model.device)  # fmt: skip
        return self._force.read(stepper.strip.ranks)

    def gather_across(self) -> np.ndarray:
        """The same out of the plane [grid node] [N], from the last `gather`."""
        return self._across_force.read(self.fields.stepper.strip.ranks)[:, 0]

    def spread(self, displacement: np.ndarray, response: Response) -> None:
        """Move the mesh with the grid (grid node, 2) [m], its repeats as endless cloth answers; the clamps stay."""
        x, y = self._surface(displacement[:, 0]), self._surface(displacement[:, 1])
        shear = 0.5 * (x[2] + y[1])  # sections rotate with the mesh as below
        changes = self._answer({"gradient_xx": x[1], "gradient_xy": shear, "gradient_yx": shear, "gradient_yy": y[2]}, response)
        changes["x"], changes["y"] = changes.get("x", 0.0) + x[0], changes.get("y", 0.0) + y[0]
        (along_x, along_y) = (self._on_mesh(*slope) for slope in (x[1:], y[1:]))
        rotation = 0.5 * (along_y[0] - along_x[1]) * fetch(self.fields.stepper.state.tangent)[:, 2]
        changes["turn"] = changes.get("turn", 0.0) + rotation
        self.fields.move(changes)

    def spread_across(self, displacement: np.ndarray) -> None:
        """Move the mesh out of plane with the grid [grid node] [m], and stop it; clamps stay."""
        stepper, rods = self.fields.stepper, self.model.rods
        lift, *slope = self._surface(displacement)
        along_x, along_y = self._on_mesh(*slope)
        height = rods.position[:, 2] - stepper.strip.whole.position[:, 2].mean()
        tangent = fetch(stepper.state.tangent)
        turn = along_y * tangent[:, 0] - along_x * tangent[:, 1]
        self.fields.move({"x": -along_x * height, "y": -along_y * height, "z": lift, "turn": turn})
        velocity = stepper.state.velocity
        store(velocity, fetch(velocity) * np.array([1.0, 1.0, 0.0]))

    def _answer(self, gradient: dict[str, np.ndarray], response: Response) -> dict[str, np.ndarray]:
        """Fields [node] that the repeats change by as the grid strains them, by name; gradient: [node] of the displacement."""
        nodes, panel, device = self.fields.nodes, self.model.panel, self.model.device
        on_panel = {name: nodes.of_panel(part) for name, part in gradient.items()}
        of_panel: dict[str, wp.array] = {name: wp.array(part, dtype=wp.float64, device=device) for name, part in on_panel.items()}
        value, answer = wp.zeros(panel.node_count, dtype=wp.float64, device=device), {}
        for name, cell in response.change.items():
            bind(
                respond_to_strain, panel.node_count, response, node_entry=self._entry, cell=cell, value=value, **of_panel,
            ).run(device)  # fmt: skip
            answer[name] = self._share * nodes.of_rods(fetch(value), of_segments=name in OF_SEGMENTS)
        return answer

    def _surface(self, values: np.ndarray) -> tuple[np.ndarray, ...]:
        """Values and slopes along x and y [1/m] of a cubic spline at rest places [node]. values [grid node]."""
        nodes, device, counts = self.model.node_count, self.model.device, [len(axis) for axis in self._axes]
        if not values.any():  # so for a single cell, whose edge is held
            return np.zeros(nodes), np.zeros(nodes), np.zeros(nodes)
        spline = RectBivariateSpline(*self._axes, values.reshape(counts), kx=min(3, counts[0] - 1), ky=min(3, counts[1] - 1))
        cell = [axis[1] - axis[0] for axis in self._axes]
        known = [spline(*self._axes, dx=a, dy=b).ravel() * cell[0] ** a * cell[1] ** b for b in (0, 1) for a in (0, 1)]
        surface: wp.array = wp.array(np.ascontiguousarray(np.transpose(known)), dtype=wp.float64, device=device)
        value, slope_x, slope_y = (wp.zeros(nodes, dtype=wp.float64, device=device) for _ in range(3))
        bind(
            spread_surface, nodes, self.fields.stepper.arrays, grid=self._grid, surface=surface, value=value, slope_x=slope_x,
            slope_y=slope_y,
        ).run(device)  # fmt: skip
        return take(value), take(slope_x), take(slope_y)

    def _on_mesh(self, slope_x: np.ndarray, slope_y: np.ndarray) -> np.ndarray:
        """(2, node) slopes on the deformed mesh, of those at rest."""
        inverse = np.linalg.inv(self.fields.stepper.state.gradient)
        return np.stack([slope_x * inverse[0, k] + slope_y * inverse[1, k] for k in (0, 1)])
