"""The load of a stage as a function of the load factor."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..measure.strain import clamp_rotation, rotation, stretch
from ..mesh.rim import LoadPoint, Rim
from ..scene import Scene, Stage
from .progress import LoadStart


def temperature_at(stage: Stage, start: LoadStart, factor: float) -> float:
    """[K] at a load factor of a stage."""
    return start.temperature + factor * (stage.temperature - start.temperature)


def load_at(
    scene: Scene, stage_index: int, stage: Stage, factor: float, start: LoadStart, gradient: np.ndarray, rim: Rim | None
) -> LoadPoint:
    """The load at a load factor of a stage that began at `start`.

    Directions driven by tension keep their strain in `gradient` (2, 2). The first stage raises the edge to its paraboloid.
    """
    start_gradient = np.array(start.gradient).reshape(2, 2)
    turn, first, now = clamp_rotation(start_gradient), stretch(start_gradient), stretch(gradient)
    target = first.copy()
    expansion = 1.0 + scene.model.frame_expansion * (stage.temperature - scene.wire.reference_temperature)
    for axis, strain in enumerate((stage.strain_weft, stage.strain_warp)):
        end = (1.0 + strain) * expansion if strain is not None else None
        target[axis, axis] = now[axis, axis] if end is None else (1 - factor) * first[axis, axis] + factor * end
    target[0, 1] = (1 - factor) * first[0, 1] + factor * stage.shear * expansion
    turn += factor * (stage.clamp_rotation - turn)
    target = rotation(-turn) @ target
    before = scene.stages[stage_index - 1] if stage_index else None
    slope = np.array(before.temperature_gradient if before else (0.0, 0.0))
    slope = (1 - factor) * slope + factor * np.array(stage.temperature_gradient)
    stations, raised = None, 0.0
    if rim is not None:
        raised = 0.0 if scene.panel.focal_length is None else 1.0 if stage_index else factor
        stations = (1 - factor) * rim.pulled(before.pull if before else ()) + factor * rim.pulled(stage.pull)
    return LoadPoint(target, temperature_at(stage, start, factor), tuple(slope.tolist()), stations, raised=raised)


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
