"""The mesh under equal tensions in weft and warp, from the mesh as knitted on.

One path serves the service tensions, the material card at a tension, the answers of a report, and what heat does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from ..errors import Diverged
from ..runner.answers import SERVICE_TENSIONS, Answer, mean_tension
from ..runner.history import Row, row_of
from ..runner.warnings_of import branch_changes, tensions_text
from ..scene import Scene
from ..sweep.states import Mesh
from ..text import celsius
from .card import MaterialCard
from .fine_states import exact_model
from .load_path import AS_KNITTED, LoadPath, PathState, part_of, under_tension
from .service import EqualTension, ServicePoint, point_of_card

BEGIN = 0.125  # of the least tension of interest: end of the first stage, so that small tensions are resolved
LEAST = 2.0**-12  # of the largest one: end of the first stage, at least
LEAST_LEVELS = 2  # of a stage that doubles the tension, which has half the levels of a run
APART = 1.05  # ratio of the tensions at the ends of two stages, at least, but for those that are wanted
YIELDED = "beyond first yield"
NO_PATH = "no strains of equal tension in the map"
JUMPS_TOLD = 4
HEAT_TOLERANCE = 1e-3  # residual, at most: heat changes tensions by little more


@dataclass(frozen=True)
class EqualTensionPath:
    """Rows of history.csv of a path under equal tensions, and its states at the ends of its stages."""

    rows: Sequence[Row] = ()
    states: Mapping[float, PathState] = field(default_factory=dict)  # by tension [N/m]
    at: Mapping[float, Row] = field(default_factory=dict)  # the rows of these states
    ended: str = ""  # why, where it did not go to its largest tension


def load_equally(
    model: Mesh, largest: EqualTension, requested: float | None, watch: Callable[[float], None] = lambda _: None
) -> EqualTensionPath:
    """The path over the `requested` tension [N/m] to first yield, else to the largest of the service tensions and of the map.

    Empty without a requested tension where the `largest` of the map is zero. A path that does not converge ends with the records
    before. `watch` is called with the share that is done. model: in double precision.
    """
    scene = model.scene
    if largest.largest == 0.0 and requested is None:
        return EqualTensionPath()
    wanted = service_tensions(scene, requested)
    ends = [0.0, *_ends(wanted, largest.largest)]
    path = LoadPath(model)
    rows: list[Row] = []
    states: dict[float, PathState] = {}
    at: dict[float, Row] = {}
    try:
        for number, (low, high) in enumerate(pairwise(ends)):
            for record in path.load(under_tension(scene, high), _levels(scene, low, high), part_of(watch, number, len(ends) - 1)):
                rows.append(row_of(record))
                if low >= (requested or 0.0) and _has_yielded(scene, rows):
                    return EqualTensionPath(rows, states, at, YIELDED)
            states[high], at[high] = path.state, rows[-1]
    except Diverged as error:
        return EqualTensionPath(rows, states, at, str(error))
    return EqualTensionPath(rows, states, at)


def service_tensions(scene: Scene, requested: float | None) -> list[float]:
    """The SERVICE_TENSIONS, that of the scene, and the `requested` one [N/m]."""
    return sorted({*SERVICE_TENSIONS, *(one for one in (scene.output.service_tension, requested) if one is not None)})


def _ends(wanted: Sequence[float], largest: float) -> list[float]:
    """Tensions [N/m] at the ends of the stages: those that are wanted, and steps of two between them."""
    top = max(largest, *wanted)
    step, steps = max(BEGIN * min(one for one in (largest, *wanted) if one > 0.0), LEAST * top), []
    while step < top:
        steps.append(step)
        step *= 2.0
    fixed = {*wanted, top}
    return sorted(fixed | {one for one in steps if all(max(one / other, other / one) > APART for other in fixed)})


def _levels(scene: Scene, low: float, high: float) -> int:
    """Levels from one tension to the next."""
    doubling = max(LEAST_LEVELS, scene.output.frames // 2)
    return doubling if low == 0.0 else max(1, math.ceil(doubling * math.log2(high / low)))


def _has_yielded(scene: Scene, rows: Sequence[Row]) -> bool:
    """Whether two records are beyond first yield: they give the place of a closing (answers.py) just below it too."""
    return len(rows) > 1 and bool(rows[-2].stress_max_Pa > scene.wire.yield_stress)


def service_points(
    scene: Scene, path: EqualTensionPath, requested: float | None, card: MaterialCard | None
) -> list[ServicePoint]:
    """The mesh at `service_tensions`: on the path, and by the `card` of the requested tension."""
    points = []
    for tension in service_tensions(scene, requested):
        if (row := path.at.get(tension)) is None:
            why = path.ended if path.ended == YIELDED else "no equilibrium found" if path.ended else NO_PATH
            points.append(ServicePoint(tension, why=why))
        elif tension == requested and card is not None:
            points.append(point_of_card(card, tension))
        else:
            points.append(ServicePoint(tension, (row.strain_weft, row.strain_warp), row.active_percent, row.stress_max_Pa))
    return points


def with_service(answers: Answer, service: Sequence[ServicePoint], heated: Answer | None) -> Answer:
    """Answers with these service points, and what heat does by the answers of a run that changes the temperature."""
    return answers | {"heat": [] if heated is None else heated["heat"], "service": [_point(point) for point in service]}


def heat(scene: Scene, path: EqualTensionPath, held: float | None, watch: Callable[[float], None] = lambda _: None) -> list[Row]:
    """Rows of a run that holds a tension [N/m] at the temperatures of [[path]]; none without them, or without a tension.

    It begins where the path has a tension as small or smaller. `watch` is called with the share that is done; a run that does not
    converge ends with the records before.
    """
    temperatures = list(dict.fromkeys(stage.temperature for stage in scene.stages))[1:]
    if held is None or not temperatures or len(path.rows) < 2:
        return []
    rows: list[Row] = []
    low = max((tension for tension in path.states if tension <= held), default=0.0)
    warm = LoadPath(exact_model(scene, HEAT_TOLERANCE), path.states.get(low, AS_KNITTED))
    begin = under_tension(scene, held)
    with suppress(Diverged):
        levels = 1 if low == held else _levels(scene, low, held)
        *_, record = warm.load(begin, levels)
        rows.append(row_of(record))
        for number, temperature in enumerate(temperatures):
            stage = replace(begin, name=celsius(temperature), temperature=temperature)
            levels = max(LEAST_LEVELS, scene.output.frames // 2)
            for record in warm.load(stage, levels, part_of(watch, number, len(temperatures))):
                rows.append(row_of(record))
    return rows


def jump_text(model: Mesh, path: EqualTensionPath) -> str | None:
    """Sentence on the jumps of a path between several equilibria, or None."""
    tensions = np.maximum.accumulate([mean_tension(row) for row in path.rows])
    rows = [row for row, more in zip(path.rows, np.diff(tensions, prepend=-1.0) > 0.0, strict=True) if more]
    found = branch_changes(model, rows, np.array([mean_tension(row) for row in rows])) if len(rows) > 1 else []
    if not found:
        return None
    places = "; ".join(tensions_text(*pair) for pair in found[:JUMPS_TOLD]) + ("; ..." if len(found) > JUMPS_TOLD else "")
    count = f"{len(found)} place{'s' if len(found) > 1 else ''}"
    return (
        f"Under equal tensions the mesh jumps to another equilibrium in {count} (between {places}): it has several equilibria"
        " under one load, and a mesh that is loaded otherwise, as in the map or a run, may give other answers."
    )


def _point(point: ServicePoint) -> Answer:
    """A service point as the answers of a run have it."""
    tensions = dict.fromkeys(("tension_weft_N_per_m", "tension_warp_N_per_m"), point.tension)
    state = None if point.strains is None else dict(zip(("strain_weft", "strain_warp"), point.strains, strict=True)) | tensions
    active = point.active_percent if state else None
    why = {"why": point.why} if point.why else {}
    return {"tension_N_per_m": point.tension, "active_percent": active, "state": state, "resolved": True} | why
