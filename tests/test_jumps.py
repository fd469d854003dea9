"""Jumps between equilibria: one rule for the levels of a run and the cells of a map."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.collections import LineCollection

from reference.in_words import ChangingRow as Row
from reference.in_words import in_words, quantities
from warpknit.export.map_figure import Marks, map_figure
from warpknit.measure.jumps import UNBALANCED, energy_gap, jumps, stands_out
from warpknit.results.row import Values
from warpknit.runner import warnings_of as warnings
from warpknit.runner.answers import heat_of
from warpknit.runner.branches import jumps_of, with_work, work_steps
from warpknit.runner.history import missing_steps, missing_work
from warpknit.scene import make_scene
from warpknit.studies.contact_map import MapRow, MapSummary, find_jumps, jump_warning, map_table

STEPS = np.linspace(0.0, 0.5, 6)
AREA = 2e-6  # [m2] of the mesh
MODULUS = 100.0  # [N/m]
SECOND = 3  # first level on the second branch


def energy_of(strain: np.ndarray, modulus: float) -> np.ndarray:
    """[J] of a bar whose tension grows as modulus x strain: area modulus strain^2/2."""
    return 0.5 * AREA * modulus * strain**2


def model() -> SimpleNamespace:
    scene = make_scene({"knit": {"bars": [{"chain": "1-0/1-2"}], "wale_spacing": "1 mm", "course_spacing": "1 mm"}})
    panel = SimpleNamespace(area=AREA, node_count=scene.model.nodes_per_loop)
    return SimpleNamespace(scene=scene, panel=panel, bending_stiffness=scene.wire.bending_stiffness)


def cells(softer: float) -> list[MapRow]:
    """A map over STEPS squared; from the weft strain SECOND on, its mesh is on a branch with `softer` times the modulus."""

    def cell(weft: float, warp: float) -> MapRow:
        modulus = MODULUS * (softer if weft >= STEPS[SECOND] else 1.0)
        return MapRow(
            strain_weft=weft, strain_warp=warp, active_percent=50.0 * (weft >= STEPS[SECOND]),
            tension_weft_N_per_m=modulus * weft, tension_warp_N_per_m=modulus * warp,
            nominal_weft_N_per_m=modulus * weft, nominal_warp_N_per_m=modulus * warp,
            energy_stretch_J=energy_of(weft, modulus) + energy_of(warp, modulus), energy_bend_J=0.0, energy_contact_J=0.0,
        )  # fmt: skip

    return [cell(x, y) for y in STEPS.tolist() for x in STEPS.tolist()]


def test_energy_follows_work_along_a_branch():
    """E = f x/2: at any step the change lies between f_a dx and f_b dx. From 0.2 to 0.3 with half the modulus, it does not."""
    force = np.where(np.arange(6) < SECOND, 1.0, 0.5) * STEPS
    assert energy_gap(STEPS[:, None], STEPS[:, None], 0.5 * STEPS**2) == pytest.approx(0.0)
    gap = energy_gap(force[:, None], STEPS[:, None], 0.5 * force * STEPS)
    assert gap == pytest.approx([0.0, 0.0, 0.015 - 0.0025, 0.0, 0.0])  # change 0.0225 - 0.02, least work 0.15 x 0.1


@pytest.mark.parametrize(
    ("value", "where"),
    [
        ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0], []),
        ([0.0, 0.0, 0.0, 1.0, 2.0, 3.0], []),  # contacts close
        ([0.0, 1.0, 2.0, 9.0, 10.0, 11.0], [2]),  # to another branch
        ([0.0, 1.0, 2.0, 9.0, 4.0, 5.0, 6.0], [2, 3]),  # there and back
        ([5.0, 2.0, 1.0, 1.0, 2.0, 5.0], []),  # a minimum
        ([0.0, 0.0, 0.0, 0.0, 1.0], []),  # the end
        ([0.0, 1.0, np.nan, 9.0, 10.0, 11.0], []),
    ],
)
def test_a_value_stands_out_that_changes_faster_than_on_both_sides(value, where):
    found = stands_out(np.arange(float(len(value))), np.array(value))
    assert np.flatnonzero(found).tolist() == where


def test_neighbouring_cells_on_different_branches_are_found():
    """Softer by half from weft 0.3 on: a jump from 0.2 to 0.3 at every warp strain, and none along warp."""
    assert find_jumps(model(), cells(1.0)) == []
    found = find_jumps(model(), cells(0.5))
    assert found == [((pytest.approx(0.2), warp), (pytest.approx(0.3), warp)) for warp in STEPS]
    [said] = jump_warning(found)
    assert said.code == "W40" and {"6", "20 %", "0 %", "30 %"} <= set(quantities(said.text))


def test_cells_without_energies_have_no_jumps():
    energies = dict.fromkeys(("energy_stretch_J", "energy_bend_J", "energy_contact_J"))
    tensions = dict.fromkeys(("tension_weft_N_per_m", "tension_warp_N_per_m"))
    rows = [row.changed(**energies, **tensions) for row in cells(0.5)]
    assert find_jumps(model(), rows) == []
    assert list(jump_warning([])) == []


def levels(softer: float) -> list[Row]:
    """A run over STEPS in weft, like a line of the map."""
    rows = []
    for strain in STEPS.tolist():
        modulus = MODULUS * (softer if strain >= STEPS[SECOND] else 1.0)
        rows.append(Row(temperature_K=293.15, stress_max_Pa=0.0,
            stage="load", load_factor=strain / STEPS[-1], strain_weft=strain, strain_warp=0.0, shear=0.0, clamp_rotation=0.0,
            length_factor=1.0, tension_weft_N_per_m=modulus * strain, tension_warp_N_per_m=0.0,
            nominal_weft_N_per_m=modulus * strain, nominal_warp_N_per_m=0.0, nominal_shear_N_per_m=0.0,
            clamp_couple_N_per_m=0.0, thermal_force_J=0.0, energy_stretch_J=float(energy_of(strain, modulus)),
            energy_bend_J=0.0, energy_contact_J=0.0, dissipated_J=0.0, edge_work_J=0.0,
        ))  # fmt: skip
    return rows


def test_a_run_warns_of_the_jump_that_a_map_marks():
    assert list(in_words(warnings._changed_branch)(model(), levels(1.0))) == []
    [said] = warnings._changed_branch(model(), levels(0.5))
    assert said.code == "W18" and {"40 %", "60 %", "10 N/m", "7.5 N/m"} <= set(quantities(said.text))
    heated = levels(0.5)
    for k, one in enumerate(heated):
        one.temperature_K += 10.0 * k
    (told,) = in_words(warnings._changed_branch)(model(), heated)
    assert "of 'load' (40 degC and 50 degC)." in told


@pytest.mark.parametrize(("stored", "found"), [(1.0, [False, False, True, False, False]), (1e-9, [False] * 5)])
def test_values_of_a_mesh_without_load_do_not_jump(stored, found):
    """Below the floor of the stored energy they are rounding errors, which change unevenly."""
    force, value = np.zeros((6, 1)), np.array([[0.0], [1.0], [2.0], [9.0], [10.0], [11.0]])
    energies = {"stored": np.full(6, stored), "dissipated": np.zeros(6)}
    assert jumps(np.arange(6.0), force, force, **energies, values=[value], floor=1e-5).tolist() == found


@pytest.mark.parametrize(("warp", "found"), [(1e-2, [2]), (1e4, [])])
def test_scatter_of_a_slack_direction_is_no_jump(warp, found):
    """Weft values of 11 jump by 7: not where the mesh carries 1000 times as much in warp."""
    force, values = np.zeros((6, 1)), np.array([[0.0, 1.0, 2.0, 9.0, 10.0, 11.0], np.linspace(0.5, 1.0, 6) * warp]).T
    seen = jumps(np.arange(6.0), force, force, stored=np.ones(6), dissipated=np.zeros(6), values=[values], floor=1e-5)
    assert np.flatnonzero(seen).tolist() == found


def test_a_picture_marks_the_cells_of_a_jump(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from warpknit.export import map_figure as module

    kept = []
    monkeypatch.setattr(module, "save_figure", lambda figure, path: kept.append(figure) or path)
    jumps = [((0.2, 0.0), (0.3, 0.0)), ((0.3, 0.0), (0.3, 0.1))]
    marks = Marks(stress=np.ones((6, 6)), yield_stress=2.0, optimum=None, jumps=jumps)
    map_figure(tmp_path / "map.png", STEPS, STEPS, np.eye(6), title="", label="", unit="% of pairs", marks=marks)
    axes = kept[0].axes[0]
    (edges,) = [found for found in axes.collections if isinstance(found, LineCollection) and len(found.get_segments()) == 2]
    upright, level = (np.sort(edge, axis=0) for edge in edges.get_segments())
    assert upright[:, 0] == pytest.approx(25.0) and upright[:, 1].mean() < 5.0 <= upright[1, 1]
    assert level[:, 1] == pytest.approx(5.0) and level[0, 0] < 30.0 < level[1, 0]
    assert "snap-through to another equilibrium" in [text.get_text() for text in axes.get_legend().get_texts()]


def test_the_table_of_a_map_has_the_jumps_in_one_line():
    jumps = find_jumps(model(), cells(0.5))
    result = MapSummary(
        scene=Values(name="map"), stop_reason="finished", warnings=list(jump_warning(jumps)), path="", loads="strains",
        cells=Values(steady=36, wanted=36), variants=1, model=Values(kind="planar", kind_reason="", nodes=1),
        solver=Values(cell_steps=1, cell_steps_per_s=1.0, wall_s=1.0),
        wire=Values(yield_stress_Pa=1.0, yield_stress_assumed=False), optimum=None, jumps=jumps,
    )  # fmt: skip
    assert [line.name for line in map_table(result).lines() if line.name.startswith("W")] == ["W40"]


@pytest.mark.parametrize(("strained", "found"), [(0.01, True), (1e-3, False)])
def test_a_jump_in_heat_is_one_by_all_rules(strained: float, found: bool) -> None:
    """Cooled by 40 K a level at a held tension, from 0.3 on; in the first level, which has none before it, the mesh is strained
    by 1 %, and its energy grows by the work of that. The list of jumps, the warning and the answer of the stage have it."""
    rows = [row for row in levels(1.0) if row.strain_weft <= 0.31]
    for k in range(1, 6):
        rows.append(Row(**vars(rows[3])))
        rows[-1].stage, rows[-1].load_factor, rows[-1].temperature_K = "cold", 0.2 * k, 293.15 - 40.0 * k
        rows[-1].strain_weft += strained
        rows[-1].energy_stretch_J += AREA * rows[-1].nominal_weft_N_per_m * strained
    for one in rows:
        one.active_percent = one.stress_max_Pa = 1.0
    jumped = [(rows[3], rows[4])] if found else []
    assert jumps_of(model(), rows) == jumped
    (stage,) = heat_of(rows, [SimpleNamespace(name=name, by_tension=(True, True)) for name in ("load", "cold")], jumped)
    assert stage["jump"] == found and (stage["jump_between"] is not None) == found
    assert len(list(in_words(warnings._changed_branch)(model(), rows))) == found


def unbalanced(rows: list[Row]) -> list[str]:
    """The warning of work that is not stored, of rows whose work is that of their nominal tension in weft, by trapezoids."""
    scene = model()
    force = AREA * np.array([row.nominal_weft_N_per_m for row in rows])
    work = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff([row.strain_weft for row in rows]))])
    for one, done in zip(rows, work.tolist(), strict=True):
        one.work_J = done
    balance = missing_work(rows[-1], scene) / max(one.stored for one in rows)
    assert abs(balance) > UNBALANCED
    return in_words(warnings._unbalanced)(scene, rows, [Row(energy_balance_of_stored=balance)])


def test_work_of_a_branch_is_that_of_its_forces() -> None:
    """W = integral of f dx. f = x^2 over four even steps: the work is a third, which trapezoids miss by 1/32 of it, as the slopes
    of a parabola are known at its ends and where they are found between. Where f falls to a tenth from one branch to the next the
    steps of either are the same as alone, and that between is the mean force over the way: a curve through all of them rings."""
    x = np.linspace(0.0, 1.0, 5)
    smooth = work_steps((x**2)[:, None], x[:, None], np.zeros(4, dtype=bool))
    assert smooth.sum() == pytest.approx(1.0 / 3.0, rel=1e-12)
    force, place = np.concatenate([1.0 + x, 0.1 * (2.0 + x)]), np.concatenate([x, 2.0 + x])
    steps = work_steps(force[:, None], place[:, None], np.arange(9) == 4)
    for first in (0, 5):
        mean = 0.5 * (force[first : first + 4] + force[first + 1 : first + 5])
        assert steps[first : first + 4] == pytest.approx(0.25 * mean, rel=1e-12)
    assert steps[4] == pytest.approx(0.5 * (2.0 + 0.2) * 1.0, rel=1e-12)


def test_work_does_not_ring_beside_a_jump_that_no_rule_finds() -> None:
    """Forces that grow over displacements that grow: the work of a step is within f_a dx and f_b dx, however uneven they are."""
    force = np.array([0.0, 0.01, 0.02, 5.0, 5.1, 5.15, 9.0])[:, None]
    place = np.array([0.0, 1.0, 1.01, 1.02, 3.0, 3.1, 3.11])[:, None]
    steps, change = work_steps(force, place, np.zeros(6, dtype=bool)), np.diff(place[:, 0])
    assert np.all(steps >= force[:-1, 0] * change)
    assert np.all(steps <= force[1:, 0] * change)


def test_a_run_loses_work_in_its_jump_alone() -> None:
    """The balance of A E e^2/2 is zero on either branch of `levels`; from 0.2 to 0.3 the work is the mean force over dx, 1.75
    units, and 0.25 are stored. Sums level by level and over all rows, as of a resumed run, are the same bits."""
    rows = levels(0.5)
    for count in range(1, len(rows) + 1):
        rows[:count] = with_work(rows[:count], model())
    again = with_work(levels(0.5), model())
    assert [one.work_J for one in rows] == [one.work_J for one in again]
    lost = np.diff([missing_work(one, model()) for one in rows]) / (AREA * MODULUS)
    between = 0.1 * 0.5 * (0.2 + 0.5 * 0.3) - 0.5 * (0.5 * 0.3**2 - 0.2**2)
    assert lost == pytest.approx(np.where(np.arange(5) == SECOND - 1, between, 0.0), abs=1e-12)


def test_slack_is_no_missing_work() -> None:
    """From 0 to 0.1 strain a slack bar whose force rises at the end only: the trapezoid over it is no work that is lost. The
    balance of the steps behind it is that of the same rows without the first."""
    rows = with_work(levels(0.5), model())
    scene, whole = model(), [row.changed(work_J=row.work_J + 1.0) for row in rows]
    whole[0] = rows[0]
    assert missing_work(whole[-1], scene) == pytest.approx(1.0 + missing_work(rows[-1], scene))
    assert sum(missing_steps(whole, scene)) == pytest.approx(sum(missing_steps(rows[1:], scene)), rel=1e-9)


def test_work_that_is_not_stored_is_told_where_it_is_missing() -> None:
    """At 0.3 half the stiffness is lost: from 0.2 to 0.3 the bar stores 2.5 of the 17.5 units of work. Energy that falls by 6 %
    at 0.3 is told at its place too. Work from 0 to 0.1 that is not stored is slack where nothing is carried at 0."""
    (told,) = unbalanced(levels(0.5))
    place = "between 40 % and 60 % of 'load'"
    assert place in told
    rows = levels(1.0)
    for one in rows[SECOND:]:
        one.energy_stretch_J -= 0.06 * energy_of(0.5, MODULUS)
    (told,) = unbalanced(rows)
    assert "differ by 6 % (6 % " + place[:-1] in told
    slack = levels(1.0)
    for one in slack[1:]:
        one.energy_stretch_J -= 0.06 * energy_of(0.5, MODULUS)
    slack[0].strain_weft = -1.0
    slack[1].energy_stretch_J = 0.0
    assert unbalanced(slack) == []
