"""At which tension classes of contact close, and what is active at a service tension.

A class of contact closes where half of its pairs carry more than the threshold. The force F that half of them reach is zero
while it is open, and grows with the load once it is closed. So the mean tension T at closing follows from the records behind it:
through three of them goes a parabola, as F bends where other contacts close, and through the first two a line,

    T = T1 - (F1 - threshold) (T2 - T1) / (F2 - F1).

Where the two differ by more than CURVED no place is given. Where a jump or the end of the stage is behind the second record, the
line alone is left, and nothing tells how F bends: it counts where the closing lies between records less than CURVED apart.

The closing is the one that lasts up to the largest tension of a stage, of the records below first yield if there is one among
them: wires in space may graze each other, and part again, long before they carry load there. Values between neighbouring records
are linear otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..measure.contact_classes import ContactClass
from .branches import Jump, is_heated
from .history import Row, mean_tension, stages_of

STATE = ("strain_weft", "strain_warp", "tension_weft_N_per_m", "tension_warp_N_per_m", "temperature_K")
STRESSES = ("stress_max_Pa", "stress_with_grips_Pa")  # [Pa] the second one beside a first one away from the grips
COMPRESSED = "compressed in weft or warp where the mean tension is this"
SCATTER = 1e-3  # of a mean tension: a smaller one in one direction is about zero
HALF = 50.0  # [%] of the pairs of a class that are closed, from which on it is
DRIFT = 1.0  # percentage points of contacts that may open while the tension drifts
CURVED = 0.1  # of a mean tension: error of a line through forces up to which a place is given
SLACK = 1e-6  # of the distance of two records: round-off of a state found between them
SLACK_STRAIN, SLACK_TENSION = 0.02, 0.1  # strain between two records, and tension over that of the next, as slack is taken up

Answer = dict[str, Any]


def closing(
    rows: Sequence[Row],
    name: str,
    threshold: float,
    least: float,
    jumps: Sequence[Jump] = (),
    end: int | None = None,
    yields: int | None = None,
) -> Answer | None:
    """The state in which a class of contact closes; None if it stays open.

    threshold [N]: of an active pair; least [N]: force below which a pair counts as open; end: number of the rows that are asked,
    where not all; those behind tell only how the force grows; yields: the first row above the elastic limit. `between`: the
    records on both sides.
    `resolved`: whether the forces give a place between them; if not, the state is halfway, or that of the record behind within a
    `jump` and where slack is taken up. `first_touch`: the record in which the class was closed before, and opened again; None
    without one. `closed_percent`: share of its pairs in the record behind.
    """
    force = [vars(row)[f"force_{name}_N"] for row in rows]
    closed = [one > threshold for one in force]
    k = _closing_record(rows[:end], closed, yields)
    if k is None:
        return None
    after, before = rows[k], rows[max(k - 1, 0)]
    touch = next((row for row, one in zip(rows[:k], closed, strict=False) if one), None)
    found = {
        "stage": after.stage, "as_knitted": k == 0, "resolved": True, "between": [state_of(before), state_of(after)],
        "jump": is_jump(before, after, jumps), "slack": k > 0 and takes_up_slack(before, after),
        "closed_percent": vars(after)[f"active_{name}_percent"],
        "first_touch": None if touch is None else state_of(touch),
        "opens": next(
            (state_of(row) | {"stage": row.stage} for row, one in zip(rows[k:], closed[k:], strict=True) if not one), None
        ),
    }  # fmt: skip
    if k == 0:
        return state_of(after) | found
    if found["jump"] or found["slack"]:
        return state_of(after) | found | {"resolved": False}
    if force[k - 1] > least:  # closed already, with less than the threshold
        return state_between(before, after, (threshold - force[k - 1]) / (force[k] - force[k - 1])) | found
    behind = list(rows[k : k + 1])
    for row in rows[k + 1 : k + 3]:
        if row.stage != after.stage or is_jump(behind[-1], row, jumps):
            break
        behind.append(row)
    tensions = [mean_tension(row) for row in (before, *behind)]
    back = _steps_back(tensions, [one - threshold for one in force[k : k + len(behind)]])
    if back is not None:
        there, low, here = (np.array([vars(row)[name] for name in STATE]) for row in (behind[1], before, after))
        values = here - back * (there - here)
        if _lies_between(values, low, here):
            return dict(zip(STATE, values.tolist(), strict=True)) | found
    return state_between(before, after, 0.5) | found | {"resolved": False}


def closed_ranges(rows: Sequence[Row], name: str, threshold: float) -> list[Answer]:
    """The ranges of records in which a class is closed: the first state and the last one of each, with their stages.

    threshold [N]: of an active pair. `closed_percent`: largest share of its pairs in the range; `lasts`: to the last record.
    """
    ranges: list[Answer] = []
    end = 0
    for is_closed, group in groupby(rows, lambda row: bool(vars(row)[f"force_{name}_N"] > threshold)):
        part = list(group)
        end += len(part)
        if is_closed:
            ends = {side: state_of(row) | {"stage": row.stage} for side, row in (("from", part[0]), ("to", part[-1]))}
            share = max(vars(row)[f"active_{name}_percent"] for row in part)
            ranges.append(ends | {"closed_percent": share, "lasts": end == len(rows)})
    return ranges


def _steps_back(tension: Sequence[float], force: Sequence[float]) -> float | None:
    """How far before the first of some records their growing force was zero, in steps to the second; None where they do not tell.

    force [N] of one to three records; tension [N/m] of the one before them, in which it is zero, and theirs.
    """
    growth = np.diff(force)
    if len(force) < 2 or growth[0] <= 0.0:
        return None
    before, *tension = tension
    back, steps = float(force[0] / growth[0]), np.diff(tension)
    if len(force) < 3 or steps.min() <= 0.0:
        return back if abs(tension[0] - before) <= CURVED * tension[0] else None
    third = steps[1] / steps[0]  # steps from the second record
    bend = (growth[1] / third - growth[0]) / (1.0 + third)
    slope = growth[0] - bend
    inside = slope * slope - 4.0 * bend * force[0]
    if slope <= 0.0 or inside < 0.0:
        return None
    curved = float(2.0 * force[0] / (slope + math.sqrt(inside)))
    return curved if abs(curved - back) * steps[0] <= CURVED * (tension[0] - curved * steps[0]) else None


def takes_up_slack(before: Row, after: Row) -> bool:
    """Whether the mesh strains freely for most of the way from one record to the next: no state between them is interpolated."""
    step = max(abs(vars(after)[name] - vars(before)[name]) for name in ("strain_weft", "strain_warp"))
    return step > SLACK_STRAIN and mean_tension(before) < SLACK_TENSION * mean_tension(after)


def _closing_record(rows: Sequence[Row], closed: Sequence[bool], yields: int | None) -> int | None:
    """The record from which a class stays closed up to the largest tension of a stage, first of those before the one that
    `yields`; else the first in which it is closed."""
    for known in (rows[:yields], rows):
        begin = 0
        for part in stages_of(known):
            top = begin + max(range(len(part)), key=lambda k: mean_tension(part[k]))
            if closed[top]:
                return max((k + 1 for k in range(top) if not closed[k]), default=0)
            begin += len(part) - 1
    return next((k for k, one in enumerate(closed[: len(rows)]) if one), None)


def _lies_between(values: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]) -> bool:
    """Whether the strain and the tension of a state (values of STATE), each summed over weft and warp, are within two others."""
    here, low, high = (np.array([one[0] + one[1], one[2] + one[3]]) for one in (values, low, high))
    slack = SLACK * np.abs(high - low) + SLACK * np.maximum(np.abs(low), np.abs(high))
    return bool(np.all((here >= np.minimum(low, high) - slack) & (here <= np.maximum(low, high) + slack)))


def service_shares(
    tension: float,
    rows: Sequence[Row],
    classes: Sequence[ContactClass],
    closings: Answer,
    jumps: Sequence[Jump],
    error: float = 0.0,
) -> list[Answer]:
    """The share at a service tension, of whole contacts, where the mesh first reaches it, and in each later stage that passes it;
    one without a state where it does not.

    `resolved`: whether no class closes, or on unloading opens, at an unknown tension between the same two records. Within a
    `jump` there is no state. error: share of a tension by which a search for it may miss it.
    """
    passages: list[Jump | None] = [*_passages(rows, tension, error)]
    return [_service_share(tension, around, classes, closings, jumps) for around in passages or [None]]


def _service_share(
    tension: float, around: Jump | None, classes: Sequence[ContactClass], closings: Answer, jumps: Sequence[Jump]
) -> Answer:
    """The share between two rows, or in one that is given twice; None: the mesh does not reach the tension."""
    stage = {"stage": None if around is None else around[1].stage}
    inside = around is not None and around[0] is not around[1] and tension != mean_tension(around[1])
    if around is not None and inside and is_jump(*around, jumps):
        sides = [state_of(row) | {"active_percent": row.active_percent} for row in around]
        unknown = {"tension_N_per_m": tension, "active_percent": None, "state": None, "resolved": False}
        return unknown | stage | {"jump": sides, "between": None}
    there = None if around is None else around[1]
    if around is not None and around[0] is not around[1]:
        there = interpolated(*around, tension, classes, closings)
    why = {}
    if there is not None and min(there.tension_weft_N_per_m, there.tension_warp_N_per_m) < -SCATTER * tension:
        there, why = None, {"why": COMPRESSED}
    near = inside and around is not None and changes_unknown(*around, classes, closings)
    pairs = max(1, sum(one.pairs for one in classes))
    active, state = (
        (None, None) if there is None else (100.0 * round(0.01 * pairs * there.active_percent) / pairs, state_of(there))
    )
    ends = [state_of(row) | {"active_percent": row.active_percent} for row in around] if around is not None and near else None
    point = {"tension_N_per_m": tension, "active_percent": None if near else active, "state": state, "resolved": not near}
    return point | stage | {"jump": None, "between": ends} | why


def changes_unknown(before: Row, after: Row, classes: Sequence[ContactClass], closings: Answer) -> bool:
    """Whether a class closes at an unknown tension between two neighbouring rows, or contacts open on unloading.

    A class that closes once more, as on loading again, has no known tension there.
    """
    ends = [state_of(before), state_of(after)]
    shares = {one.name: [vars(row)[f"active_{one.name}_percent"] for row in (before, after)] for one in classes}
    if mean_tension(after) < mean_tension(before):
        return any(abs(there - here) > DRIFT for here, there in shares.values())
    again = {name: here < HALF <= there for name, (here, there) in shares.items()}
    known = [name for name, one in closings.items() if one is not None and one["resolved"] and one["between"] == ends]
    return ends in _unknown(closings) or any(closes and name not in known for name, closes in again.items())


def _passages(rows: Sequence[Row], tension: float, error: float) -> list[Jump]:
    """The neighbouring rows between which the mean tension first reaches `tension` [N/m], and those of each later stage between
    which it first passes it, upwards or downwards, but for changes of temperature; a row that has it, within the `error` of a
    search, stands twice.
    """
    first = _around(rows, tension, error)
    if first is None:
        return []
    passages, begun = [first], False
    for part in stages_of(rows):
        here, begun = begun, begun or any(row is first[1] for row in part)
        if not here or is_heated(part):
            continue
        offsets = [mean_tension(row) - tension for row in part]
        side = math.copysign(1.0, offsets[0])
        slack = error * tension
        if abs(offsets[0]) <= slack:  # the end of the stage before
            continue
        k = next((k for k, one in enumerate(offsets) if side * one <= slack), None)
        if k is not None:
            passages.append((part[k], part[k]) if abs(offsets[k]) <= slack else (part[k - 1], part[k]))
    return passages


def _around(rows: Sequence[Row], tension: float, error: float) -> Jump | None:
    """The rows between which the mean tension first reaches `tension` [N/m], one of them twice if it has it within the `error`
    of a search; None if not."""
    slack = error * tension
    k = next((k for k, row in enumerate(rows) if mean_tension(row) >= tension - slack), None)
    if k is None:
        return None
    return rows[k if mean_tension(rows[k]) <= tension + slack else max(k - 1, 0)], rows[k]


def interpolated(before: Row, after: Row, tension: float, classes: Sequence[ContactClass], closings: Answer) -> Row:
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
        if closes is not None and closes["resolved"] and closes["between"][1] == state_of(after):
            active += one.pairs * ends[int(share >= share_of(mean_tension(Row(**closes))))]
        elif one.pairs * DRIFT < 100.0:
            active += one.pairs * (min(ends) if share < 1.0 else ends[1])
        else:
            active += one.pairs * ((1.0 - share) * ends[0] + share * ends[1])
    stresses = {name: (1.0 - share) * vars(before)[name] + share * vars(after)[name] for name in STRESSES if name in vars(before)}
    pairs = max(1, sum(one.pairs for one in classes))
    state = state_between(before, after, share)
    return Row(**state, stage=after.stage, active_percent=active / pairs, **stresses)


def _unknown(closings: Answer) -> list[list[Answer]]:
    """The pairs of states between which a class closes at an unknown tension."""
    return [one["between"] for one in closings.values() if one is not None and not one["resolved"]]


def is_jump(before: Row, after: Row, jumps: Sequence[Jump]) -> bool:
    """Whether there is a jump between two neighbouring rows."""
    return any(one is before and other is after for one, other in jumps)


def state_of(row: Row) -> Answer:
    return {name: vars(row)[name] for name in STATE}


def state_between(before: Row, after: Row, share: float) -> Answer:
    """State at a share of the way from one record to the next."""
    return {name: (1.0 - share) * vars(before)[name] + share * vars(after)[name] for name in STATE}
