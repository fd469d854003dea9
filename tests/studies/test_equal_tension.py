"""States of equal tension in weft and warp: the largest a map has, and what is said of those without a state."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from reference.in_words import quantities
from reference.map_rows import row
from warpknit.results.row import Row
from warpknit.scene import load_scene
from warpknit.studies.contact_map import MapRow
from warpknit.studies.equal_tension import (
    YIELDED,
    EqualTensionPath,
    branches_at,
    largest_equal_tension,
    service_points,
    unreached_text,
)

SCENES = Path(__file__).parents[2] / "scenes"


def test_an_end_of_the_path_is_told_by_the_wire_first():
    """To 1.2 N/m: under 700 MPa a wire of 600 and 800 MPa would yield, under 900 MPa break; below them the solver is quoted."""
    scene = load_scene(SCENES / "contact_map.toml", ["wire.yield_stress=600 MPa", "wire.tensile_strength=800 MPa"])
    told = {}
    for stress in (5e8, 7e8, 9e8):
        record = SimpleNamespace(tension_weft_N_per_m=1.25, tension_warp_N_per_m=1.15, stress_max_Pa=stress)
        told[stress] = unreached_text(scene, EqualTensionPath(rows=[record], ended="level 0.5 did not converge"), 2.0)
        assert quantities(told[stress])[0] == "1.2 N/m"
    assert "0.5" in quantities(told[5e8]) and "level" not in told[7e8] + told[9e8]
    assert "600 MPa" in quantities(told[7e8])
    assert "800 MPa" in quantities(told[9e8]) and "assumed" not in told[9e8]


@pytest.mark.parametrize(
    ("tensions", "ended", "is_jump", "why"),
    [
        ((1.0, 3.4), "level 0.5 did not converge", False, "the relaxation did not converge beyond 3.4 N/m"),
        ((1.0, 8.0), "", False, "the relaxation did not converge there"),  # its stage was missed, the next one was not
        ((), "level 0 did not converge", False, "the mesh as knitted did not converge"),
        ((), "", False, "no strains of equal tension in the map"),
        ((1.0, 3.4), YIELDED, False, YIELDED),
        ((1.0, 8.0), YIELDED, False, "the relaxation did not converge there"),  # first yield is beyond 4.9 N/m
        ((1.0, 8.0), YIELDED, True, "skipped by a snap-through"),
        ((1.0, 4.8), "", False, "not reached, up to 4.8 N/m"),
    ],
)
def test_a_service_tension_without_a_state_says_why(tensions, ended, is_jump, why):
    rows = [SimpleNamespace(tension_weft_N_per_m=one, tension_warp_N_per_m=one) for one in tensions]
    jumps = [(rows[0], rows[1])] if is_jump else []
    scene = load_scene(SCENES / "contact_map.toml")
    points = service_points(scene, EqualTensionPath(rows=rows, ended=ended), jumps, None, None)
    assert {point.tension: point.why for point in points}[4.9] == why


def test_the_largest_equal_tension_of_a_bilinear_map():
    """Weft tension 10 x + 2 y + 100 x y, warp tension 20 y: alike along x = 18 y/(10 + 100 y), up to 4 N/m at the edge."""
    places = [(x, y) for x in (0.0, 0.1, 0.2) for y in (0.0, 0.1, 0.2)]
    rows = [row(x, y, (10 * x + 2 * y + 100 * x * y, 20 * y)) for x, y in places]
    assert largest_equal_tension(rows) == pytest.approx(4.0, rel=1e-3)


def test_a_mesh_that_is_always_stiffer_one_way_carries_no_tension_alike():
    rows = [row(x, y, (1.0 + x, 2.0 + y)) for x in (0.0, 0.1) for y in (0.0, 0.1)]
    assert largest_equal_tension(rows) == 0.0


def test_unknown_states_carry_nothing():
    rows = [row(x, y, (None, None)) for x in (0.0, 0.1) for y in (0.0, 0.1)]
    assert largest_equal_tension(rows) == 0.0


def state(strain: float, stress: float, active: float = 50.0, **more) -> Row:
    return Row(strain_weft=strain, strain_warp=0.059, active_percent=active, stress_max_Pa=stress, stage="equal tension", **more)


@pytest.mark.parametrize(("stress", "strain", "same"), [(364e6, 0.076, True), (370e6, 0.077, True), (306e6, 0.0755, False),
                                                        (364e6, 0.072, False)])  # fmt: skip
def test_a_card_in_another_equilibrium_than_the_path_is_told(stress, strain, same) -> None:
    """The state of a card is found to a smaller tolerance from that of the path; beside a jump it may leave it."""
    row, card = state(0.076, 364e6), SimpleNamespace(row=state(strain, stress))
    scene = load_scene(SCENES / "contact_map.toml", ["wire.yield_stress=2 GPa"])
    points = service_points(scene, EqualTensionPath(at={2.0: row}), [], 2.0, card)
    (point,) = (each for each in points if each.tension == 2.0)
    assert point.resolved == same and point.row.stress_max_Pa == stress
    assert same == (point.texts[2] == f"{1e-6 * stress:.0f} MPa")
    told = branches_at(2.0, row, (), card)
    assert same == (told == "") and (same or ("364 MPa" in quantities(told) and f"{1e-6 * stress:.0f} MPa on the card" in told))


def test_two_equilibria_of_a_page_at_one_tension_are_told() -> None:
    """A map has 11.6 / 9.5 % and 50 % at 4 N/m, the path 6.2 / 10.0 % and 66.7 %: both, with the place that shows it."""
    target = dict.fromkeys(("target_tension_weft_N_per_m", "target_tension_warp_N_per_m"), 4.0)
    cell = MapRow(strain_weft=0.116, strain_warp=0.095, active_percent=50.0, stress_max_Pa=6e8, stop_reason="steady", variants=1)
    vars(cell).update(target)
    row = Row(strain_weft=0.062, strain_warp=0.1, active_percent=200.0 / 3.0, stress_max_Pa=5.9e8)
    mine, theirs = (
        "strain 6.2 % weft, 10.0 % warp, 66.7 % active, 590 MPa",
        "strain 11.6 % weft, 9.5 % warp, 50.0 % active, 600 MPa in the map.",
    )
    begin = "The mesh has two equilibria at 4 N/m: "
    assert branches_at(4.0, row, [cell]) == f"{begin}{mine} under equal tensions; {theirs}"
    card = SimpleNamespace(row=row)
    assert branches_at(4.0, row, [cell], card) == f"{begin}{mine} on the card and under equal tensions; {theirs}"
    assert branches_at(4.0, None, [cell], card) == f"{begin}{mine} on the card; {theirs}"
    assert branches_at(4.0, Row(**vars(cell)), [cell]) == "" and branches_at(3.0, row, [cell]) == ""
    of_several = MapRow(**{**vars(cell), "variants": 3})
    assert branches_at(4.0, row, [of_several]) == "", "a mean over meshes is no equilibrium"
