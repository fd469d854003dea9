"""PyElastica and Yade on the wires of the study tools/studies/other_codes.py; each test is skipped where its code is absent."""

from __future__ import annotations

import math
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from other_cases import LEVELS, Numerics, by_warpknit, knot_shortening, problem_of
from other_codes import BOUNDS, CASES, CODES, Row, by_other, result_of, solved_of, time_to
from rod_problem import Problem, frames, load
from study import RESULTS, read_rows

PAGE = Path(__file__).parents[2] / "docs" / "studies" / "other_codes.md"
HOOK = Numerics(12, periods=0.25, step=0.05, damping=8.0, stiffness=1.0)
NO_YADE = pytest.mark.skipif(shutil.which("yade") is None, reason="yade is not installed: apt-get install yade")


# --- problems ---------------------------------------------------------------------------------------------------------


def test_a_problem_is_read_as_it_was_saved(tmp_path: Path) -> None:
    problem = problem_of("PyElastica", "hook", HOOK)
    problem.save(tmp_path / "problem.npz")
    found = load(tmp_path / "problem.npz")
    assert (found.levels, found.segments, found.straight, found.time_step) == (LEVELS, 12, False, problem.time_step)
    assert np.array_equal(found.lines, problem.lines) and np.array_equal(found.guided, problem.guided)


def test_nodes_of_a_hook_stand_on_its_arcs() -> None:
    """A third of a circle of 1 mm, 200/3 d of radius: equal chords of 2 R sin(s/2R), 2 pi/3 R between the clamps."""
    radius = 200.0 / 3.0
    problem = problem_of("Yade", "hook", HOOK)
    assert problem.length == pytest.approx(2.0 * np.pi / 3.0 * radius, rel=1e-5)
    for straddle, count in ((False, 13), (True, 14)):
        points = problem.nodes(0, straddle)
        chord = np.linalg.norm(np.diff(points, axis=0), axis=1)
        assert len(points) == count
        assert chord == pytest.approx(2.0 * radius * np.sin(0.5 * problem.length / 12 / radius), rel=1e-4)


def test_frames_do_not_twist() -> None:
    """Along a planar curve the normal out of the plane stays; frames are orthonormal and right-handed."""
    t = np.linspace(0.0, 3.0, 40)
    found = frames(np.stack([np.cos(t), np.sin(t), 0 * t], axis=1))
    assert np.einsum("kij,klj->kil", found, found) == pytest.approx(np.broadcast_to(np.eye(3), found.shape), abs=1e-12)
    assert np.linalg.det(found) == pytest.approx(1.0)
    assert np.ptp(found[:, 0, 2]) < 1e-12


def test_a_knot_ends_at_its_loop_radius() -> None:
    """S = 2 pi R with R = h/e^2, and the clamps move by what the shortening loses."""
    distance, first, last = knot_shortening()
    problem = problem_of("Yade", "knot", Numerics(64))
    assert last == pytest.approx(2.0 * np.pi * 0.5 / 0.3**2)
    assert problem.move[0, 1, 0] - problem.move[0, 0, 0] == pytest.approx(first - last)
    assert problem.length == pytest.approx(distance + first, rel=1e-6)


def test_forces_are_read_from_the_ends() -> None:
    """Of a hook what the ends of one wire carry together, of a knot the mean pull of both ends, behind its relaxation."""
    ends = np.zeros((LEVELS, 2, 2, 3))
    ends[:, 0, 0], ends[:, 0, 1] = (3.0, 1.0, 0.0), (0.0, 3.0, 0.0)
    other = {"cpu_s": [1.0], "setup_s": 0.0, "steps": 1, "nodes": [2]}
    assert solved_of("hook", {"force": ends, **other}).force == pytest.approx(5.0)
    pulled = np.zeros((LEVELS + 1, 1, 2, 3))
    pulled[1:, 0, 0, 0], pulled[1:, 0, 1, 0] = -2.0, 4.0
    assert solved_of("knot", {"force": pulled, **other}).force == pytest.approx(3.0)
    with pytest.raises(RuntimeError, match="diverged"):
        solved_of("knot", {"force": pulled * np.nan, **other})


# --- other codes ------------------------------------------------------------------------------------------------------


