"""Answers of a run: where contacts close, where the wire yields, what heat does, which tension is best."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from warpknit.measure.contact_classes import ContactClass
from warpknit.runner import answers as module
from warpknit.runner.answers import answers_of, closing, heat_of
from warpknit.runner.answers_table import answer_rows
from warpknit.runner.history import Row, read_history
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene

CELL = Path(__file__).parent.parent / "scenes" / "atlas_cell.toml"
QUICK = ("solver.preset=draft", "output.figures=false", "output.usd=false")
CLOSES, SLOPE = {"A": 0.23, "B": 0.61}, 3e-5  # [N/m], and [m] force of a closed contact by tension beyond it
LIMIT, STRESS = 700e6, 1e9  # [Pa] elastic limit, and [Pa m/N] stress by tension
STRAIN = 0.2  # [m/N] by tension


def row(tension: float, *, stage: str = "load", temperature: float = 293.15) -> Row:
    """A state of a mesh of two classes of contact, linear in its tension [N/m]."""
    force = {f"force_{name}_N": max(0.0, SLOPE * (tension - at)) for name, at in CLOSES.items()}
    active = {f"active_{name}_percent": 100.0 * (tension > at) for name, at in CLOSES.items()}
    return Row(
        stage=stage, temperature_K=temperature, strain_weft=STRAIN * tension, strain_warp=0.5 * STRAIN * tension,
        tension_weft_N_per_m=tension, tension_warp_N_per_m=tension, stress_max_Pa=STRESS * tension,
        stress_max_part="head of a closed loop", stress_max_wire=1, stress_max_node=7, stress_max_x_m=1e-3, stress_max_y_m=2e-3,
        active_percent=0.25 * active["active_A_percent"] + 0.75 * active["active_B_percent"], **force, **active,
    )  # fmt: skip


def found(
    rows: list[Row],
    monkeypatch: pytest.MonkeyPatch,
    service: float | None = None,
    jumps: list[tuple[Row, Row]] | None = None,
    pairs: tuple[int, int] = (10, 30),
) -> dict[str, Any]:
    """The answers from rows of such a mesh."""
    scene = SimpleNamespace(
        hook=None, wire=SimpleNamespace(yield_stress=LIMIT), output=SimpleNamespace(service_tension=service),
        solver=SimpleNamespace(residual_tolerance=1e-3),
        stages=[SimpleNamespace(name=name, by_tension=(False, False)) for name in ("load", "cold")],
    )  # fmt: skip
    monkeypatch.setattr(module, "classes_of", lambda _: [ContactClass("A", pairs[0]), ContactClass("B", pairs[1])])
    monkeypatch.setattr(module.measure, "active_threshold", lambda _: 1e-12)
    monkeypatch.setattr(module.measure, "least_force", lambda _: 1e-12)
    monkeypatch.setattr(module.measure, "tension_scale", lambda _: 1.0)
    answers = answers_of(SimpleNamespace(scene=scene), rows, jumps or ())
    assert answers is not None
    return answers


@pytest.mark.parametrize("levels", [7, 10, 33])
def test_contacts_close_and_wires_yield_where_they_do(levels: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """F = SLOPE (T - T0) is linear, so that T0 follows from two records exactly, wherever the records are."""
    answers = found([row(1.0 * k / levels) for k in range(levels + 1)], monkeypatch)
    for one in answers["contacts"]:
        assert one["closes"]["resolved"]
        assert one["closes"]["tension_weft_N_per_m"] == pytest.approx(CLOSES[one["name"]], rel=1e-6)
        assert one["closes"]["strain_warp"] == pytest.approx(0.5 * STRAIN * CLOSES[one["name"]], rel=1e-6)
    assert answers["first_yield"]["tension_warp_N_per_m"] == pytest.approx(LIMIT / STRESS, rel=1e-9)
    assert answers["first_yield"]["stress_max_part"] == "head of a closed loop"
    best = answers["best"]
    assert best["low"]["tension_weft_N_per_m"] == pytest.approx(CLOSES["B"], rel=1e-6) and not best["open_low"]
    assert best["high"]["tension_weft_N_per_m"] == pytest.approx(LIMIT / STRESS, rel=1e-9) and not best["open_high"]


@pytest.mark.parametrize("bend", [-0.6, 0.6])
def test_a_force_that_bends_closes_where_it_begins(bend: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """F = SLOPE (x + bend x^2) with x = T - T0 is a parabola, so that T0 follows from three records exactly; a line through two
    is off by about bend x1 x2 = 0.01 N/m."""
    rows = [row(0.2 * k + 0.1) for k in range(5)]
    for one in rows:
        x = max(0.0, one.tension_weft_N_per_m - CLOSES["A"])
        one.force_A_N = SLOPE * (x + bend * x * x)
    closes = found(rows, monkeypatch)["contacts"][0]["closes"]
    assert closes["resolved"] and closes["tension_weft_N_per_m"] == pytest.approx(CLOSES["A"], rel=1e-6)


def test_a_force_that_bends_too_much_has_no_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """F = SLOPE x^3 with x = T - T0: the line through two records ends at 0.47 N/m, and no parabola through three at zero."""
    rows = [row(0.4 * k + 0.1) for k in range(6)]
    for one in rows:
        one.force_A_N = SLOPE * max(0.0, one.tension_weft_N_per_m - CLOSES["A"]) ** 3
    closes = found(rows, monkeypatch)["contacts"][0]["closes"]
    assert not closes["resolved"]
    assert [one["tension_weft_N_per_m"] for one in closes["between"]] == pytest.approx([0.1, 0.5])


@pytest.mark.parametrize(("tension", "share"), [(0.22, 0.0), (0.24, 25.0), (0.60, 25.0), (0.62, 100.0)])
def test_a_class_counts_at_service_tension_from_its_closing_on(
    tension: float, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between two records the share is that of the classes closed by then, not a mean: 10 of 40 pairs, then all."""
    (point,) = found([row(0.2 * k) for k in range(6)], monkeypatch, service=tension)["service"]
    assert point["active_percent"] == pytest.approx(share)
    assert point["state"]["strain_weft"] == pytest.approx(STRAIN * tension)


