"""Large spatial meshes: prolongation from smaller ones, and transfer to and from the coarse grid of a membrane.

The grid gathers forces, and spreads displacements as cubic splines, whose slopes have no jumps: a jump would bend the wires that
cross it. Wires rotate with the membrane, and repeats change by the response of endless cloth to the strain, less so within a
repeat of the edge.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.host import fetch, store, take
from ..compute.launch import bind
from ..kernels.membrane_transfer import gather_forces, respond_to_strain
from ..mechanics.grid import CountedForces
from ..mechanics.numerics import MAX_OVERLAP
from ..mechanics.prolongation import RepeatProlongation
from ..mechanics.repeat_mesh import RepeatArrays
from ..mechanics.response import Response
from .clamps import Edge
from .fields import OF_SEGMENTS, Fields
from .model import SpatialModel
from .surface import Surface

MAX_SHIFT = 0.25  # of the thickness: by which a correction moves a loop against its neighbour, so that no wire passes another
LEAST_LIFT = 1.0  # thicknesses: over a panel, changes strains and contacts by far less than any tolerance


def share_of_repeat(model: SpatialModel) -> np.ndarray:
    """[rod node] share of what a repeat does that a gripped mesh does: less within a repeat of the edge.

    By place, not along the wires: what touches moves together.
    """
    assert model.panel.outline is not None
    away = model.panel.outline.nearest(model.rods.position[:, :2])[1]
    return np.asarray(np.minimum(away / min(model.scene.knit.repeat), 1.0))


class Prolongation:
    """Brings a large mesh to the state of a small one (warpknit/mechanics/prolongation.py)."""

    KEPT = ("_last", "_before")

    def __init__(self, large: Fields, small: Fields, arrays: RepeatArrays, edge: Edge | None) -> None:
        """arrays, edge: of the large mesh."""
        self.large, self.small, self._edge = large, small, edge
        self._repeats = RepeatProlongation(large.model, small.model, arrays, fades=False)
        self._last = small.read_everywhere()
        self._before: dict[str, np.ndarray] = {}  # state of the large mesh before the last `carry`
        self._nodes = large.model.panel.node_count
        self._share: np.ndarray | float = 1.0
        if self._repeats.is_periodic and large.model.panel.boundary == "gripped":
            self._share = large.nodes.of_panel(share_of_repeat(large.model))
        self._one = wp.full(len(large.model.panel.wire_first), 1.0, dtype=wp.float64, device=large.model.device)

    @property
    def replaces(self) -> bool:
        """Whether the state of the small mesh replaces the state here; else its change is added."""
        return self._repeats.replaces

    def carry(self, response: Response) -> bool:
        """Bring the large mesh to the small one's state, and raise its stiffnesses.

        `response`: of the cloth at the load. False where wires would overlap too deeply.
        """
        last, self._last = self._last, self.small.read_everywhere()
        taken, stiffness = self._repeats.taken(self._last, last), self.small.read_stiffness()
        change: dict[str, wp.array] = {
            name: wp.array(value, dtype=wp.float64, device=self.large.model.device)
            for name, value in (stiffness | (self._last if taken is None else taken)).items()
        }
        raised = {name: self._prolonged(name, change, response) for name in stiffness}
        self.large.stiffen(raised, self.small.multipliers.mean_force)
        stations = {} if self._edge is None else {"stations": self._edge.station_displacement.copy()}
        self._before = self.large.snapshot() | stations
        if taken is None:
            return True
        own = self.large.read() if self._repeats.replaces else dict.fromkeys(taken, 0.0)
        self.large.add({name: self._share * (self._prolonged(name, change, response) - own[name]) for name in taken})
        fits = self.large.overlap() <= MAX_OVERLAP  # else wires may push each other through
        if fits and self.replaces:
            self._before = {}
        return fits

    def put_back(self) -> None:
        """Return the large mesh to its state before the last `carry`."""
        if self._edge is not None:
            self._edge.station_displacement = self._before["stations"]
        self.large.put_back(self._before)

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
        self._surface = Surface(low, cell, cells, fields.stepper.arrays.rest_position, self.model.device)
        count = int(np.prod(cells + 1))
        stiffness = self.model.rods.section.axial_stiffness
        self._force, self._across_force = (CountedForces(count, stiffness, self.model.device) for _ in range(2))
        panel, device = self.model.panel, self.model.device
        self._entry: wp.array = wp.array(panel.node_entry, dtype=wp.int32, device=device)
        self._share = share_of_repeat(self.model)

    def gather(self) -> np.ndarray:
        """Out-of-balance forces (grid node, 2) [N], in the state last evaluated."""
        stepper = self.fields.stepper
        self._force.counts.zero_()
        self._across_force.counts.zero_()
        own = stepper.strip.nodes
        bind(
            gather_forces, len(own), stepper.arrays, stepper.state, first_node=own.start, grid=self._surface.grid,
            grid_force=self._force.counts, across_force=self._across_force.counts, force_unit=self._force.unit,
        ).run(self.model.device)  # fmt: skip
        return self._force.read(stepper.strip.ranks)

    def gather_across(self) -> np.ndarray:
        """The same out of the plane [grid node] [N], from the last `gather`."""
        return self._across_force.read(self.fields.stepper.strip.ranks)[:, 0]

    def spread(self, displacement: np.ndarray, response: Response) -> None:
        """Move the mesh with the grid (grid node, 2) [m], its repeats as endless cloth answers; the clamps stay."""
        x, y = self._surface.at_nodes(displacement[:, 0]), self._surface.at_nodes(displacement[:, 1])
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
        lift, *slope = self._surface.at_nodes(displacement)
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

    def _on_mesh(self, slope_x: np.ndarray, slope_y: np.ndarray) -> np.ndarray:
        """(2, node) slopes on the deformed mesh, of those at rest."""
        inverse = np.linalg.inv(self.fields.stepper.state.gradient)
        return np.stack([slope_x * inverse[0, k] + slope_y * inverse[1, k] for k in (0, 1)])
