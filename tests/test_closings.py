"""Where classes of contact close, and what is active at a service tension."""

import numpy as np
import pytest

from reference.in_words import quantities, table_of
from reference.two_classes import CLOSES, LIMIT, SLOPE, STRAIN, found, row
from warpknit.runner.answers import class_answer
from warpknit.runner.answers_table import answer_findings
from warpknit.runner.branches import Rows


@pytest.mark.parametrize(("levels", "is_known"), [(100, True), (50, True), (49, False), (10, False)])
def test_a_closing_is_the_record_behind_it(levels: int, is_known: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A closes at 0.23 N/m, 23 % of the load: it is the first record beyond. Its place is known to 2 % of the load or not."""
    answers = found([row(k / levels) for k in range(levels + 1)], monkeypatch)
    closes = answers["contacts"][0]["closes"]
    low, high = (one["tension_weft_N_per_m"] for one in closes["between"])
    assert low <= CLOSES["A"] < high == closes["tension_weft_N_per_m"]
    assert closes["resolved"] == is_known
    text = table_of(answer_findings(answers, LIMIT))["  class A"]
    assert (quantities(text)[:6] == ["200 mN/m", "300 mN/m", "4.0 %", "2.0 %", "6.0 %", "3.0 %"]) == (levels == 10)
    assert (quantities(text)[:4] == ["240 mN/m", "4.8 %", "2.4 %", "10"]) == (levels in (50, 100))


@pytest.mark.parametrize(("tension", "share"), [(0.1, 0.0), (0.25, None), (0.35, 25.0), (0.65, None), (0.75, 100.0)])
def test_a_share_between_two_records_is_theirs_or_unknown(
    tension: float, share: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A closes between 0.2 and 0.3 N/m, B between 0.6 and 0.7 N/m; 10 of 40 pairs, then all."""
    answers = found([row(0.1 * k) for k in range(11)], monkeypatch, service=tension)
    (point,) = answers["service"]
    assert point["active_percent"] == share and point["resolved"] == (share is not None)
    assert point["state"]["strain_weft"] == pytest.approx(STRAIN * tension)
    if tension == 0.25:
        text = table_of(answer_findings(answers, LIMIT))["active at 250 mN/m"]
        assert quantities(text) == ["0.0 %", "25.0 %", "200 mN/m", "300 mN/m"]


def test_each_stage_that_passes_the_service_tension_has_its_share(monkeypatch: pytest.MonkeyPatch) -> None:
    """On unloading to 0.4 N/m B is held closed: 100 % there, and 25 % on loading. The last record misses 0.4 N/m by half of the
    error of its search. Holding it while the mesh cools is no other branch."""
    rows = [row(0.1 * k) for k in range(9)] + [row(tension, stage="unload") for tension in (0.7, 0.6, 0.5, 0.3996)]
    for one in rows[9:]:
        one.force_B_N, one.active_B_percent, one.active_percent = SLOPE, 100.0, 100.0
    held = [row(0.3996, stage="cold", temperature=kelvin) for kelvin in (250.0, 200.0)]
    for records in (rows, [*rows, *held]):
        answers = found(records, monkeypatch, service=0.4)
        assert [(one["stage"], one["active_percent"]) for one in answers["service"]] == [("load", 25.0), ("unload", 100.0)]
        texts = [line.text for line in answer_findings(answers, LIMIT) if line.name == "active at 400 mN/m"]
        assert texts == [
            f"{share} %, strain 8.0 % weft, 4.0 % warp, in '{stage}'" for share, stage in (("25.0", "load"), ("100.0", "unload"))
        ]


@pytest.mark.parametrize("opens", [False, True])
def test_contacts_that_open_on_unloading_leave_the_share_unknown(opens: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """B opens between the records at 0.6 and 0.4 N/m on unloading, on both sides of 0.5 N/m, or not at all."""
    rows = [row(0.1 * k) for k in range(9)] + [row(tension, stage="unload") for tension in (0.6, 0.4, 0.3)]
    for one in rows[9:10] if opens else rows[9:]:
        one.force_B_N, one.active_B_percent, one.active_percent = SLOPE, 100.0, 100.0
    answers = found(rows, monkeypatch, service=0.5)
    point = answers["service"][1]
    assert point["resolved"] != opens and point["active_percent"] == (None if opens else 100.0)
    if opens:
        assert [one["active_percent"] for one in point["between"]] == [100.0, 25.0]


@pytest.mark.parametrize(("missed", "is_known"), [(1e-3, True), (0.02, False)])
def test_a_search_that_misses_the_service_tension_by_its_error_has_its_share(
    missed: float, is_known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The last record of a run to 0.7 N/m carries a little less."""
    rows = [row((1.0 - missed) * 0.1 * k) for k in range(8)]
    (point,) = found(rows, monkeypatch, service=0.7)["service"]
    assert point["active_percent"] == (pytest.approx(100.0) if is_known else None)
    assert (point["state"] is not None) == is_known


def test_a_compressed_mesh_has_no_service_state(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mean tension of 0.3 N/m of 0.7 and -0.1 N/m is not a mesh in tension."""
    rows = [row(0.1 * k) for k in range(6)]
    for one in rows:
        one.tension_weft_N_per_m, one.tension_warp_N_per_m = one.tension_weft_N_per_m + 0.4, one.tension_warp_N_per_m - 0.4
    answers = found(rows, monkeypatch, service=0.3)
    assert answers["service"][0]["state"] is None
    assert table_of(answer_findings(answers, LIMIT))["active at 300 mN/m"].startswith("compressed in weft or warp")


def test_what_closes_under_a_held_tension_is_told_by_the_temperature(monkeypatch: pytest.MonkeyPatch) -> None:
    """B closes on cooling by 40 K at 0.5 N/m, and opens again on the next 40 K."""
    rows = [row(0.1 * k) for k in range(6)] + [row(0.5) for _ in range(2)]
    for k, one in enumerate(rows[5:]):
        one.temperature_K, one.stage, one.load_factor = 293.15 - 40.0 * k, "cold", 0.5 * k
    for one in rows[:5]:
        one.temperature_K = 293.15
    rows[6].force_B_N, rows[6].active_B_percent = 1e-3, 100.0
    closes = table_of(answer_findings(found(rows, monkeypatch), LIMIT))["  class B"]
    assert quantities(closes)[:3] == ["20 degC", "-20 degC", "500 mN/m"] and {"500 mN/m", "-60 degC"} <= set(quantities(closes))


def test_a_class_that_opens_again_is_said_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """A carries force from 0.23 to 0.3 N/m alone: its closing is there, and the record in which it is open again is given."""
    rows = [row(0.1 * k) for k in range(6)]
    for one in rows[4:]:
        one.force_A_N, one.active_A_percent = 0.0, 0.0
    answers = found(rows, monkeypatch)
    assert answers["contacts"][0]["closes"]["opens"]["tension_weft_N_per_m"] == pytest.approx(0.4)
    assert "400 mN/m" in quantities(table_of(answer_findings(answers, LIMIT))["  class A"])


def test_a_class_that_opened_again_has_its_ranges(monkeypatch: pytest.MonkeyPatch) -> None:
    """A is held at 50 % from 0.05 to 0.15 N/m, and closed from 0.23 N/m on, then open on unloading below 0.23 N/m: two ranges.
    B closes and opens once: one range."""
    rows = [row(0.05 * k) for k in range(15)] + [row(0.05 * k, stage="cold") for k in range(13, 1, -1)]
    for one in rows[1:4]:
        one.force_A_N, one.active_A_percent = 1e-9, 50.0
    answers = found(rows, monkeypatch)
    ranges = {one["name"]: one["closed"] for one in answers["contacts"]}
    ends = [[one[side]["tension_weft_N_per_m"] for side in ("from", "to")] for one in ranges["A"]]
    assert np.array(ends) == pytest.approx(np.array([[0.05, 0.15], [0.25, 0.25]]))
    assert [one["to"]["stage"] for one in ranges["A"]] == ["load", "cold"] and not any(one["lasts"] for one in ranges["A"])
    assert [one["closed_percent"] for one in ranges["A"]] == [50.0, 100.0] and len(ranges["B"]) == 1
    text = table_of(answer_findings(answers, LIMIT))
    assert "200 mN/m" in quantities(text["  class A"])
    assert "also closed from 50 mN/m to 150 mN/m" in text["  class A"]
    assert "600 mN/m" in quantities(text["  class B"])
    alone = table_of(answer_findings(found(rows[:15], monkeypatch), LIMIT))["  class A"]
    assert quantities(alone) == ["200 mN/m", "250 mN/m", "4.0 %", "2.0 %", "5.0 %", "2.5 %", "50 mN/m", "150 mN/m", "10"]


def test_a_graze_is_not_the_closing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A carries 1 nN at 0.1 N/m and opens again: it closes at 0.23 N/m all the same."""
    rows = [row(0.02 * k) for k in range(26)]
    rows[5].force_A_N, rows[2].active_A_percent = 1e-9, 50.0
    answers = found(rows, monkeypatch)
    closes = answers["contacts"][0]["closes"]
    assert closes["tension_weft_N_per_m"] == pytest.approx(0.24)
    assert closes["first_touch"]["tension_weft_N_per_m"] == pytest.approx(0.1)
    text = table_of(answer_findings(answers, LIMIT))["  class A"]
    assert quantities(text) == ["240 mN/m", "4.8 %", "2.4 %", "10"]


def test_a_service_tension_of_the_first_record_is_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mesh that carries 0.3 N/m as knitted, asked for 0.2 N/m: its state is the first record, with class A."""
    (point,) = found([row(0.3 + 0.1 * k) for k in range(4)], monkeypatch, service=0.2)["service"]
    assert point["state"]["tension_weft_N_per_m"] == 0.3
    assert point["active_percent"] == pytest.approx(25.0)


def test_a_closing_elsewhere_on_the_path_leaves_a_service_tension_known(monkeypatch: pytest.MonkeyPatch) -> None:
    """The mesh jumps back from 0.5 to 0.15 N/m; behind, B closes somewhere between 0.25 and 0.35 N/m. 0.31 N/m is reached
    first on the way to 0.5 N/m, where nothing closes."""
    rows = [row(0.1 * k) for k in range(6)] + [row(0.15 + 0.1 * k) for k in range(4)]
    for k, one in enumerate(rows):
        one.force_B_N, one.active_B_percent, one.load_factor = (SLOPE if k > 7 else 0.0), 100.0 * (k > 7), 0.1 * k
        one.active_percent = 0.25 * one.active_A_percent + 0.75 * one.active_B_percent
    answers = found(rows, monkeypatch, service=0.31, jumps=[(rows[5], rows[6])])
    closes = answers["contacts"][1]["closes"]
    assert not closes["resolved"]
    assert [one["tension_weft_N_per_m"] for one in closes["between"]] == pytest.approx([0.25, 0.35])
    assert answers["service"][0]["resolved"]
    assert not found(rows[6:], monkeypatch, service=0.31)["service"][0]["resolved"]


def test_a_closing_below_first_yield_is_told_before_one_beyond(monkeypatch: pytest.MonkeyPatch) -> None:
    """A is closed from 0.23 N/m up to first yield at 0.7 N/m, open in the record at 0.8 N/m, and closed again at the end."""
    rows = [row(0.1 * k) for k in range(11)]
    rows[8].force_A_N = rows[8].active_A_percent = 0.0
    answers = found(rows, monkeypatch)
    closes = answers["contacts"][0]["closes"]
    assert closes["tension_weft_N_per_m"] == pytest.approx(0.3) and closes["first_touch"] is None
    assert closes["opens"]["tension_weft_N_per_m"] == pytest.approx(0.8)
    text = table_of(answer_findings(answers, LIMIT))["  class A"]
    assert quantities(text)[:2] == ["200 mN/m", "300 mN/m"] and "800 mN/m" in quantities(text)


def test_a_service_tension_is_that_of_the_load_and_not_of_heat_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search of the load ends a hair below 0.4 N/m, and the mesh is held there a hair above it while B closes by heat."""
    rows = [row(0.1 * k) for k in range(4)] + [row(0.39996)]
    rows += [row(0.40004, stage="cold", temperature=kelvin) for kelvin in (250.0, 200.0)]
    for one in rows[5:]:
        one.force_B_N, one.active_B_percent, one.active_percent = SLOPE, 100.0, 100.0
    (point,) = found(rows, monkeypatch, service=0.4)["service"]
    assert (point["stage"], point["active_percent"]) == ("load", 25.0) and point["state"]["temperature_K"] == 293.15


def test_a_class_that_closes_again_leaves_the_share_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    """B closes at 0.61 N/m on loading, is open once unloaded, and closes again between the records at 0.5 and 0.68 N/m: the share
    at 0.63 N/m is known on loading, and unknown when the mesh is loaded again."""
    rows = [row(0.01 * k) for k in range(75)] + [row(tension, stage="off") for tension in (0.4, 0.1)]
    rows += [row(tension, stage="again") for tension in (0.5, 0.68)]
    service = {one["stage"]: one for one in found(rows, monkeypatch, service=0.63)["service"]}
    assert service["load"]["active_percent"] == 100.0 and service["load"]["resolved"]
    assert service["again"]["active_percent"] is None and not service["again"]["resolved"]
    assert [one["active_percent"] for one in service["again"]["between"]] == [25.0, 100.0]


def test_a_closing_stays_that_of_the_loading() -> None:
    """Unloaded to 0 and loaded again, A opens and closes once more; the closing is that of the first stage."""
    rows = [row(0.1 * k) for k in range(6)]
    rows += [row(0.5 - 0.1 * k, stage="unload") for k in range(1, 6)] + [row(0.1 * k, stage="again") for k in range(1, 6)]
    closes = class_answer(Rows(rows), "A", 10, 1e-12).closes
    assert closes is not None and closes["stage"] == "load" and closes["first_touch"] is None
    assert closes["tension_weft_N_per_m"] == pytest.approx(0.3)
