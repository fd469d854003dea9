"""Answers of a run: where contacts close, where the wire yields, what heat does, which tension is best."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from reference.in_words import quantities, table_of
from reference.two_classes import CLOSES, LIMIT, STRAIN, STRESS, found, row
from warpknit.results.row import Row, Values
from warpknit.runner.answers import heat_of
from warpknit.runner.answers_table import ahead_texts, answer_findings
from warpknit.runner.branches import jumps_in_heat, state_of
from warpknit.runner.run import run_scene
from warpknit.runner.summary import Summary
from warpknit.runner.summary_table import summary_findings
from warpknit.scene import load_scene

CELL = Path(__file__).parent.parent / "scenes" / "atlas_cell.toml"
EXPANSION = 4.5e-6  # [1/K]
QUICK = ("solver.preset=draft", "output.figures=false", "output.usd=false")


def best_texts(answers: Any, *, failed: bool = False) -> str:
    """The rows on the best tension, and its range where there is one."""
    text = table_of(answer_findings(answers, LIMIT, failed=failed))
    return text.get("  valid", text["best tension"])


@pytest.mark.parametrize("levels", [50, 70, 300])
def test_contacts_close_and_wires_yield_where_they_do(levels: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The load is 1 N/m: in 50 levels or more each of these tensions is known to 2 % of it, from the records beside it."""
    answers = found([row(1.0 * k / levels) for k in range(levels + 1)], monkeypatch)
    for one in answers["contacts"]:
        assert one["closes"]["resolved"]
        assert CLOSES[one["name"]] <= one["closes"]["tension_weft_N_per_m"] <= CLOSES[one["name"]] + 1.0 / levels
        assert one["closes"]["strain_warp"] == pytest.approx(0.5 * STRAIN * one["closes"]["tension_weft_N_per_m"], rel=1e-6)
    first_yield = answers["first_yield"]
    assert 0.7 < first_yield["tension_warp_N_per_m"] <= 0.7 + 1.0 / levels + 1e-9
    assert first_yield["stress_max_part"] == "head of a closed loop"
    best = answers["best"]
    assert (
        best["low"]["tension_weft_N_per_m"] == answers["contacts"][1]["closes"]["tension_weft_N_per_m"] and not best["open_low"]
    )
    assert best["high"]["tension_weft_N_per_m"] == first_yield["between"][0]["tension_weft_N_per_m"] and not best["open_high"]
    assert best["low_between"] is best["high_between"] is None
    middle = 0.5 * (best["low"]["tension_weft_N_per_m"] + best["high"]["tension_weft_N_per_m"])
    assert best["tension_weft_N_per_m"] == pytest.approx(middle, rel=1e-9)
    assert best["stress_over_limit"] == pytest.approx(STRESS * middle / LIMIT, rel=1e-9)
    assert best["first_yield_over_tension"] == pytest.approx(first_yield["tension_weft_N_per_m"] / middle, rel=1e-9)
    text = table_of(answer_findings(answers, LIMIT))["  margin"]
    assert quantities(text)[:1] == ["94 %"]


def test_what_does_not_happen_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run to half a newton per metre: B stays open, the wire elastic, and the service tension is not reached."""
    text = table_of(answer_findings(found([row(0.1 * k) for k in range(6)], monkeypatch, service=2.0), LIMIT))
    assert quantities(text["  class B"])[:1] == ["500 mN/m"] and text["classes closed"].endswith("; B open")
    assert quantities(text["first yield"])[:3] == ["500 mN/m", "500 MPa", "71 %"]
    assert quantities(text["active at 2 N/m"]) == ["500 mN/m"]
    assert quantities(text["best tension"]) == ["400 mN/m", "25 %", "400 MPa", "300 mN/m", "500 mN/m"]
    assert quantities(text["  margin"]) == ["57 %"]
    assert quantities(text["  valid"]) == ["300 mN/m", "-25 %", "200 mN/m", "500 mN/m", "+25 %"]


def test_a_limit_of_the_solver_is_told_as_such(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that did not converge beyond half a newton per metre, below first yield."""
    text = table_of(answer_findings(found([row(0.1 * k) for k in range(6)], monkeypatch), LIMIT, failed=True))
    assert quantities(text["first yield"])[:2] == ["500 mN/m", "500 MPa"]
    assert "did not converge" in text["  class B"]
    assert quantities(text["  valid"])[-1:] == ["500 mN/m"]
    assert {"500 mN/m", "+25 %"} <= set(quantities(text["  valid"]))


