"""Answers to a designer's questions from the rows of a run: at which tension contacts close and the wire yields, what heat does,
which tension is best and how far it may drift.

A class of contact closes where half of its pairs carry more than the threshold. The force F that half of them reach is zero
while it is open, and grows with the load once it is closed. So the mean tension T at closing follows from the records behind it.
Through two of them, where a jump or the end of the stage is next, goes a line,

    T = T1 - (F1 - threshold) (T2 - T1) / (F2 - F1),

through three a parabola, as F bends where other contacts close. Where the two differ by more than CURVED no place is given.

The closing is the one that lasts up to the largest tension of a stage: wires in space may graze each other, and part again, long
before they carry load there. Values between neighbouring records are linear otherwise.

Tensions are known to a tolerance: smaller ones are zero.

Keys. A state has `strain_weft`, `strain_warp`, `tension_weft_N_per_m`, `tension_warp_N_per_m` and `temperature_K`.

    contacts                          classes of contact: `name`, `pairs`, `active_percent` at the end, and `closes`; null if
                                      they stay open
    contacts[].closes                 the state where half of the pairs carry more than the threshold, its `stage`, the records
                                      `between`
    contacts[].closes.resolved        false where the forces give no place between two records: the state is halfway
    contacts[].closes.jump            true where the mesh jumps to another equilibrium between them
    contacts[].closes.slack           true where the mesh strains freely for most of the way between them
    contacts[].closes.as_knitted      true where the class is closed in the first record
    contacts[].closes.closed_percent  share of its pairs that are closed in the second record of `between`
    contacts[].closes.first_touch     the record in which a class was closed before, and opened again; null without one
    contacts[].closes.opens           the record behind in which less than half of its pairs are closed; null without one
    service                           `tension_N_per_m` with `active_percent` and the `state` where the mean of weft and warp
                                      first reaches it; `why` there is none, or what limits it
    service[].resolved                false where a class closes at an unknown tension between the same two records
    service[].jump                    the records on both sides where the mesh jumps to another equilibrium at this tension,
                                      each with `active_percent`, in place of a state; null without one
    first_yield                       the state where the largest stress reaches the yield stress, the records `between`, the
                                      place; null if not
    first_yield.jump                  true where the mesh jumps to another equilibrium between them: the state is the one behind
    largest_stress                    the largest stress of the run, and its place
    largest_tension                   the state of the largest tension
    tension_tolerance_N_per_m         smaller tensions are zero within the tolerance of the equilibria
    heat                              each stage that changes the temperature alone: values at its begin and end
    heat[].held                       what it holds in weft and warp, `tension` or `strain` each
    best                              the state in the middle of the widest range of tension with the most active contacts, up to
                                      first yield; what a single record alone shows does not count
    best.low                          the lower end of this range, in which at most one percentage point of contacts opens along
                                      the load; that of `best` where the range is a single record
    best.high                         the upper end
    best.low_between                  the records on both sides of the lower end, where contacts close or open between them at an
                                      unknown tension; null where it is known, or the records end there
    best.low_jump                     true where the mesh jumps to another equilibrium between them
    best.high_between                 the same of the upper end
    best.high_jump                    the same of the upper end
    best.jumps                        the states on both sides of each jump to another equilibrium within the range
    best.open_low                     true where the records begin there
    best.open_high                    true where the records end there
    best.grows                        true where no record but the last is known to be in the range: the state is the last one
                                      then
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import measure
from ..measure import MeshModel
from ..measure.contact_classes import ContactClass, classes_of
from ..scene import Stage
from .branches import Jump
from .history import Row, mean_tension, stages_of

SERVICE_TENSIONS = (2.0, 3.4, 4.9)  # [N/m] of meshes in orbit (VSOP-2, ASP Conf. Ser. 402, 66)
STATE = ("strain_weft", "strain_warp", "tension_weft_N_per_m", "tension_warp_N_per_m", "temperature_K")
HEATED = (*STATE, "active_percent", "stress_max_Pa")
PEAK = ("stress_max_part", "stress_max_wire", "stress_max_node", "stress_max_x_m", "stress_max_y_m")
ROUND_OFF = 1e-9  # of the elastic limit, in a state that is interpolated to lie on it
HELD_STRAIN, HELD_TENSION = 2e-3, 0.02  # a frame expands by less over 200 K; tensions are found to less, of themselves
ZERO_TENSION = 0.01  # of EI/C^3: tensions of loose meshes are found to the residual tolerance of this (solve/tension.py)
COMPRESSED = "compressed in weft or warp where the mean tension is this"
SCATTER = 1e-3  # of a mean tension: a smaller one in one direction is about zero
DRIFT = 1.0  # percentage points of contacts that may open while the tension drifts
DRIFT_STATES = 201  # states between the least and the largest tension of a stage, in which a drift is looked for
CURVED = 0.1  # of a mean tension: difference of a parabola from a line through forces, up to which the parabola counts
SLACK = 1e-6  # of the distance of two records: round-off of a state found between them
SLACK_STRAIN, SLACK_TENSION = (
    0.02,
    0.1,
)  # strain between two records, and tension of one over that of the next, where slack is taken up

Answer = dict[str, Any]


def answers_of(model: MeshModel, rows: Sequence[Row], jumps: Sequence[Jump] = ()) -> Answer | None:
    """The section `answers` of summary.json, in SI units; None of two hooked wires, which have no tension.

    jumps: neighbouring rows of different branches of equilibria (branches.py); no state is interpolated between them.
    """
    if not rows or model.scene.hook is not None:
        return None
    classes = classes_of(model)
    threshold = measure.active_threshold(model)
    closings = {one.name: closing(rows, one.name, threshold, measure.least_force(model), jumps) for one in classes}
    first_yield = _first_yield(model, rows, jumps)
    top = max(rows, key=mean_tension)
    given = model.scene.output.service_tension
    wanted = SERVICE_TENSIONS if given is None else (given,)
    service = [_service(tension, rows, classes, closings, jumps) for tension in wanted]
    limit = model.scene.wire.yield_stress
    yields = _yielding_record(rows, limit)
    known = rows if yields is None else rows[: yields + 1]  # what is loaded further does not change the best tension
    until = {one.name: closing(rows, one.name, threshold, measure.least_force(model), jumps, len(known)) for one in classes}
    return {
        "contacts": [
            {
                "name": one.name,
                "pairs": one.pairs,
                "active_percent": vars(rows[-1])[f"active_{one.name}_percent"],
                "closes": closings[one.name],
            }
            for one in classes
        ],
        "service": service if given is not None else [point for point in service if point["state"] or point["jump"]],
        "first_yield": first_yield,
        "largest_stress": _peak(max(rows, key=lambda row: row.stress_max_Pa)),
        "largest_tension": _state(top),
        "tension_tolerance_N_per_m": ZERO_TENSION * model.scene.solver.residual_tolerance * measure.tension_scale(model),
        "heat": heat_of(rows, model.scene.stages),
        "best": _best(known, limit, classes, until, jumps),
    }


def _is_jump(before: Row, after: Row, jumps: Sequence[Jump]) -> bool:
    """Whether there is a jump between two neighbouring rows."""
    return any(one is before and other is after for one, other in jumps)


def closing(
    rows: Sequence[Row], name: str, threshold: float, least: float, jumps: Sequence[Jump] = (), end: int | None = None
) -> Answer | None:
    """The state in which a class of contact closes; None if it stays open.

    threshold [N]: of an active pair; least [N]: force below which a pair counts as open; end: number of the rows that are asked,
    where not all; those behind tell only how the force grows. `between`: the records on both sides.
    `resolved`: whether the forces give a place between them; if not, as within a `jump` or where slack is taken up, the state is
    halfway. `first_touch`: the record in which the class was closed before, and opened again; None without one. `closed_percent`:
    share of its pairs in the record behind.
    """
    force = [vars(row)[f"force_{name}_N"] for row in rows]
    closed = [one > threshold for one in force]
    k = _closing_record(rows[:end], closed[:end])
    if k is None:
        return None
    after, before = rows[k], rows[max(k - 1, 0)]
    touch = next((row for row, one in zip(rows[:k], closed, strict=False) if one), None)
    found = {
        "stage": after.stage, "as_knitted": k == 0, "resolved": True, "between": [_state(before), _state(after)],
        "jump": _is_jump(before, after, jumps), "slack": k > 0 and _takes_up_slack(before, after),
        "closed_percent": vars(after)[f"active_{name}_percent"],
        "first_touch": None if touch is None else _state(touch),
        "opens": next((_state(row) for row, one in zip(rows[k:], closed[k:], strict=True) if not one), None),
    }  # fmt: skip
    if k == 0:
        return _state(after) | found
    if found["jump"] or found["slack"]:
        return _between(before, after, 0.5) | found | {"resolved": False}
    if force[k - 1] > least:  # closed already, with less than the threshold
        return _between(before, after, (threshold - force[k - 1]) / (force[k] - force[k - 1])) | found
    behind = list(rows[k : k + 1])
    for row in rows[k + 1 : k + 3]:
        if row.stage != after.stage or _is_jump(behind[-1], row, jumps):
            break
        behind.append(row)
    back = _steps_back([mean_tension(row) for row in behind], [one - threshold for one in force[k : k + len(behind)]])
    if back is not None:
        there, low, here = (np.array([vars(row)[name] for name in STATE]) for row in (behind[1], before, after))
        values = here - back * (there - here)
        if _lies_between(values, low, here):
            gained = [float(one[2] + one[3] - low[2] - low[3]) for one in (values, here)]  # twice the mean tension
            share = float(np.clip(gained[0] / gained[1], 0.0, 1.0)) if gained[1] > 0.0 else 0.5
            return _between(before, after, share) | found
    return _between(before, after, 0.5) | found | {"resolved": False}


def _steps_back(tension: Sequence[float], force: Sequence[float]) -> float | None:
    """How far before the first of some records their growing force was zero, in steps to the second; None where they do not tell.

    tension [N/m] and force [N] of one to three records.
    """
    growth = np.diff(force)
    if len(force) < 2 or growth[0] <= 0.0:
        return None
    back, steps = float(force[0] / growth[0]), np.diff(tension)
    if len(force) < 3 or steps.min() <= 0.0:
        return back
    third = steps[1] / steps[0]  # steps from the second record
    bend = (growth[1] / third - growth[0]) / (1.0 + third)
    slope = growth[0] - bend
    inside = slope * slope - 4.0 * bend * force[0]
    if slope <= 0.0 or inside < 0.0:
        return None
    curved = float(2.0 * force[0] / (slope + math.sqrt(inside)))
    return curved if abs(curved - back) * steps[0] <= CURVED * (tension[0] - curved * steps[0]) else None


def _takes_up_slack(before: Row, after: Row) -> bool:
    """Whether the mesh strains freely for most of the way from one record to the next: no state between them is interpolated."""
    step = max(abs(vars(after)[name] - vars(before)[name]) for name in ("strain_weft", "strain_warp"))
    return step > SLACK_STRAIN and mean_tension(before) < SLACK_TENSION * mean_tension(after)


def _closing_record(rows: Sequence[Row], closed: Sequence[bool]) -> int | None:
    """The record from which a class stays closed up to the largest tension of a stage, else the first in which it is closed."""
    begin = 0
    for part in stages_of(rows):
        top = begin + max(range(len(part)), key=lambda k: mean_tension(part[k]))
        if closed[top]:
            return max((k + 1 for k in range(top) if not closed[k]), default=0)
        begin += len(part) - 1
    return next((k for k, one in enumerate(closed) if one), None)


def _lies_between(values: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]) -> bool:
    """Whether the strain and the tension of a state (values of STATE), each summed over weft and warp, are within two others."""
    here, low, high = (np.array([one[0] + one[1], one[2] + one[3]]) for one in (values, low, high))
    slack = SLACK * np.abs(high - low) + SLACK * np.maximum(np.abs(low), np.abs(high))
    return bool(np.all((here >= np.minimum(low, high) - slack) & (here <= np.maximum(low, high) + slack)))


def _state(row: Row) -> Answer:
    return {name: vars(row)[name] for name in STATE}


def _between(before: Row, after: Row, share: float) -> Answer:
    """State at a share of the way from one record to the next."""
    return {name: (1.0 - share) * vars(before)[name] + share * vars(after)[name] for name in STATE}


def _peak(row: Row) -> Answer:
    """Where the stress is largest, and how large."""
    return {"stress_max_Pa": row.stress_max_Pa} | {name: vars(row).get(name) for name in PEAK}


def _yielding_record(rows: Sequence[Row], limit: float) -> int | None:
    """The first record with a stress above the elastic limit [Pa]."""
    return next((k for k, row in enumerate(rows) if row.stress_max_Pa > limit), None)


def _first_yield(model: MeshModel, rows: Sequence[Row], jumps: Sequence[Jump]) -> Answer | None:
    """The state in which the largest stress first reaches the elastic limit, and the place; None if it does not."""
    limit = model.scene.wire.yield_stress
    k = _yielding_record(rows, limit)
    if k is None:
        return None
    before, after = rows[max(k - 1, 0)], rows[k]
    state, jump = _state(after), _is_jump(before, after, jumps)
    if k and not jump:
        state = _between(before, after, (limit - before.stress_max_Pa) / (after.stress_max_Pa - before.stress_max_Pa))
    between = [_state(before), _state(after)]
    return state | {"stage": after.stage, "as_knitted": k == 0, "jump": jump, "between": between} | _peak(after)


def _around(rows: Sequence[Row], tension: float) -> Jump | None:
    """The rows between which the mean tension first reaches `tension` [N/m], the first one twice if it has it; None if not."""
    k = next((k for k, row in enumerate(rows) if mean_tension(row) >= tension), None)
    return None if k is None else (rows[max(k - 1, 0)], rows[k])


def _at_tension(rows: Sequence[Row], tension: float, classes: Sequence[ContactClass], closings: Answer) -> Row | None:
    """The state in which the mean tension first reaches `tension` [N/m], with its contacts and stress; None if it does not."""
    around = _around(rows, tension)
    if around is None or around[0] is around[1]:
        return None if around is None else around[1]
    return _interpolated(*around, tension, classes, closings)


def _interpolated(before: Row, after: Row, tension: float, classes: Sequence[ContactClass], closings: Answer) -> Row:
    """The state between two records with the mean tension `tension` [N/m], with its contacts and stress.

    A class that closes between them, at a tension that is known, counts as closed from there on. Of a class of so few pairs that
    one of them is more than DRIFT, as many count as are active in both records: others close or open somewhere between.
    """

    def share_of(tension: float) -> float:
        return (tension - mean_tension(before)) / (mean_tension(after) - mean_tension(before))

    share, active = share_of(tension), 0.0
    for one in classes:
        ends = [vars(row)[f"active_{one.name}_percent"] for row in (before, after)]
        closes = closings[one.name]
        if closes is not None and closes["resolved"] and closes["between"][1] == _state(after):
            active += one.pairs * ends[int(share >= share_of(mean_tension(Row(**closes))))]
        elif one.pairs * DRIFT < 100.0:
            active += one.pairs * (min(ends) if share < 1.0 else ends[1])
        else:
            active += one.pairs * ((1.0 - share) * ends[0] + share * ends[1])
    stress = (1.0 - share) * before.stress_max_Pa + share * after.stress_max_Pa
    pairs = max(1, sum(one.pairs for one in classes))
    return Row(**_between(before, after, share), active_percent=active / pairs, stress_max_Pa=stress)


def _service(
    tension: float, rows: Sequence[Row], classes: Sequence[ContactClass], closings: Answer, jumps: Sequence[Jump]
) -> Answer:
    """The share at a service tension, of whole contacts; `resolved`: whether no class closes at an unknown tension between the
    same two records. Within a `jump` there is no state."""
    around = _around(rows, tension)
    if around is not None and _is_jump(*around, jumps) and tension < mean_tension(around[1]):
        sides = [_state(row) | {"active_percent": row.active_percent} for row in around]
        return {"tension_N_per_m": tension, "active_percent": None, "state": None, "resolved": False, "jump": sides}
    there = _at_tension(rows, tension, classes, closings)
    why = {}
    if there is not None and min(there.tension_weft_N_per_m, there.tension_warp_N_per_m) < -SCATTER * tension:
        there, why = None, {"why": COMPRESSED}
    near = around is not None and [_state(row) for row in around] in _unknown(closings) and tension < mean_tension(around[1])
    pairs = max(1, sum(one.pairs for one in classes))
    active, state = (None, None) if there is None else (100.0 * round(0.01 * pairs * there.active_percent) / pairs, _state(there))
    return {"tension_N_per_m": tension, "active_percent": active, "state": state, "resolved": not near, "jump": None} | why


def _unknown(closings: Answer) -> list[list[Answer]]:
    """The pairs of states between which a class closes at an unknown tension."""
    return [one["between"] for one in closings.values() if one is not None and not one["resolved"]]


def heat_of(rows: Sequence[Row], stages: Sequence[Stage]) -> list[Answer]:
    """Stages that change the temperature, and hold strain or tension in either direction: values at begin and end."""
    by_tension = {stage.name: stage.by_tension for stage in stages}
    return [
        {"stage": part[-1].stage, "held": ["tension" if one else "strain" for one in by_tension[part[-1].stage]]}
        | {name: [vars(row)[name] for row in (part[0], part[-1])] for name in HEATED}
        for part in stages_of(rows)
        if part[-1].temperature_K != part[0].temperature_K and all(_is_held(part, side) for side in ("weft", "warp"))
    ]


def _is_held(part: Sequence[Row], side: str) -> bool:
    """Whether the load along a side is the same at begin and end of a stage: no strain but that of a frame, or no tension."""
    begin, end = part[0], part[-1]
    strain = abs(vars(end)[f"strain_{side}"] - vars(begin)[f"strain_{side}"])
    tension = [vars(row)[f"tension_{side}_N_per_m"] for row in (begin, end)]
    return strain <= HELD_STRAIN or abs(tension[1] - tension[0]) <= HELD_TENSION * max(map(abs, tension))


def _path(
    rows: Sequence[Row], limit: float, classes: Sequence[ContactClass], closings: Answer, jumps: Sequence[Jump]
) -> list[Row]:
    """The records of a stage, with states between them where there is no jump: at even steps of the mean tension, and where
    contacts close or the stress reaches `limit` [Pa]."""
    step = float(np.ptp([mean_tension(row) for row in rows])) / (DRIFT_STATES - 1)
    path = list(rows[:1])
    for before, after in pairwise(rows):
        low, high = mean_tension(before), mean_tension(after)
        if not _is_jump(before, after, jumps) and step > 0.0:
            tensions = np.linspace(low, high, math.ceil(abs(high - low) / step) + 1).tolist()
            tensions += [mean_tension(Row(**one)) for one in closings.values() if one and one["between"][1] == _state(after)]
            if before.stress_max_Pa < limit < after.stress_max_Pa:
                tensions.append(
                    low + (limit - before.stress_max_Pa) / (after.stress_max_Pa - before.stress_max_Pa) * (high - low)
                )
            inside = sorted({one for one in tensions if min(low, high) < one < max(low, high)}, reverse=high < low)
            path += [_interpolated(before, after, tension, classes, closings) for tension in inside]
        path.append(after)
    return path


def _best(
    rows: Sequence[Row], limit: float, classes: Sequence[ContactClass], closings: Answer, jumps: Sequence[Jump]
) -> Answer | None:
    """The tension in the middle of the widest range with the most active contacts, and no stress above `limit` [Pa]; or None.

    rows: up to the first one above the limit. A range is a part of the path of one stage. Contacts that are active in one record,
    and in neither of those beside it without a jump, do not count.
    """

    def share(row: Row) -> float:
        tensile = row.tension_weft_N_per_m > 0.0 and row.tension_warp_N_per_m > 0.0
        return float(row.active_percent) if tensile and row.stress_max_Pa <= limit * (1.0 + ROUND_OFF) else 0.0

    rows = max(stages_of(rows), key=lambda part: max(map(share, part)), default=list(rows))
    states = _path(rows, limit, classes, closings, jumps)
    shares = [share(row) for row in states]
    if max(shares) == 0.0:
        return None

    def shown(k: int) -> float:
        """The share of a record that one beside it has on the same branch; all of the first one, and of the last one."""
        near = [j for j in (k - 1, k + 1) if 0 <= j < len(rows) and not _is_jump(rows[min(j, k)], rows[max(j, k)], jumps)]
        beside = [rows[j].active_percent for j in near]
        own = rows[k].active_percent
        if k in (0, len(rows) - 1) and (beside or share(rows[k]) > 0.0):
            return float(own)
        return float(min(own, max(beside, default=0.0)))

    most = min(max(shares), max(map(shown, range(len(rows))))) or max(shares)
    good = [0.0 < one >= most - DRIFT for one in shares]
    ends = np.flatnonzero(np.diff([False, *good, False])).reshape(-1, 2)  # of each range, (range, 2)
    ranges = [states[begin:end] for begin, end in ends.tolist()]
    number = max(range(len(ranges)), key=lambda k: float(np.ptp([mean_tension(row) for row in ranges[k]])))
    within, (begin, end) = ranges[number], ends[number].tolist()
    low, high = min(within, key=mean_tension), max(within, key=mean_tension)
    middle = 0.5 * (mean_tension(low) + mean_tension(high))
    inside, recorded_at = {id(row) for row in within}, {id(row) for row in rows}
    grows = high is states[-1] and not any(id(row) in inside for row in rows[:-1])
    best = high if grows else min(within, key=lambda row: abs(mean_tension(row) - middle))
    known = {mean_tension(Row(**one)) for one in closings.values() if one is not None and one["resolved"]}

    def sides_of(row: Row) -> Jump | None:
        """The records on both sides of an end of the range, the lower tension first; None where it is known, or the last one."""
        at_limit = math.isclose(row.stress_max_Pa, limit, rel_tol=ROUND_OFF)
        if at_limit or any(math.isclose(mean_tension(row), one, rel_tol=ROUND_OFF) for one in known):
            return None
        for last, beyond in ((begin, begin - 1), (end - 1, end)):
            if row is states[last] and 0 <= beyond < len(states):
                first, second = sorted((last, beyond))
                before = next(one for one in states[first::-1] if id(one) in recorded_at)
                after = next(one for one in states[second:] if id(one) in recorded_at)
                return (before, after) if mean_tension(before) <= mean_tension(after) else (after, before)
        return None

    passed = [sorted(jump, key=mean_tension) for jump in jumps if all(id(row) in inside for row in jump)]
    between: Answer = {}
    for name, row in (("low", low), ("high", high)):
        sides = sides_of(row)
        between[f"{name}_between"] = None if sides is None else [_state(one) for one in sides]
        between[f"{name}_jump"] = sides is not None and (_is_jump(*sides, jumps) or _is_jump(*sides[::-1], jumps))
    return between | {
        **_state(best), "active_percent": best.active_percent, "stress_max_Pa": best.stress_max_Pa, "stage": rows[-1].stage,
        "low": _state(low), "high": _state(high), "grows": grows,
        "open_low": any(low is one for one in (states[0], states[-1])),
        "open_high": any(high is one for one in (states[0], states[-1])),
        "jumps": [[_state(row) for row in jump] for jump in passed],
    }  # fmt: skip
