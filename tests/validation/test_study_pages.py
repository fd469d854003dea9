"""Tables of study pages (docs/studies) hold the figures of the stored results (tools/studies/results)."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from experiment import Row as Predicted
from study import RESULTS, read_rows

PAGES = Path(__file__).parents[2] / "docs" / "studies"
NUMBER = re.compile(r"-?\d[\d,]*\.?\d*")


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


@pytest.mark.parametrize(("heading", "sample", "tensions"), [("tight mesh | plane", "tight", (2.0, 3.4, 4.9)),
                                                             ("control | plane", "control", (1.0, 2.0, 3.4))])  # fmt: skip
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
