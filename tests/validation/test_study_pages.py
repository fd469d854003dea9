"""Tables of study pages (docs/studies) hold the figures of the stored results (tools/studies/results)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from clasps import ClaspRow
from experiment import Row as Predicted
from friction import Row as Rubbing
from knot_braid import braid
from knots import FrictionRow
from knots import Row as Knot
from pulled_data import MESHES
from pulled_inputs import InputRow
from pulled_meshes import LevelRow
from pulled_meshes import Row as Pulled
from study import RESULTS, read_rows
from trefoil import TrefoilRow

PAGES = Path(__file__).parents[2] / "docs" / "studies"
NUMBER = re.compile(r"-?\d[\d,]*(?:\.\d+)?")


def table(page: str, first: str) -> list[list[str]]:
    """Cells of the rows of the first table whose heading begins with these words."""
    lines = (PAGES / page).read_text(encoding="utf-8").splitlines()
    start = next(n for n, line in enumerate(lines) if line.startswith(f"| {first}"))
    rows = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


def is_rounded(text: str, value: float, scale: float = 1.0) -> bool:
    """Whether a printed number is the value to its last digit; half a digit more for the five digits of a result."""
    plain = text.replace(",", "")
    digits = len(plain.partition(".")[2])
    zeros = len(plain) - len(plain.rstrip("0")) if digits == 0 and plain.strip("-0") else 0
    return abs(float(plain) - scale * value) <= 0.51 * 10.0 ** (zeros - digits) + 1e-4 * abs(scale * value)


def numbers(cell: str) -> list[str]:
    return NUMBER.findall(cell)


def check(cell: str, *values: float) -> None:
    """The numbers of a cell are these."""
    found = numbers(cell)
    assert len(found) == len(values), (cell, values)
    for text, value in zip(found, values, strict=True):
        assert is_rounded(text, value), (cell, values)


# --- an experiment ----------------------------------------------------------------------------------------------------

PREDICTED = {
    "stiffness, weft N/m": ("stiffness_weft", 1.0),
    "stiffness, warp N/m": ("stiffness_warp", 1.0),
    "Poisson's ratio, weft raised": ("poisson_weft", 1.0),
    "Poisson's ratio, warp raised": ("poisson_warp", 1.0),
    "active contacts %": ("active_percent", 1.0),
    "contact resistance, median mOhm": ("contact_ohm", 1e3),
    "sheet resistance, weft mOhm": ("sheet_weft_ohm", 1e3),
    "sheet resistance, warp mOhm": ("sheet_warp_ohm", 1e3),
}


@pytest.mark.parametrize(("heading", "sample", "tensions"), [("tight mesh | planar", "tight", (2.0, 3.4, 4.9)),
                                                             ("control | planar", "control", (1.0, 2.0, 3.4))])  # fmt: skip
def test_the_experiment_is_as_predicted(heading: str, sample: str, tensions: tuple[float, ...]) -> None:
    """Base case, and in brackets the range of all cases."""
    rows = read_rows(RESULTS / "experiment.csv", Predicted)
    for name, *cells in table("experiment.md", heading):
        key, scale = PREDICTED[name]
        for cell, (tension, model) in zip(cells, ((t, m) for t in tensions for m in ("planar", "spatial")), strict=True):
            at = [r for r in rows if (r.sample, r.model, r.tension) == (sample, model, tension)]
            values = [scale * getattr(r, key) for r in at]
            base = next(scale * getattr(r, key) for r in at if r.case == "base")
            check(cell, *([base, min(values), max(values)] if ".." in cell else [base]))
            assert ".." in cell or max(values) - min(values) < 0.01 * abs(base), cell


# --- meshes pulled to break -------------------------------------------------------------------------------------------

DIRECTIONS = {"wales": "warp", "courses": "weft"}
LOADED = 50e6  # [Pa] axial stress below which a pull is left out of the ranges of forces


def check_with_range(cell: str, base: Iterable[float], values: Iterable[float]) -> None:
    """The numbers before the brackets, and in brackets, where there are any, the range of all cases."""
    first, _, spread = cell.partition("(")
    check(first, *base)
    known = [value for value in values if not math.isnan(value)]
    if spread:
        check(spread, *sorted({min(known), max(known)}))


def strain_at(levels: list[LevelRow], pull: Pulled, stress: float) -> float:
    """Strain at which the axial stress of a wire reaches `stress` [Pa], between two levels; not a number where it does not."""
    own = [one for one in levels if (one.mesh, one.direction, one.case) == (pull.mesh, pull.direction, pull.case)]
    for before, after in pairwise(own):
        if before.axial < stress <= after.axial:
            return before.strain + (stress - before.axial) / (after.axial - before.axial) * (after.strain - before.strain)
    return math.nan


def test_strips_are_as_pulled() -> None:
    rows, levels = read_rows(RESULTS / "pulled_meshes.csv", Pulled), read_rows(RESULTS / "pulled_meshes_levels.csv", LevelRow)
    for name, measured, stiff, broken, last, straight, force, fibre, most in table("pulled_meshes.md", "pulled | measured"):
        mesh, direction = name.split(", ")
        pulls = [r for r in rows if (r.mesh, r.direction) == (mesh, DIRECTIONS[direction])]
        (base,) = [r for r in pulls if r.case == "base"]
        (there,) = [m.measured[DIRECTIONS[direction]] for m in MESHES if m.name == mesh]
        width = there.force / there.width
        check(measured, *(100.0 * there.strain * k for k in (1.0, there.strain_cv)), width, width * there.force_cv)
        begins = base.last_strain if math.isnan(base.stiff_strain) else base.stiff_strain
        check_with_range(stiff, [100.0 * begins], [100.0 * r.stiff_strain for r in pulls])
        assert stiff.startswith("not by") == math.isnan(base.stiff_strain)
        weak = next(m.strength[0] for m in MESHES if m.name == mesh)
        at_strength = {r.case: 100.0 * strain_at(levels, r, weak) for r in pulls}
        assert broken.startswith("not by") == math.isnan(at_strength["base"])
        check_with_range(
            broken, [100.0 * base.last_strain if broken.startswith("not by") else at_strength["base"]], at_strength.values()
        )
        check(fibre, 1e-9 * base.last_fibre)
        check(last, 100.0 * base.last_strain, base.last_force)
        check_with_range(straight, [100.0 * base.straight_strain], [100.0 * r.straight_strain for r in pulls])
        loaded = [r for r in pulls if r.last_axial >= LOADED]
        check_with_range(force, [base.force_weak, base.force_strong], [f for r in loaded for f in (r.force_weak, r.force_strong)])
        check(most, base.bound_weak, base.bound_strong)


def test_inputs_of_hf_1_are_as_pulled() -> None:
    """Strain at the measured force with free sides and with the width held, or the last one where it is not carried."""
    rows = [r for r in read_rows(RESULTS / "pulled_inputs.csv", InputRow) if r.direction == "warp"]
    for name, free, held, straight in table("pulled_meshes.md", "HF-1 along the wales"):
        wales, courses, *more = (float(v) for v in numbers(name.replace(",", "")))
        friction, run_in = more[0] if "friction" in name else 0.2, more[0] if "run-in" in name else 1.0
        for cell, sides in ((free, "free"), (held, "held")):
            own = [
                r
                for r in rows
                if (r.wales, r.courses, r.friction, r.run_in, r.sides) == (wales, courses, friction, run_in, sides)
            ]
            assert len(own) == len(numbers(cell)), (name, cell)
            for row in own:
                check(cell, 100.0 * (row.last_strain if math.isnan(row.strain) else row.strain))
                assert cell.startswith("not by") == math.isnan(row.strain)
                check(straight, 100.0 * row.straight_strain)


# --- knots and clasps -------------------------------------------------------------------------------------------------


def has_row(cells: list[str], values: Iterable[list[list[float]]]) -> bool:
    """Whether the numbers of the cells are those of one of the rows of values, of which each has a list for each cell."""
    for row in values:
        found = [numbers(cell) for cell in cells]
        if [len(f) for f in found] == [len(v) for v in row] and all(
            is_rounded(text, value) for f, v in zip(found, row, strict=True) for text, value in zip(f, v, strict=True)
        ):
            return True
    return False


braid_of = cache(braid)


def of_free_knot(r: Knot) -> list[list[float]]:
    b, e = braid_of(r.turns), r.e
    return [
        [r.turns], [e], [r.force_radius, r.energy_force, float(b.elastic(np.array(e))) / e**4],
        [r.energy / (np.pi * e**2), 1.0 + b.c * e], [r.contact_force / e**3, b.sigma],
    ]  # fmt: skip


def of_clasp(r: ClaspRow) -> list[list[float]]:
    return [[r.tension], [r.tip_curvature], [r.tip_distance], [r.gap, r.reach]]


def of_trefoil(r: TrefoilRow) -> list[list[float]]:
    return [[r.length_d], [r.energy], [r.contact_force], [r.curvature]]


def of_friction(r: FrictionRow) -> list[list[float]]:
    return [[r.spacing_d], [r.load_steps], [r.friction_share], [r.steps]]


@pytest.mark.parametrize(
    ("heading", "file", "kind", "values"),
    [
        ("turns, without", "knots.csv", Knot, of_free_knot),
        ("T d^2/B", "clasp.csv", ClaspRow, of_clasp),
        ("L/d", "trefoil.csv", TrefoilRow, of_trefoil),
        ("node spacing", "knots_friction.csv", FrictionRow, of_friction),
    ],
)
def test_rows_of_the_page_of_knots_are_in_the_results(
    heading: str, file: str, kind: type, values: Callable[..., list[list[float]]]
) -> None:
    rows = [r for r in read_rows(RESULTS / file, kind) if getattr(r, "way", "tighten") == "tighten"]
    for cells in table("knots.md", heading):
        assert has_row(cells, map(values, rows)), cells


def test_knots_with_friction_are_in_the_results() -> None:
    """F R^2/B, that of a long knot, that to first order, and the share, for each friction coefficient."""
    rows = [r for r in read_rows(RESULTS / "knots.csv", Knot) if r.friction > 0.0 and r.way == "tighten"]
    for turns, e, *cells in table("knots.md", "turns | e | friction 0.1"):
        for friction, cell in zip((0.1, 0.2, 0.3), cells, strict=True):
            own = [r for r in rows if (r.turns, r.friction) == (int(turns), friction) and is_rounded(e, r.e)]
            found = [[[r.force_radius, r.long_knot / r.e**4, r.theory / r.e**4, r.friction_share]] for r in own]
            assert has_row([cell], found), (turns, e, cell)


def test_answers_with_friction() -> None:
    rows = {(row.knit, row.friction, row.load): row for row in read_rows(RESULTS / "friction.csv", Rubbing)}
    for knit, friction, tension, strain, active, stress in table("friction.md", "knit | friction"):
        strained, pulled = (rows.get((knit, float(friction), load)) for load in ("strain", "tension"))
        assert strained is not None and (pulled is None) == (strain == "-")
        check(tension, strained.tension_weft_N_per_m, strained.tension_warp_N_per_m)
        if pulled is None:
            continue
        check(strain, 100.0 * pulled.strain_weft, 100.0 * pulled.strain_warp)
        check(active, pulled.active_percent)
        check(stress, 1e-6 * pulled.stress_max_Pa)
