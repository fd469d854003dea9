"""Maps over tensions: each cell is the run under its tensions, in either model."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from reference.in_words import quantities
from warpknit.base.errors import SceneError
from warpknit.commands.cli import main
from warpknit.mechanics.driven_strain import TOLERANCE
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene
from warpknit.studies.contact_map import MapRow, find_optimum, read_map
from warpknit.studies.sweep import run_map

CELL = Path(__file__).parents[1] / "scenes" / "atlas_cell.toml"
QUICK = ("solver.preset=draft", "output.frames=2", "output.figures=false", "output.usd=false")
TENSIONS = (0.03, 0.06)  # [N/m]
SWEEP = (f"sweep.tension_weft={list(TENSIONS)}", f"sweep.tension_warp={list(TENSIONS)}")


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_a_cell_is_the_run_under_its_tensions(kind: str, tmp_path: Path) -> None:
    """The tensions of a cell are those asked for, to the tolerance of the search, and strains and contacts those of a run.

    The two stop at different states within TOLERANCE of the tension: strains differ by that over the stiffness, a fraction of
    a percent of strain.
    """
    of_kind = f"model.kind={kind}"
    scene = load_scene(CELL, [*QUICK, *SWEEP, of_kind])
    assert run_map(scene, out=tmp_path / "map", device="cpu").exit_code == 0
    rows = read_map(tmp_path / "map" / "map.csv", tmp_path / "map" / "map_details.csv")
    assert [row.load for row in rows] == [(x, y) for y in TENSIONS for x in TENSIONS]
    for row in rows:
        assert row.stop_reason == "steady"
        slack = max(TOLERANCE, scene.solver.residual_tolerance) * np.maximum(row.load, 0.5 * max(row.tension))
        assert np.all(np.abs(np.subtract(row.tension, row.load)) <= slack)
    row = rows[1]
    loads = (f"load.tension_weft={row.load[0]}", f"load.tension_warp={row.load[1]}")
    assert run_scene(load_scene(CELL, [*QUICK, *loads, of_kind]), out=tmp_path / "run", device="cpu").exit_code == 0
    run = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    for side in ("weft", "warp"):
        assert vars(row)[f"strain_{side}"] == pytest.approx(run["mesh"][f"strain_{side}"], abs=3e-3)
    assert row.active_percent == run["contacts"]["active_percent"]
    assert row.stress_max_Pa == pytest.approx(run["wire"]["stress_max_Pa"], rel=0.05)


@pytest.mark.parametrize("history", [("contact.friction=0.2",), ("wire.plastic=true", "wire.yield_stress=2e8")])
def test_a_planar_cell_with_history_is_the_run_under_its_load(history: tuple[str, ...], tmp_path: Path) -> None:
    """Each cell has its own stick places and plastic turns: tensions to the bit."""
    of_plane = (*QUICK, "model.kind=planar", *history)
    swept = ("sweep.strain_weft=[0.05, 0.1]", "sweep.strain_warp=[0.05]")
    assert run_map(load_scene(CELL, [*of_plane, *swept]), out=tmp_path / "map", device="cpu").exit_code == 0
    row = read_map(tmp_path / "map" / "map.csv", tmp_path / "map" / "map_details.csv")[1]
    loads = ("load.strain_weft=0.1", "load.strain_warp=0.05")
    assert run_scene(load_scene(CELL, [*of_plane, *loads]), out=tmp_path / "run", device="cpu").exit_code == 0
    run = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    assert row.tension == tuple(run["mesh"][f"tension_{side}_N_per_m"] for side in ("weft", "warp"))


def test_a_map_over_tensions_goes_on_and_draws_its_axes(tmp_path: Path) -> None:
    """Its table names tensions; --resume keeps the cells; a weft tension on the command line takes the place of strains."""
    strains = str(CELL.with_name("contact_map.toml"))
    settings = [part for setting in (*QUICK[:2], *SWEEP) for part in ("--set", setting)]
    call = ["map", strains, "--out", str(tmp_path / "m"), *settings]
    done = CliRunner().invoke(main, call, prog_name="warpknit")
    assert done.exit_code == 0, done.output
    assert {"4"} <= set(quantities(done.stdout)) and "  valid both tensions" in done.stdout
    found = {path.name for path in (tmp_path / "m" / "figures").iterdir()}
    assert {"contact_map.png", "strain_weft_map.png", "strain_warp_map.png"} <= found and "tension_weft_map.png" not in found
    with open(tmp_path / "m" / "map.csv", newline="", encoding="utf-8") as file:
        (row, *_) = csv.DictReader(file)
    assert float(row["target_tension_weft_N_per_m"]) == TENSIONS[0]
    before = (tmp_path / "m" / "map.csv").read_bytes()
    assert CliRunner().invoke(main, [*call, "--resume"], prog_name="warpknit").exit_code == 0
    assert (tmp_path / "m" / "map.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("sweep", "said"),
    [
        ("{strain_weft=[0.1], tension_warp=[0.1]}", "sweep.tension_weft: "),
        ("{tension_weft=[0.1]}", "sweep.tension_warp: "),
        ('{tension_weft=["-1 N/m"], tension_warp=[0.1]}', "sweep.tension_weft[0]"),
    ],
)
def test_strains_and_tensions_are_not_mixed(sweep: str, said: str) -> None:
    with pytest.raises(SceneError, match="sweep") as refusal:
        load_scene(CELL, [f"sweep={sweep}"])
    assert said in str(refusal.value)


def cell(weft: float, warp: float) -> MapRow:
    """All contacts are active where both tensions are 2 to 5 N/m; the stress is 100 MPa for each N/m of their sum."""
    complete = 2.0 <= weft <= 5.0 and 2.0 <= warp <= 5.0
    return MapRow(
        strain_weft=0.1, strain_warp=0.1, tension_weft_N_per_m=weft, tension_warp_N_per_m=warp, stop_reason="steady",
        active_percent=100.0 if complete else 66.7, stress_max_Pa=1e8 * (weft + warp),
        target_tension_weft_N_per_m=weft, target_tension_warp_N_per_m=warp,
    )  # fmt: skip


def test_the_drift_ends_where_contacts_open_or_the_wire_yields() -> None:
    """At 750 MPa of elastic limit: from (3, 3) weft alone goes from 2 to 4 N/m, and so does warp; both go from 2 to 3."""
    rows = [cell(weft, warp) for warp in range(1, 7) for weft in range(1, 7)]
    optimum = find_optimum(rows, 750e6)
    assert optimum is not None and optimum.load == (3, 3)
    weft, warp, both = optimum.drift
    assert (weft.low, weft.high) == ((2, 3), (4, 3)) and (warp.low, warp.high) == ((3, 2), (3, 4))
    assert (both.low, both.high) == ((2, 2), (3, 3))
    assert not any(drift.open_low or drift.open_high for drift in optimum.drift)
    narrow = find_optimum([row for row in rows if min(row.load) >= 2.0], 750e6)
    assert narrow is not None and narrow.drift[0].open_low
