"""A dead load of one's own on a clamped wire in space: the beam under tension, and the balance of forces.

w'''' = q^2 w'' with q^2 = T/EI between two clamps, loaded by P at the middle of the span 2 a:

    w_max = P (q a - 2 tanh(q a/2)) / (2 q T)

A clamp holds two nodes, so that the wire bends from the middle of the segment between them on. T is the tension that the model
finds.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.constants import g as GRAVITY

from warpknit import Simulation, build_model, load_scene
from warpknit.base.errors import ModelError

LENGTH = 4e-3  # [m]
SCENES = Path(__file__).parents[2] / "scenes"


def clamped_wires(folder: Path, spacing: float, **tables: Any) -> Simulation:
    """Two straight wires side by side, which never touch."""
    x = 1e3 * np.linspace(0.0, LENGTH, 81)
    rows = [f"{wire},{place},{wire},0" for wire in (1, 2) for place in x]
    (folder / "wires.csv").write_text("\n".join(["wire,x [mm],y [mm],z [mm]", *rows]))
    wires = {"file": folder / "wires.csv", "node_spacing": spacing}
    scene = {
        "wire": {"diameter": "50 um"},
        "wires": wires,
        "solver": {"residual_tolerance": 1e-3},
        "contact": {"friction": 0.0},
        "variants": {"count": 1},
        "output": {"frames": 1},
    } | tables
    return Simulation(build_model(load_scene(scene)))


@pytest.mark.parametrize(("spacing", "tolerance"), [(100e-6, 5e-3), (50e-6, 1.25e-3)])  # the error falls with h^2
def test_a_clamped_wire_bends_as_a_beam_under_tension(tmp_path: Path, spacing: float, tolerance: float) -> None:
    simulation = clamped_wires(tmp_path, spacing)
    model = simulation.model
    stiffness, nodes = model.bending_stiffness, model.node_count // 2
    load = 1e-2 * 192.0 * stiffness / LENGTH**2
    force = np.zeros((model.node_count, 3))
    force[nodes // 2, 2] = load
    simulation.set_force(force)
    state = list(simulation.run())[-1].observables
    tension, half_span = state.tension[2 : nodes - 3].mean(), (LENGTH - spacing) / 2
    q = np.sqrt(tension / stiffness)
    deflection = load * (q * half_span - 2.0 * np.tanh(q * half_span / 2.0)) / (2.0 * q * tension)
    assert state.node_position[:, 2].max() == pytest.approx(deflection, rel=tolerance, abs=0)
    left = model.node_count * state.unbalanced_force  # the sum of n forces is at most n times their rms
    assert left < 1e-2 * load
    np.testing.assert_allclose(state.edge_force.sum(axis=0), -force.sum(axis=0), rtol=0, atol=left)


@pytest.mark.parametrize("spacing", [100e-6, 50e-6])
def test_own_weight_bends_clamped_wires_that_nothing_else_loads(tmp_path: Path, spacing: float) -> None:
    """w_max = q l^4/(384 EI) between clamps l apart, with the weight q of the wire a metre, to 11 (h/l)^2 of differences."""
    simulation = clamped_wires(tmp_path, spacing, load={"strain_weft": 0.0})
    model = simulation.model
    weight = GRAVITY * model.scene.wire.linear_density
    simulation.set_force(np.full((model.node_count, 3), [0.0, 0.0, -weight * spacing]))
    unloaded, *_, last = simulation.run()
    sag = weight * (LENGTH - spacing) ** 4 / (384.0 * model.bending_stiffness)
    for record in (unloaded, last):
        assert -record.observables.node_position[:, 2].min() == pytest.approx(sag, rel=11.0 * (spacing / LENGTH) ** 2, abs=0)


def test_only_forces_on_the_nodes_of_a_model_in_space_are_taken(tmp_path: Path) -> None:
    simulation = clamped_wires(tmp_path, 100e-6)
    for wrong in (np.zeros(3), np.full((simulation.model.node_count, 3), np.nan), "abc", np.zeros((1, 3), dtype=complex)):
        with pytest.raises(ModelError, match="^forces on nodes: "):
            simulation.set_force(wrong)
    planar = Simulation(build_model(load_scene(SCENES / "atlas_cell.toml")))
    with pytest.raises(ModelError, match="planar"):
        planar.set_force(np.zeros((planar.model.node_count, 3)))


def test_a_tile_that_nothing_holds_takes_no_resultant() -> None:
    """Its own weight is refused; forces that add up to zero are taken."""
    simulation = Simulation(build_model(load_scene(SCENES / "atlas_cell_spatial.toml")))
    weight = np.full((simulation.model.node_count, 3), [0.0, 0.0, -1e-9])
    with pytest.raises(ModelError, match="forces on nodes: .* nN"):
        simulation.set_force(weight)
    weight[: len(weight) // 2] *= -1.0
    simulation.set_force(weight)