def arch(code: str, damping: float) -> Problem:
    """A rod clamped at both ends that is 2 to 3 % longer than their distance; it bulges, but is straight close to its clamps."""
    t = np.linspace(0.0, 1.0, 4001)
    bulge = 5.0 * (1.0 - np.cos(2.0 * np.pi * np.clip((t - 0.03) / 0.94, 0.0, 1.0)))
    line = np.stack([100.0 * t, bulge, 0.0 * t], axis=1)
    line = np.concatenate([[[-5.0, 0.0, 0.0]], line, [[105.0, 0.0, 0.0]]])
    knot = problem_of(code, "knot", Numerics(60, periods=0.5, step=0.2, damping=damping, stiffness=30.0))
    return replace(knot, lines=line[None], move=np.zeros((1, 2, 3)), levels=1)


def check_arch(given: Problem, result: dict) -> None:
    """-P L^2/(4 pi^2 B) = 1 + S/(2 L) + O((S/L)^2), S the length less the distance of the ends; segments add (2 pi/60)^2."""
    length = given.length
    shortening = 1.0 - 100.0 / length
    pull = 0.5 * (result["force"][-1][0][1][0] - result["force"][-1][0][0][0])
    assert pull * length**2 / (4.0 * np.pi**2) == pytest.approx(-(1.0 + 0.5 * shortening), abs=(2.0 * np.pi / 60) ** 2)


def test_pyelastica_has_the_load_of_a_buckled_rod() -> None:
    pytest.importorskip("elastica", reason="pyelastica is not installed: pip install -e '.[other-codes]'")
    from elastica_rods import solve

    given = arch("PyElastica", 1.0)
    check_arch(given, solve(given))


@NO_YADE
def test_yade_has_the_load_of_a_buckled_rod(tmp_path: Path) -> None:
    """A rod that is straight without load, moved onto its shape (`bend` of yade_rods.py)."""
    given = arch("Yade", 0.2)
    check_arch(given, result_of("Yade", given))


def test_pyelastica_agrees_on_a_coarse_hook() -> None:
    """12 segments a wire: the page gives 3 % for warpknit, and both err by the square of the spacing. With damping of 2 and
    levels of 0.1 periods vibrations at the contact are chaotic: a change of damping by 1e-12 changes the force by a quarter,
    here by 1 %."""
    pytest.importorskip("elastica", reason="pyelastica is not installed: pip install -e '.[other-codes]'")
    found = by_other("PyElastica", "hook", HOOK)
    wanted = by_warpknit("hook", Numerics(12, tolerance=1e-3, softening=64.0))
    assert found.force[-1] == pytest.approx(wanted.force[-1], rel=0.03 + 0.01)


@NO_YADE
def test_yade_agrees_on_a_hook() -> None:
    """24 segments a wire: the page gives 3 to 7 % for Yade and 1 % for warpknit."""
    found = by_other("Yade", "hook", Numerics(24, periods=0.5, step=0.5, damping=0.2, stiffness=1.0))
    wanted = by_warpknit("hook", Numerics(24, tolerance=1e-3, softening=64.0))
    assert found.force[-1] == pytest.approx(wanted.force[-1], rel=0.08)


# --- the page ---------------------------------------------------------------------------------------------------------


def test_a_time_counts_only_where_finer_and_slower_runs_keep_the_error() -> None:
    def run(segments: int, periods: float, error: float, cpu: float) -> Row:
        return Row("hook", "Yade", segments, 0, periods, *(0.0,) * 8, error, 0, cpu, 0.0)

    lucky, slow, fine, both = run(8, 1.0, 0.01, 1.0), run(8, 2.0, 0.09, 2.0), run(16, 1.0, 0.03, 3.0), run(16, 2.0, 0.02, 4.0)
    rows = [lucky, slow, fine, both]
    assert time_to(rows, "hook", "Yade", 0.10) == lucky
    assert time_to(rows, "hook", "Yade", 0.05) == fine
    assert time_to(rows, "hook", "Yade", 0.02) == both
    assert time_to(rows, "hook", "Yade", 0.01) is None


def test_the_page_has_the_times_of_the_table() -> None:
    """The cheapest run of each code within each error, and where there is none."""
    rows, text = read_rows(RESULTS / "other_codes.csv", Row), PAGE.read_text(encoding="utf-8")
    for case in CASES:
        for code in CODES:
            line = re.search(rf"^\| {case}, {code} \|(.*)\|$", text, re.MULTILINE)
            assert line, f"no row of {case}, {code}"
            cells = [cell.strip() for cell in line.group(1).split("|")]
            for cell, bound in zip(cells, BOUNDS, strict=False):
                best = time_to(rows, case, code, bound)
                time = math.nan if best is None else float(f"{best.cpu_s:.2g}")
                assert cell == ("not reached" if best is None else f"{time:g} s, {best.segments}"), (case, code, bound)
