"""Answers from the rows of a run: closing contacts, service tensions, yield, heat, best tension.

A class of contacts is closed where half of its pairs carry more than the threshold. A closing lasts up to the largest tension of
a load step, among the records below first yield if possible: spatial wires may graze each other and part again long before they
carry load there. A service tension has the share of both records around, where the run passes it.

Answers are read from the records. An event between two records has the state of the second one, and both as its bounds. With
`output.frames = "auto"` the two are within `output.load_tolerance` of the load. Tensions are known to a tolerance: smaller ones
are zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from .. import measure
from ..measure import MeshModel
from ..mechanics.driven_strain import TOLERANCE
from ..mesh.tight_loops import tension_error
from ..results.row import Row, Values
from ..scene import Scene, Stage
from .best_tension import DRIFT, Best, best_tension
from .branches import STATE, Event, Jump, Rows, is_heated, ranges_of, row_between, state_of
from .history import mean_tension, stages_of

PEAK = ("stress_max_part", "stress_max_wire", "stress_max_node", "stress_max_x_m", "stress_max_y_m")
ZERO_TENSION = 0.01  # of EI/C^3: tensions of loose meshes are found to the tolerance of this (mechanics/driven_strain.py)
HEATED = (*STATE, "active_percent", "stress_max_Pa")
SERVICE_TENSIONS = (2.0, 3.4, 4.9)  # [N/m] of meshes in orbit (VSOP-2, ASP Conf. Ser. 402, 66)
COMPRESSED = "compressed in weft or warp where the mean tension is this"
SCATTER = 1e-3  # of a mean tension: a smaller one in one direction is about zero


class Closing(Event):
    """First record in which half of a class's pairs exceed the threshold."""

    closed_percent: float  # share of its pairs that are closed in the second record of `between`
    first_touch: Row | None  # an earlier record in which the class was closed before it opened again; null without one
    opens: Row | None  # first later record in which less than half of its pairs are closed, with its `stage`; null without one


class ClosedRange(Values):
    """A range of records in which a class is closed: the states `from` and `to`, each with its `stage`."""

    closed_percent: float  # largest share of its pairs that are closed in the range
    lasts: bool  # true where the last record is in the range


class ClassAnswer(Values):
    """Closing of a class of contacts."""

    name: str
    pairs: int
    active_percent: float
    closes: Closing | None  # None: they stay open
    closed: Sequence[ClosedRange]  # ranges of records in which the class is closed


class Service(Values):
    """The share of active contacts at a service tension."""

    tension_N_per_m: float
    active_percent: float | None
    state: Row | None
    resolved: bool  # false where the records on both sides have different shares
    stage: str | None  # load step of this state; null without one
    jump: Sequence[Row] | None  # records on both sides of a snap-through at this tension, in place of a state
    between: Sequence[Row] | None  # records on both sides, each with `active_percent`, where not resolved; null otherwise
    why: str  # why there is no share, or what limits it; left out otherwise


class Heat(Values):
    """Effects of a change of temperature. The values of HEATED are pairs, at begin and end."""

    stage: str
    held: Sequence[str]  # what is constant in weft and in warp: `tension` or `strain`
    peak: Row  # largest stress of its records, and the temperature there
    jump: bool  # whether the load step has a snap-through: between records of `jumps`
    jump_between: Sequence[Row] | None  # the records on both sides of the first of these jumps; null without one


class Answers(Values):
    """The section `answers` of summary.json, in SI units."""

    contacts: Sequence[ClassAnswer]  # classes of contact
    service: Sequence[Service]  # where the mean of weft and warp first reaches a tension, in each load step
    first_yield: Event | None  # the first record with a largest stress above the yield stress; None: there is none
    first_yield_interior: Event | None  # first yield away from the grips; without a place
    largest_stress: Row  # the largest stress of the run, and its place
    largest_tension: Row  # the state of the largest tension
    asked_tension_N_per_m: float | None  # largest mean tension in the scene; None: no load step gives both
    tension_tolerance_N_per_m: float  # smaller tensions are zero within the tolerance of the equilibria
    tension_error_percent: float | None  # known error of tensions at the preset; None: not known
    heat: Sequence[Heat]  # load steps that change the temperature only: values at begin and end of each
    best: Best | None  # middle of the widest range of tensions with the most active contacts, up to first yield