def test_what_does_not_happen_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run to half a newton per metre: B stays open, the wire elastic, and the service tension is not reached."""
    text = dict(answer_rows(found([row(0.1 * k) for k in range(6)], monkeypatch, service=2.0), LIMIT))
    assert text["contacts B close at"].startswith("not closed up to 500 mN/m")
    assert text["first yield at"].startswith("not up to 500 mN/m: 500 MPa, 71 % of the limit, in the head of a closed loop")
    assert text["active at 2 N/m"] == "not reached; up to 500 mN/m"
    assert text["best tension"] == "365 mN/m, the middle of its range: 25.0 % active, 365 MPa"
    assert text["  may drift"] == "from 230 mN/m (-37 %) to at least 500 mN/m (+37 %), where the records end"


def test_a_compressed_mesh_has_no_service_state(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mean tension of 0.3 N/m of 0.7 and -0.1 N/m is not a mesh in tension."""
    rows = [row(0.1 * k) for k in range(6)]
    for one in rows:
        one.tension_weft_N_per_m, one.tension_warp_N_per_m = one.tension_weft_N_per_m + 0.4, one.tension_warp_N_per_m - 0.4
    answers = found(rows, monkeypatch, service=0.3)
    assert answers["service"][0]["state"] is None
    assert dict(answer_rows(answers, LIMIT))["active at 300 mN/m"].startswith("compressed in weft or warp")


def test_a_class_that_opens_again_is_said_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """A carries force from 0.23 to 0.3 N/m alone: its closing is there, and the record in which it is open again is given."""
    rows = [row(0.1 * k) for k in range(6)]
    for one in rows[4:]:
        one.force_A_N, one.active_A_percent = 0.0, 0.0
    answers = found(rows, monkeypatch)
    assert answers["contacts"][0]["closes"]["opens"]["tension_weft_N_per_m"] == pytest.approx(0.4)
    assert "open again at 400 mN/m" in dict(answer_rows(answers, LIMIT))["contacts A close at"]


def test_what_one_record_shows_is_not_the_best_tension(monkeypatch: pytest.MonkeyPatch) -> None:
    """All contacts are active at 0.2 N/m alone, and half of them from 0.3 N/m on: best is the range of the half."""
    rows = [row(0.1 * k) for k in range(7)]
    for k, one in enumerate(rows):
        one.force_A_N = one.force_B_N = 0.0
        one.active_percent = one.active_A_percent = one.active_B_percent = 100.0 if k == 2 else 50.0 * (k > 2)
    best = found(rows, monkeypatch)["best"]
    assert best["high"]["tension_weft_N_per_m"] == pytest.approx(0.6)
    assert best["active_percent"] == pytest.approx(50.0) and best["tension_weft_N_per_m"] > 0.3


