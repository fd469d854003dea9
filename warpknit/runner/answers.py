"""Answers from the rows of a run: closing contacts, yield, heat, best tension.

Answers are read from the records. An event between two records has the state of the second one, and both as its bounds. With
`output.frames = "auto"` the two are within `output.load_tolerance` of the load. A class of contacts closes where half of its
pairs carry more than the threshold. Its closing lasts up to the largest tension of a load step, among the records below first
yield if possible: spatial wires may graze each other and part again long before they carry load there.

The best tension is the middle of the widest range with the most active contacts. Tensions are known to a tolerance: smaller
ones are zero.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby, pairwise

import numpy as np

from .. import measure
from ..measure import MeshModel
from ..measure.contact_classes import classes_of
from ..mechanics.driven_strain import TOLERANCE
from ..mesh.tight_loops import tension_error
from ..results.row import Row, Values
from ..scene import Stage
from .branches import HELD_TENSION, STATE, Event, Jump, Rows, is_heated, state_of
from .history import mean_tension, stages_of

SERVICE_TENSIONS = (2.0, 3.4, 4.9)  # [N/m] of meshes in orbit (VSOP-2, ASP Conf. Ser. 402, 66)
COMPRESSED = "compressed in weft or warp where the mean tension is this"
SCATTER = 1e-3  # of a mean tension: a smaller one in one direction is about zero
HEATED = (*STATE, "active_percent", "stress_max_Pa")
PEAK = ("stress_max_part", "stress_max_wire", "stress_max_node", "stress_max_x_m", "stress_max_y_m")
DRIFT = 1.0  # percentage points of contacts that may open while the tension drifts, or half a pair
SAME = 1e-9  # of a tension: round-off
ZERO_TENSION = 0.01  # of EI/C^3: tensions of loose meshes are found to the tolerance of this (mechanics/driven_strain.py)


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
    closes: Closing | None  # the first record in which half of the pairs carry more than the threshold, its `stage`, and the
    # records `between`
    closed: Sequence[ClosedRange]  # ranges of records in which the class is closed, by their states `from` and `to` with their
    # `stage`. Several where the class opened again, empty where it stays open


class Service(Values):
    """The share of active contacts at a service tension."""

    tension_N_per_m: float
    active_percent: float | None
    state: Row | None
    resolved: bool  # false where the records on both sides have different shares
    stage: str | None  # load step of this state; null without one
    jump: Sequence[Row] | None  # in place of a state: records on both sides of a snap-through at this tension, each with
    # `active_percent`; null without one
    between: Sequence[Row] | None  # records on both sides, each with `active_percent`, where not resolved; null otherwise
    why: str  # why there is no share, or what limits it; left out otherwise


class Heat(Values):
    """Effects of a change of temperature. The values of HEATED are pairs, at begin and end."""

    stage: str
    held: Sequence[str]  # what is constant in weft and in warp: `tension` or `strain`
    peak: Row  # largest stress of its records, and the temperature there
    jump: bool  # whether the load step has a snap-through: between records of `jumps`
    jump_between: Sequence[Row] | None  # the records on both sides of the first of these jumps; null without one


class Best(Row):
    """State of the best tension, and its range of records."""

    low: Row  # lower end of the range. If the range is a single record: the tension below `best`
    # down to which at most one percentage point of contacts opens
    open_low: bool  # true where the records begin there
    low_jump: bool  # true where a snap-through lies between the records of `low_between`
    low_between: Sequence[Row] | None  # records on both sides of the lower end; null where they are within
    # `output.load_tolerance`, or the records end there
    high: Row  # upper end of this range
    open_high: bool  # true where the records end there
    high_jump: bool  # the same as `low_jump` of the upper end
    high_between: Sequence[Row] | None  # the same as `low_between` of the upper end
    stress_with_grips_Pa: float  # the largest stress of this state, at the grips as well
    stage: str  # load step of this state
    grows: bool  # true where only the last record is in the range; `best` is then this record
    next_jump: Sequence[Row] | None  # the states on both sides of the first snap-through at a larger tension, up to first yield;
    # null without one
    jumps: Sequence[Sequence[Row]]  # states on both sides of each snap-through within the range
    stages: int  # number of load steps that were searched, up to first yield
    stress_over_limit: float  # the stress away from the grips over the elastic limit
    first_yield_over_tension: float | None  # mean tension of first yield away from the grips, over the tension of this state;
    # null without such a yield at a known larger tension and the same temperature


class Answers(Values):
    """The section `answers` of summary.json, in SI units."""

    contacts: Sequence[ClassAnswer]  # classes of contact: `name`, `pairs`, `active_percent` at the end, and `closes`; null if
    # they stay open
    service: Sequence[Service]  # `tension_N_per_m` with `active_percent` and the `state` where the mean of weft and warp first
    # reaches this tension. Each later load step that passes this tension, as on unloading, has an entry of its own
    first_yield: Event | None  # the first record with a largest stress `stress_max_Pa` above the yield stress, and the place
    # of this stress; null if there is none
    first_yield_interior: Event | None  # first yield away from the grips; without a place
    largest_stress: Row  # the largest stress of the run, and its place
    largest_tension: Row  # the state of the largest tension
    asked_tension_N_per_m: float | None  # largest mean tension of weft and warp in the scene; null where no load step gives
    # both tensions
    tension_tolerance_N_per_m: float  # smaller tensions are zero within the tolerance of the equilibria
    tension_error_percent: float | None  # known error of tensions at the preset: of tight knits against the reference preset, at
    # nine of ten loads; else the error for the double atlas mesh; null where it is not known
    heat: Sequence[Heat]  # load steps that change the temperature only: values at begin and end of each
    best: Best | None  # state in the middle of the widest range of tensions with the most active contacts, up to first yield
    # away from the grips. A share that only a single record has does not count. Load steps that go on loading at one
    # temperature count as one. A load step that changes the temperature under constant tensions does not count


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
    given, asked = scene.output.service_tension, _asked_tension(scene.stages)
    wanted = SERVICE_TENSIONS if given is None else (given,)
    error = max(TOLERANCE, scene.solver.residual_tolerance)
    inner = "stress_interior_max_Pa" if "stress_interior_max_Pa" in rows[0] else "stress_max_Pa"
    inner_yield = first_yield(run, limit, inner)
    yields = _yielding_row(rows, limit, inner)
    known = rows if yields is None else rows[: yields + 1]  # what is loaded further does not change the best tension
    best = best_tension(Rows(known, jumps, run.tolerance), limit, inner)
    service = [_service_share(run, tension, around) for tension in wanted for around in _passages(rows, tension, error)]
    return Answers(
        contacts=[
            ClassAnswer(
                name=name,
                pairs=pairs,
                active_percent=rows[-1][f"active_{name}_percent"],
                closes=closing(run, name, threshold, yields),
                closed=closed_ranges(rows, name, threshold),
            )
            for name, pairs in classes_of(model).items()
        ],
        service=[one for one in service if given is not None or one.state or one.jump or one.tension_N_per_m <= (asked or 0.0)],
        first_yield=first_yield(run, limit, "stress_max_Pa"),
        first_yield_interior=inner_yield and Event(**{n: value for n, value in vars(inner_yield).items() if n not in PEAK}),
        largest_stress=_peak(max(rows, key=lambda row: row.stress_max_Pa)),
        largest_tension=state_of(max(rows, key=mean_tension)),
        asked_tension_N_per_m=asked,
        tension_tolerance_N_per_m=zero_tension(model),
        tension_error_percent=tension_error(scene),
        heat=heat_of(rows, scene.stages, jumps),
        best=best and with_margin(best, limit, inner_yield),
    )


# --- closings


def closing(run: Rows, name: str, threshold: float, yields: int | None = None) -> Closing | None:
    """The first record in which a class of contact is closed; None if it stays open.

    threshold [N]: of an active pair. yields: the first row above the elastic limit.
    """
    rows = run.rows
    closed = [row[f"force_{name}_N"] > threshold for row in rows]
    k = _closing_row(rows, closed, yields)
    if k is None:
        return None
    touch = next((row for row, one in zip(rows[:k], closed, strict=False) if one), None)
    opens = next((row for row, one in zip(rows[k:], closed[k:], strict=True) if not one), None)
    return Closing(
        **vars(run.first(k)),
        closed_percent=rows[k][f"active_{name}_percent"],
        first_touch=None if touch is None else state_of(touch),
        opens=None if opens is None else state_of(opens).changed(stage=opens.stage),
    )


def _closing_row(rows: Sequence[Row], closed: Sequence[bool], yields: int | None) -> int | None:
    """Record from which a class stays closed to the load step's largest tension.

    Preferably a record before the wire `yields`; else the first record in which the class is closed.
    """
    for known in (rows[:yields], rows):
        begin = 0
        for part in stages_of(known):
            top = begin + max(range(len(part)), key=lambda k: mean_tension(part[k]))
            if closed[top]:
                return max((k + 1 for k in range(top) if not closed[k]), default=0)
            begin += len(part) - 1
    return next((k for k, one in enumerate(closed) if one), None)


def closed_ranges(rows: Sequence[Row], name: str, threshold: float) -> list[ClosedRange]:
    """The ranges of records in which a class is closed: the first state and the last one of each, with their stages.

    threshold [N]: of an active pair. `closed_percent`: largest share of its pairs in the range; `lasts`: to the last record.
    """
    ranges: list[ClosedRange] = []
    end = 0
    for is_closed, group in groupby(rows, lambda row: bool(row[f"force_{name}_N"] > threshold)):
        part = list(group)
        end += len(part)
        if is_closed:
            ends = {side: state_of(row).changed(stage=row.stage) for side, row in (("from", part[0]), ("to", part[-1]))}
            share = max(row[f"active_{name}_percent"] for row in part)
            ranges.append(ClosedRange(**ends, closed_percent=share, lasts=end == len(rows)))
    return ranges


# --- service tensions


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


def _service_share(run: Rows, tension: float, around: Jump | None) -> Service:
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
    ends = [state_of(row).changed(active_percent=row.active_percent) for row in around]
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


def _asked_tension(stages: Sequence[Stage]) -> float | None:
    """[N/m] the largest mean tension of stages that give both tensions; None without one."""
    both = [(stage.tension_weft, stage.tension_warp) for stage in stages if all(stage.by_tension)]
    return max((0.5 * ((weft or 0.0) + (warp or 0.0)) for weft, warp in both), default=None)


# --- yield


def _yielding_row(rows: Sequence[Row], limit: float, stress: str) -> int | None:
    """The first row with a `stress` above the elastic limit [Pa]."""
    return next((k for k, row in enumerate(rows) if row[stress] > limit), None)


def first_yield(run: Rows, limit: float, stress: str) -> Event | None:
    """First record whose `stress` column exceeds the elastic limit [Pa], with the place; or None."""
    k = _yielding_row(run.rows, limit, stress)
    return None if k is None else run.first(k).changed(**vars(_peak(run.rows[k])) | {"stress_max_Pa": run.rows[k][stress]})


def _peak(row: Row) -> Row:
    """Place and value of the largest stress."""
    return Row(stress_max_Pa=row.stress_max_Pa, **{name: row.get(name) for name in PEAK})


# --- heat


def heat_of(rows: Sequence[Row], stages: Sequence[Stage], jumps: Sequence[Jump]) -> list[Heat]:
    """Stages that change the temperature, and hold strain or tension in either direction: values at begin and end."""
    by_tension = {stage.name: stage.by_tension for stage in stages}
    run = Rows(rows, jumps)
    return [_heated(run, part, by_tension[part[-1].stage]) for part in stages_of(rows) if is_heated(part)]


def _heated(run: Rows, part: Sequence[Row], by_tension: Sequence[bool]) -> Heat:
    """The answer of one stage, from the record before it on."""
    peak = max(part, key=lambda row: row.stress_max_Pa)
    jump = next((both for both in pairwise(part) if run.is_jump(*both)), None)
    return Heat(
        stage=part[-1].stage, held=["tension" if one else "strain" for one in by_tension],
        **{name: [row[name] for row in (part[0], part[-1])] for name in HEATED},
        peak=Row(stress_max_Pa=peak.stress_max_Pa, temperature_K=peak.temperature_K),
        jump=jump is not None,
        jump_between=None if jump is None else [state_of(row) for row in jump],
    )  # fmt: skip


# --- best tension


def best_tension(run: Rows, limit: float, stress: str) -> Best | None:
    """Middle of the widest tension range with the most active contacts; or None. No stress there exceeds `limit` [Pa].

    run: up to the first row above the limit. stress: the column that counts. A range is a part of the path of one stage, or of
    stages that continue loading at one temperature. Of several ranges with the most contacts, a range at one temperature comes
    first, then the widest. A stage that holds the tension while the temperature changes does not count.
    """
    parts = [part for part in _loadings(run.rows) if not _holds_tension(part)] or [list(run.rows)]
    every = [(found, part) for part in parts if (found := _best_of(replace(run, rows=part), limit, stress)) is not None]
    if not every:
        return None

    def width(found: Best) -> float:
        return mean_tension(found.high) - mean_tension(found.low)

    most = max(found.active_percent for found, _ in every)
    good = [(found, part) for found, part in every if found.active_percent >= most - DRIFT]
    best, _ = max(good, key=lambda one: (_temperatures(one[1]) == 1, width(one[0])))
    return best.changed(stages=len({row.stage for row in run.rows[1:]}))


def with_margin(best: Best, limit: float, first_yield: Event | None) -> Best:
    """With its distance from yield: by its stress over the elastic `limit` [Pa], by the tension of `first_yield`."""
    times = None
    if first_yield is not None and first_yield.resolved and first_yield.between[1].temperature_K == best.temperature_K:
        times = mean_tension(first_yield) / mean_tension(best)
        times = times if times >= 1.0 - SAME else None  # it yields where it is unloaded, or compressed
    return best.changed(stress_over_limit=best.stress_max_Pa / limit, first_yield_over_tension=times)


def _best_of(run: Rows, limit: float, stress: str) -> Best | None:
    """Best tension of one part of the path. Contacts that only one of its records has do not count."""
    rows = run.rows

    def share(row: Row) -> float:
        tensile = row.tension_weft_N_per_m > 0.0 and row.tension_warp_N_per_m > 0.0
        return float(row.active_percent) if tensile and row[stress] <= limit else 0.0

    shares = [share(row) for row in rows]
    if max(shares) == 0.0:
        return None
    lasting = [min(shares[k : k + 2]) for k in range(len(rows) - 1) if not run.is_jump(*rows[k : k + 2])]
    most = max(shares[0], shares[-1], *lasting) or max(shares)
    drift = max(DRIFT, 50.0 / rows[0].get("pairs", math.inf))
    good = [0.0 < one >= most - drift for one in shares]
    ends = np.flatnonzero(np.diff([False, *good, False])).reshape(-1, 2)  # of each range, (range, 2)
    begin, end = max(ends.tolist(), key=lambda one: float(np.ptp([mean_tension(row) for row in rows[one[0] : one[1]]])))
    low, high = (find(range(begin, end), key=lambda k: mean_tension(rows[k])) for find in (min, max))
    grows = begin == len(rows) - 1
    best = rows[high] if grows else _middle(replace(run, rows=rows[begin:end]), stress)
    above = [jump for jump in run.jumps if mean_tension(jump[1]) > max(mean_tension(jump[0]), mean_tension(best))]
    within = {id(row) for row in rows}
    following = min((jump for jump in above if id(jump[1]) in within), key=lambda jump: mean_tension(jump[1]), default=None)
    passed = [pair for pair in pairwise(rows[begin:end]) if run.is_jump(*pair)]
    found: dict[str, object] = {}
    for name, k in (("low", low), ("high", high)):
        beyond = k - 1 if k == begin else k + 1
        is_end = not 0 <= beyond < len(rows)
        sides = () if is_end or begin < k < end - 1 else (rows[min(k, beyond)], rows[max(k, beyond)])
        found |= {
            name: state_of(rows[k]), f"open_{name}": is_end, f"{name}_jump": bool(sides) and run.is_jump(*sides),
            f"{name}_between": _sorted(sides) if sides and not run.is_near(*sides) else None,
        }  # fmt: skip
    return Best(
        **found, **vars(state_of(best)), active_percent=best.active_percent, stress_max_Pa=best[stress],
        stress_with_grips_Pa=best.stress_max_Pa, stage=best.stage, grows=grows,
        next_jump=None if following is None else [state_of(row) for row in following],
        jumps=[_sorted(pair) for pair in passed],
    )  # fmt: skip


def _sorted(pair: Sequence[Row]) -> list[Row]:
    """The states of two rows, the smaller tension first."""
    return [state_of(row) for row in sorted(pair, key=mean_tension)]


def _middle(run: Rows, stress: str) -> Row:
    """The state in the middle of the tensions of some rows: between two rows without a jump, else the nearest row."""
    tensions = [mean_tension(row) for row in run.rows]
    middle = 0.5 * (min(tensions) + max(tensions))
    for before, after in pairwise(run.rows):
        low, high = mean_tension(before), mean_tension(after)
        if min(low, high) < middle < max(low, high) and not run.is_jump(before, after):
            return row_between(before, after, (middle - low) / (high - low), stress)
    return min(run.rows, key=lambda row: abs(mean_tension(row) - middle))


def row_between(before: Row, after: Row, share: float, *names: str) -> Row:
    """State, stress and columns `names` between two rows; contacts of the nearest row."""
    values = {name: (1.0 - share) * before[name] + share * after[name] for name in (*STATE, "stress_max_Pa", *names)}
    return Row(**values, stage=after.stage, active_percent=(before if share < 0.5 else after).active_percent)


def _loadings(rows: Sequence[Row]) -> list[list[Row]]:
    """Rows of each load step, joined where loading continues at one temperature."""
    parts: list[list[Row]] = []
    for part in stages_of(rows):
        if parts and _loads(parts[-1]) and _loads(part):
            parts[-1] += part[1:]
        else:
            parts.append(part)
    return parts


def _loads(part: Sequence[Row]) -> bool:
    """Whether a stage raises the tension at one temperature."""
    return mean_tension(part[-1]) > mean_tension(part[0]) and _temperatures(part) == 1


def _holds_tension(part: Sequence[Row]) -> bool:
    """Whether a stage changes the temperature under one tension."""
    tensions = [mean_tension(row) for row in part]
    return _temperatures(part) > 1 and float(np.ptp(tensions)) <= HELD_TENSION * float(np.abs(tensions).max())


def _temperatures(part: Sequence[Row]) -> int:
    """Number of temperatures on a part of the path."""
    return len({row.temperature_K for row in part})