def zero_tension(model: MeshModel) -> float:
    """Tension [N/m] below which a tension is zero within the tolerance of the equilibria."""
    return ZERO_TENSION * model.scene.solver.residual_tolerance * measure.tension_scale(model)


def answers_of(model: MeshModel, rows: Sequence[Row], jumps: Sequence[Jump] = ()) -> Answers | None:
    """The answers from the rows of a run; None of two hooked wires, which have no tension.

    jumps: neighbouring rows of different branches of equilibria (branches.py).
    """
    if not rows or model.scene.hook is not None:
        return None
    run, scene = Rows(rows, jumps, model.scene.output.load_tolerance), model.scene
    threshold, limit = measure.active_threshold(model), scene.wire.yield_stress
    inner = "stress_interior_max_Pa" if "stress_interior_max_Pa" in rows[0] else "stress_max_Pa"
    first, inside = (next((k for k, row in enumerate(rows) if row[name] > limit), None) for name in ("stress_max_Pa", inner))
    inner_yield = None if inside is None else run.first(inside).changed(stress_max_Pa=rows[inside][inner])
    known = run if inside is None else replace(run, rows=rows[: inside + 1])  # larger loads do not change the best tension
    return Answers(
        contacts=[class_answer(run, name, pairs, threshold, inside) for name, pairs in measure.classes_of(model).items()],
        service=service_shares(run, scene),
        first_yield=None if first is None else run.first(first).changed(**vars(_peak(rows[first]))),
        first_yield_interior=inner_yield,
        largest_stress=_peak(max(rows, key=lambda row: row.stress_max_Pa)),
        largest_tension=state_of(max(rows, key=mean_tension)),
        asked_tension_N_per_m=asked_tension(scene.stages),
        tension_tolerance_N_per_m=zero_tension(model),
        tension_error_percent=tension_error(scene),
        heat=heat_of(rows, scene.stages, jumps),
        best=best_tension(known, limit, inner, inner_yield),
    )


def _peak(row: Row) -> Row:
    return Row(stress_max_Pa=row.stress_max_Pa, **{name: row.get(name) for name in PEAK})


# --- closings of classes of contact


def class_answer(run: Rows, name: str, pairs: int, threshold: float, yields: int | None = None) -> ClassAnswer:
    """Closing of a class of contact, and the ranges in which it is closed.

    threshold [N]: of an active pair. yields: the first row above the elastic limit.
    """
    rows, share = run.rows, f"active_{name}_percent"
    closed = ranges_of([row[f"force_{name}_N"] > threshold for row in rows])
    return ClassAnswer(
        name=name, pairs=pairs, active_percent=rows[-1][share],
        closes=_closing(run, closed, share, yields) if closed else None,
        closed=[
            ClosedRange(
                **{"from": state_of(rows[one[0]], "stage"), "to": state_of(rows[one[-1]], "stage")},
                closed_percent=max(rows[k][share] for k in one), lasts=one.stop == len(rows),
            )
            for one in closed
        ],
    )  # fmt: skip


def _closing(run: Rows, closed: Sequence[range], share: str, yields: int | None) -> Closing:
    """The begin of the range that counts. share: column of the closed pairs."""
    rows, found = run.rows, _closed_at_top(run.rows, closed, yields)
    return Closing(
        **vars(run.first(found.start)),
        closed_percent=rows[found.start][share],
        first_touch=None if found is closed[0] else state_of(rows[closed[0].start]),
        opens=None if found.stop == len(rows) else state_of(rows[found.stop], "stage"),
    )


def _closed_at_top(rows: Sequence[Row], closed: Sequence[range], yields: int | None) -> range:
    """The range with a load step's largest tension, preferably before the wire `yields`; else the first range."""
    for known in (rows[:yields], rows):
        begin = 0
        for part in stages_of(known):
            top = begin + max(range(len(part)), key=lambda k: mean_tension(part[k]))
            if found := next((one for one in closed if top in one), None):
                return found
            begin += len(part) - 1
    return closed[0]