def test_the_best_tension_of_a_path_that_ended_early_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever its range is: in the last record alone, in the middle of the records, or none. Not behind first yield."""
    for rows in ([row(0.1 * k) for k in range(4)], [row(0.0), row(0.25)], [row(0.01 * k) for k in range(3)]):
        text = best_texts(found(rows, monkeypatch), failed=True)
        top = f"{1e3 * rows[-1].tension_weft_N_per_m:.0f} mN/m"
        assert text.endswith(f"; not known beyond {top}, where the relaxation did not converge")
        assert "not known" not in best_texts(found(rows, monkeypatch))
    yielded = found([row(0.1 * k) for k in range(11)], monkeypatch)
    assert "not known" not in best_texts(yielded, failed=True)


def test_a_larger_load_is_advised_only_below_yield_at_the_grips(monkeypatch: pytest.MonkeyPatch) -> None:
    """B closes in the last record alone, elastic away from the grips: a larger load extends its range, unless the wire yields
    at the grips."""
    for at_grips, advised in ((0.9, True), (1.1, False)):
        rows = [row(0.1 * k) for k in (0, 2, 4, 6.5)]
        for one in rows:
            one.stress_interior_max_Pa = one.stress_max_Pa
        rows[-1].stress_max_Pa = at_grips * LIMIT
        text = table_of(answer_findings(found(rows, monkeypatch), LIMIT))["best tension"]
        assert ("larger load" in text) == advised and ("at the grips the wire yields" in text) != advised


def test_the_margin_is_told_where_the_wire_yields_in_a_snap_through(monkeypatch: pytest.MonkeyPatch) -> None:
    """From 0.6 to 0.8 N/m the mesh snaps through, and the wire yields at 0.7 N/m or at once: at 0.6 N/m or more."""
    rows = [row(0.1 * k) for k in (0, 1, 2, 3, 4, 5, 6, 8, 9)]
    best = (answers := found(rows, monkeypatch, jumps=[(rows[6], rows[7])]))["best"]
    assert [one["tension_weft_N_per_m"] for one in best["next_jump"]] == pytest.approx([0.6, 0.8])
    assert best["first_yield_over_tension"] is None
    times = 0.6 / best["tension_weft_N_per_m"]
    text = table_of(answer_findings(answers, LIMIT))["  margin"]
    assert text.endswith(f"; first yield at 600 to 800 mN/m, a snap-through, {times:.3g} times this tension")


def test_the_margin_is_to_the_next_snap_through_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mesh that snaps through from 0.2 to 0.3 and from 0.5 to 0.6 N/m, whose best tension of the records up to 0.6 N/m is
    between both; with those up to 0.8 N/m it is above them. The wire yields at 0.7 N/m."""
    rows = [row(0.1 * k) for k in range(7)] + [row(tension) for tension in (0.62, 0.64, 0.66, 0.68, 0.699, 0.701, 0.8)]
    jumps = [(rows[2], rows[3]), (rows[5], rows[6])]
    sides = [state_of(one) for one in jumps[1]]
    best, all_rows = found(rows[:7], monkeypatch, jumps=jumps)["best"], found(rows, monkeypatch, jumps=jumps)
    assert 0.3 < best["tension_weft_N_per_m"] < 0.5 and best["next_jump"] == sides
    assert all_rows["best"]["tension_weft_N_per_m"] > 0.6 and all_rows["best"]["next_jump"] is None
    told = [*ahead_texts(state_of(rows[4]), all_rows["first_yield"], sides)]
    assert list(map(quantities, told)) == [["500", "600 mN/m", "1.25"], ["1.75"]]


def test_a_service_tension_that_was_asked_for_is_told_where_it_is_not_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    """A load to 2 N/m that converges up to 0.5 N/m: 2 N/m is not reached, and 3.4 and 4.9 N/m nobody asked for."""
    answers = found([row(0.1 * k) for k in range(6)], monkeypatch, asked=2.0)
    active = {name: text for name, text in table_of(answer_findings(answers, LIMIT, failed=True)).items() if name[:6] == "active"}
    assert [(*quantities(name), *quantities(text)) for name, text in active.items()] == [("2 N/m", "500 mN/m")]
    model, solver = Values(kind="planar", kind_reason="", source="knit", nodes=1), Values(steps=1, wall_s=1.0, compile_s=0.0)
    end = Row(stage="load", yield_stress_Pa=LIMIT, tension_warp_N_per_m=0.0)
    summary = Summary(Values(name="tile"), "diverged", model, solver, stages=(end,), answers=answers)
    assert quantities(table_of(summary_findings(summary))["load not reached"]) == ["500 mN/m", "2 N/m", "10.0 %", "5.0 %"]
    assert "load not reached" not in table_of(summary_findings(replace(summary, stop_reason="steady")))


