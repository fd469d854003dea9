"""Meshes in space that are cut along other outlines than a rectangle: where their clamps stand, and what these carry."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from warpknit import measure
from warpknit.planar.state import initial_state
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.spatial.observables import SpatialObservables

SCENES = Path(__file__).parents[1] / "scenes"
OUTLINES = {
    "hexagon": ["panel.size=3 mm"],
    "turned": ["panel.size=4 mm", "panel.rotation=0.3"],
    "disc": ["panel.size=7 mm"],
    "triangle": ["panel.size=9 mm"],
    "polygon": ["panel.corners=[[0.0, 0.0], [9e-3, 0.0], [9e-3, 4e-3], [5e-3, 4e-3], [5e-3, 9e-3], [0.0, 9e-3]]"],
}
SMALL = ["model.boundary=gripped", "output.frames=1", "solver.residual_tolerance=0.01"]


def scene_of(outline: str, *settings: str):
    shape = "hexagon" if outline == "turned" else outline
    keys = [*SMALL, f"panel.outline={shape}", *OUTLINES[outline], *settings]
    return load_scene(SCENES / "atlas_cell_spatial.toml", keys, "draft")


def at_rest(outline: str, *settings: str) -> SpatialObservables:
    relaxation = Simulation(build_model(scene_of(outline, *settings)))
    relaxation.compile()
    *_, last = relaxation.run()
    return last.observables


@pytest.mark.parametrize("outline", OUTLINES)
def test_clamps_stand_on_the_outline_in_the_middle_of_their_segments(outline):
    """The middle of a chord is off its arc by h^2 kappa/8: by h/8 times the angle between segments, the sharpest of the mesh."""
    mesh = build_model(scene_of(outline))
    rods, panel = mesh.rods, mesh.panel
    clamp = panel.clamp_position
    assert clamp.shape == (2 * len(rods.wire_first), 2)
    _, away = panel.outline.nearest(clamp)
    assert away.max() < 1e-6 * float(panel.size.max())
    middle = rods.position[mesh.wires.held_node, :2].reshape(-1, 2, 2).mean(axis=1)
    sharpest = 0.0
    for points in np.split(rods.position, rods.wire_first[1:]):
        along = np.diff(points, axis=0)
        along /= np.linalg.norm(along, axis=1)[:, None]
        sharpest = max(sharpest, float(np.arccos(np.sum(along[1:] * along[:-1], axis=1)).max()))
    assert np.linalg.norm(middle - clamp, axis=1).max() < rods.natural_length.max() * sharpest / 8.0


@pytest.fixture(scope="module")
def pulled() -> SpatialObservables:
    return at_rest("hexagon", "load.strain_weft=0.02", "load.strain_warp=0.02", "model.nodes_per_loop=40")


def test_grips_carry_what_the_mesh_does_and_nothing_else(pulled):
    """Forces between wires and within them come in pairs, so that what the clamps feel is minus what is out of balance inside: at
    most the sum of its sizes. And P A0 = - sum over clamps f (x) c - sum over free nodes f (x) X to round-off: the tension
    by virtual work is that of the clamps but for what is out of balance."""
    mesh, force = pulled.model, pulled.force
    held = mesh.wires.held_node
    free = np.setdiff1d(np.arange(mesh.rods.node_count), held)
    of_clamp = force[held].reshape(-1, 2, 3).sum(axis=1)
    carried = np.linalg.norm(of_clamp, axis=1)
    left = np.linalg.norm(force[free], axis=1)
    assert np.linalg.norm(of_clamp.sum(axis=0)) <= left.sum() < 0.01 * carried.sum()
    by_clamps = -np.einsum("ia,ib->ab", of_clamp[:, :2], mesh.panel.clamp_position)
    inside = np.einsum("ia,ib->ab", force[free, :2], mesh.rods.position[free, :2])
    total = mesh.panel.area * pulled.nominal_stress
    assert total == pytest.approx(by_clamps - inside, abs=1e-9 * np.abs(total).max())
    assert np.abs(inside).max() < 0.01 * np.abs(total).max()


@pytest.mark.slow
@pytest.mark.parametrize(("outline", "size"), [("hexagon", "4 mm"), ("disc", "7 mm")])
def test_a_panel_in_space_carries_what_the_planar_one_does(outline, size):
    """Where contacts have closed the two models differ by 9 % in the tension that contacts bring (studies/condensation.md), of
    which a small patch between grips has little; as many nodes a loop."""
    load = [f"panel.size={size}", "load.strain_weft=0.1", "load.strain_warp=0.1"]
    found = at_rest(outline, *load)
    plane = ["model.kind=planar", "model.nodes_per_loop=48", "solver.precision=double", "solver.residual_tolerance=1e-3"]
    model = build_model(scene_of(outline, *load, *plane))
    *_, last = Simulation(model, initial_state(model)).run()
    assert measure.mesh_tension(found) == pytest.approx(measure.mesh_tension(last.observables), rel=0.03)
    assert measure.interior_stress(found) == pytest.approx(measure.interior_stress(last.observables), rel=0.06)


@pytest.mark.parametrize("nodes", [20, 28])
def test_wires_cut_at_one_place_do_not_touch_in_their_clamps(nodes):
    """A cut may take two wires where they touch. The chords of their clamps overlap, by more than half a wire at 20 nodes a
    loop; nothing moves there, and no contact is listed between two clamps."""
    inch, tight = 25.4e-3, ["wire.material=molybdenum", "wire.diameter=30 um", 'knit.bars=[{chain="1-0/1-2"}, {chain="1-2/1-0"}]']
    spacing = [f"knit.wale_spacing={inch / 26}", f"knit.course_spacing={inch / 30}", f"model.nodes_per_loop={nodes}"]
    keys = [*SMALL, "panel.outline=hexagon", "panel.size=12 mm", *tight, *spacing]
    model = build_model(load_scene(SCENES / "atlas_cell_spatial.toml", keys, "draft"))
    rods, held = model.rods, model.wires.held_node.reshape(-1, 2)
    share = np.linspace(0.0, 1.0, 41)[:, None]
    chords = np.concatenate([(1.0 - share) * rods.position[first] + share * rods.position[last] for first, last in held])
    close = cKDTree(chords).query_pairs(rods.section.thickness, output_type="ndarray") // len(share)
    assert np.any(close[:, 0] != close[:, 1])
    simulation = Simulation(model)
    simulation.compile()
    simulation.mechanics.contact.search()
    simulation.mechanics.stepper.evaluate()
    near = simulation.mechanics.contact.find_contacts(0.5 * rods.section.thickness)
    is_held = np.zeros(rods.node_count, dtype=bool)
    is_held[held[:, 0]] = True
    assert len(near.first) > 0
    assert not np.any(is_held[near.first] & is_held[near.second])
