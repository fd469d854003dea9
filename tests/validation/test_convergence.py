"""Meshes of many nodes a loop converge in a number of steps that grows with the square of the nodes.

Fictitious masses go with EI/h^3, so the steps of the slowest bending waves grow with the square of the nodes of a loop: an
undisturbed level takes about 5 n^2 of them.
"""

from pathlib import Path

import pytest

from warpknit import measure
from warpknit.planar.observables import read
from warpknit.planar.state import initial_state
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

SCENES = Path(__file__).parents[2] / "scenes"


def converged_run(scene: str, nodes: int, max_steps: int, *overrides: str) -> Simulation:
    """A simulation that converged within `max_steps` steps a level; else `Diverged` is raised."""
    keys = (f"model.nodes_per_loop={nodes}", f"solver.max_steps={max_steps}", "output.frames=1", *overrides)
    model = build_model(load_scene(SCENES / scene, keys))
    simulation = Simulation(model, initial_state(model))
    *_, last = simulation.run()
    assert last.steady
    return simulation


def test_bodies_do_not_rattle_between_wires_that_drift() -> None:
    """Wires that go to rest together carry bodies along that they hardly squeeze: stopped dead when a wire lets go of them, such
    bodies are hit, let go and stopped again for twice as many steps, and at 200 nodes for good."""
    nodes = 80
    converged_run("atlas_cell.toml", nodes, 6 * nodes**2)


@pytest.mark.slow
def test_slow_wires_do_not_count_as_taut() -> None:
    """Wires with slack miss their stretch for as long as they move: on the way to rest 4 % of strain leaves all as soft as the
    bound on the softening, y^2 EA/(3 EI), does, and single precision finds the forces of double."""
    overrides = ("knit.repeats=[2, 2]", "load.strain_weft=0.04", "load.strain_warp=0.04")
    found, nodes = [], 48
    for precision in ("single", "double"):
        simulation = converged_run("atlas_patch.toml", nodes, 10 * nodes**2, *overrides, f'solver.precision="{precision}"')
        soft = simulation.model.axial_stiffness / simulation.model.softening
        assert simulation.state.wire_axial.numpy().max() < 16 * soft
        found.append(measure.mesh_tension(read(simulation.model, simulation.state)))
    tolerance = simulation.model.scene.solver.residual_tolerance
    assert found[0] == pytest.approx(found[1], rel=tolerance)
