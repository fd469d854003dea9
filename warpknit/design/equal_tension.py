"""The mesh under equal tensions in weft and warp, from the mesh as knitted on: answers for the report, and what heat does."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from ..errors import Diverged
from ..runner.answers import answers_of, mean_tension
from ..runner.history import Row, row_of
from ..scene import Scene, Stage
from ..solve.simulate import Simulation
from ..sweep.states import mesh_of
from ..text import celsius
from .service import ServicePoint

BEGIN = 0.125  # of the largest tension of the map: end of the first stage, so that small tensions are resolved
LEAST_LEVELS = 2  # of a stage, which has half the levels of a run: each starts where the one before it ends


@dataclass(frozen=True)
class EqualTensionRun:
    """Records of a run under equal tensions, and its answers (runner/answers.py)."""

    rows: Sequence[Row]
    answers: dict[str, Any] | None  # None without a tension to run to
    heated: Sequence[Row] = ()  # the mesh at one tension while its temperature changes


def run_equal_tension(
    scene: Scene,
    largest: float,
    held: float | None,
    service: Sequence[ServicePoint],
    watch: Callable[[float], None] = lambda _: None,
) -> EqualTensionRun:
    """A run to `largest` [N/m] and beyond, and one that holds a tension at the temperatures of [[path]].

    The first goes twice as far with each stage, to the largest of the `service` tensions, whose contacts its answers give, or to
    first yield. held [N/m]: tension of the second; default: the best one. `watch` is called with the share that is done. A run
    that does not converge ends with the records before.
    """
    if largest <= 0.0:
        return EqualTensionRun((), None)
    model = mesh_of(scene)
    tensions = [BEGIN * largest]
    while tensions[-1] < max(largest, *(point.tension for point in service)):
        tensions.append(2.0 * tensions[-1])
    stages = [_stage(scene, tension, "equal tension") for tension in tensions]  # of one name: they are one stage of the answers
    rows = _records(scene, stages, lambda share: watch(0.5 * share), until=scene.wire.yield_stress)
    answers = answers_of(model, rows)
    if answers is None or len(rows) < 2:
        return EqualTensionRun(rows, None)
    best = answers["best"]
    tension = held or (None if best is None else mean_tension(Row(**best)))
    temperatures = list(dict.fromkeys(stage.temperature for stage in scene.stages))[1:]
    heated: list[Row] = []
    if tension is not None and temperatures:
        begin = _stage(scene, tension, "equal tension")
        stages = [replace(begin, name=celsius(temperature), temperature=temperature) for temperature in temperatures]
        heated = _records(scene, [begin, *stages], lambda share: watch(0.5 + 0.5 * share))
        heat = answers_of(model, heated)
        answers |= {"heat": [] if heat is None else heat["heat"]}
    points = [_point(point) for point in service]
    return EqualTensionRun(rows, answers | {"service": points}, heated)


def _stage(scene: Scene, tension: float, name: str) -> Stage:
    load = replace(scene.stages[0], strain_weft=None, strain_warp=None, shear=0.0, name=name)
    return replace(load, tension_weft=tension, tension_warp=tension)


def _records(scene: Scene, stages: Sequence[Stage], watch: Callable[[float], None], until: float = math.inf) -> list[Row]:
    """Rows of history.csv of a run of these stages, to the one behind the first with a stress above `until` [Pa].

    Two records behind a closing give its place (answers.py), also of one just below first yield.
    """
    rows: list[Row] = []
    output = replace(scene.output, frames=max(LEAST_LEVELS, scene.output.frames // 2))
    with suppress(Diverged):
        for record in Simulation(mesh_of(replace(scene, stages=tuple(stages), output=output, sweep=None))).run():
            rows.append(row_of(record))
            watch((record.stage_index + record.load_factor) / len(stages))
            if len(rows) > 1 and rows[-2].stress_max_Pa > until:
                break
    return rows


def _point(point: ServicePoint) -> dict[str, Any]:
    """A service point as the answers of a run have it."""
    tensions = dict.fromkeys(("tension_weft_N_per_m", "tension_warp_N_per_m"), point.tension)
    state = None if point.strains is None else dict(zip(("strain_weft", "strain_warp"), point.strains, strict=True)) | tensions
    active = point.active_percent if state else None
    why = {} if point.why == ServicePoint.why else {"why": point.why}
    return {"tension_N_per_m": point.tension, "active_percent": active, "state": state, "resolved": True} | why
