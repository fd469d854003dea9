"""Which tension is best, and how far it may drift."""

import pytest

from reference.in_words import quantities, table_of
from reference.two_classes import CLOSES, LIMIT, SLOPE, found, row
from warpknit.runner.answers_table import answer_findings


def test_what_one_record_shows_is_not_the_best_tension(monkeypatch: pytest.MonkeyPatch) -> None:
    """All contacts are active at 0.2 N/m alone, and half of them from 0.3 N/m on: best is the range of the half."""
    rows = [row(0.1 * k) for k in range(7)]
    for k, one in enumerate(rows):
        one.force_A_N = one.force_B_N = 0.0
        one.active_percent = one.active_A_percent = one.active_B_percent = 100.0 if k == 2 else 50.0 * (k > 2)
    best = found(rows, monkeypatch)["best"]
    assert best["high"]["tension_weft_N_per_m"] == pytest.approx(0.6)
    assert best["active_percent"] == pytest.approx(50.0) and best["tension_weft_N_per_m"] > 0.3


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
    text = table_of(answer_findings(found(rows, monkeypatch, jumps=[(rows[3], rows[4]), (rows[5], rows[6])]), LIMIT))["  valid"]
    assert quantities(text) == ["400 mN/m", "-20 %", "300 mN/m", "600 mN/m", "+20 %", "500 mN/m", "600 mN/m"]


def test_both_ends_of_a_range_of_drift_are_told_where_they_are_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of all contacts close somewhere from 0.2 to 0.3 N/m, and open by a jump from 0.5 to 0.6 N/m: no place is known."""
    rows = [row(0.1 * k) for k in range(7)]
    for k, one in enumerate(rows):
        one.force_A_N = one.force_B_N = 0.0
        one.active_percent = one.active_A_percent = one.active_B_percent = 100.0 if 2 < k < 6 else 50.0
    answers = found(rows, monkeypatch, jumps=[(rows[5], rows[6])])
    best = answers["best"]
    sides = {end: [one["tension_weft_N_per_m"] for one in best[f"{end}_between"]] for end in ("low", "high")}
    assert sides == {"low": pytest.approx([0.2, 0.3]), "high": pytest.approx([0.5, 0.6])}
    assert (best["low_jump"], best["high_jump"], best["jumps"]) == (False, True, [])
    text = table_of(answer_findings(answers, LIMIT))["  valid"]
    assert text == "from 300 mN/m (-25 %; 200 mN/m is outside) to 500 mN/m (+25 %; 600 mN/m is outside, a snap-through)"


def test_a_range_goes_on_in_the_next_stage_that_loads(monkeypatch: pytest.MonkeyPatch) -> None:
    """All contacts are active from 0.61 N/m to first yield at 0.7 N/m, and a second stage begins at 0.65 N/m: both together have
    the range, as one stage has."""
    tensions = [0.01 * k + 0.005 for k in range(80)]
    one, two = ([row(t, stage="more" if split and t > 0.651 else "load") for t in tensions] for split in (False, True))
    whole, staged = (found(rows, monkeypatch)["best"] for rows in (one, two))
    assert whole["low"]["tension_weft_N_per_m"] == pytest.approx(0.615) and whole["stages"] == 1
    assert staged.changed(stage="load", stages=1) == whole
    assert (staged["stage"], staged["stages"]) == ("more", 2)
    text = table_of(answer_findings(found(two, monkeypatch), LIMIT))["best tension"]
    assert " in 'more': " in text


def test_the_widest_range_of_all_stages_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Loaded up to 0.65 N/m, all contacts are active from 0.61 N/m on; unloaded, they are so down to 0.3 N/m. A stage that cools
    keeps them over a wider range yet, but at no one temperature."""
    rows = [row(0.05 * k) for k in range(14)]
    for k in range(12, -1, -1):
        rows.append(row(0.05 * k, stage="unload"))
        rows[-1].force_A_N = rows[-1].force_B_N = SLOPE * (k > 5)
        rows[-1].active_percent = rows[-1].active_A_percent = rows[-1].active_B_percent = 100.0 * (k > 5)
    for k in range(14):
        rows.append(row(0.05 * k, stage="cold", temperature=293.15 - 10.0 * k))
        rows[-1].active_percent = rows[-1].active_A_percent = rows[-1].active_B_percent = 100.0
        rows[-1].force_A_N = rows[-1].force_B_N = SLOPE
    best = found(rows, monkeypatch)["best"]
    assert (best["stage"], best["stages"], best["active_percent"]) == ("unload", 3, 100.0)
    assert best["low"]["tension_weft_N_per_m"] == pytest.approx(0.3) and best["high"]["tension_weft_N_per_m"] == pytest.approx(
        0.65
    )


def test_the_best_tension_is_in_the_widest_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """All contacts are active in one record at 0.2 N/m, by a graze, and from the closing of B to first yield at 0.7 N/m."""
    rows = [row(0.025 * k) for k in range(41)]
    rows[8].active_percent = rows[8].active_A_percent = rows[8].active_B_percent = 100.0
    best = found(rows, monkeypatch)["best"]
    assert best["low"]["tension_weft_N_per_m"] == pytest.approx(0.625)
    assert best["high"]["tension_weft_N_per_m"] == pytest.approx(0.675 if rows[28].stress_max_Pa > LIMIT else 0.7)
    assert best["tension_weft_N_per_m"] == pytest.approx(0.5 * sum(best[end]["tension_weft_N_per_m"] for end in ("low", "high")))


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
    """First yield is at 0.7 N/m. The mesh jumps back from 0.9 to 0.45 N/m and is loaded on, below the limit and with B open."""
    rows = [row(0.02 * k) for k in range(46)]
    behind = [row(0.45 + 0.1 * k) for k in range(10)]
    for one in behind:
        one.stress_max_Pa, one.force_B_N, one.active_B_percent, one.active_percent = 0.5 * LIMIT, 0.0, 0.0, 25.0
    best = found(rows, monkeypatch)["best"]
    assert [best[end]["tension_weft_N_per_m"] for end in ("low", "high")] == pytest.approx([0.62, 0.68])
    assert found(rows + behind, monkeypatch, jumps=[(rows[-1], behind[0])])["best"] == best


