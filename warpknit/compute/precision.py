"""The Warp types of a run, in single or double precision."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

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
