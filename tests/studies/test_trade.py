"""warpknit trade: its points, its table, what it makes of them, and how it goes on after an interrupt."""

import csv
import json
import logging
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from warpknit.base.errors import RunDirectoryError
from warpknit.commands.cli import main
from warpknit.mechanics.probe_settings import SOFTENING, Setting
from warpknit.planar import kind
from warpknit.results.row import Row, plain
from warpknit.runner.interrupts import Interrupted
from warpknit.scene import load_scene
from warpknit.scene.presets import PRESETS
from warpknit.spatial import kind as spatial_kind
from warpknit.studies import points as parameters
from warpknit.studies import probe_run
from warpknit.studies import trade as study
from warpknit.studies.points import RESULTS, Errors, Scales, TradeRow, errors_of
from warpknit.studies.trade import MIN_ORDER, extrapolate, pareto, read_trade, run_trade

CELL = Path(__file__).parents[2] / "scenes" / "atlas_cell.toml"
SMALL = ("load.strain_weft=0.12", "load.strain_warp=0.12", "output.frames=1")


def test_extrapolation_finds_the_limit_of_a_power_law() -> None:
    """f(n) = 3 + 5 n^-2.5 at n, n/r, n/r^2 gives p = 2.5 and f = 3, to round-off of differences of 5 n^-2.5."""
    ratio = math.sqrt(2.0)
    values = [3.0 + 5.0 * (40.0 / ratio**k) ** -2.5 for k in range(3)]
    order, limit = extrapolate(*values, ratio)
    assert order == pytest.approx(2.5, rel=1e-9)
    assert limit == pytest.approx(3.0, rel=1e-12)


def test_extrapolation_of_rough_values_errs_to_the_safe_side() -> None:
    """Differences of unlike sign: first order, whose error is the difference over r - 1."""
    order, limit = extrapolate(1.0, 1.1, 1.0, 2.0)
    assert order == MIN_ORDER
    assert abs(limit - 1.0) == pytest.approx(0.1)


def test_front_keeps_what_nothing_beats() -> None:
    points = [(1.0, 5.0), (2.0, 5.0), (3.0, 1.0), (2.5, 2.0), (4.0, 1.0), (0.5, 9.0)]
    assert pareto(points) == [5, 0, 3, 2]


def results(*values: float) -> Row:
    """The first results of a point; the strains are 0."""
    return Row(**dict(zip(RESULTS, (*values, 0.0, 0.0), strict=True)))


