"""The study of metal meshes pulled to break (tools/studies/pulled_meshes.py), its bounds and its strips with free sides."""

from __future__ import annotations

import math
from functools import cache

import pytest
from pulled_data import CASES, MESHES, Case
from pulled_meshes import pulls_of, scene_of
from strip_bounds import straight_strain, strongest, yarns_across
from strip_pull import FREE, WARP, WEFT, Level, Pull, pull

from warpknit import measure
from warpknit.model import build_model
from warpknit.scene import Scene
from warpknit.solve.simulate import Simulation

INCH = 25.4e-3
HF_1, LF_2 = MESHES[:2]
ELASTIC = Case("elastic and smooth", {"wire.plastic": False, "contact.friction": 0.0})


@cache
def smooth() -> Scene:
    return scene_of(HF_1, (26, 33), ELASTIC)


def test_wires_across_a_line_are_counted() -> None:
    """Reverse locknit: a line across the wales cuts, for each of two bars, two legs and an underlap a wale; one across the
    courses, the underlaps of one and of two needles. All of them at their strength carry n A sigma over the spacing."""
    scene = smooth()
    assert yarns_across(scene, WARP) == pytest.approx(6 * 26 / INCH)
    assert yarns_across(scene, WEFT) == pytest.approx(3 * 33 / INCH)
    area = 4 * math.pi * (8.5e-6) ** 2
    assert strongest(scene, WEFT, 1e9) == pytest.approx(3 * 33 / INCH * area * 1e9)


def test_wire_is_straight_when_its_course_is_spent() -> None:
    """2220 mm a rack of 480 courses: along the wales L = 3 C'. 2370 mm of the bar that goes two needles: along the courses
    L = 2 W'."""
    scene = smooth()
    assert straight_strain(scene, WARP) == pytest.approx(2.220 / 480 / (3 * INCH / 33) - 1.0, rel=2e-3)
    assert straight_strain(scene, WEFT) == pytest.approx(2.370 / 480 / (2 * INCH / 26) - 1.0, rel=2e-3)


def test_forces_between_levels_are_interpolated() -> None:
    levels = tuple(Level(e, 0.0, f, a, 0.0, 0.0) for e, f, a in ((0.0, 0.0, 0.0), (0.1, 50.0, 1e8), (0.2, 150.0, 3e8)))
    pulled = Pull(levels, "end", 0)
    assert pulled.strain_at(100.0) == pytest.approx(0.15) and math.isnan(pulled.strain_at(200.0))
    assert pulled.force_at(2e8) == pytest.approx(100.0) and pulled.force_at(9e8) == pytest.approx(450.0)


def test_a_strip_has_free_sides() -> None:
    """Without friction and yield the state does not depend on the search: the force along the wales is that of a run whose weft
    tension is prescribed as zero. Tolerance: both hold the tension across within a share of that along, FREE and the residual,
    and it acts on the force by Poisson's ratio, at most one here; so does the residual itself."""
    scene, strain = smooth(), 0.06
    last = pull(scene, WARP, strain, step=0.02).levels[-1]
    run = scene.changed({"load.strain_warp": strain, "load.tension_weft": 0.0, "output.frames": 3})
    *_, record = Simulation(build_model(run)).run()
    weft = float(record.observables.gradient[0, 0]) - 1.0
    there = measure.mesh_tension(record.observables)[WARP] * (1.0 + weft)
    assert last.strain == pytest.approx(strain)
    assert last.force == pytest.approx(there, rel=2.0 * (FREE + scene.solver.residual_tolerance))
    assert last.strain_across == pytest.approx(weft, abs=0.005)


def test_a_wire_that_yields_is_pulled_by_less() -> None:
    """At 30 % along the wales wires have passed the elastic limit: with yield they carry less bending, and the strip less
    force. Up to there the axial stress is a hundredth of the strength, so that bending carries the load."""
    elastic = pull(smooth(), WARP, 0.3, step=0.06)
    yielding = pull(smooth().changed({"wire.plastic": True}), WARP, 0.3, step=0.06)
    assert elastic.levels[-1].strain == yielding.levels[-1].strain == pytest.approx(0.3)
    assert yielding.levels[-1].force < 0.8 * elastic.levels[-1].force
    assert yielding.levels[-1].fibre < elastic.levels[-1].fibre
    assert elastic.levels[-1].axial < 0.05 * HF_1.middle


@pytest.mark.slow
def test_every_case_is_a_scene() -> None:
    """Each can be knitted, with both bars at their run-in where that is known; the plane is not taken for any of them."""
    for mesh in MESHES:
        for spacing in mesh.spacings.values():
            scene = scene_of(mesh, spacing, Case(""))
            assert scene.changed({"model.kind": "auto"}).model.kind == "spatial"
    for case in CASES:
        scene_of(LF_2 if case.bars else HF_1, (26, 30) if case.bars else (26, 33), case)


@pytest.mark.slow
def test_the_quick_study_ends_with_wires_at_their_strength_or_near_it() -> None:
    """Both pulls of HF-1 go on until wire is nearly straight, and no wire carries more than all wires across a line."""
    for row, levels in pulls_of(HF_1, quick=True):
        assert row.last_strain > 0.6 * row.straight_strain and levels[-1].force > 100.0
        assert row.last_force < row.bound_strong and row.force_strong < row.bound_strong