def test_a_last_record_gives_a_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """One record behind a closing cannot give its place: the records on both sides are given."""
    rows = [row(0.1 * k) for k in range(4)]  # A closes at 0.23 between the last two
    closes = closing(rows, "A", 1e-12, 1e-12)
    assert closes is not None and not closes["resolved"]
    assert [state["tension_weft_N_per_m"] for state in closes["between"]] == pytest.approx([0.2, 0.3])
    text = dict(answer_rows(found(rows, monkeypatch, service=0.25), LIMIT))
    assert text["contacts A close at"].startswith("between 200 mN/m and 300 mN/m")
    assert text["active at 250 mN/m"].endswith("more output.frames tell which")


def test_a_range_of_drift_tells_jumps_and_an_unknown_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """All contacts close by a jump from 0.3 to 0.4 N/m, and the mesh jumps again from 0.5 to 0.6 N/m, where they stay closed."""
    rows = [row(0.1 * k) for k in range(7)]
    for k, one in enumerate(rows):
        one.force_A_N = one.force_B_N = SLOPE * (k > 3)
        one.active_percent = one.active_A_percent = one.active_B_percent = 100.0 * (k > 3)
    best = found(rows, monkeypatch, jumps=[(rows[3], rows[4]), (rows[5], rows[6])])["best"]
    assert [one["tension_weft_N_per_m"] for one in best["low_between"]] == pytest.approx([0.3, 0.4]) and best["low_jump"]
    (jump,) = best["jumps"]
    assert [one["tension_weft_N_per_m"] for one in jump] == pytest.approx([0.5, 0.6])
    text = dict(answer_rows(found(rows, monkeypatch, jumps=[(rows[3], rows[4]), (rows[5], rows[6])]), LIMIT))["  may drift"]
    assert "between records at 300 mN/m and 400 mN/m" in text and text.endswith("; the mesh jumps between 500 mN/m and 600 mN/m")


def test_both_ends_of_a_range_of_drift_are_told_where_they_are_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of all contacts close somewhere from 0.2 to 0.3 N/m, and open by a jump from 0.5 to 0.6 N/m: neither place is known,
    and the range ends at one percentage point less on the way to 0.3 N/m."""
    rows = [row(0.1 * k) for k in range(7)]
    for k, one in enumerate(rows):
        one.force_A_N = one.force_B_N = 0.0
        one.active_percent = one.active_A_percent = one.active_B_percent = 100.0 if 2 < k < 6 else 50.0
    answers = found(rows, monkeypatch, jumps=[(rows[5], rows[6])])
    best = answers["best"]
    sides = {end: [one["tension_weft_N_per_m"] for one in best[f"{end}_between"]] for end in ("low", "high")}
    assert sides == {"low": pytest.approx([0.2, 0.3]), "high": pytest.approx([0.5, 0.6])}
    assert (best["low_jump"], best["high_jump"], best["jumps"]) == (False, True, [])
    text = dict(answer_rows(answers, LIMIT))["  may drift"]
    assert text.startswith("from about 300 mN/m") and ", between records at 200 mN/m and 300 mN/m, to about 500 mN/m" in text
    assert text.endswith(", between records at 500 mN/m and 600 mN/m, where the mesh jumps")


def test_heat_is_told_stage_by_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stage that cools the mesh from 20 to -190 degC at a held strain, while its tension rises from 0.3 to 0.4 N/m."""
    cold = [row(0.3 + 0.02 * k, stage="cold", temperature=293.15 - 42.0 * k) for k in range(1, 6)]
    stretched = found([row(0.1 * k) for k in range(4)] + cold, monkeypatch)
    assert stretched["heat"] == []  # what the load does cannot be told from what heat does
    for one in cold:
        one.strain_weft, one.strain_warp = row(0.3).strain_weft, row(0.3).strain_warp
    answers = found([row(0.1 * k) for k in range(4)] + cold, monkeypatch)
    (stage,) = answers["heat"]
    assert stage["stage"] == "cold"
    assert stage["temperature_K"] == pytest.approx([293.15, 83.15])
    assert stage["tension_weft_N_per_m"] == pytest.approx([0.3, 0.4])
    text = dict(answer_rows(answers, LIMIT))["heat, 20 to -190 degC"]
    assert text.startswith("frame held: active")
    assert "tension 300 mN/m to 400 mN/m, strain 6.0 % / 3.0 %, stress 300 MPa to 400 MPa" in text
    for k, one in enumerate(cold):
        one.tension_weft_N_per_m = one.tension_warp_N_per_m = 0.3
        one.strain_weft += 1e-4 * k
    by_tension = [SimpleNamespace(name="cold", by_tension=(True, True))]
    text = dict(answer_rows(answers | {"heat": heat_of([row(0.3), *cold], by_tension)}, LIMIT))
    assert text["heat, 20 to -190 degC"].startswith("tension held: active")
    assert "tension 300 mN/m, strain 6.0 % / 3.0 %, changed by +0.04 / +0 %" in text["heat, 20 to -190 degC"]