# --- service tensions


def service_shares(run: Rows, scene: Scene) -> list[Service]:
    """Shares at the service tension of the scene; without one, at those SERVICE_TENSIONS that are reached or asked for."""
    given, asked = scene.output.service_tension, asked_tension(scene.stages)
    wanted = SERVICE_TENSIONS if given is None else (given,)
    error = max(TOLERANCE, scene.solver.residual_tolerance)
    shares = [_share(run, tension, around) for tension in wanted for around in _passages(run.rows, tension, error)]
    return [one for one in shares if given is not None or one.state or one.jump or one.tension_N_per_m <= (asked or 0.0)]


def _passages(rows: Sequence[Row], tension: float, error: float) -> list[Jump | None]:
    """Neighbouring rows between which the mean tension passes `tension` [N/m]: the first in each load step.

    Changes of temperature after the first passage are left out. A row within the `error` of the tension stands twice. Without any
    passage the result is one None.
    """
    slack = error * tension
    passages: list[Jump | None] = [(rows[0], rows[0])] if mean_tension(rows[0]) >= tension - slack else []
    for part in stages_of(rows):
        offsets = [mean_tension(row) - tension for row in part]
        if abs(offsets[0]) <= slack or (passages and is_heated(part)):
            continue  # the first row is the end of the stage before
        side = math.copysign(1.0, offsets[0])
        k = next((k for k, one in enumerate(offsets) if side * one <= slack), None)
        if k is not None:
            passages.append((part[k], part[k]) if abs(offsets[k]) <= slack else (part[k - 1], part[k]))
    return passages or [None]


def _share(run: Rows, tension: float, around: Jump | None) -> Service:
    """The share of active contacts between two rows, or in one given twice; None: tension not reached.

    `resolved`: whether both rows have the same share. Within a jump there is no state.
    """
    point = Service(
        tension_N_per_m=tension, active_percent=None, state=None, resolved=True, stage=around and around[1].stage,
        jump=None, between=None,
    )  # fmt: skip
    if around is None:
        return point
    before, after = around
    ends = [state_of(row, "active_percent") for row in around]
    if run.is_jump(before, after) and tension != mean_tension(after):
        return point.changed(resolved=False, jump=ends)
    there = after
    if before is not after:
        there = row_between(before, after, (tension - mean_tension(before)) / (mean_tension(after) - mean_tension(before)))
    if min(there.tension_weft_N_per_m, there.tension_warp_N_per_m) < -SCATTER * tension:
        return point.changed(why=COMPRESSED)
    if tension != mean_tension(after) and abs(after.active_percent - before.active_percent) > DRIFT:
        return point.changed(state=state_of(there), resolved=False, between=ends)
    return point.changed(state=state_of(there), active_percent=there.active_percent)


def asked_tension(stages: Sequence[Stage]) -> float | None:
    """[N/m] the largest mean tension of stages that give both tensions; None without one."""
    both = [(stage.tension_weft, stage.tension_warp) for stage in stages if all(stage.by_tension)]
    return max((0.5 * ((weft or 0.0) + (warp or 0.0)) for weft, warp in both), default=None)


# --- heat


def heat_of(rows: Sequence[Row], stages: Sequence[Stage], jumps: Sequence[Jump]) -> list[Heat]:
    """Stages that change the temperature, and hold strain or tension in either direction: values at begin and end."""
    run, found = Rows(rows, jumps), []
    by_tension = {stage.name: stage.by_tension for stage in stages}
    for part in filter(is_heated, stages_of(rows)):
        peak = max(part, key=lambda row: row.stress_max_Pa)
        jump = next((both for both in pairwise(part) if run.is_jump(*both)), None)
        found.append(Heat(
            stage=part[-1].stage, held=["tension" if one else "strain" for one in by_tension[part[-1].stage]],
            **{name: [row[name] for row in (part[0], part[-1])] for name in HEATED},
            peak=Row(stress_max_Pa=peak.stress_max_Pa, temperature_K=peak.temperature_K),
            jump=jump is not None, jump_between=None if jump is None else [state_of(row) for row in jump],
        ))  # fmt: skip
    return found
