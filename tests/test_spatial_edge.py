"""Pulled edges and cords of meshes in space: how the mesh is carried along, what balances, and the work that goes in."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp

from warpknit import measure
from warpknit.compute.kept import Owner, restore, save
from warpknit.mesh.rim import LoadPoint
from warpknit.planar.state import initial_state
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Record, Simulation
from warpknit.spatial.clamps import Edge

SCENES = Path(__file__).parents[1] / "scenes"
HEXAGON = ["model.boundary=gripped", "panel.outline=hexagon", "output.frames=1", "solver.residual_tolerance=0.01"]
SMALL = [*HEXAGON, "panel.size=3 mm", "model.nodes_per_loop=40"]
CORD = ["panel.grip_pitch=3 mm", "panel.cord={tension=2e-3, stiffness=1.0}"]


def scene_of(*settings: str):
    return load_scene(SCENES / "atlas_cell_spatial.toml", settings, "draft")


def pull(by: str, at: str = "3 mm") -> str:
    return f'load.pull=[{{at=["{at}", "0 mm"], by=["{by}", "0 mm"], width="3 mm"}}]'


def at_rest(*settings: str) -> tuple[Simulation, Record]:
    relaxation = Simulation(build_model(scene_of(*settings)))
    relaxation.compile()
    *_, last = relaxation.run()
    return relaxation, last


def test_stations_that_move_as_one_sheet_carry_the_mesh_as_that_sheet():
    """A thin plate through the clamps gives linear motions back at every node; both nodes of a clamp move as the clamp does."""
    mesh = build_model(scene_of(*SMALL, *CORD))
    edge = Edge(mesh, wp.array(mesh.rods.position, dtype=wp.vec3d, device=mesh.device))
    rim = edge.rim
    sheet = np.array([[0.02, 0.03], [-0.01, 0.05], [0.04, -0.02]])
    found = edge.mesh_displacement(rim.place @ sheet.T)
    held = mesh.wires.held_node
    free = np.setdiff1d(np.arange(mesh.rods.node_count), held)
    size = float(mesh.panel.size.max())
    assert found[free] == pytest.approx(mesh.rods.position[free, :2] @ sheet.T, abs=1e-5 * size)
    assert found[held] == pytest.approx(np.repeat(mesh.panel.clamp_position @ sheet.T, 2, axis=0), abs=1e-12)


def test_a_small_pull_stores_the_work_of_its_clamps():
    """Clapeyron: a pull of q on a mesh free of stress stores f q/2, which is what the work is by the mean of the forces at both
    ends. 2 um over 2 mm is a strain of 1e-3; stiffness changes by as much, and 1 % is left out of balance."""
    close = "solver.residual_tolerance=0.001"
    _, last = at_rest(*SMALL, close, "load.strain_weft=0.0", "load.strain_warp=0.0", pull("2 um"))
    assert np.linalg.norm(last.stations, axis=1).max() == pytest.approx(2e-6, rel=1e-9)
    assert last.edge_work > 0.0
    assert last.edge_work == pytest.approx(last.observables.energies.stored, rel=0.02, abs=0.0)


def test_a_cord_carries_what_the_clamps_between_net_nodes_do():
    """At every free station the cord and its clamps balance within the tolerance of what the clamps carry, the cord hangs
    inwards, and the net nodes, which hold all of it, hold nothing more."""
    relaxation, last = at_rest(*SMALL, *CORD, "load.strain_weft=0.02", "load.strain_warp=0.02")
    edge, r = relaxation.mechanics.edge, last.observables
    free = ~edge.rim.given
    carried = edge.rim.clamps.T @ edge.grip_forces(r.force)
    balance = edge.rim.cord_forces(r.gradient, edge.station_displacement)[0] - carried
    tolerance = 0.01 * np.sqrt(np.mean(carried[free] ** 2))
    assert free.sum() == 6 and np.sqrt(np.mean(balance[free] ** 2)) < tolerance
    middle = edge.rim.place.mean(axis=0)
    assert np.all(np.sum(last.stations[free, :2] * (edge.rim.place[free] - middle), axis=1) < 0.0)
    left = np.linalg.norm(np.delete(r.force, edge.model.wires.held_node, axis=0)[:, :2], axis=1).sum()
    assert np.abs(balance[~free].sum(axis=0)).max() < left + free.sum() * tolerance
    assert np.all(last.stations[~free] == 0.0)


def test_an_edge_is_taken_up_where_it_was_left():
    """What a checkpoint keeps gives the same stations and shares."""
    relaxation = Simulation(build_model(scene_of(*SMALL, *CORD)))
    edge = relaxation.mechanics.edge
    edge.set_target(LoadPoint(np.eye(2), 293.15, stations=np.full((len(edge.rim.arc), 2), 1e-6)))
    edge.move_given(0.5)
    edge.move(np.where(edge.rim.given[:, None], 0.0, 1e-6))
    other = Simulation(build_model(scene_of(*SMALL, *CORD)))
    restore(save(Owner(edge)), Owner(other.mechanics.edge))
    assert np.array_equal(other.mechanics.edge.station_displacement, edge.station_displacement)
    assert np.array_equal(other.mechanics.edge.move_given(0.7), edge.move_given(0.7))


@pytest.mark.slow
def test_a_pulled_panel_in_space_is_that_of_the_plane():
    """Both tensions and the work of the pull of 0.3 mm, with as many nodes a loop; contacts, which close sooner in space, carry
    little here."""
    settings = [*HEXAGON, "panel.size=4 mm", "load.strain_weft=0.02", "load.strain_warp=0.02", pull("0.3 mm", at="4 mm")]
    settings.append("model.nodes_per_loop=48")
    _, last = at_rest(*settings)
    plane = ["model.kind=planar", "solver.precision=double", "solver.residual_tolerance=1e-3"]
    model = build_model(scene_of(*settings, *plane))
    *_, other = Simulation(model, initial_state(model)).run()
    assert measure.mesh_tension(last.observables) == pytest.approx(measure.mesh_tension(other.observables), rel=0.04)
    assert last.edge_work == pytest.approx(other.edge_work, rel=0.05, abs=0.0)
