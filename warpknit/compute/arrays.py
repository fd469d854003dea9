"""Dataclasses of device arrays, in single or double precision: a field has the type of its array and what it counts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar

import numpy as np
import warp as wp

from .host import shared, zeros

T = TypeVar("T")
VECTORS: dict[type, tuple[type, type]] = {wp.float32: (wp.vec3f, wp.vec4f), wp.float64: (wp.vec3d, wp.vec4d)}


@dataclass(frozen=True)
class Precision:
    """The Warp types of a run; see kernels/__init__.py."""

    name: str
    real: type
    coordinate: type
    unit: float  # [m] of one count of a coordinate

    @property
    def vec3(self) -> type:
        """Vectors of three numbers `real`."""
        return VECTORS[self.real][0]

    @property
    def vec4(self) -> type:
        """Vectors of four numbers `real`."""
        return VECTORS[self.real][1]

    def counts(self, metres: np.ndarray) -> np.ndarray:
        """Lengths [m] in counts, ready to upload."""
        if self.coordinate is wp.int32:
            return np.rint(np.asarray(metres) / self.unit).astype(np.int64).astype(np.int32)
        return np.asarray(metres, dtype=np.float64) / self.unit


def precision_of(name: str, displacement_range: float) -> Precision:
    """The types of "single" or "double".

    `displacement_range` [m]: bound on all displacements, and on the distance of a body from its wire.

    Counts of positions wrap around; their differences are exact within this range.
    """
    if name == "double":
        return Precision("double", wp.float64, wp.float64, 1.0)
    # a power of two, so that counts convert exactly
    return Precision("single", wp.float32, wp.int32, 2.0 ** math.ceil(math.log2(displacement_range / 2**31)))


DOUBLE = precision_of("double", 1.0)


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
