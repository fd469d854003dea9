"""A load path against a run of the same stages, and its branches."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from warpknit import measure
from warpknit.base.errors import Diverged
from warpknit.runner.history import mean_tension, row_of
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.studies.curves import tension_strain
from warpknit.studies.equal_tension import YIELDED, load_equally, service_points, with_state_at
from warpknit.studies.load_path import LoadPath, Meshes, exact_model, under_strain, under_tension
from warpknit.studies.report import read_states, write_states

SCENES = Path(__file__).parents[2] / "scenes"
KINDS = {"planar": "contact_map.toml", "spatial": "atlas_cell_spatial.toml"}


@pytest.fixture(scope="module", params=list(KINDS))
def model(request):
    return build_model(replace(load_scene(SCENES / KINDS[request.param], ["output.frames=2"], "draft"), sweep=None))


def test_stages_of_a_path_are_those_of_a_run(model):
    """The same bits as a run that knows all its stages at once, also where contacts carry force at the end of a stage."""
    stages = under_strain(model.scene, np.diag([1.05, 1.05])), under_tension(model.scene, 0.05), under_tension(model.scene, 0.1)
    whole = [row_of(r) for r in Simulation(replace(model, scene=replace(model.scene, stages=stages))).run()]
    path = LoadPath(model)
    parts = [row for stage in stages for row in path.rows(stage, levels=2)]
    assert [vars(row) for row in parts] == [vars(row) for row in whole]
    assert whole[4].active_pairs > 0 and whole[5].tension_weft_N_per_m == pytest.approx(0.075, rel=0.01)


def test_branches_do_not_depend_on_each_other(model):
    path = LoadPath(model)
    path.to(under_strain(model.scene, np.diag([1.1, 1.1])))
    nearby = under_strain(model.scene, np.diag([1.101, 1.1]))

    def tension():
        return measure.mesh_tension(LoadPath(model, path.states).to(nearby)[0].observables)

    first = tension()
    LoadPath(model, path.states).to(under_strain(model.scene, np.diag([1.1, 1.102])))
    assert tension() == first


def test_a_path_that_does_not_converge_stays_where_it_was():
    model = build_model(load_scene(SCENES / "contact_map.toml", ["solver.max_steps=100"], "draft"))
    path = LoadPath(model)
    with pytest.raises(Diverged):
        path.to(under_strain(model.scene, np.diag([1.1, 1.1])))
    assert path.states[0].stages == ()
    assert all(
        point.tension_weft_N_per_m is None for point in tension_strain(Meshes.of(model), 0.1, 0.1) if point.strain_weft > 0.0
    )


@pytest.mark.parametrize("levels", [1, 2])
def test_a_curve_marks_the_point_behind_a_jump(levels, monkeypatch):
    """One of three points at 2, 4 and 6 % strain; between points lie as many levels as a run would have."""
    monkeypatch.setattr("warpknit.studies.curves.POINTS", 3)
    monkeypatch.setattr("warpknit.studies.curves.jumps_of", lambda model, rows: [(rows[2 * levels - 1], rows[2 * levels])])
    model = build_model(load_scene(SCENES / "contact_map.toml", [f"output.frames={3 * levels}"], "draft"))
    points = tension_strain(Meshes.of(model), 0.06, 0.06)
    assert [point.jump for point in points] == 3 * [0, 0, 1, 0]
    assert all(point.tension_weft_N_per_m is not None for point in points)


def test_both_directions_are_strained_together_to_the_largest_strains_of_the_map(monkeypatch):
    """In proportion: at two thirds of the way both strains are two thirds of their ends."""
    monkeypatch.setattr("warpknit.studies.curves.POINTS", 3)
    model = build_model(load_scene(SCENES / "contact_map.toml", ["output.frames=3"], "draft"))
    both = [(one.strain_weft, one.strain_warp) for one in tension_strain(Meshes.of(model), 0.06, 0.03) if one.load == "both"]
    assert both == [pytest.approx((0.02 * k, 0.01 * k), abs=1e-12) for k in range(4)]


def test_strains_of_a_path_are_those_asked_for_whatever_the_frame_expands():
    """under_strain prescribes the deformation gradient; a frame that grows with heat adds its own strain to those of a scene."""
    settings = ["model.frame_expansion=1e-5", 'load.temperature="120 degC"', "output.frames=1"]
    model = build_model(load_scene(SCENES / "contact_map.toml", settings, "draft"))
    gradient = LoadPath(model).to(under_strain(model.scene, np.diag([1.05, 1.02])))[0].observables.gradient
    assert gradient == pytest.approx(np.diag([1.05, 1.02]), abs=1e-12)


def test_a_path_ends_behind_first_yield():
    """The double atlas of 15 um yields at 0.6 N/m: service tensions beyond have no point; a larger map adds nothing."""
    scene = load_scene(SCENES / "contact_map.toml", ["output.frames=4"], "draft")
    path = load_equally(exact_model(scene, scene.solver.residual_tolerance), 0.2)
    above = [row.stress_max_Pa > scene.wire.yield_stress for row in path.rows]
    assert above == [False] * (len(above) - 1) + [True]
    assert {point.why for point in service_points(scene, path, (), None, None)} == {YIELDED}


@pytest.mark.parametrize("failing", [1, 2, 99])
def test_a_stage_that_does_not_converge_is_left_out(failing, monkeypatch):
    """The next one begins where it began; of three in a row the path ends with what it has, and says why."""
    tried = []

    class Failing(LoadPath):
        def load(self, stage, levels, monitor=lambda _: None):
            tried.append(stage.tension_weft)
            for number, record in enumerate(super().load(stage, levels, monitor)):
                if number == 1 and 1 < len(tried) <= 1 + failing:
                    raise Diverged("no progress")
                yield record

    monkeypatch.setattr("warpknit.studies.equal_tension.LoadPath", Failing)
    scene = load_scene(SCENES / "contact_map.toml", ["output.frames=4"], "draft")
    path = load_equally(exact_model(scene, scene.solver.residual_tolerance), 0.2)
    tensions = [row.tension_weft_N_per_m for row in path.rows]
    assert tensions == sorted(tensions)
    if failing == 99:
        assert (len(tried), list(path.states), path.ended) == (4, tried[:1], "no progress")
    else:
        assert list(path.states)[:2] == [tried[0], tried[1 + failing]]
        assert path.ended == YIELDED


def test_a_path_gets_the_state_at_a_further_tension(tmp_path):
    """Of a double atlas that yields at 0.6 N/m: 0.13 N/m lies on its path, 0.8 N/m beyond. The path itself stays the same, as it
    does on the disk, from where a state goes on bit for bit."""
    scene = load_scene(SCENES / "contact_map.toml", ["output.frames=4"], "draft")
    model = exact_model(scene, scene.solver.residual_tolerance)
    path = load_equally(model, 0.2)
    write_states(scene, tmp_path, [], path)
    _, kept = read_states(scene, tmp_path)
    assert (kept.rows, kept.at, kept.ended, list(kept.states)) == (path.rows, path.at, path.ended, list(path.states))
    assert read_states(load_scene(SCENES / "contact_map.toml", ["output.frames=5"], "draft"), tmp_path)[1].rows == ()
    between, beyond = (with_state_at(model, path, tension) for tension in (0.13, 0.8))
    for longer, tension in ((between, 0.13), (beyond, 0.8)):
        row = longer.at[tension]
        assert (row.tension_weft_N_per_m, row.tension_warp_N_per_m) == pytest.approx((tension, tension), rel=3e-3)
        assert longer.rows.index(row) == sum(mean_tension(one) < mean_tension(row) for one in longer.rows)
    assert [row for row in between.rows if row is not between.at[0.13]] == path.rows
    assert set(between.states) - set(path.states) == {0.13} and with_state_at(model, between, 0.13) is between
    assert with_state_at(model, kept, 0.13).at[0.13] == between.at[0.13]
