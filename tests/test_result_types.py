"""The types of results: rows that do not change, findings in words, warnings with a code."""

import json
import re
from dataclasses import FrozenInstanceError
from pathlib import Path

import numpy as np
import pytest

from reference.in_words import quantities
from warpknit.results.finding import KINDS, Finding, ResultTable, ResultWarning
from warpknit.results.row import Row, Values, columns_of, plain, read_rows, valued, write_rows

HOST = Path(__file__).parents[1] / "warpknit"


def test_a_row_does_not_change() -> None:
    row = Row(stage="load", strain_weft=0.1)
    with pytest.raises(FrozenInstanceError, match="strain_weft"):
        row.strain_weft = 0.2
    assert row.changed(strain_weft=0.2).strain_weft == 0.2 and row["strain_weft"] == 0.1 and "shear" not in row


def test_rows_of_a_file_are_those_that_were_written(tmp_path: Path) -> None:
    """Bit-identical: numbers, counts, truth values, words and cells without a value."""
    rows = [Row(index=0, stage="load", strain_weft=0.1 + 0.2, steady=True, active_rhombus_percent=None)]
    write_rows(tmp_path / "rows.csv", rows, list(vars(rows[0])))
    assert read_rows(tmp_path / "rows.csv", Row) == rows


def test_columns_have_nan_where_a_row_has_no_number() -> None:
    columns = columns_of([{"stage": "load", "a": 1, "b": None}, {"stage": "more", "a": 2.5}])
    assert columns["stage"].tolist() == ["load", "more"] and columns["a"].tolist() == [1.0, 2.5]
    assert np.isnan(columns["b"]).all()


def test_values_come_back_from_json() -> None:
    """Tables in tables and lists of them; a number that is not finite is null."""
    values = Values(name="a", more=Values(x=1.5, missing=float("nan")), rows=[Values(k=1)])
    again = valued(json.loads(json.dumps(plain(values))))
    assert again == values.changed(more=Values(x=1.5, missing=None))


def test_a_finding_in_words() -> None:
    assert quantities(Finding("largest stress", 1.48e8, "Pa", where=", 25 % of the elastic limit").text) == ["148 MPa", "25 %"]
    assert Finding("preset", "draft").text == "draft"


def test_a_warning_is_one_line_with_what_to_do() -> None:
    """The advice is that of its kind, unless it has its own."""
    own, line = ResultWarning("W18", "Snap-through.", "Compare."), str(ResultWarning("W18", "Snap-through."))
    assert str(own) == "W18 Snap-through. Compare." and line == f"W18 Snap-through. {KINDS['W18'][1]}"
    assert str(ResultWarning.of(line)) == line and ResultWarning.of(line).code == "W18"
    assert str(ResultWarning.of("of an older version")) == "of an older version"


def test_every_kind_of_warning_is_used_and_declared() -> None:
    """A code is given where the warning is made, and declared once."""
    found = {
        code for path in HOST.rglob("*.py") for code in re.findall(r'(?:ResultWarning\(\s*"|"warning )(W\d\d)', path.read_text())
    }
    assert found == set(KINDS)


def test_a_short_table_has_the_gravest_warnings_and_the_number_of_the_others() -> None:
    """W01 and W06 are invalid results, W05 and W18 limits, W24 is about the input."""
    warnings = tuple(ResultWarning(code, code) for code in ("W24", "W05", "W01", "W18", "W06"))
    table = ResultTable((Finding("a", "1", short=True), Finding("b", "2")), warnings, "map.json")
    short, every = ([line.name for line in table.lines(verbose=verbose)] for verbose in (False, True))
    assert short == ["a", "W01", "W06", "W05", ""] and every == ["a", "b", "W01", "W06", "W05", "W18", "W24"]
    assert quantities([line.text for line in table.lines()][-1]) == ["2"]
