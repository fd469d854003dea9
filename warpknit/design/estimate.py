"""Time of a report, from the estimates of runs: a map, and paths of so many levels as its curves, its card and its heat have."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from ..mechanics.estimate import Size, levels_of_pairs
from ..scene import Scene, Stage
from ..solve.model import estimates_of
from .curves import LOADS, POINTS
from .fine_states import DIFFERENCE_TOLERANCE
from .heat import LEAST_LEVELS, TOLERANCE, later_temperatures

PAGE_TIME = 12.0  # [s] of models, figures and the page, however small the mesh
EQUAL_STAGES = 2  # stages of a run by tension that cost as much as equal tensions up to first yield
CARD_STATES = 15  # beside the state of a card


def report_time(scene: Scene, size: Size) -> tuple[float, float]:
    """[s] of the map of a report, and of all else: curves, equal tensions, card, heat, page.

    scene: with a sweep.
    """
    assert scene.sweep is not None
    estimates, frames = estimates_of(scene), scene.output.frames

    def path_time(stages: Sequence[Stage], levels: int, tolerance: float) -> float:
        solver = replace(scene.solver, residual_tolerance=min(scene.solver.residual_tolerance, tolerance))
        path = replace(scene, stages=tuple(stages), solver=solver, output=replace(scene.output, frames=levels))
        return estimates.cost_of(path, size).seconds

    load = scene.stages[0]
    strained = replace(load, strain_weft=0.1, strain_warp=0.1, tension_weft=None, tension_warp=None)
    tensioned = replace(load, strain_weft=None, strain_warp=None, tension_weft=1.0, tension_warp=1.0)
    seconds = path_time(len(LOADS) * [strained], POINTS * math.ceil(frames / POINTS), math.inf)
    seconds += path_time([tensioned], EQUAL_STAGES * frames, math.inf)
    seconds += path_time([strained], frames + CARD_STATES, DIFFERENCE_TOLERANCE)
    if temperatures := later_temperatures(scene):
        seconds += path_time(len(temperatures) * [tensioned, strained], max(LEAST_LEVELS, frames // 2), TOLERANCE)
    by_map = scene.sweep.seeds * estimates.map_time(scene, size, levels_of_pairs(scene.sweep.pairs, frames))
    return by_map, PAGE_TIME + seconds
