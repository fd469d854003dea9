"""One recorded state in numbers, frozen: what history.csv, summary.json, a map, tables and pictures show of it."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import FrozenInstanceError, fields, is_dataclass
from inspect import get_annotations
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..base.files import write_aside

Columns: TypeAlias = Mapping[str, NDArray[Any]]  # by name, a value a row
Kind = TypeVar("Kind", bound="Values")


class Values(SimpleNamespace):
    """Values by name that do not change: `values.name`, or `values[name]` where the name is computed."""

    def __setattr__(self, name: str, value: object) -> NoReturn:
        raise FrozenInstanceError(f"{name}: this value is read-only; make a new object with changed({name}=...)")

    def __getitem__(self, name: str) -> Any:
        return self.__dict__[name]

    def __contains__(self, name: str) -> bool:
        return name in vars(self)

    def get(self, name: str, other: Any = None) -> Any:
        """The value of a name; `other` where there is none."""
        return self.__dict__.get(name, other)

    def changed(self: Kind, **values: Any) -> Kind:
        """The same with other or further values."""
        return type(self)(**vars(self) | values)


def plain(value: Any) -> Any:
    """A result as tables, lists, texts and numbers, for JSON: values and dataclasses as tables of their names."""
    if isinstance(value, Values):
        return plain(vars(value))
    if is_dataclass(value) and not isinstance(value, type):
        named = {entry.name: getattr(value, entry.name) for entry in fields(value)}
        return str(value) if "__str__" in vars(type(value)) else plain(named)
    if isinstance(value, Mapping):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_json(path: Path, result: Any) -> None:
    """Write a result to a JSON file, atomically; numbers that are not finite as null."""
    with write_aside(path) as file:
        json.dump(plain(result), file, indent=2, allow_nan=False)


def valued(tree: Mapping[str, Any]) -> Any:
    """Values for a table of JSON and the tables in it: what `plain` was given, but for dataclasses and texts."""

    def of(value: Any) -> Any:
        if isinstance(value, list):
            return [of(one) for one in value]
        return valued(value) if isinstance(value, dict) else value

    return Values(**{name: of(value) for name, value in tree.items()})


class Row(Values):
    """One recorded state: the measures of measure/table.py in SI units by their names, which end in the unit.

    A measure that a mesh or a model does not have is left out. `row["active_A_percent"]` is of a class of contact.
    docs/reference/summary.md has all meanings. The measures are numbers, but for these:
    """

    index: int
    stage: str
    pairs: int
    active: int
    active_pairs: int
    bodies: int
    active_bodies: int
    at_reach_end: int
    near_bodies: int
    elsewhere: int
    contacts_elsewhere: int
    central_rhombus: Mapping[str, float]
    stress_max_part: str | None
    stress_max_node: int
    stress_max_wire: int
    yield_stress_assumed: bool
    steps: int
    steady: bool
    probes: Mapping[str, float | None]
    panel: Mapping[str, Any]

    @property
    def stored(self) -> float:
        """[J]"""
        return float(self.energy_stretch_J + self.energy_bend_J + self.energy_contact_J)

    @property
    def tension(self) -> tuple[float, float]:
        """[N/m] in weft and warp."""
        return self.tension_weft_N_per_m, self.tension_warp_N_per_m

    @property
    def is_hook(self) -> bool:
        """Whether the row is of two hooked wires."""
        return "displacement_m" in self

    @property
    def hook_is_closed(self) -> bool:
        """Whether both contacts of the hook carry force."""
        return bool(self.force_left_N > 0.0 and self.force_right_N > 0.0)


def _number(text: str) -> float | None:
    return float(text) if text else None


def _count(text: str) -> float:
    """A whole number, or the mean of such."""
    return float(text) if "." in text or "e" in text else int(text)


# of a column that is no number; an empty cell of numbers is None
KINDS: dict[str, Callable[[str], Any]] = {"int": _count, "str": str, "bool": "True".__eq__}


def columns_of(rows: Iterable[Mapping[str, object]]) -> Columns:
    """(row,) numbers of each column, nan where there is none; the names of the stages."""
    lines = list(rows)
    names = dict.fromkeys(name for line in lines for name in line)
    columns = {name: np.array([_as_number(line.get(name)) for line in lines]) for name in names if name != "stage"}
    return columns | {"stage": np.array([str(line.get("stage", "")) for line in lines])}


def _as_number(value: Any) -> float:
    return float(value) if isinstance(value, int | float | np.number | np.bool_) else math.nan


def write_rows(path: Path, rows: Iterable[Values], columns: Sequence[str]) -> None:
    """Write these columns of rows to a CSV file, atomically; None is an empty cell."""
    with write_aside(path) as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(vars(row) for row in rows)


def read_rows(path: Path, kind: type[Kind]) -> list[Kind]:
    """The rows that `write_rows` wrote, bit-identical, as values of a `kind`; columns of other names are numbers or None."""
    with open(path, newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    hints = {name: hint for part in (Row, *kind.__mro__[::-1]) for name, hint in get_annotations(part).items()}
    readers = {name: KINDS.get(hint.partition(" ")[0], _number) for name, hint in hints.items()}
    return [kind(**{name: readers.get(name, _number)(text) for name, text in line.items()}) for line in lines]