def test_a_range_goes_along_the_load_and_not_over_other_states_of_its_tensions(monkeypatch: pytest.MonkeyPatch) -> None:
    """The mesh jumps back from 0.5 to 0.25 N/m, where all contacts close: they are active from there to 0.65 N/m."""
    rows = [row(0.1 * k) for k in range(6)] + [row(0.25 + 0.1 * k) for k in range(5)]
    for one in rows[6:]:
        one.active_percent = one.active_A_percent = one.active_B_percent = 100.0
    best = found(rows, monkeypatch, jumps=[(rows[5], rows[6])])["best"]
    assert [best[end]["tension_weft_N_per_m"] for end in ("low", "high")] == pytest.approx([0.25, 0.65])
    assert best["active_percent"] == 100.0 and best["open_high"] and not best["open_low"]


def test_one_record_between_jumps_is_not_the_best_tension(monkeypatch: pytest.MonkeyPatch) -> None:
    """All contacts are active in one elastic record, which the mesh reaches by a jump and leaves by one for a state beyond the
    limit: best is the range of A before, of 25 %, in which this record lies too."""
    monkeypatch.setitem(CLOSES, "A", 0.15)
    rows = [row(0.1 * k) for k in range(7)]
    rows[6].stress_max_Pa = 2.0 * LIMIT
    for one in rows[5:]:
        one.active_percent = one.active_A_percent = one.active_B_percent = 100.0
    best = found(rows, monkeypatch, jumps=[(rows[4], rows[5]), (rows[5], rows[6])])["best"]
    assert [best[end]["tension_weft_N_per_m"] for end in ("low", "high")] == pytest.approx([0.2, 0.5])
    assert best["active_percent"] == 25.0 and len(best["jumps"]) == 1 and best["high_jump"]


def test_a_range_of_one_record_is_called_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between two jumps one record has contacts, no other has any, and the wire yields at the next one."""
    rows = [row(0.1 * k) for k in range(6)]
    rows[5].stress_max_Pa = 2.0 * LIMIT
    for k, one in enumerate(rows):
        one.active_percent = one.active_A_percent = one.active_B_percent = 100.0 * (k > 3)
    answers = found(rows, monkeypatch, jumps=[(rows[3], rows[4]), (rows[4], rows[5])])
    assert answers["best"]["low"] == answers["best"]["high"]
    assert table_of(answer_findings(answers, LIMIT))["best tension"].endswith("valid in one record only")


def test_stresses_at_the_grips_do_not_decide_which_tension_is_best(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wires at the grips carry three times the stress of those inside, and yield at a third of the tension; those inside
    do not yield. A jump is found by its records, whatever their stress."""
    rows = [row(0.1 * k) for k in range(7)]
    at_grips = [row(0.1 * k) for k in range(7)]
    for one in at_grips:
        one.stress_interior_max_Pa, one.stress_max_Pa = one.stress_max_Pa, 3.0 * one.stress_max_Pa
    best, answers = found(rows, monkeypatch)["best"], found(at_grips, monkeypatch, jumps=[(at_grips[3], at_grips[4])])
    with_grips = {"stress_with_grips_Pa": pytest.approx(3.0 * best["stress_with_grips_Pa"])}
    assert found(at_grips, monkeypatch)["best"] == best.changed(**with_grips) and best["active_percent"] == pytest.approx(25.0)
    assert answers["best"]["active_percent"] == pytest.approx(25.0) and answers["best"]["stress_max_Pa"] <= LIMIT
    assert answers["first_yield"]["tension_weft_N_per_m"] == pytest.approx(0.3)  # at 0.233 N/m
    assert answers["first_yield_interior"] is None
    text = table_of(answer_findings(answers, LIMIT))
    assert quantities(text["  away from the grips"]) == ["600 mN/m"] and text["first yield"].startswith(
        "between 200 mN/m and 300 mN/m"
    )


def test_a_tension_that_is_held_while_the_mesh_cools_is_no_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """A is active from 0.23 N/m up to the last record at 0.5 N/m; there the mesh cools, and all contacts close."""
    rows = [row(0.05 * k) for k in range(11)]
    for k in (1, 2, 3):
        rows.append(row(0.5 + 1e-4 * k, stage="cold", temperature=293.15 - 50.0 * k))
        rows[-1].force_B_N, rows[-1].active_B_percent, rows[-1].active_percent = SLOPE, 100.0, 100.0
    best = found(rows, monkeypatch)["best"]
    assert (best["stage"], best["active_percent"]) == ("load", 25.0)
    assert best["low"]["tension_weft_N_per_m"] == pytest.approx(0.25) and best["open_high"]


def test_a_yield_where_the_mesh_is_unloaded_is_no_margin(monkeypatch: pytest.MonkeyPatch) -> None:
    """The wire yields in compression, in a stage that unloads: that is no number of times the best tension."""
    rows = [row(0.1 * k) for k in range(6)] + [row(-0.1 * k, stage="off") for k in range(1, 4)]
    for one, stress in zip(rows[6:], (0.3, 0.6, 1.2), strict=True):
        one.stress_max_Pa = stress * LIMIT
    answers = found(rows, monkeypatch)
    assert answers["first_yield"]["stage"] == "off" and answers["best"]["first_yield_over_tension"] is None
