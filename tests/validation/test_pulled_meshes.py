"""The study of metal meshes pulled to break (tools/studies/pulled_meshes.py), its bounds and its strips with free sides."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
import strip_pull
from pulled_data import CASES, MESHES, Case
from pulled_inputs import QUICK
from pulled_inputs import rows_of as inputs_of
from pulled_meshes import pulls_of, scene_of
from strip_bounds import straight_strain, strongest, yarns_across
from strip_pull import FREE, WARP, WEFT, Level, Pull, pull

from warpknit import measure
from warpknit.scene import Scene
from warpknit.solve.model import build_model
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


@pytest.mark.slow
def test_a_wire_that_yields_is_pulled_by_less() -> None:
    """At 30 % along the wales wires have passed the elastic limit: with yield they carry less bending, and the strip less
    force. Up to there the axial stress is a hundredth of the strength, so that bending carries the load."""
    elastic = pull(smooth(), WARP, 0.3, step=0.06)
    yielding = pull(smooth().changed({"wire.plastic": True}), WARP, 0.3, step=0.06)
    assert elastic.levels[-1].strain == yielding.levels[-1].strain == pytest.approx(0.3)
    assert yielding.levels[-1].force < 0.8 * elastic.levels[-1].force
    assert yielding.levels[-1].fibre < elastic.levels[-1].fibre
    assert elastic.levels[-1].axial < 0.05 * HF_1.middle


def test_a_strip_that_is_held_in_width_is_stiffer() -> None:
    """At the width as knitted it carries tension across. Of all widths the free one has the least energy, so the work of a pull
    from the mesh as knitted is less with free sides: the sum of two forces, by trapezoids, and the last one."""
    free, held = (pull(smooth(), WARP, 0.12, step=0.06, held=held).levels for held in (False, True))
    assert [v.strain for v in held] == pytest.approx([v.strain for v in free])
    assert all(v.strain_across == 0.0 for v in held) and abs(free[-1].strain_across) > 0.01
    assert held[1].force + 0.5 * held[2].force > 1.02 * (free[1].force + 0.5 * free[2].force)


class _Fold:
    """Stands for the relaxation of a mesh whose tension across [N/m] jumps from one branch to another, one width apart, and
    that starts each trial from the state it was restored to. Branch 0: 1 + 10 (a + 0.05) down to a = -0.05; branch 1:
    -1 + 100 (a + 0.05) up to a = -0.03. Without tension across there is only a = -0.04 on branch 1."""

    branch, across = 0, 0.0

    def snapshot(self) -> dict[str, Any]:
        return {"branch": self.branch, "across": self.across}

    def restore(self, kept: dict[str, Any]) -> None:
        self.branch, self.across = kept["branch"], kept["across"]

    def solve(self, strain: float, across: float) -> None:
        self.across = across
        self.branch = 1 if across < -0.05 else 0 if across > -0.03 else self.branch

    def mesh_tension(self, observed: object) -> np.ndarray:
        side = (1.0 + 10.0 * (self.across + 0.05), -1.0 + 100.0 * (self.across + 0.05))[self.branch]
        return np.array([side, 2.0])  # weft, warp


def test_a_strip_goes_on_behind_a_jump_of_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trials from the state before the jump find tension across of either sign and none between; from the state behind it the
    strip finds the width without. The tolerance is FREE of the tension along, by the slope of the branch."""
    fold, strip = _Fold(), object.__new__(strip_pull._Strip)
    monkeypatch.setattr(strip_pull._Strip, "_solve", lambda self, strain, across: fold.solve(strain, across))
    monkeypatch.setattr(strip_pull._Strip, "accept", lambda self: None)
    monkeypatch.setattr(strip_pull._Strip, "level", lambda self, observed: Level(0.0, fold.across, 0.0, 0.0, 0.0, 0.0))
    strip.relaxation, strip.scene = fold, smooth().changed({"contact.friction": 0.2})  # type: ignore[assignment]
    strip.axis, strip.held, strip.stiffness, strip.floor = WARP, False, 0.0, 1.0
    levels = [Level(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)]
    assert strip.advance(levels, 0.04) is None
    strip.stiffness, fold.branch = 0.0, 0
    found = strip.advance(levels, 0.04, jumps=True)
    assert found is not None and found.strain_across == pytest.approx(-0.04, abs=FREE * 2.0 / 100.0)


@pytest.mark.slow
def test_a_strip_of_hf_1_between_clamps_is_between_held_and_free_sides() -> None:
    """With 32 wales an inch: the elongation at the measured force is shorter with the width held, and the wires are straight
    beyond both."""
    free, held = inputs_of(QUICK)
    assert held.strain < free.strain < free.straight_strain == held.straight_strain


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