def test_a_graze_is_not_the_closing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A carries 1 nN at 0.1 N/m and opens again: it closes at 0.23 N/m all the same, and the graze is told."""
    rows = [row(0.05 * k) for k in range(11)]
    rows[2].force_A_N, rows[2].active_A_percent = 1e-9, 50.0
    answers = found(rows, monkeypatch)
    closes = answers["contacts"][0]["closes"]
    assert closes["tension_weft_N_per_m"] == pytest.approx(CLOSES["A"], rel=1e-6)
    assert closes["first_touch"]["tension_weft_N_per_m"] == pytest.approx(0.1)
    text = dict(answer_rows(answers, LIMIT))["contacts A close at"]
    assert text == "230 mN/m, strain 4.6 % / 2.3 %, after a touch at 100 mN/m that opens again (10 pairs)"
    rows[5].active_A_percent = 70.0
    assert "(70 % of 10 pairs)" in dict(answer_rows(found(rows, monkeypatch), LIMIT))["contacts A close at"]


def test_a_closing_stays_that_of_the_loading() -> None:
    """Unloaded to 0 and loaded again, A opens and closes once more; the closing is that of the first stage."""
    rows = [row(0.1 * k) for k in range(5)]
    rows += [row(0.4 - 0.1 * k, stage="unload") for k in range(1, 5)] + [row(0.1 * k, stage="again") for k in range(1, 6)]
    closes = closing(rows, "A", 1e-12, 1e-12)
    assert closes is not None and closes["stage"] == "load" and closes["first_touch"] is None
    assert closes["tension_weft_N_per_m"] == pytest.approx(CLOSES["A"], rel=1e-6)


def test_a_place_outside_its_records_is_not_given() -> None:
    """Forces that grow slower than from zero point to a closing before the last open record: only the records are known."""
    rows = [row(0.1 * k) for k in range(6)]
    rows[3].force_A_N, rows[4].force_A_N = 2.0e-6, 2.5e-6  # 0.3 - 4 * 0.1 N/m
    closes = closing(rows, "A", 1e-12, 1e-12)
    assert closes is not None and not closes["resolved"]
    assert closes["tension_weft_N_per_m"] == pytest.approx(0.25)


@pytest.mark.parametrize("levels", [4, 10])
def test_the_drift_does_not_depend_on_the_records(levels: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """100 % T/(1 N/m) of many contacts are active, and the wire yields at 0.7 N/m: best are 69 to 70 %, at 0.69 to 0.7 N/m."""
    rows = [row(1.0 * k / levels) for k in range(levels + 1)]
    for one in rows:
        one.active_percent = one.active_A_percent = one.active_B_percent = 100.0 * one.tension_weft_N_per_m
        one.force_A_N = one.force_B_N = 0.0
    best = found(rows, monkeypatch, pairs=(100, 300))["best"]
    assert best["high"]["tension_weft_N_per_m"] == pytest.approx(LIMIT / STRESS, rel=1e-9) and not best["grows"]
    spacing = 1.0 / (module.DRIFT_STATES - 1)  # [N/m]
    assert 0.69 <= best["low"]["tension_weft_N_per_m"] <= 0.69 + spacing


def test_the_best_tension_is_in_the_widest_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """All contacts are active in one record at 0.2 N/m, by a graze, and from the closing of B to first yield at 0.7 N/m."""
    rows = [row(0.05 * k) for k in range(21)]
    rows[4].active_percent = rows[4].active_A_percent = rows[4].active_B_percent = 100.0
    best = found(rows, monkeypatch)["best"]
    assert best["low"]["tension_weft_N_per_m"] == pytest.approx(CLOSES["B"], rel=1e-6)
    assert best["high"]["tension_weft_N_per_m"] == pytest.approx(LIMIT / STRESS, rel=1e-9)
    assert best["tension_weft_N_per_m"] == pytest.approx(0.5 * (CLOSES["B"] + LIMIT / STRESS), abs=1.0 / module.DRIFT_STATES)


def test_a_service_tension_of_the_first_record_is_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mesh that carries 0.3 N/m as knitted, asked for 0.2 N/m: its state is the first record, with class A."""
    (point,) = found([row(0.3 + 0.1 * k) for k in range(4)], monkeypatch, service=0.2)["service"]
    assert point["state"]["tension_weft_N_per_m"] == 0.3
    assert point["active_percent"] == pytest.approx(25.0)


