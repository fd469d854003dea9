"""How means change with nodes, friction and an overshoot, and the error that follows."""

import time

import numpy as np
import pytest

from warpknit import load_run, load_scene
from warpknit.results.row import Row
from warpknit.runner.estimates import Estimate, Sensitivity, beside, changed_rows, changes_of, estimated_again
from warpknit.runner.interrupts import Interrupts
from warpknit.runner.monitor import Monitor
from warpknit.runner.other_model import _spatial, spatial_means
from warpknit.runner.progress_display import Display
from warpknit.runner.run import run_scene
from warpknit.runner.summary_table import _changed, _error_finding
from warpknit.scene import Scene
from warpknit.scene.presets import PRESETS
from warpknit.studies.sweep import run_map

STRAINS = {"strain_weft": 0.03, "strain_warp": 0.03}
FIGURES = ("tension_weft_N_per_m", "tension_warp_N_per_m", "active_percent", "stress_max_Pa")


def scene_of(**tables: object) -> Scene:
    table: dict = {
        "wire": {"material": "molybdenum", "diameter": "30 um"},
        "knit": {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"},
        "model": {"kind": "spatial", "boundary": "periodic", "nodes_per_loop": 28},
        "contact": {"friction": 0.2},
        "load": STRAINS,
        "solver": {"residual_tolerance": 1e-2},
        "output": {"frames": 2, "usd": False, "figures": False},
        "variants": {"count": 2, "standard_error": 0.0, "sensitivity": False},
    }
    return load_scene(table | tables)


def ends(scene: Scene, out) -> np.ndarray:
    """(mesh, figure) of the last rows."""
    assert run_scene(scene, out=out, device="cpu").exit_code == 0
    rows = load_run(out).tables["variants"]
    columns = np.array([rows[name] for name in FIGURES], dtype=float).T
    return np.array([columns[rows["variant"] == number][-1] for number in sorted(set(rows["variant"]))])


def row_of(tension: float) -> Row:
    values = dict.fromkeys(("tension_weft_N_per_m", "tension_warp_N_per_m", "stress_max_Pa"), tension)
    return Row(strain_weft=0.03, strain_warp=0.03, active_percent=50.0, **values)


@pytest.mark.slow
def test_changes_and_errors_are_those_of_runs_of_the_same_meshes(tmp_path):
    variants = {"count": 3, "standard_error": 0.0, "overshoot": 0.1}
    base = ends(scene_of(variants=variants), tmp_path / "base")
    run = load_run(tmp_path / "base")
    coarse = {"model": {"kind": "spatial", "boundary": "periodic", "nodes_per_loop": 20}}
    nodes = ends(scene_of(**coarse), tmp_path / "nodes")
    half = ends(scene_of(**coarse, contact={"friction": 0.1}), tmp_path / "half")
    double = ends(scene_of(**coarse, contact={"friction": 0.4}), tmp_path / "double")
    path = {"load": {name: 1.1 * strain for name, strain in STRAINS.items()}, "path": [STRAINS]}
    back = ends(scene_of(**coarse, **path), tmp_path / "back")
    scale = np.array([*[base[:, :2].mean(axis=0).max()] * 2, 100.0, base[:, 3].mean()])
    expected = {
        "nodes": (nodes - base[:2]).mean(axis=0) / scale,
        "friction_half": (half - nodes).mean(axis=0) / scale,
        "friction_double": (double - nodes).mean(axis=0) / scale,
        "overshoot": (back - nodes).mean(axis=0) / scale,
    }
    changes = run.summary["variants"]["changes"]
    assert {name: [change[figure] for figure in FIGURES] for name, change in changes.items()} == {
        name: pytest.approx(values.tolist(), rel=1e-9, abs=1e-12) for name, values in expected.items()
    }
    of_nodes = np.abs(expected["nodes"]) / ((28 / 20) ** 2 - 1.0)
    of_friction = np.sqrt((expected["friction_half"] ** 2 + expected["friction_double"] ** 2) / 2.0)
    of_meshes = base.std(axis=0, ddof=1) / np.sqrt(3.0) / scale
    total = np.sqrt(of_nodes**2 + of_friction**2 + of_meshes**2)
    errors = run.summary["quality"]["estimated_errors"]
    assert run.summary["quality"]["estimated_error"] == pytest.approx(total.max(), rel=1e-9)
    assert errors["tension"] == pytest.approx(total[:2].max(), rel=1e-9) and errors["strain"] is None
    assert (errors["nodes"], errors["friction"]) == pytest.approx((of_nodes.max(), of_friction.max()), rel=1e-9)


def test_an_error_of_second_order_is_found_from_fewer_nodes():
    """A figure a + b/n^2: its error b/n^2 follows from that with 20 nodes."""
    scene = scene_of()
    rows = {number: row_of(1.0 + 3.0 / 28**2) for number in (0, 1)}
    sensitivity = Sensitivity(scene, "cpu", rows)
    change = sensitivity._change(rows, {number: row_of(1.0 + 3.0 / 20**2) for number in (0, 1)})
    assert sensitivity.estimate({"nodes": change}).nodes == pytest.approx(3.0 / 28**2 / (1.0 + 3.0 / 28**2), rel=1e-12)


def test_where_tension_drives_the_error_of_the_strain_has_its_name():
    """The largest of the sides that tension drives; deviations of one in 101 of two meshes are 0.01/sqrt(2) over sqrt(2)."""
    rows = {k: row_of(1.0).changed(strain_weft=0.1 + 0.001 * k, strain_warp=0.2 + 0.001 * k) for k in (0, 1)}
    for load, expected in (
        ({"tension_weft": "1 N/m", "tension_warp": "1 N/m"}, 0.0005 / 0.2005),
        ({"tension_weft": "1 N/m", "strain_warp": 0.2}, 0.0005 / 0.2005),
        ({"strain_weft": 0.1, "strain_warp": 0.2}, None),
    ):
        found = Sensitivity(scene_of(load=load), "cpu", rows).estimate({})
        assert found.strain == (None if expected is None else pytest.approx(expected, rel=1e-9))


def test_without_friction_nothing_is_said_of_it():
    assert list(changes_of(scene_of(contact={"friction": 0.0}))) == ["nodes"]


def test_an_interrupt_leaves_the_results_without_their_error(tmp_path, monkeypatch):
    def changes(self, monitor):
        interrupts.request()
        monitor(None)

    interrupts = Interrupts()
    monkeypatch.setattr("warpknit.runner.monitor.Interrupts", lambda: interrupts)
    monkeypatch.setattr(Sensitivity, "changes", changes)
    scene = scene_of(variants={"count": 2, "standard_error": 0.0})
    result = run_scene(scene, out=tmp_path, device="cpu")
    assert result.exit_code == 130 and not result.goes_on and not (tmp_path / "variants").exists()
    summary = load_run(tmp_path).summary
    assert summary["stop_reason"] == "steady" and summary["quality"]["estimated_error"] is None


def test_a_resumed_run_has_the_estimated_error_of_one_in_one_go(tmp_path, monkeypatch):
    """Interrupted on the way, and again while the error is estimated."""
    scene = scene_of(variants={"count": 2, "standard_error": 0.0}, output={"frames": 1, "usd": False, "figures": False})
    assert run_scene(scene, out=tmp_path / "whole", device="cpu").exit_code == 0
    check, changes, interrupts = Monitor._check, Sensitivity.changes, Interrupts()
    checks: list[object] = []

    def interrupt_once(self, progress):
        checks.append(progress)
        if len(checks) == 30:
            self.interrupts.request()
        check(self, progress)

    def interrupted(self, monitor):
        interrupts.request()
        monitor(None)

    monkeypatch.setattr(Monitor, "_check", interrupt_once)
    assert run_scene(scene, out=tmp_path / "parts", device="cpu").exit_code == 130
    monkeypatch.setattr("warpknit.runner.monitor.Interrupts", lambda: interrupts)
    monkeypatch.setattr(Sensitivity, "changes", interrupted)
    assert run_scene(scene, out=tmp_path / "parts", device="cpu", resume=True).exit_code == 130
    assert load_run(tmp_path / "parts").summary["quality"]["estimated_error"] is None
    monkeypatch.setattr(Sensitivity, "changes", changes)
    assert run_scene(scene, out=tmp_path / "parts", device="cpu", resume=True).exit_code == 0
    whole, parts = (load_run(tmp_path / name).summary for name in ("whole", "parts"))
    for name in ("quality", "variants", "warnings", "message", "stop_reason", "mesh"):
        assert parts[name] == whole[name]
    done = (tmp_path / "parts" / "summary.json").stat().st_mtime_ns
    assert run_scene(scene, out=tmp_path / "parts", device="cpu", resume=True).exit_code == 0
    assert (tmp_path / "parts" / "summary.json").stat().st_mtime_ns == done


def test_memory_that_runs_out_leaves_the_results_without_their_error(tmp_path, monkeypatch):
    def changes(self, watch):
        raise MemoryError

    monkeypatch.setattr(Sensitivity, "changes", changes)
    assert run_scene(scene_of(variants={"count": 2, "standard_error": 0.0}), out=tmp_path, device="cpu").exit_code == 0
    summary = load_run(tmp_path).summary
    assert summary["quality"]["estimated_error"] is None
    assert "W45 The error was not estimated: memory ran out." in summary["warnings"][-1]


def test_the_wall_time_of_a_run_is_without_that_of_its_error(tmp_path, monkeypatch):
    def changes(self, watch):
        walls.append(load_run(tmp_path).summary["solver"]["wall_s"])
        time.sleep(0.2)
        return {}

    walls: list[float] = []
    monkeypatch.setattr(Sensitivity, "changes", changes)
    run_scene(scene_of(variants={"count": 2, "standard_error": 0.0}), out=tmp_path, device="cpu")
    assert [load_run(tmp_path).summary["solver"]["wall_s"]] == walls


def test_changes_that_are_not_known_are_named():
    rows = {number: row_of(1.0 + 0.1 * number) for number in (0, 1)}
    sensitivity = Sensitivity(scene_of(), "cpu", rows)
    change = sensitivity._change(rows, rows)
    every = dict.fromkeys(("nodes", "friction_half", "friction_double"), change)
    assert sensitivity.estimate(every).warning is None
    found = sensitivity.estimate({"nodes": change, "friction_half": change})
    assert found.warning.code == "W45" and "leaves out twice the friction," in str(found.warning)
    assert found.error == sensitivity.estimate({}).error > 0.0


def test_large_meshes_run_one_after_the_other_by_the_same_results(monkeypatch):
    scene = scene_of(variants={"count": 2, "standard_error": 0.0})
    sensitivity = Sensitivity(scene, "cpu", {number: row_of(1.0) for number in (0, 1)})
    beside = sensitivity.changes(lambda _: None)
    monkeypatch.setattr("warpknit.solve.variant_models.MOST_NODES", 200)  # two of 80
    apart = sensitivity.changes(lambda _: None)
    assert list(apart) == list(beside)
    for name, change in beside.items():
        assert vars(apart[name]) == pytest.approx(vars(change), rel=1e-9, abs=1e-12)


def test_a_planar_scene_in_space_keeps_its_loops_and_has_the_nodes_of_its_preset():
    table = {"knit.scatter": 0.03, "knit.seed": 4}
    planar = scene_of(variants={}, model={"kind": "planar", "boundary": "periodic", "nodes_per_loop": 12}).changed(table)
    other = _spatial(planar)
    assert (other.variants.scatter, other.variants.seed, other.knit.scatter, other.variants.count) == (0.03, 4, 0.0, 3)
    assert other.model.nodes_per_loop == PRESETS["standard"]["spatial", "relax"].nodes_per_loop
    assert _spatial(planar.changed({"variants.sensitivity": False})) is None


def test_planar_meshes_are_compared_too(tmp_path, monkeypatch):
    means = Row(meshes=3, **dict.fromkeys(("strain_weft", "strain_warp", *FIGURES), 1.0))
    monkeypatch.setattr("warpknit.runner.estimates.spatial_means", lambda _scene, _watch: means)
    model = {"kind": "planar", "boundary": "periodic", "nodes_per_loop": 12}
    run_scene(scene_of(model=model, variants={"count": 2, "standard_error": 0.0}), out=tmp_path, device="cpu")
    summary = load_run(tmp_path).summary
    assert summary["spatial_model"]["meshes"] == 3 and summary["quality"]["estimated_error"] > 0.0


def test_a_planar_tile_is_compared_with_meshes_of_the_spatial_model(tmp_path, monkeypatch):
    table = {
        "wire": {"material": "molybdenum", "diameter": "30 um"},
        "knit": {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"},
        "model": {"boundary": "periodic"},
        "load": STRAINS,
        "solver": {"preset": "draft"},
        "output": {"frames": 2, "usd": False, "figures": False},
    }

    def of(kind: str, **tables: object) -> Scene:
        return load_scene(table | {"model": {"boundary": "periodic", "kind": kind}} | tables)

    monkeypatch.setattr("warpknit.runner.other_model.NODE_STEPS", 1e7)
    run_scene(of("planar"), out=tmp_path / "planar", device="cpu")
    expected = ends(of("spatial", variants={"count": 3, "standard_error": 0.0, "sensitivity": False}), tmp_path / "spatial")
    found = load_run(tmp_path / "planar").summary["spatial_model"]
    assert [found[name] for name in FIGURES] == pytest.approx(expected.mean(axis=0).tolist(), rel=1e-12)
    monkeypatch.setattr("warpknit.runner.other_model.NODE_STEPS", 3e5)  # it takes more
    run_scene(of("planar"), out=tmp_path / "planar", device="cpu", force=True)
    assert "spatial_model" not in load_run(tmp_path / "planar").summary


def test_a_planar_map_is_compared_with_spatial_meshes_at_its_largest_load(tmp_path, monkeypatch):
    """The same means as of a run at that load."""
    table = {
        "wire": {"material": "molybdenum", "diameter": "30 um"},
        "knit": {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"},
        "model": {"boundary": "periodic", "kind": "planar"},
        "load": STRAINS,
        "solver": {"preset": "draft"},
        "output": {"frames": 2, "usd": False, "figures": False},
        "sweep": {"strain_weft": [0.01, 0.03], "strain_warp": [0.03]},
    }
    monkeypatch.setattr("warpknit.runner.other_model.NODE_STEPS", 1e7)
    result = run_map(load_scene(table), out=tmp_path)
    assert result.exit_code == 0 and result.summary is not None
    single = load_scene({name: part for name, part in table.items() if name != "sweep"})
    expected, found = spatial_means(single, lambda _steps: None), result.summary.spatial_model
    assert found.load == [0.03, 0.03] and {name: found[name] for name in vars(expected)} == vars(expected)
    table_of_map = load_run(tmp_path).tables["map"]
    row = [float(value) for value in table_of_map["strain_weft"]].index(0.03)
    assert found.planar.stress_max_Pa == float(table_of_map["stress_max_Pa"][row])
    written = load_run(tmp_path).summary
    assert written["spatial_model"]["tension_warp_N_per_m"] == expected.tension_warp_N_per_m
    monkeypatch.setattr("warpknit.runner.other_model.NODE_STEPS", 1e5)  # it takes more
    assert "spatial_model" not in run_map(load_scene(table), out=tmp_path, force=True).summary


def test_changed_meshes_beside_a_run_have_the_rows_of_those_after_it():
    scene = scene_of(variants={"count": 2, "standard_error": 0.0})
    expected = changed_rows(scene, "cpu", [0, 1], lambda _: None)
    with beside(scene, "cpu", [0, 1]) as other:
        if other is None:
            pytest.skip("a single core")
        assert other([0, 2], lambda _: None) is None
        assert other([0, 1], lambda _: None) == expected
        assert other([0, 1], lambda _: None) is None  # the process has ended


def test_an_interrupted_estimate_goes_on_with_the_meshes_in_the_files_of_the_run(tmp_path, monkeypatch):
    scene = scene_of(output={"frames": 1, "usd": False, "figures": False})
    done = run_scene(scene, out=tmp_path, device="cpu").summary
    numbers: list[int] = []

    def changed(_scene, _device, meshes, _check):
        numbers.extend(meshes)
        return {}

    monkeypatch.setattr("warpknit.runner.estimates.changed_rows", changed)
    estimated_again(scene.changed({"variants.sensitivity": True}), tmp_path, done, "cpu", Display())
    assert numbers == [0, 1] and all(isinstance(number, int) for number in numbers)  # seeds are whole numbers


def test_errors_are_shown_in_the_units_of_their_figures():
    end = Row(strain_weft=0.1, strain_warp=-0.02, tension_weft_N_per_m=2.0, tension_warp_N_per_m=4.0, stress_max_Pa=1e8)
    by_tension = Estimate(0.15, 15.0, 0.05, stress=0.1, strain=0.05, friction=0.15, nodes=0.01)
    found = _error_finding(by_tension, end, by_tension=True)
    assert (found.value, found.where) == ("strain 0.5 points, active 15 points, stress 10 MPa", ", mostly by friction")
    assert _error_finding(Estimate(0.05, tension=0.05), end, by_tension=False).value == "tension 200 mN/m"
    mixed = Estimate(0.05, tension=0.05, strain=0.01)
    assert _error_finding(mixed, end, by_tension=False).value == "tension 200 mN/m, strain 0.1 points"
    hook = Row(displacement_m=1e-3, drive_force_N=-2e-3, stress_max_Pa=1e8)
    assert _error_finding(Estimate(0.05, tension=0.05), hook, by_tension=False).value == "force 100 uN"
    assert _changed("strain_warp", -0.2, end, "+") == "strain -2 points warp"
    assert _changed("tension_weft_N_per_m", 0.25, end, "+") == "tension +1 N/m weft"
