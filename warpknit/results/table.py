"""A table of results: columns by name, as arrays."""

from __future__ import annotations

import csv
import difflib
from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..base.errors import InputError, RunDirectoryError, needing_extra
from ..base.text import either
from ..measure.table import MEASURES
from .row import Row

Value = TypeVar("Value")

AGAIN = "run it again, with --force"  # where a file of results is missing or damaged
SHOWN_ROWS = 5  # at either end
TEXTS = {name for name, kind in Row.__annotations__.items() if kind.startswith("str")}  # measures that are words
NUMBERS = {measure.name for measure in MEASURES} - TEXTS  # measures that are numbers or truth values
UNITS = {
    "N_per_m": "N/m", "kg_per_m2": "kg/m^2", "percent": "%", "Pa": "Pa", "K": "K", "N": "N", "J": "J", "rad": "rad", "m2": "m^2",
    "m": "m", "s": "s", "bytes": "byte",
}  # fmt: skip  # ends of names, the longest first
TRUTH = {"True": True, "False": False}


class Table(Mapping[str, np.ndarray]):
    """Columns [row] of a CSV file by their names, which end in their unit: `table["tension_weft_N_per_m"]`.

    Whole numbers, numbers (nan where a cell is empty), truth values, or texts; read-only. `len` is the number of columns.
    """

    def __init__(self, columns: Mapping[str, np.ndarray]) -> None:
        self._columns = {name: column.view() for name, column in columns.items()}
        for column in self._columns.values():
            column.flags.writeable = False

    @classmethod
    def read(cls, path: Path) -> Table:
        """The table of a CSV file with a header. Raises RunDirectoryError, which names the file, where it is damaged."""
        try:
            with open(path, newline="", encoding="utf-8") as file:
                lines = [line for line in csv.reader(file) if line]
        except (OSError, ValueError, csv.Error) as error:
            raise RunDirectoryError(f"{path}: unreadable ({error}); {AGAIN}") from error
        names, rows = (lines[0], lines[1:]) if lines else ([], [])
        if not names:
            raise RunDirectoryError(f"{path}: empty; {AGAIN}")
        for number, row in enumerate(rows, start=1):
            if len(row) != len(names):
                raise RunDirectoryError(f"{path}: {len(row)} cells in row {number}, {len(names)} in the heading; {AGAIN}")
        cells = zip(*rows, strict=True) if rows else [()] * len(names)
        of_history = path.name == "history.csv"  # whose other columns are probes, which give numbers
        return cls({name: _column(path, name, texts, of_history) for name, texts in zip(names, cells, strict=True)})

    def __getitem__(self, name: str) -> np.ndarray:
        return found(self._columns, name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self._columns.values()), ()))

    def grid(self, name: str, rows: str, columns: str) -> np.ndarray:
        """(row, column) [unit of the name] a column over the values of two others, rising; nan where there is no such pair.

        Raises InputError for a column of words.

        run.tables["map"].grid("active_percent", "strain_warp", "strain_weft")    # (warp, weft) [%]
        """
        if self[name].dtype.kind == "U":
            raise InputError(f"grid: {name!r} is a column of words; give a column of numbers")
        (y, row), (x, column) = (np.unique(self[by], return_inverse=True) for by in (rows, columns))
        values = np.full((len(y), len(x)), np.nan)
        values[row, column] = self[name]
        return values

    def to_xarray(self, *by: str) -> Any:
        """An xarray.Dataset along `row`, or with the columns `by` as coordinates.

        `attrs["units"]` of each variable is the unit that ends its name (UNITS). Raises `MissingExtra` without xarray.
        """
        with needing_extra("to_xarray()", "notebooks"):
            import xarray

        for name in by:
            found(self, name)
        if by:
            data = self.to_pandas().set_index(list(by)).to_xarray()
        else:
            data = xarray.Dataset({name: ("row", column) for name, column in self.items()}, {"row": np.arange(self.rows)})
        for name in data.variables:
            data[name].attrs |= units(str(name))
        return data

    def to_pandas(self) -> Any:
        """The table as a pandas.DataFrame. Raises `MissingExtra` without pandas (extra `notebooks`)."""
        with needing_extra("to_pandas()", "notebooks"):
            import pandas

        return pandas.DataFrame(self._columns)

    def __repr__(self) -> str:
        first = ", ".join(list(self)[:4])
        return f"<Table of {self.rows} rows, {len(self)} columns: {first}{', ...' if len(self) > 4 else ''}>"

    def _repr_html_(self) -> str:
        places = [*range(self.rows)]
        if self.rows > 2 * SHOWN_ROWS:
            places = [*places[:SHOWN_ROWS], -1, *places[-SHOWN_ROWS:]]
        formats = ["{:.4g}" if column.dtype.kind == "f" else "{}" for column in self.values()]
        cells = list(zip(formats, self.values(), strict=True))
        lines = [["..." if k < 0 else text.format(column[k]) for text, column in cells] for k in places]
        return f"{html_table(lines, head=list(self))}<p>{self.rows} rows, {len(self)} columns</p>"


def found(items: Mapping[str, Value], name: str) -> Value:
    """The item of a name. Raises KeyError, which names the nearest ones."""
    if name in items:
        return items[name]
    near = difflib.get_close_matches(str(name), items, n=3, cutoff=0.3)
    instead = f"use {either(list(islice(items, 3)))}" if items else "there are no names here"
    nearest = f"the nearest {'are' if len(near) > 1 else 'is'} {' and '.join(near)}"
    raise KeyError(f"{name!r} is unknown; {nearest if near else instead}")


def html_table(lines: Sequence[Sequence[str]], head: Sequence[str] = ()) -> str:
    """Lines of texts as a table of a page."""
    top = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(f"<tr>{''.join(f'<td>{escape(text)}</td>' for text in line)}</tr>" for line in lines)
    return f"<table>{f'<tr>{top}</tr>' if head else ''}{body}</table>"


def units(name: str) -> dict[str, str]:
    """The attribute `units` of a quantity whose name ends in its unit; empty for counts, shares and words.

    >>> units("tension_weft_N_per_m"), units("strain_weft")
    ({'units': 'N/m'}, {})
    """
    return next(({"units": unit} for end, unit in UNITS.items() if name.endswith(f"_{end}")), {})


def _column(path: Path, name: str, texts: Sequence[str], of_history: bool) -> np.ndarray:
    """The values of a column. Raises RunDirectoryError for a word where the name stands for a number."""
    if name in TEXTS:
        return np.array(texts, dtype=str)
    values = _values(texts)
    if values.dtype.kind == "U" and (of_history or name in NUMBERS):
        row = next(number for number, text in enumerate(texts) if _values([text]).dtype.kind not in "if")
        raise RunDirectoryError(f"{path}: {name}: {texts[row]!r} in row {row + 1} is not a number; {AGAIN}")
    return values


def _values(texts: Sequence[str]) -> np.ndarray:
    """A column of one kind, the narrowest that has all its cells; nan where all are empty."""
    kinds: tuple[Callable[[str], Any], ...] = (int, lambda text: float(text or "nan"), TRUTH.__getitem__)
    for kind in kinds:
        try:
            return np.array([kind(text) for text in texts])
        except (ValueError, KeyError):
            continue
    return np.array(texts, dtype=str)
