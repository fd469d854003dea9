"""The meshes that the kernel tests share: the periodic cell and a gripped patch at 10 % strain, where contacts carry
force; and a patch whose wires have yielded and whose contacts stick."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from reference.solved import solved
from warpknit.planar.model import Model
from warpknit.planar.state import State, initial_state
from warpknit.planar.world_step import WorldStepper
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

SCENES = Path(__file__).parents[2] / "scenes"
MESHES = {
    "cell": ("atlas_cell.toml", ()),
    "patch": ("atlas_patch.toml", ("knit.repeats=[2, 2]",)),
    "yielded": (
        "atlas_patch.toml",
        ("knit.repeats=[2, 2]", "wire.plastic=true", "wire.yield_stress='60 MPa'", "contact.friction=0.2"),
    ),
}
PRECISIONS = ("single", "double")


@dataclass(frozen=True)
class Mesh:
    model: Model
    state: State

    def probe(self, by_pair: bool) -> WorldStepper:
        return WorldStepper(self.model, state=self.state, by_pair=by_pair)


@cache
def _model(mesh: str, precision: str, device: str) -> Model:
    scene, overrides = MESHES[mesh]
    strains = ("load.strain_weft=0.1", "load.strain_warp=0.1", "output.frames=1", f"solver.precision='{precision}'")
    strains = ("model.nodes_per_loop=24", *strains)
    return build_model(load_scene(SCENES / scene, [*overrides, *strains], preset="standard"), device)


@cache
def _settled(mesh: str, precision: str) -> dict[str, np.ndarray]:
    def solve() -> dict[str, np.ndarray]:
        model = _model(mesh, precision, "cpu")
        state = initial_state(model)
        for _record in Simulation(model, state).run():
            pass
        return state.arrays()

    return solved(f"kernel tests, {mesh}, {precision}", solve)


def settled(mesh: str, precision: str = "double", device: str = "cpu") -> Mesh:
    """The mesh at rest under 10 % strain in weft and warp."""
    model = _model(mesh, precision, device)
    state = initial_state(model)
    state.restore(_settled(mesh, precision))
    return Mesh(model, state)


def shaken(mesh: str, precision: str = "double", device: str = "cpu", size: float = 2e-3) -> Mesh:
    """The settled mesh with nodes and bodies displaced at random by up to `size` node spacings, so that nothing
    balances."""
    made = settled(mesh, precision, device)
    model, state = made.model, made.state
    random = np.random.default_rng(5)
    free = np.ones(model.panel.node_count)
    free[model.panel.held_node] = 0.0
    for array, share in (
        (state.node_ux[state.parity], free),
        (state.node_uy[state.parity], free),
        (state.body_ux, 1.0),
        (state.body_uy, 1.0),
    ):
        move = size * model.table.spacing.min() * random.uniform(-1, 1, array.shape[0]) * share
        array.assign(array.numpy() + model.precision.counts(move))
    return made


def node_forces(mesh: Mesh, probe: WorldStepper) -> np.ndarray:
    """Forces (node, 2) [N]; zero at held nodes."""
    probe.probe(np.array([0]))
    panel = mesh.model.panel
    per_wire = mesh.state.wire_mass.numpy().astype(float)
    mass = np.repeat(per_wire, panel.wire_count) / mesh.model.rest.inverse_mass.numpy().astype(float)[mesh.model.panel.node_entry]
    acceleration = np.stack([values.numpy() for values in probe.accelerations[0]], axis=1).astype(float)
    return acceleration * mass[:, None]


def round_off(mesh: Mesh) -> float:
    """[N] force that the rounding of an edge and of its angle makes: EPSILON (EA/s + 4 EI/h^2)."""
    real = np.float32 if mesh.model.precision.name == "single" else np.float64
    axial = float(mesh.state.wire_axial.numpy().max())
    h = float(mesh.model.table.spacing.min())
    return float(np.finfo(real).eps) * (axial + 4 * mesh.model.bending_stiffness / h**2)