def closing_of_cell(out: Path, levels: int, *more: str) -> dict[str, Any]:
    """Where class A of the periodic cell closes, in a run to 8 % strain in both directions."""
    settings = [*QUICK, "load.strain_weft=0.08", "load.strain_warp=0.08", f"output.frames={levels}", *more]
    assert run_scene(load_scene(CELL, settings), out=out, device="cpu").exit_code == 0
    contacts = json.loads((out / "summary.json").read_text(encoding="utf-8"))["answers"]["contacts"]
    assert [one["name"] for one in contacts] == ["A", "B", "C"]
    return dict(contacts[0]["closes"])


@pytest.mark.parametrize(("kind", "levels"), [("planar", 80), ("spatial", 40)])
def test_the_tension_of_touch_is_that_of_a_run_in_small_levels(kind: str, levels: int, tmp_path: Path) -> None:
    """Interpolated in levels of 1 % strain, against the record in which the class closes in small levels.

    The records of the small levels bound the strain of the closing; the coarse one agrees to the curvature of the force in
    two of its levels, here a fifth of a level.
    """
    of_kind = f"model.kind={kind}"
    coarse = closing_of_cell(tmp_path / "coarse", 8, of_kind)
    fine = closing_of_cell(tmp_path / "fine", levels, of_kind)
    low, high = (state["strain_weft"] for state in fine["between"])
    assert high - low == pytest.approx(0.08 / levels, rel=1e-3)
    assert low - 0.002 < coarse["strain_weft"] < high + 0.002
    rows = read_history(tmp_path / "fine" / "history.csv")
    tension = np.interp(coarse["strain_weft"], [r.strain_weft for r in rows], [r.tension_warp_N_per_m for r in rows])
    assert coarse["tension_warp_N_per_m"] == pytest.approx(tension, rel=0.05)


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_first_yield_is_that_of_a_run_in_small_levels(kind: str, tmp_path: Path) -> None:
    """At 500 MPa, interpolated in levels of 2 % strain, against levels of 0.5 %.

    Linear interpolation of a stress s(e) errs by s'' h^2/8 at most, which over the slope is a strain: here taken from the
    second difference of the records about it, D s/(8 D' s) levels.
    """
    settings = (*QUICK, f"model.kind={kind}", "wire.yield_stress=500e6", "load.strain_weft=0.2", "load.strain_warp=0.2")
    found, records = [], []
    for levels in (10, 40):
        out = tmp_path / str(levels)
        assert run_scene(load_scene(CELL, [*settings, f"output.frames={levels}"]), out=out, device="cpu").exit_code == 0
        found.append(json.loads((out / "summary.json").read_text(encoding="utf-8"))["answers"]["first_yield"])
        records.append(read_history(out / "history.csv"))
    coarse, fine = found
    stress = np.array([r.stress_max_Pa for r in records[0]])
    k = int(np.flatnonzero(stress > 500e6)[0])
    curvature = np.abs(np.diff(stress[k - 2 : k + 2], 2)).max()
    error = 0.02 * curvature / (8.0 * (stress[k] - stress[k - 1]))
    low, high = (state["strain_weft"] for state in fine["between"])
    assert low - error <= coarse["strain_weft"] <= high + error
    assert error < 0.004
    assert coarse["stress_max_part"] == fine["stress_max_part"]
    strain, tension = (np.array([vars(r)[name] for r in records[1]]) for name in ("strain_weft", "tension_weft_N_per_m"))
    assert coarse["tension_weft_N_per_m"] == pytest.approx(np.interp(coarse["strain_weft"], strain, tension), rel=0.05)


