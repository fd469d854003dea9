"""Means over meshes with scattered loops: how many are needed, their rows and branches, their runs."""

import json
import math

import numpy as np
import pytest

from reference.in_words import quantities, table_of
from reference.interrupted import assert_parts_are_the_whole
from warpknit import build_model, load_run, load_scene, measure
from warpknit.base.errors import Diverged
from warpknit.knit.lapping import KnitError
from warpknit.results.row import Row
from warpknit.runner.run import run_scene
from warpknit.runner.summary_table import summary_findings
from warpknit.runner.variants import MeshValues, branch_of, mean_row, range_of, spreads, wanted
from warpknit.scene import Scene
from warpknit.solve.relax import Relaxation
from warpknit.solve.simulate import Simulation
from warpknit.solve.variant_models import VariantModels, last_records

WHY = "wire 3 is caught"


def scene_of(count: int = 3, kind: str = "spatial", **tables: dict) -> Scene:
    table = {
        "wire": {"material": "molybdenum", "diameter": "30 um"},
        "knit": {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"},
        "model": {"kind": kind, "boundary": "periodic"},
        "contact": {"friction": 0.0},
        "load": {"strain_weft": 0.03, "strain_warp": 0.03},
        "solver": {"preset": "draft"},
        "output": {"frames": 2, "usd": False, "figures": False},
        "variants": {"count": count, "standard_error": 0.0, "sensitivity": False},
    }
    return load_scene({name: table.get(name, {}) | tables.get(name, {}) for name in table | tables})


def seen(*columns: list[float]) -> MeshValues:
    names = ("tension_weft_N_per_m", "stress_max_Pa")[: len(columns)]
    return MeshValues(names, np.array(columns).T, np.ones(len(columns)))


# --- statistics


@pytest.mark.parametrize(
    ("found", "error", "expected"),
    [
        (0, math.inf, 8),  # half of them first
        (8, 0.0199, 8),  # which are enough
        (8, 0.0201, 16),
        (16, 0.0499, 16),
        (16, 0.0501, 32),
        (32, 0.06, 64),
        (64, 0.5, 64),  # four times as many at most
    ],
)
def test_meshes_are_added_until_their_mean_is_known(found, error, expected):
    assert wanted(16, 0.05, found, error) == expected


def test_an_error_of_zero_asks_for_the_count_exactly():
    assert [wanted(16, 0.0, found, 1.0) for found in (0, 16)] == [16, 16]


def test_the_standard_error_is_that_of_the_worst_figure_over_its_scale():
    values = MeshValues(("a", "b"), np.array([[1.0, 0.0], [3.0, 0.0], [1.0, 3.0], [3.0, 3.0]]), np.array([2.0, 10.0]))
    assert values.standard_error == pytest.approx(math.sqrt(4.0 / 3.0) / 2.0 / 2.0, rel=1e-12)


def test_the_median_mesh_is_the_one_nearest_to_all_medians():
    assert seen([1.0, 2.0, 3.0, 4.0, 9.0], [5.0, 9.0, 5.0, 1.0, 2.0]).median == 2


def test_a_mean_row_has_the_places_and_words_of_the_median_mesh():
    common = {"stage": "load", "panel": None, "steady": True, "pairs": 24}
    rows = [
        Row(variant=0, **common, steps=10, active=8, stress_max_wire=3, tension_weft_N_per_m=1.0, central_rhombus={"active": 1}),
        Row(variant=4, **common, steps=30, active=9, stress_max_wire=7, tension_weft_N_per_m=2.0, central_rhombus={"active": 2}),
    ]
    mean = mean_row(rows, median=1)
    assert (mean.stage, mean.steady, mean.pairs, mean.steps, mean.active) == ("load", True, 24, 40, 8.5)
    assert (mean.stress_max_wire, mean.tension_weft_N_per_m, mean.central_rhombus) == (7, 1.5, {"active": 1.5})
    assert (mean.p10_tension_weft_N_per_m, mean.p90_tension_weft_N_per_m) == (1.0, 2.0)
    assert "variant" not in mean


def test_the_spread_is_that_of_the_values():
    (spread,) = spreads([Row(active_percent=value) for value in (1.0, 2.0, 3.0, 4.0, 5.0)]).values()
    assert (spread.mean, spread.p10, spread.p90) == (3.0, 1.0, 5.0)
    assert spread.std == pytest.approx(math.sqrt(2.5)) and spread.standard_error == pytest.approx(math.sqrt(0.5))


def test_meshes_on_another_branch_are_told_from_the_tail_of_one():
    random = np.random.default_rng(1)
    low, high = random.normal(2.1, 0.15, 9), random.normal(5.0, 0.3, 5)
    branch = branch_of(seen([*low, *high], [*random.normal(2e8, 1e8, 14)]))
    assert branch is not None
    assert (branch.count, branch.figure) == (5, "tension_weft_N_per_m")
    assert (branch.mean, branch.others) == (pytest.approx(high.mean()), pytest.approx(low.mean()))
    assert branch.stress_max_Pa == pytest.approx(2e8, rel=0.5)
    found = [branch_of(seen(random.normal(2.0, 0.5, 16).tolist(), [1e8] * 16)) for _ in range(200)]
    assert sum(one is not None for one in found) <= 2  # one of a thousand


# --- meshes


def test_each_mesh_has_loops_and_friction_of_its_own():
    scene = scene_of(variants={"friction": 0.3, "seed": 5, "scatter": 0.04}, contact={"friction": 0.2})
    one, other = scene.variant(0), scene.variant(1)
    assert (one.knit.scatter, one.knit.seed, other.knit.seed, one.variants.count) == (0.04, 5, 6, 1)
    frictions = [scene.variant(k).contact.friction for k in range(200)]
    assert np.log(frictions).mean() == pytest.approx(math.log(0.2), abs=3.0 * 0.3 / math.sqrt(200.0))
    assert np.log(frictions).std() == pytest.approx(0.3, rel=0.15)  # three standard errors
    assert scene.variant(7) == scene.variant(7)


def test_each_mesh_has_a_wire_of_its_own():
    scene = scene_of(variants={"wire": 0.05, "friction": 0.3}, contact={"friction": 0.2})
    meshes = [scene.variant(k) for k in range(400)]
    logarithms = np.log([mesh.wire.diameter / 30e-6 for mesh in meshes])
    assert logarithms.mean() == pytest.approx(0.0, abs=3.0 * 0.05 / math.sqrt(400.0))
    assert logarithms.std() == pytest.approx(0.05, rel=0.11)  # three standard errors
    assert np.abs(logarithms).max() <= 3.0 * 0.05 * (1.0 + 1e-9)
    stiffness = np.array([mesh.wire.axial_stiffness for mesh in meshes]) / scene.wire.axial_stiffness
    assert np.log(stiffness) == pytest.approx(2.0 * logarithms, abs=1e-9)  # EA as d^2
    even = scene.changed({"variants.wire": 0.0})
    assert [even.variant(k).contact.friction for k in range(9)] == [mesh.contact.friction for mesh in meshes[:9]]


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_a_mesh_of_another_wire_is_that_of_a_scene_with_its_diameter_to_the_bit(kind):
    scene = scene_of(2, kind, variants={"wire": 0.05}, output={"frames": 1})
    mesh = scene.variant(1)
    other = scene.changed({"wire.diameter": mesh.wire.diameter, "variants.wire": 0.0}).variant(1)
    found, expected = (list(Simulation(build_model(one)).run())[-1].observables for one in (mesh, other))
    assert np.array_equal(found.node_position, expected.node_position)
    assert np.array_equal(found.wire_stress.node, expected.wire_stress.node)


def test_results_of_a_wire_do_not_depend_on_the_wires_beside_it():
    variants = VariantModels(scene_of(3, variants={"wire": 0.05}, contact={"friction": 0.2}, output={"frames": 1}))
    models = [variants.model(k) for k in range(3)]
    beside = dict(last_records(models))
    for place, model in enumerate(models):
        ((_, alone),) = last_records([model])
        assert np.array_equal(beside[place].observables.node_position, alone.observables.node_position)
        assert beside[place].steps == alone.steps


def test_loops_that_do_not_fit_are_replaced_by_those_of_the_next_seed(monkeypatch):
    import warpknit.solve.variant_models as module

    real = module.build_model

    def refuse_even_seeds(scene, device):
        if scene.knit.scatter and scene.knit.seed % 2 == 0:
            raise KnitError("knit.scatter", "changes which loops hook", "write less")
        return real(scene, device)

    monkeypatch.setattr(module, "build_model", refuse_even_seeds)
    models = VariantModels(scene_of(2))
    assert models.take(2) == [1, 3]
    assert sorted(models.refused) == [0, 2]
    monkeypatch.setattr(module, "build_model", lambda scene, device: refuse_even_seeds(scene.variant(0), device))
    models = VariantModels(scene_of(2))
    with pytest.raises(KnitError):
        models.take(2)


# --- runs


def test_a_run_is_the_mean_of_its_meshes_with_the_states_of_the_median_one(tmp_path):
    scene = scene_of(5)
    assert run_scene(scene, out=tmp_path, device="cpu").exit_code == 0
    run, scenes = load_run(tmp_path), [scene.variant(k) for k in range(5)]
    records = [record for record in Simulation(VariantModels(scene).model(0), worlds=scenes).run() if record.load_factor == 1.0]
    tensions = np.array([measure.mesh_tension(record.observables) for record in sorted(records, key=lambda one: one.world)])
    assert run.history["tension_weft_N_per_m"][-1] == pytest.approx(tensions[:, 0].mean(), rel=1e-12)
    figure = run.summary["variants"]["tension_warp_N_per_m"]
    assert figure["std"] == pytest.approx(tensions[:, 1].std(ddof=1), rel=1e-12)
    assert figure["mean"] == run.summary["mesh"]["tension_warp_N_per_m"] == pytest.approx(tensions[:, 1].mean(), rel=1e-12)
    assert run.history["p10_tension_weft_N_per_m"][-1] == pytest.approx(min(tensions[:, 0]), rel=1e-12)
    rows = run.tables["variants"]
    assert sorted(set(rows["variant"].tolist())) == [0, 1, 2, 3, 4] and len(rows["variant"]) == 15
    median = run.summary["variants"]["median"]
    expected = next(record for record in records if record.world == median).observables.wire_stress.node
    assert np.array_equal(run.states[-1].node_stress, expected)
    assert len(run.states) == len(run.history["load_factor"]) == 3
    assert run.scene == scene and run.summary["scene"]["hash"] == scene.hash


@pytest.mark.parametrize(("count", "kind"), [(1, "spatial"), (2, "spatial"), (1, "planar")])
def test_the_error_of_one_mesh_is_unknown_where_others_would_differ(count: int, kind: str, tmp_path):
    summary = run_scene(scene_of(count, kind), out=tmp_path / "run", device="cpu").summary
    is_one_of_many = (count, kind) == (1, "spatial")
    assert summary.model.one_of_many is is_one_of_many
    assert ("estimated error" in table_of(summary_findings(summary))) is is_one_of_many


def test_meshes_of_several_repeats_have_a_layout_of_their_own(tmp_path):
    scene = scene_of(2, "planar", knit={"repeats": [2, 1]}, load={"strain_weft": 0.0, "strain_warp": 0.01}, output={"frames": 1})
    assert run_scene(scene, out=tmp_path, device="cpu").exit_code == 0
    run = load_run(tmp_path)
    assert len(run.layout.body_class) == run.summary["model"]["bodies"] == 24
    assert np.bincount(run.layout.body_class).tolist() == [4, 4, 8, 8]


def test_a_planar_run_is_the_mean_of_its_meshes_too(tmp_path):
    scene = scene_of(2, "planar")
    assert run_scene(scene, out=tmp_path, device="cpu").exit_code == 0
    ends = [list(Simulation(VariantModels(scene).model(k)).run())[-1] for k in (0, 1)]
    expected = np.mean([measure.mesh_tension(record.observables) for record in ends], axis=0)
    mesh = json.loads((tmp_path / "summary.json").read_text())["mesh"]
    assert (mesh["tension_weft_N_per_m"], mesh["tension_warp_N_per_m"]) == pytest.approx(tuple(expected), rel=1e-12)


def test_parts_of_an_interrupted_run_are_the_whole_to_the_bit(tmp_path, monkeypatch):
    # two groups: half of four meshes first, and the others as their error is above nothing
    scene = scene_of(8, variants={"standard_error": 1e-6}, output={"frames": 1, "checkpoint_interval": 1e9})
    monkeypatch.setattr("warpknit.runner.variants.MOST", 1)
    parts = assert_parts_are_the_whole(scene, tmp_path, monkeypatch, every=20)
    assert (parts / "variants.csv").read_text() == (tmp_path / "whole" / "variants.csv").read_text()
    assert not (parts / "variants").exists()


def test_a_mesh_that_fails_is_left_out_and_all_that_fail_end_the_run(tmp_path, monkeypatch):
    fails = {1}
    original = Relaxation.reach

    def fail_some(self, *args, **options):
        if self.row in fails and self.progress.load_factor == 1.0:
            raise Diverged(WHY)
        yield from original(self, *args, **options)

    monkeypatch.setattr(Relaxation, "reach", fail_some)
    scene = scene_of(3, output={"frames": 1})
    result = run_scene(scene, out=tmp_path / "some", device="cpu")
    assert result.exit_code == 0 and result.summary is not None and result.summary.variants is not None
    means = result.summary.variants
    assert (means.count, means.failed, means.why) == (2, 1, WHY)
    assert [warning.code for warning in result.summary.warnings if warning.code == "W60"] == ["W60"]
    fails |= {0, 2}
    result = run_scene(scene, out=tmp_path / "all", device="cpu")
    assert (result.exit_code, "3" in quantities(result.message)) == (3, True)


def test_eight_in_ten_other_meshes_are_in_the_range_of_some():
    """Of 19 draws exactly, on average, normal or skewed. By 20,000 ranges the share is known to 0.1 %."""
    draws = np.random.default_rng(5)
    for values, below in (
        (draws.normal(size=(19, 20_000)), normal_share),
        (draws.exponential(size=(19, 20_000)), exponential_share),
    ):
        low, high = below(range_of(values))
        assert np.mean(high - low) == pytest.approx(0.8, abs=0.003)


def normal_share(x: np.ndarray) -> np.ndarray:
    return 0.5 * (1.0 + np.vectorize(math.erf)(x / math.sqrt(2.0)))


def exponential_share(x: np.ndarray) -> np.ndarray:
    return 1.0 - np.exp(-x)
