"""Probes: measures of one's own at every record of a run, as further columns of its history."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Mapping
from contextlib import suppress

from ..base.errors import InputError
from ..measure import table
from ..measure.table import Record

Probe = Callable[[Record], float | None]


class Probes:
    """Named functions of a `Record`. None, nan and infinity are no value: the cell of the history stays empty.

    Raises `InputError` for a name that a column has, or for what is no number.
    """

    def __init__(self, functions: Mapping[str, Probe] | None = None) -> None:
        if not isinstance(functions, Mapping | None):
            raise InputError(f"probes: {functions!r} is not a dict; give functions of a record by name, {{'name': function}}")
        self._functions = dict(functions or {})
        taken = {line.name for line in table.MEASURES}
        for name, function in self._functions.items():
            if not isinstance(name, str) or not name.strip() or not name.isprintable() or name in taken:
                raise InputError(f"probes: {name!r} cannot name a column; give one line of text that is no column of history.csv")
            if not callable(function):
                raise InputError(f"probes: {name}: {function!r} is not a function; give a function of a record")

    @property
    def names(self) -> list[str]:
        """Ordered names."""
        return list(self._functions)

    def values(self, record: Record) -> dict[str, float | None]:
        """Values of a record by name."""
        return {name: self._number(name, function(record), record) for name, function in self._functions.items()}

    @staticmethod
    def _number(name: str, value: object, record: Record) -> float | None:
        if value is None:
            return None
        if hasattr(value, "item"):  # an array of one element, or a number of NumPy
            with suppress(ValueError, RuntimeError):
                value = value.item()
        if not isinstance(value, numbers.Real):
            raise InputError(f"probes: {name}: {value!r} at record {record.index} is not a number; return one, or None")
        return float(value) if math.isfinite(value) else None