def test_a_class_that_grazes_in_space_closes_where_it_carries_load(tmp_path: Path) -> None:
    """Contacts C of the atlas touch at 0.01 N/m and open again; from 0.6 N/m on their force grows to that of the others.

    The tension of closing is that between the last record in which C is open and the first in which it bears, in any levels.
    """
    tensions = []
    for levels in (7, 14):
        settings = [*QUICK, "model.kind=spatial", "load.strain_weft=0.35", "load.strain_warp=0.2625", f"output.frames={levels}"]
        assert run_scene(load_scene(CELL, settings), out=tmp_path / str(levels), device="cpu").exit_code == 0
        contacts = json.loads((tmp_path / str(levels) / "summary.json").read_text(encoding="utf-8"))["answers"]["contacts"]
        closes = contacts[2]["closes"]
        assert closes["first_touch"]["tension_weft_N_per_m"] < 0.2 * closes["tension_weft_N_per_m"]
        tensions.append(closes["tension_weft_N_per_m"])
    assert tensions[0] == pytest.approx(tensions[1], rel=0.02)


def test_the_answers_of_the_spatial_model_have_the_same_keys(tmp_path: Path) -> None:
    """The tightest class closes in space too, and sooner: wires over each other touch before their planar gap closes."""
    planar = closing_of_cell(tmp_path / "planar", 8)
    spatial = closing_of_cell(tmp_path / "spatial", 8, "model.kind=spatial")
    assert planar.keys() == spatial.keys()
    assert 0.02 < spatial["strain_weft"] < planar["strain_weft"]
    wire = json.loads((tmp_path / "spatial" / "summary.json").read_text(encoding="utf-8"))["wire"]
    assert wire["stress_max_part"].endswith("loop")


def test_heat_is_drawn_against_temperature(tmp_path: Path) -> None:
    """Cooled under held strains, wires shorten and the tension grows, as heat.png draws and the answers tell."""
    settings = ["solver.preset=draft", "output.frames=3", "output.usd=false", 'path=[{name="cold", temperature="-190 degC"}]']
    assert run_scene(load_scene(CELL, settings), out=tmp_path / "run", device="cpu").exit_code == 0
    assert (tmp_path / "run" / "figures" / "heat.png").stat().st_size > 0
    (stage,) = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))["answers"]["heat"]
    assert stage["strain_weft"][0] == pytest.approx(stage["strain_weft"][1], abs=1e-9)
    for side in ("weft", "warp"):
        before, after = stage[f"tension_{side}_N_per_m"]
        assert after > before