@pytest.mark.parametrize(("error", "says"), [(1.0, False), (7.0, True), (None, False)])
def test_an_error_of_the_preset_beyond_the_drift_is_told(
    error: float | None, says: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All contacts are active from 0.61 N/m to first yield at 0.7 N/m: the best tension may drift by 6.9 %."""
    text = table_of(answer_findings(found([row(0.01 * k) for k in range(76)], monkeypatch, error=error), LIMIT))
    assert ("  accuracy" in text) == says
    assert not says or quantities(text["  accuracy"])[:1] == ["7 %"]


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
    text = table_of(answer_findings(answers, LIMIT))["heat, 20 to -190 degC"]
    assert quantities(text)[-6:] == ["300 mN/m", "400 mN/m", "6.0 %", "3.0 %", "300 MPa", "400 MPa"]
    for k, one in enumerate(cold):
        one.tension_weft_N_per_m = one.tension_warp_N_per_m = 0.3
        one.strain_weft += 1e-4 * k
    by_tension = [SimpleNamespace(name="cold", by_tension=(True, True))]
    rows = [row(0.3), *cold]
    (held,) = heat_of(rows, by_tension, jumps_in_heat(rows, EXPANSION))
    text = table_of(answer_findings(answers.changed(heat=[held]), LIMIT))
    assert not held["jump"] and "largest" not in text["heat, 20 to -190 degC"]
    assert text["heat, 20 to -190 degC"].startswith("tension held: active")
    # 4e-4 of the mesh as knitted, whose 6 % before it are in its length: 4e-4/1.06, to be compared with the expansion of a metal
    assert {"300 mN/m", "6.0 %", "3.0 %", "+0.038 %", "+0.000 %"} <= set(quantities(text["heat, 20 to -190 degC"]))
    for one in cold[2:]:
        one.strain_weft += 0.05  # 42 K strain free wire by 0.02 %
    cold[3].stress_max_Pa = 500e6
    (jumped,) = heat_of(rows, by_tension, jumps_in_heat(rows, EXPANSION))
    assert jumped["jump"] and jumped.peak == Values(stress_max_Pa=500e6, temperature_K=pytest.approx(293.15 - 4 * 42.0))
    text = table_of(answer_findings(answers.changed(heat=[jumped]), LIMIT))["heat, 20 to -190 degC"]
    assert [one["temperature_K"] for one in jumped["jump_between"]] == pytest.approx([293.15 - 84.0, 293.15 - 126.0])
    jump = "snap-through to another equilibrium between -64 degC and -106 degC, which heat alone does not cause"
    assert f"largest 500 MPa at -148 degC, {jump}: +0.0094 % weft, +0.0000 % warp up to there" in text


def closing_of_cell(out: Path, levels: int, *more: str) -> dict[str, Any]:
    """Where class A of the periodic cell closes, in a run to 8 % strain in both directions."""
    settings = [*QUICK, "load.strain_weft=0.08", "load.strain_warp=0.08", f"output.frames={levels}", *more]
    assert run_scene(load_scene(CELL, settings), out=out, device="cpu").exit_code == 0
    contacts = json.loads((out / "summary.json").read_text(encoding="utf-8"))["answers"]["contacts"]
    assert [one["name"] for one in contacts] == ["A", "B", "C"]
    return dict(contacts[0]["closes"])


@pytest.mark.slow
def test_a_class_that_grazes_in_space_closes_where_it_carries_load(tmp_path: Path) -> None:
    """Contacts C of the atlas touch at 0.01 N/m and open again; from 0.6 N/m on their force grows to that of the others.

    The tension of closing is that between the last record in which C is open and the first in which it bears, in any levels.
    """
    tensions = []
    for levels in (14, 21):
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
    assert answers["best"]["first_yield_over_tension"] is None and answers["best"]["stress_over_limit"] == 0.5
    closes = answers["contacts"][1]["closes"]
    assert closes["jump"] and not closes["resolved"] and not answers["contacts"][0]["closes"]["jump"]
    (point,) = answers["service"]
    assert point["state"] is None and [one["active_percent"] for one in point["jump"]] == [25.0, 100.0]
    text = table_of(answer_findings(answers, LIMIT))
    there = "between 500 mN/m and 600 mN/m, strain 10.0 % weft, 5.0 % warp and 12.0 % weft, 6.0 % warp, a snap-through"
    assert text["  class B"] == f"closes {there} (30 pairs)"
    assert text["first yield"].startswith(f"{there}, in the head of a closed loop")
    assert quantities(text["active at 550 mN/m"]) == ["25.0 %", "100.0 %", "500 mN/m", "600 mN/m"]
    (behind,) = found(rows, monkeypatch, service=rows[6].tension_weft_N_per_m, jumps=[(rows[5], rows[6])])["service"]
    assert behind["active_percent"] == 100.0


def test_the_margin_is_to_yield_away_from_the_grips_at_the_same_temperature(monkeypatch: pytest.MonkeyPatch) -> None:
    """Away from the grips the stress is half of the largest: 0.7 GPa come at 1.4 N/m, past the records to 1 N/m. The best of
    them has up to 1 N/m from the closing of B at 0.61 N/m on: 0.81 N/m, with 405 MPa. Heated at 1 N/m the wire yields too."""
    rows = [row(0.02 * k + 1e-9) for k in range(51)]
    hot = row(1.0, stage="cold", temperature=400.0)
    hot.stress_interior_max_Pa = 2.0 * LIMIT
    for one in rows:
        one.stress_interior_max_Pa = 0.5 * one.stress_max_Pa
    for records in (rows, [*rows, hot]):
        answers = found(records, monkeypatch)
        best = answers["best"]
        assert best["stress_over_limit"] == pytest.approx(0.81 * 0.5 * STRESS / LIMIT, rel=1e-6)
        assert best["first_yield_over_tension"] is None and answers["first_yield"] is not None
        text = table_of(answer_findings(answers, LIMIT))
        assert {"100 %", "405 MPa"} <= set(quantities(text["best tension"]))
        assert quantities(text["  margin"]) == ["58 %", "810 MPa", "700 mN/m"]
        assert best["stress_with_grips_Pa"] == pytest.approx(2.0 * best["stress_max_Pa"])
    rows[-1].stress_interior_max_Pa = 1.5 * LIMIT  # yields between 0.98 and 1 N/m
    text = table_of(answer_findings(found(rows, monkeypatch), LIMIT))
    assert quantities(text["  margin"])[:1] == ["57 %"]
    assert quantities(text["  margin"])[-2:] == ["700 mN/m", "1.25"]


def test_unequal_tensions_are_given_with_their_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    """Warp carries three times the tension of weft: 0.4 N/m is the mean of 0.2 and 0.6 N/m."""
    rows = [row(0.1 * k) for k in range(7)]
    for one in rows:
        one.tension_weft_N_per_m, one.tension_warp_N_per_m = 0.5 * one.tension_weft_N_per_m, 1.5 * one.tension_warp_N_per_m
    text = table_of(answer_findings(found(rows, monkeypatch, service=0.4), LIMIT))
    assert quantities(text["active at 400 mN/m"]) == ["25.0 %", "200 mN/m", "600 mN/m", "8.0 %", "4.0 %"]
    assert {"300 mN/m", "900 mN/m", "+33 %"} <= set(quantities(text["  valid"]))


def test_tensions_that_a_search_leaves_apart_are_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is within 0.2 % of the same target: 300.9 and 300.0 mN/m are 300 mN/m, 303 mN/m is another."""
    for more, shown in ((1.003, "300 mN/m"), (1.01, "300 mN/m weft, 303 mN/m warp")):
        rows = [row(0.1 * k) for k in range(4)]
        for one in rows:
            one.tension_weft_N_per_m, one.tension_warp_N_per_m = 0.1 * rows.index(one), 0.1 * more * rows.index(one)
        assert (
            f"up to {shown}" in table_of(answer_findings(found(rows, monkeypatch), LIMIT))["first yield"].partition(":")[0] + ":"
        )


def test_a_tension_within_the_tolerance_is_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tensions are known to 0.01 EI/C^3 times the residual tolerance, here 10 uN/m: a mesh as knitted has none."""
    monkeypatch.setitem(CLOSES, "A", 0.05)
    rows = [row(0.2 * k) for k in range(4)]
    rows[0].tension_weft_N_per_m, rows[0].tension_warp_N_per_m = -2.45e-6, 8e-6
    answers = found(rows, monkeypatch)
    assert answers["tension_tolerance_N_per_m"] == pytest.approx(1e-5)
    assert quantities(table_of(answer_findings(answers, LIMIT))["  class A"])[:3] == ["200 mN/m", "4.0 %", "2.0 %"]
    rows[1].tension_weft_N_per_m = rows[1].tension_warp_N_per_m = 5e-6
    text = table_of(answer_findings(found(rows[:2], monkeypatch), LIMIT))["  class A"]
    assert quantities(text) == ["0 N/m", "0.0 %", "0.0 %", "4.0 %", "2.0 %", "10"]
