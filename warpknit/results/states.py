"""Recorded states of a finished run, read when they are asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from ..frame import Frame
from .table import Table, found

if TYPE_CHECKING:
    from ..export.run_record import RunRecord

# of a frame: dimensions after the record, and unit
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
    """The recorded states of a run, one a row of its history: `states[-1].node_position`."""

    def __init__(self, record: RunRecord | None) -> None:
        self._record = record

    @overload
    def __getitem__(self, which: int) -> Frame: ...
    @overload
    def __getitem__(self, which: slice) -> list[Frame]: ...
    def __getitem__(self, which: int | slice) -> Frame | list[Frame]:
        paths = () if self._record is None else self._record.states
        return [Frame.load(path) for path in paths[which]] if isinstance(which, slice) else Frame.load(paths[which])

    def __len__(self) -> int:
        return 0 if self._record is None else len(self._record.states)

    def __iter__(self) -> Iterator[Frame]:
        return iter(()) if self._record is None else self._record.frames()

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
        """An xarray.Dataset over `record`, by default of everything. Raises ImportError without xarray (extra `notebooks`)."""
        import xarray

        of_state = {name: FIELDS[name] for name in self._fields}
        return xarray.Dataset(
            {
                name: (("record", *dimensions), self[name], {"units": unit} if unit else {})
                for name in (self if names is None else names)
                for dimensions, unit in [of_state.get(name, ((), ""))]
            }
        )