def test_no_state_within_a_jump_is_interpolated(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between 0.5 and 0.6 N/m the mesh jumps: B closes, the wire yields, and a share at 0.55 N/m is of neither equilibrium."""
    rows = [row(0.1 * k) for k in range(10)]
    for k, one in enumerate(rows):
        one.stress_max_Pa = LIMIT * (1.2 if k > 5 else 0.5)
        one.force_B_N, one.active_B_percent = (1e-6 * k, 100.0) if k > 5 else (0.0, 0.0)
        one.active_percent = 0.25 * one.active_A_percent + 0.75 * one.active_B_percent
    answers = found(rows, monkeypatch, service=0.55, jumps=[(rows[5], rows[6])])
    assert answers["first_yield"]["jump"] and answers["first_yield"]["tension_weft_N_per_m"] == rows[6].tension_weft_N_per_m
    closes = answers["contacts"][1]["closes"]
    assert closes["jump"] and not closes["resolved"] and not answers["contacts"][0]["closes"]["jump"]
    (point,) = answers["service"]
    assert point["state"] is None and [one["active_percent"] for one in point["jump"]] == [25.0, 100.0]
    text = dict(answer_rows(answers, LIMIT))
    there = "between 500 mN/m and 600 mN/m, strain 10.0 % / 5.0 % and 12.0 % / 6.0 %, where the mesh jumps"
    assert text["contacts B close at"] == f"{there} (30 pairs)"
    assert text["first yield at"].startswith(f"{there}, in the head of a closed loop")
    assert text["active at 550 mN/m"] == "unknown: the mesh jumps there, from 25.0 % at 500 mN/m to 100.0 % at 600 mN/m"
    (behind,) = found(rows, monkeypatch, service=rows[6].tension_weft_N_per_m, jumps=[(rows[5], rows[6])])["service"]
    assert behind["active_percent"] == 100.0


def test_no_state_within_a_jump_is_best(monkeypatch: pytest.MonkeyPatch) -> None:
    """The mesh jumps between 0.5 and 0.6 N/m: what lies between them is no state of it."""
    rows = [row(0.1 * k) for k in range(10)]
    for k, one in enumerate(rows):
        one.active_percent = one.active_A_percent = one.active_B_percent = 100.0 if k in (5, 6) else 0.0
        one.force_A_N = one.force_B_N = 0.0
    best = found(rows, monkeypatch, jumps=[(rows[5], rows[6])])["best"]
    assert best["low"]["tension_weft_N_per_m"] <= 0.5 <= best["high"]["tension_weft_N_per_m"]
    for state in (best, best["low"], best["high"]):
        assert not 0.5 + 1e-9 < state["tension_weft_N_per_m"] < 0.6 - 1e-9


def test_what_is_loaded_beyond_first_yield_does_not_change_the_best_tension(monkeypatch: pytest.MonkeyPatch) -> None:
    """First yield is at 0.7 N/m. The mesh jumps back from 0.8 to 0.45 N/m and is loaded on, below the limit and with B open."""
    rows = [row(0.1 * k) for k in range(9)]
    behind = [row(0.45 + 0.1 * k) for k in range(10)]
    for one in behind:
        one.stress_max_Pa, one.force_B_N, one.active_B_percent, one.active_percent = 0.5 * LIMIT, 0.0, 0.0, 25.0
    best = found(rows, monkeypatch)["best"]
    assert best["low"]["tension_weft_N_per_m"] == pytest.approx(CLOSES["B"], rel=1e-6)
    assert best["high"]["tension_weft_N_per_m"] == pytest.approx(LIMIT / STRESS, rel=1e-9)
    assert found(rows + behind, monkeypatch, jumps=[(rows[-1], behind[0])])["best"] == best


def test_a_range_goes_along_the_load_and_not_over_other_states_of_its_tensions(monkeypatch: pytest.MonkeyPatch) -> None:
    """The mesh jumps back from 0.5 to 0.25 N/m, where all contacts close: they are active from there to 0.65 N/m."""
    rows = [row(0.1 * k) for k in range(6)] + [row(0.25 + 0.1 * k) for k in range(5)]
    for one in rows[6:]:
        one.active_percent = one.active_A_percent = one.active_B_percent = 100.0
    best = found(rows, monkeypatch, jumps=[(rows[5], rows[6])])["best"]
    assert [best[end]["tension_weft_N_per_m"] for end in ("low", "high")] == pytest.approx([0.25, 0.65])
    assert best["active_percent"] == 100.0 and best["open_high"] and not best["open_low"]


def test_shares_of_few_contacts_are_those_of_records(monkeypatch: pytest.MonkeyPatch) -> None:
    """A closes at 0.15 N/m. Of the 30 pairs of B, 3 are active at 0.85 N/m, behind first yield at 0.7 N/m: no record below it
    has one of them, and the best tension is in the range of A."""
    monkeypatch.setitem(CLOSES, "A", 0.15)
    monkeypatch.setitem(CLOSES, "B", 2.0)
    rows = [row(0.05 + 0.2 * k) for k in range(6)]
    for one in rows[4:]:
        one.active_B_percent, one.active_percent = 10.0, 25.0 + 7.5
    best = found(rows, monkeypatch)["best"]
    assert best["active_percent"] == 25.0
    assert [best[end]["tension_weft_N_per_m"] for end in ("low", "high")] == pytest.approx([0.15, LIMIT / STRESS])
    assert best["tension_weft_N_per_m"] == pytest.approx(0.5 * (0.15 + LIMIT / STRESS), abs=0.01)


def test_one_record_between_jumps_is_not_the_best_tension(monkeypatch: pytest.MonkeyPatch) -> None:
    """All contacts are active in one elastic record, which the mesh reaches by a jump and leaves by one for a state beyond the
    limit: best is the range of A before, of 25 %, in which this record lies too."""
    monkeypatch.setitem(CLOSES, "A", 0.15)
    rows = [row(0.1 * k) for k in range(6)]
    rows[5].stress_max_Pa = 2.0 * LIMIT
    for one in rows[4:]:
        one.active_percent = one.active_A_percent = one.active_B_percent = 100.0
    best = found(rows, monkeypatch, jumps=[(rows[3], rows[4]), (rows[4], rows[5])])["best"]
    assert [best[end]["tension_weft_N_per_m"] for end in ("low", "high")] == pytest.approx([0.15, 0.4])
    assert best["active_percent"] == 25.0 and len(best["jumps"]) == 1 and best["high_jump"]


def test_a_closing_elsewhere_on_the_path_leaves_a_service_tension_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """The mesh jumps back from 0.5 to 0.15 N/m; behind, B closes somewhere between 0.25 and 0.35 N/m. 0.29 N/m is reached
    first on the way to 0.5 N/m, where nothing closes."""
    rows = [row(0.1 * k) for k in range(6)] + [row(0.15 + 0.1 * k) for k in range(4)]
    for k, one in enumerate(rows):
        one.force_B_N, one.active_B_percent = (SLOPE, 100.0) if k > 7 else (0.0, 0.0)
    answers = found(rows, monkeypatch, service=0.29, jumps=[(rows[5], rows[6])])
    closes = answers["contacts"][1]["closes"]
    assert not closes["resolved"]
    assert [one["tension_weft_N_per_m"] for one in closes["between"]] == pytest.approx([0.25, 0.35])
    assert answers["service"][0]["resolved"]
    assert not found(rows[6:], monkeypatch, service=0.29)["service"][0]["resolved"]


def test_a_range_of_one_record_is_called_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between two jumps one record has contacts, no other has any, and the wire yields at the next one."""
    rows = [row(0.1 * k) for k in range(6)]
    rows[5].stress_max_Pa = 2.0 * LIMIT
    for k, one in enumerate(rows):
        one.active_percent = one.active_A_percent = one.active_B_percent = 100.0 * (k > 3)
    answers = found(rows, monkeypatch, jumps=[(rows[3], rows[4]), (rows[4], rows[5])])
    assert answers["best"]["low"] == answers["best"]["high"]
    assert dict(answer_rows(answers, LIMIT))["  may drift"] == "unknown: a single record has this share; more output.frames tell"


def test_unequal_tensions_are_given_with_their_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    """Warp carries three times the tension of weft: 0.4 N/m is the mean of 0.2 and 0.6 N/m."""
    rows = [row(0.1 * k) for k in range(7)]
    for one in rows:
        one.tension_weft_N_per_m, one.tension_warp_N_per_m = 0.5 * one.tension_weft_N_per_m, 1.5 * one.tension_warp_N_per_m
    text = dict(answer_rows(found(rows, monkeypatch, service=0.4), LIMIT))
    assert text["active at 400 mN/m"] == "25.0 %, mean of 200 mN/m / 600 mN/m in weft / warp, strain 8.0 % / 4.0 %"
    assert "to at least 300 mN/m / 900 mN/m (+45 % of the mean), where the records end" in text["  may drift"]


def test_a_tension_has_the_digits_that_its_records_need(monkeypatch: pytest.MonkeyPatch) -> None:
    """A closes at 231.4 mN/m, just above a record at 230.6 mN/m and far from the next: 230 mN/m would lie below it."""
    monkeypatch.setitem(CLOSES, "A", 0.2314)
    rows = [row(one) for one in (0.0, 0.1, 0.2306, 0.5, 0.6)]
    text = dict(answer_rows(found(rows, monkeypatch), LIMIT))["contacts A close at"]
    assert text.startswith("about 231 mN/m, between records at 231 mN/m and 500 mN/m")


def test_a_tension_within_the_tolerance_is_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tensions are known to 0.01 EI/C^3 times the residual tolerance, here 10 uN/m: a mesh as knitted has none."""
    monkeypatch.setitem(CLOSES, "A", 0.05)
    rows = [row(0.2 * k) for k in range(4)]
    rows[0].tension_weft_N_per_m, rows[0].tension_warp_N_per_m = -2.45e-6, 8e-6
    answers = found(rows, monkeypatch)
    assert answers["tension_tolerance_N_per_m"] == pytest.approx(1e-5)
    assert dict(answer_rows(answers, LIMIT))["contacts A close at"].startswith(
        "by 200 mN/m, once the slack is taken up, strain 0.0 % / 0.0 % to 4.0 % / 2.0 %"
    )
    rows[1].tension_weft_N_per_m = rows[1].tension_warp_N_per_m = 5e-6
    text = dict(answer_rows(found(rows[:2], monkeypatch), LIMIT))["contacts A close at"]
    assert text == "without tension, once the slack is taken up, strain 0.0 % / 0.0 % to 4.0 % / 2.0 % (10 pairs)"
