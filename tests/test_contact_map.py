"""Rows of a contact map: files, means over meshes, the optimum."""

import math

import numpy as np
import pytest

from reference.in_words import quantities
from warpknit.runner.other_model import FIGURES
from warpknit.studies.contact_map import (
    MapRow,
    drift_text,
    find_optimum,
    grid,
    mean_map,
    optimum_warnings,
    read_map,
    unconverged_warning,
    write_map,
)


def row(weft, warp, active=50.0, stress=1e8, tension=(0.1, 0.2), reason="steady", above=0.0) -> MapRow:
    steady = reason == "steady"
    measures = {
        "active_percent": active,
        "tension_weft_N_per_m": tension[0],
        "tension_warp_N_per_m": tension[1],
        "stress_max_Pa": stress,
        "yield_fraction": above,
        "active_bodies_percent": active,
        "active_rhombus_percent": None,
        "contact_force_max_N": 1e-6,
        "stress_interior_max_Pa": stress,
        "slid_max_m": 0.0,
        "residual": 1e-3,
        "dissipated_J": 0.0,
        **dict.fromkeys(("energy_stretch_J", "energy_bend_J", "energy_contact_J"), 1e-9),
        "nominal_weft_N_per_m": tension[0],
        "nominal_warp_N_per_m": tension[1],
    }
    return MapRow(
        strain_weft=weft,
        strain_warp=warp,
        stop_reason=reason,
        variants=int(steady),
        steps=5 if steady else 7,
        message="" if steady else "too fast",
        **dict.fromkeys(f"std_{name}" for name in FIGURES),
        **(measures if steady else dict.fromkeys(measures)),
    )


def test_rows_come_back_to_the_bit_and_blanks_as_none(tmp_path):
    rows = [row(0.1, 1 / 3, active=200 / 3), row(0.2, 0.0, reason="diverged")]
    paths = tmp_path / "map.csv", tmp_path / "details.csv"
    write_map(rows, *paths)
    assert read_map(*paths) == rows
    assert "nan" not in paths[0].read_text().lower()
    header = paths[0].read_text().splitlines()[0]
    assert header == (
        "strain_weft,strain_warp,active_percent,tension_weft_N_per_m,tension_warp_N_per_m,stress_max_Pa,yield_fraction,stop_reason"
    )


def test_the_mean_is_over_meshes_at_rest():
    """Shares 20 and 40: mean 30, standard deviation sqrt(200)."""
    (mean,) = mean_map([[row(0, 0, 20.0, 1e8)], [row(0, 0, 40.0, 3e8)], [row(0, 0, reason="diverged")]])
    assert mean.active_percent == 30.0
    assert mean.stress_max_Pa == 2e8
    assert quantities(mean.stop_reason) == ["2", "3"]
    assert mean.std_active_percent == pytest.approx(math.sqrt(200.0))
    assert (mean.variants, mean.steps, mean.message) == (2, 17, "too fast")


def test_a_grid_is_warp_by_weft_and_unknown_where_there_is_no_row():
    values = grid([row(0.0, 0.0, 1.0), row(0.1, 0.0, 2.0), row(0.0, 0.2, 3.0)], "active_percent", [0.0, 0.1], [0.0, 0.2])
    assert np.array_equal(values, [[1.0, 2.0], [3.0, np.nan]], equal_nan=True)


def square(share, stress) -> list[MapRow]:
    """Rows of 5 x 5 strains from functions of their places."""
    places = [(i, j) for j in range(5) for i in range(5)]
    return [row(0.1 * i, 0.1 * j, float(share(i, j)), float(stress(i, j))) for i, j in places]


def pulled(one: MapRow) -> MapRow:
    """The row with tensions 0.1 N/m above the strains."""
    return one.changed(tension_weft_N_per_m=one.strain_weft + 0.1, tension_warp_N_per_m=one.strain_warp + 0.1)


def test_the_optimum_has_the_most_contacts_below_the_elastic_limit():
    """Contacts and stress both grow with strain: the best cell is the last below the limit."""
    best = find_optimum(square(lambda i, j: 10 * (i + j) + i, lambda i, j: 1e8 * (i + j)), yield_stress=5.5e8)
    assert best is not None
    assert (best.strain_weft, best.strain_warp) == (0.4, 0.1)
    assert best.stress_margin == pytest.approx(0.5 / 5.5)
    assert best.at_edge == ["weft"] and next(optimum_warnings(best, [])).code == "W43"


def test_among_equal_shares_the_optimum_has_equal_neighbours_and_the_least_stress():
    """A plateau from weft 0.1 on: its cell of least stress with all eight neighbours on it is (0.2, 0.1)."""
    best = find_optimum(square(lambda i, j: 60 * (i >= 1), lambda i, j: 1e8 * (1 + i + j)), yield_stress=2e9)
    assert best is not None
    assert (best.strain_weft, best.strain_warp) == (0.2, 0.1)
    assert best.at_edge == []


def test_a_drift_of_the_optimum_ends_where_the_mesh_jumps():
    """All cells are alike, and the mesh jumps at weft 0.3 to 0.4, at every warp: tensions are the strains and 0.1, in N/m."""
    rows = square(lambda i, j: 60, lambda i, j: 1e8)
    rows = list(map(pulled, rows))
    warp = sorted({one.strain_warp for one in rows})
    weft = sorted({one.strain_weft for one in rows})
    best = find_optimum(rows, yield_stress=2e9, jumps=[((weft[3], y), (weft[4], y)) for y in warp])
    assert best is not None
    drift = {one.along: one for one in best.drift}
    assert [len(drift[along].jumps) for along in ("weft", "warp", "both")] == [1, 0, 1]
    assert np.array(drift["weft"].jumps[0])[:, 0] == pytest.approx([0.4, 0.5])
    assert (drift["weft"].high[0], drift["warp"].high[1]) == pytest.approx((0.4, 0.5))
    assert drift_text(drift["weft"]).count("; beyond it a snap-through between 400 mN/m weft, ") == 1


def test_a_drift_beside_a_pair_that_did_not_converge_is_at_least_that_far():
    """The optimum is in the middle of a plateau of three cells in weft, beside cells that diverged."""
    rows = square(lambda i, j: 60 * (1 <= j <= 3), lambda i, j: 1e8)
    failed = {"stop_reason": "diverged", "active_percent": None}
    rows = [pulled(one).changed(**(failed if one.strain_weft in (0.0, 0.4) else {})) for one in rows]
    best = find_optimum(rows, yield_stress=2e9)
    assert best is not None
    weft, warp, _ = best.drift
    text = drift_text(weft)
    assert quantities(text)[:3] == ["200 mN/m", "300 mN/m", "400 mN/m"]
    assert "converge" not in drift_text(warp)
    assert quantities(drift_text(warp.changed(open_low=True)))[:2] == ["300 mN/m", "200 mN/m"]
    (said,) = unconverged_warning(rows, by_tension=False)
    assert said.code == "W39" and quantities(said.text)[:2] == ["10", "25"]


@pytest.mark.parametrize(
    "rows",
    [
        [row(0.1, 0.1, stress=3e9)],  # beyond the limit
        [row(0.1, 0.1, active=0.0)],  # nothing touches
        [row(0.1, 0.1, tension=(0.1, -0.1))],  # not tensile
        [row(0.1, 0.1, reason="diverged")],
        mean_map([[row(0.1, 0.1)], [row(0.1, 0.1, reason="diverged")]]),  # not at rest for all meshes
    ],
)
def test_there_may_be_no_optimum(rows):
    assert find_optimum(rows, yield_stress=2e9) is None