def test_errors_are_points_of_percent_and_shares() -> None:
    """By hand: tension misses 0.03 of the larger, 0.2; where the reference carries nothing the scales stand in."""
    scales = Scales(force=1e-6, tension=1e-3, stress=1e6)
    true = results(66.0, 0.1, 0.2, 2e-3, 1e-4, 1e9)
    errors = errors_of(results(60.0, 0.13, 0.19, 1.9e-3, 1e-4, 1.1e9), true, scales)
    assert errors == Errors(6.0, pytest.approx(0.15), pytest.approx(0.05), pytest.approx(0.1))
    assert errors.largest_percent == pytest.approx(15.0)
    slack = results(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert errors_of(results(0.0, 1e-5, 0.0, 1e-8, 0.0, 1e4), slack, scales) == Errors(
        0.0, pytest.approx(0.01), pytest.approx(0.01), pytest.approx(0.01)
    )


# --- the study


@pytest.fixture
def few_points(monkeypatch: pytest.MonkeyPatch) -> None:
    """A coarse reference and a handful of points."""
    monkeypatch.setattr(kind, "REFERENCE", ((math.inf, 24),))
    coarse = {
        name: {key: replace(preset, nodes_per_loop=min(20, preset.nodes_per_loop)) for key, preset in presets.items()}
        for name, presets in PRESETS.items()
    }
    monkeypatch.setattr(parameters, "PRESETS", coarse)
    monkeypatch.setattr(study, "RAMP_NODES", 0)
    monkeypatch.setattr(kind, "COMBINED", ((10, 12), (1000.0,), (0.01,)))
    for name, values in (("NODES", (10,)), ("TOLERANCES", (0.03,)), ("SOFTENINGS", (200.0,))):
        monkeypatch.setattr(kind, f"VARIED_{name}", values)
    monkeypatch.setattr(parameters, "STIFFNESSES", (4.0,))
    monkeypatch.setattr(parameters, "LEVELS", (2,))


def loader(more: parameters.Overrides, preset: str | None) -> object:
    return load_scene(CELL, (*SMALL, *more), preset)


def test_interrupted_study_goes_on_where_it_stopped(
    tmp_path: Path, few_points: None, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The points of both parts are those of a study, each once; what was found before the interrupt stands as it was. Both say
    how many points are left and how long they take."""
    caplog.set_level(logging.INFO, logger="warpknit")
    run, taken = study.run_point, []

    def three(load: object, **options: object) -> object:
        if len(taken) == 3:
            raise Interrupted
        taken.append(load)
        return run(load, **options)

    monkeypatch.setattr(study, "run_point", three)
    first = run_trade(loader, out=tmp_path / "t")
    assert first.exit_code == 130 and first.message.endswith(f" {tmp_path / 't'}")
    before = read_trade(tmp_path / "t" / "trade.csv")
    assert len(before) == 3
    monkeypatch.setattr(study, "run_point", run)
    result = run_trade(loader, out=tmp_path / "t", resume=True)
    assert result.exit_code == 0
    rows = read_trade(tmp_path / "t" / "trade.csv")
    assert [row.point for row in rows[:3]] == [row.point for row in before]
    assert [row.wall_s for row in rows[:3]] == [row.wall_s for row in before]
    names = [row.point for row in rows]
    assert len(set(names)) == len(names)
    assert not any(re.search(r"[0-9]\.[0-9]{5,}", name) for name in names)  # labels of more digits than a table can show
    said = [re.match(r"(\d+) settings to run", message) for message in caplog.messages]
    assert [int(line[1]) for line in said if line] == [len(names), len(names) - 3]
    assert (tmp_path / "t" / "figures" / "trade.png").exists()
    _check_study(tmp_path / "t", rows, plain(result.summary))


def _check_study(out: Path, rows: list[TradeRow], summary: dict) -> None:
    with open(out / "trade.csv", newline="", encoding="utf-8") as file:
        table = list(csv.DictReader(file))
    needed = {"preset", "wall_s", "node_steps", "error_active_percent", "error_tension", "error_contact_force", "error_stress"}
    assert needed <= set(table[0])
    assert [line["preset"] for line in table if line["preset"]] == ["draft", "standard", "reference"]
    assert float(table[0]["error_tension"]) == 0.0  # the reference itself
    coarse = next(line for line in table if line["point"].endswith("model.nodes_per_loop=10") and line["knob"])
    draft = next(line for line in table if line["preset"] == "draft")
    assert float(coarse["error_stress"]) > float(draft["error_stress"])
    assert {row["knob"] for row in summary["knobs"]} >= {"nodes_per_loop", "axial_softening", "precision", "multipliers"}
    prices = [point["price"] for point in summary["front"]]
    errors = [point["largest_error_percent"] for point in summary["front"]]
    assert prices == sorted(prices) and errors == sorted(errors, reverse=True)


@pytest.mark.slow
def test_study_in_space_varies_what_space_has(tmp_path: Path, few_points: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Points stay in the kind of model of the scene, whatever `auto` would take with one of their values; settings that it lacks
    are left out, and a ramp far beyond the limit is not run. More nodes are nearer to the reference."""
    monkeypatch.setattr(spatial_kind, "REFERENCE", ((math.inf, 40),))
    monkeypatch.setattr(spatial_kind, "COMBINED", ((24,), (0.01,)))
    for name, values in (("NODES", (16, 32)), ("TOLERANCES", (0.01,)), ("SOFTENINGS", (0.25,)), ("RAMP_NODES", (40,))):
        monkeypatch.setattr(spatial_kind, name if name.startswith("RAMP") else f"VARIED_{name}", values)
    monkeypatch.setattr(study, "RAMP_NODES", math.inf)
    for name in ("PERIODS", "DAMPINGS", "STEPS"):
        monkeypatch.setattr(parameters, name, ())
    scene = Path(__file__).parents[2] / "scenes" / "atlas_cell_spatial.toml"
    small = ("load.strain_weft=0.04", "load.strain_warp=0.08", "output.frames=1")
    result = run_trade(lambda more, preset: load_scene(scene, (*small, *more), preset), out=tmp_path / "t")
    rows = read_trade(tmp_path / "t" / "trade.csv")
    assert result.exit_code == 0 and {row.kind for row in rows} == {"spatial"}
    assert not {row.knob for row in rows} & {"multipliers", "body_mass"}
    ramp = next(row for row in rows if row.knob == "drive")
    assert ramp.stop_reason == "cost limit" and ramp.node_steps == 0
    assert "not run" in ramp.message
    errors = {
        knob["value"]: knob["largest_error_percent"]
        for knob in plain(result.summary)["knobs"]
        if knob["knob"] == "nodes_per_loop"
    }
    assert errors["model.nodes_per_loop=32"] < errors["model.nodes_per_loop=16"]
    assert all(row.has_results for row in rows if row.drive == "relax")


def test_reference_that_is_refused_is_bad_input(tmp_path: Path) -> None:
    """Nothing is written for it."""
    arguments = ["trade", str(CELL), "--out", str(tmp_path / "t"), "--set", "model.nodes_per_loop=2"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert not (tmp_path / "t").exists()


# --- the error of a run


@pytest.fixture
def quick_pilot(monkeypatch: pytest.MonkeyPatch) -> None:
    """A coarser mesh counts as true."""
    monkeypatch.setattr(kind, "FINE", {"periodic": 30})
    monkeypatch.setattr(probe_run, "LEVELS", 1)


def test_setting_within_an_error_is_the_cheapest_that_meets_it(quick_pilot: None) -> None:
    """Settings are tried from the coarsest on; a larger error never asks for more nodes."""
    scene = load_scene(CELL, SMALL)
    small = probe_run.ProbeRun(scene)
    loose, missed = probe_run.choose_setting(small, 20.0)
    tight, left = probe_run.choose_setting(small, 2.0)
    assert loose.nodes_per_loop == kind.NODES[0]
    assert loose.nodes_per_loop <= tight.nodes_per_loop
    assert probe_run.error_bound_percent(left) <= 2.0 and probe_run.error_bound_percent(missed) <= 20.0


def test_run_within_an_error_says_what_it_may_miss(tmp_path: Path, quick_pilot: None) -> None:
    out = tmp_path / "r"
    overrides = [item for value in SMALL for item in ("--set", value)]
    arguments = ["run", str(CELL), "--error", "3", "--out", str(out), "--set", "output.usd=false", *overrides]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert "estimated error" in result.output
    quality = load_summary(out)["quality"]
    assert 0.0 < quality["estimated_error"] <= 0.03
    errors = [quality["estimated_errors"][name] for name in ("tension", "contact_force", "stress")]
    assert max(errors) <= quality["estimated_error"]


def test_error_of_a_run_in_space_is_found_on_a_small_mesh_in_space(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in the plane; here finer meshes that count as true are coarse."""
    monkeypatch.setattr(spatial_kind, "FINE", {"periodic": 52})
    monkeypatch.setattr(spatial_kind, "TOLERANCE", 1e-2)
    monkeypatch.setattr(probe_run, "LEVELS", 1)
    scene = load_scene(CELL, ["model.kind=spatial", "load.strain_weft=0.0", "load.strain_warp=0.02", "output.frames=1"])
    small = probe_run.ProbeRun(scene)
    setting, errors = probe_run.choose_setting(small, 20.0)
    assert setting == Setting(spatial_kind.NODES[0], SOFTENING, 1e-2, "double")
    assert 0.0 < errors.largest_percent < 5.0 and small.node_steps > 0
    own = small.errors(setting, small.fine)
    assert own is not None and own.largest_percent == 0.0


def load_summary(out: Path) -> dict:
    return json.loads((out / "summary.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--error", "0"), "--error: '0'"),
        (("--error", "2 N"), "--error: '2 N'"),
        (("--error", "2", "--preset", "draft"), "--preset"),
        (("--error", "2", "--set", "solver.drive=ramp"), "'relax'"),
    ],
)
def test_error_is_refused_where_it_means_nothing(tmp_path: Path, options: tuple[str, ...], said: str) -> None:
    result = CliRunner().invoke(main, ["run", str(CELL), "--out", str(tmp_path / "r"), *options])
    assert result.exit_code == 2
    assert said in result.output


def test_table_of_another_version_is_refused_in_one_line(tmp_path: Path) -> None:
    """One without a column of this version's."""
    (tmp_path / "trade.csv").write_text("preset,group\ndraft,preset\n", encoding="utf-8")
    with pytest.raises(RunDirectoryError, match="trade.csv: .*strain_weft.* --force"):
        read_trade(tmp_path / "trade.csv")
