"""The load of a stage as a function of the load factor."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..measure.strain import clamp_rotation, rotation, stretch
from ..mesh.rim import LoadPoint, Rim
from ..scene import Stage
from .progress import LoadStart


def temperature_at(stage: Stage, start: LoadStart, factor: float) -> float:
    """[K] at a load factor of a stage."""
    return start.temperature + factor * (stage.temperature - start.temperature)


def strained(load: LoadPoint, gradient: np.ndarray) -> LoadPoint:
    """A load with the strains of another `gradient` (2, 2) where its tension is given."""
    if load.tension is None:
        return load
    there = stretch(load.gradient)
    there[np.diag_indices(2)] = np.where(np.isfinite(load.tension), np.diag(stretch(gradient)), np.diag(there))
    return replace(load, gradient=rotation(clamp_rotation(load.gradient)).T @ there)


def increments_between(begin: LoadPoint, end: LoadPoint, rim: Rim | None, largest: float) -> int:
    """Number of increments between two loads, with strains of at most `largest`."""
    strain = float(np.abs(end.gradient - begin.gradient).max())
    if rim is not None and begin.stations is not None and end.stations is not None:
        strain = max(strain, rim.strain(end.stations - begin.stations))  # a pull strains the mesh near it most
    return max(1, math.ceil(strain / largest - 1e-9))
