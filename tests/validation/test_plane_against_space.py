"""What the studies of the plane against space read off a state, and what a planar run says of it."""

import numpy as np
import pytest
from condensation import PLANAR, SCENE, SINGLE_ATLAS, SPATIAL, TRICOT, lens_of

from warpknit.measure import wires_slid
from warpknit.mesh.layout import knit_scene
from warpknit.planar.model import slid_wires, tight_loops
from warpknit.planar.state import initial_state
from warpknit.results.row import Row
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation


def strained(strain: float) -> list[str]:
    return [f"load.strain_weft={strain}", f"load.strain_warp={strain}", "output.frames=1"]


def test_lenses_of_a_cell_in_space() -> None:
    """The cell is its own mirror image, which carries its first clasp to its eighth and the second to its seventh: their lenses
    are alike, where the state is at rest within a percent. Wires that have begun to touch have gone part of the way together."""
    mesh = build_model(load_scene(SCENE, [*strained(0.04), *SPATIAL, "solver.residual_tolerance=1e-3"]))
    relaxation = Simulation(mesh)
    *_, record = relaxation.run()
    found = [lens_of(relaxation, record.observables, site) for site in (0, 1, 6, 7)]
    for one, two in ((found[0], found[3]), (found[1], found[2])):
        assert one.width == pytest.approx(two.width, rel=0.01)
        assert one.q == pytest.approx(two.q, rel=0.01)
    as_knitted = mesh.cloth.clasps[0].arms[0].clearance + mesh.cloth.clasps[0].arms[1].clearance
    for lens in found:
        assert 1.25 < lens.width < as_knitted / mesh.rods.section.thickness
        assert lens.force > 0.0 and lens.contacts == 1


def test_bars_of_a_tricot_slide_along_each_other() -> None:
    """Between 5 and 8 % strain the wires of either bar slide along those of the other by several diameters; on the double atlas
    cell, whose wires are all alike, none does, although contacts move along their wires by 14 diameters. A run says so."""
    slid = {}
    for name, knit in (("tricot", TRICOT), ("double atlas", [])):
        model = build_model(load_scene(SCENE, [*knit, *PLANAR, *strained(0.07), "output.frames=7"]))
        *_, record = Simulation(model, initial_state(model)).run()
        slid[name] = wires_slid(record.observables.u, model.panel.wire_first) / model.scene.wire.diameter
        lines = list(slid_wires(model.scene, [Row(slid_max_m=slid[name] * model.scene.wire.diameter)]))
        assert len(lines) == (name == "tricot")
    assert slid["tricot"] > 5.0
    assert slid["double atlas"] < 0.01


def test_wires_slid_is_what_whole_wires_have_moved() -> None:
    moved = np.array([[0.0, 1.0], [0.0, 3.0], [0.5, -1.0], [0.5, -1.0], [0.5, -1.0]])
    assert wires_slid(moved, np.array([0, 2])) == pytest.approx(3.0)


@pytest.mark.parametrize(("knit", "says"), [([], False), (SINGLE_ATLAS, True), (TRICOT, True)])
def test_tight_loops_are_said(knit: list[str], says: bool) -> None:
    scene = load_scene(SCENE, [*knit])
    assert bool(list(tight_loops(scene, knit_scene(scene)))) == says
