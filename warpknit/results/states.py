"""Recorded states of a finished run, read when they are asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from ..errors import ExportError, RunDirectoryError, needing_extra
from .frame import Frame
from .table import Table, found, units

if TYPE_CHECKING:
    from ..export.run_record import RunRecord

AXES = ("x", "y", "z")  # weft, warp, normal
PLACES = ("stage", "load_factor")  # columns that say where in the load history a record is
# of a frame: dimensions after the record, and unit; contacts elsewhere have another number in each record
FIELDS = {
    "node_position": (("node", "axis"), "m"),
    "node_stress": (("node",), "Pa"),
    "body_position": (("body", "axis"), "m"),
    "body_force": (("body",), "N"),
    "body_active": (("body",), ""),
    "pair_force": (("pair",), "N"),
    "pair_active": (("pair",), ""),
}


class States(Sequence[Frame]):
    """The recorded states of a run, one a row of its history: `states[-1].node_position`.

    Raises IndexError for a record that is not there, RunDirectoryError for a file that cannot be read.
    """

    def __init__(self, record: RunRecord | None) -> None:
        self._record = record

    @overload
    def __getitem__(self, which: int) -> Frame: ...
    @overload
    def __getitem__(self, which: slice) -> list[Frame]: ...
    def __getitem__(self, which: int | slice) -> Frame | list[Frame]:
        try:
            chosen = range(len(self))[which]
        except IndexError as error:
            instead = f"use {-len(self)} to {len(self) - 1}" if len(self) else "a map or an empty run has none"
            raise IndexError(f"states: {which} is not one of {len(self)} states; {instead}") from error
        return [self._read(index) for index in chosen] if isinstance(chosen, range) else self._read(chosen)

    def __len__(self) -> int:
        return 0 if self._record is None else len(self._record.states)

    def __iter__(self) -> Iterator[Frame]:
        return map(self._read, range(len(self)))

    def _read(self, index: int) -> Frame:
        assert self._record is not None
        try:
            return self._record.frame(index)
        except ExportError as error:
            raise RunDirectoryError(str(error)) from error

    def __repr__(self) -> str:
        return f"<{len(self)} states>"


class Series(Mapping[str, np.ndarray]):
    """Quantities of all records: columns of the history [record], and fields of the states, stacked [record, ...].

    A field is read from all states when it is asked for: `node_position` of a large mesh may not fit in memory.
    """

    def __init__(self, history: Table, states: States) -> None:
        self._history, self._states = history, states
        self._fields = FIELDS if len(states) else {}

    def __getitem__(self, name: str) -> np.ndarray:
        if name in self._fields:
            return np.stack([getattr(state, name) for state in self._states])
        return self._history[name] if name in self._history else found(dict.fromkeys(self, np.empty(0)), name)

    def __iter__(self) -> Iterator[str]:
        yield from self._history
        yield from self._fields

    def __len__(self) -> int:
        return len(self._history) + len(self._fields)

    def __repr__(self) -> str:
        return f"<{len(self)} quantities of {self._history.rows} records>"

    def to_xarray(self, names: Sequence[str] | None = None) -> Any:
        """An xarray.Dataset over `record`, by default of everything. Raises `MissingExtra` without xarray (extra `notebooks`).

        Coordinates: `record`, the index from 0; `stage` and `load_factor` of each record; `axis`, of positions: x, y, z.
        `attrs["units"]` of each variable is its unit (`units` in table.py); none for counts, shares and words.
        """
        with needing_extra("to_xarray()", "notebooks"):
            import xarray

        variables: dict[str, Any] = {}
        for name in self if names is None else names:
            dimensions, unit = FIELDS[name] if name in self._fields else ((), units(name).get("units", ""))
            variables[name] = (("record", *dimensions), self[name], {"units": unit} if unit else {})
        coordinates: dict[str, object] = {name: ("record", self[name]) for name in PLACES if name in self._history}
        coordinates["record"] = np.arange(self._history.rows)
        if any("axis" in variable[0] for variable in variables.values()):
            coordinates["axis"] = list(AXES)
        return xarray.Dataset({name: value for name, value in variables.items() if name not in coordinates}, coordinates)
