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
from warpknit.runner.answers import answers_of, closing
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


def found(rows: list[Row], monkeypatch: pytest.MonkeyPatch, service: float | None = None) -> dict[str, Any]:
    """The answers from rows of such a mesh."""
    scene = SimpleNamespace(hook=None, wire=SimpleNamespace(yield_stress=LIMIT), output=SimpleNamespace(service_tension=service))
    monkeypatch.setattr(module, "classes_of", lambda _: [ContactClass("A", 10), ContactClass("B", 30)])
    monkeypatch.setattr(module.measure, "active_threshold", lambda _: 1e-12)
    monkeypatch.setattr(module.measure, "least_force", lambda _: 1e-12)
    answers = answers_of(SimpleNamespace(scene=scene), rows)
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
    assert text["first yield at"].startswith("not up to 500 mN/m: 500 MPa, 71% of the limit, in the head of a closed loop")
    assert text["active at 2 N/m"] == "not reached; up to 500 mN/m"
    assert "end of the stage" in text["  may drift"]


def test_a_last_record_gives_a_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """One record behind a closing cannot give its place: the records on both sides are given."""
    rows = [row(0.1 * k) for k in range(4)]  # A closes at 0.23 between the last two
    closes = closing(rows, "A", 1e-12, 1e-12)
    assert closes is not None and not closes["resolved"]
    assert [state["tension_weft_N_per_m"] for state in closes["between"]] == pytest.approx([0.2, 0.3])
    text = dict(answer_rows(found(rows, monkeypatch, service=0.25), LIMIT))
    assert text["contacts A close at"].startswith("between 200 mN/m and 300 mN/m")
    assert text["active at 250 mN/m"].endswith("more output.frames tell which")


def test_heat_is_told_stage_by_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stage that cools the mesh from 20 to -190 degC while its tension rises from 0.3 to 0.4 N/m."""
    cold = [row(0.3 + 0.02 * k, stage="cold", temperature=293.15 - 42.0 * k) for k in range(1, 6)]
    answers = found([row(0.1 * k) for k in range(4)] + cold, monkeypatch)
    (stage,) = answers["heat"]
    assert stage["stage"] == "cold"
    assert stage["temperature_K"] == pytest.approx([293.15, 83.15])
    assert stage["tension_weft_N_per_m"] == pytest.approx([0.3, 0.4])
    assert "heat, 20 to -190 degC" in dict(answer_rows(answers, LIMIT))


def closing_of_cell(out: Path, levels: int, *more: str) -> dict[str, Any]:
    """Where class A of the periodic cell closes, in a run to 8 % strain in both directions."""
    settings = [*QUICK, "load.strain_weft=0.08", "load.strain_warp=0.08", f"output.frames={levels}", *more]
    assert run_scene(load_scene(CELL, settings), out=out, device="cpu").exit_code == 0
    contacts = json.loads((out / "summary.json").read_text(encoding="utf-8"))["answers"]["contacts"]
    assert [one["name"] for one in contacts] == ["A", "B", "C"]
    return dict(contacts[0]["closes"])


def test_the_tension_of_touch_is_that_of_a_run_in_small_levels(tmp_path: Path) -> None:
    """Interpolated in levels of 1 % strain, against the record in which the class closes in levels of 0.1 %.

    The records of the small levels bound the strain of the closing; the coarse one agrees to the curvature of the force in
    two of its levels, here a tenth of a level.
    """
    coarse, fine = closing_of_cell(tmp_path / "coarse", 8), closing_of_cell(tmp_path / "fine", 80)
    low, high = (state["strain_weft"] for state in fine["between"])
    assert high - low == pytest.approx(0.001, rel=1e-3)
    assert low - 0.001 < coarse["strain_weft"] < high + 0.001
    rows = read_history(tmp_path / "fine" / "history.csv")
    tension = np.interp(coarse["strain_weft"], [r.strain_weft for r in rows], [r.tension_warp_N_per_m for r in rows])
    assert coarse["tension_warp_N_per_m"] == pytest.approx(tension, rel=0.05)


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
