"""Dataclasses of device arrays: a field has the type of its array and what it counts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, fields
from typing import Any, TypeVar

import numpy as np

from .host import shared, zeros
from .precision import DOUBLE, Precision

T = TypeVar("T")


def array(kind: Any, count: str = "node", columns: int = 0) -> Any:
    """A field [count] or (count, columns); kind: a type, or the name of one that depends on the precision."""
    return field(metadata={"kind": kind, "count": count, "columns": columns})


def names_of(arrays: type, *counts: str) -> tuple[str, ...]:
    """The fields that count one of these."""
    return tuple(one.name for one in fields(arrays) if one.metadata.get("count") in counts)


def new_arrays(
    arrays: type[T],
    device: str,
    counts: dict[str, int],
    values: Mapping[str, Any],
    precision: Precision = DOUBLE,
    worlds: tuple[int, ...] = (),
) -> T:
    """Arrays of zeros, or of `values` by name: on the CPU in their memory if the types agree. worlds: first axis of the zeros."""
    made: dict[str, Any] = dict(values)
    for one in fields(arrays):  # type: ignore[arg-type]
        value, kind = values.get(one.name), one.metadata.get("kind")
        kind = getattr(precision, kind) if isinstance(kind, str) else kind
        if isinstance(value, np.ndarray) and kind is not None:
            made[one.name] = shared(value, kind, device)
        elif value is None and kind is not None:
            count, columns = np.atleast_1d(counts[one.metadata["count"]]).tolist(), one.metadata["columns"]
            made[one.name] = zeros((*worlds, *count, *([columns] if columns else [])), kind, device)
    return arrays(**made)
