"""The best tension: the middle of the widest range with the most active contacts, and how far it may drift."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..measure.contact_classes import ContactClass
from .branches import HELD_TENSION, Jump
from .closings import DRIFT, Answer, changes_unknown, interpolated, is_jump, state_of
from .history import Row, mean_tension, stages_of

DRIFT_STATES = 201  # states between the least and the largest tension of a stage, in which a drift is looked for
ROUND_OFF = 1e-9  # of the elastic limit, in a state that is interpolated to lie on it


def best_tension(
    rows: Sequence[Row], limit: float, classes: Sequence[ContactClass], closings: Answer, jumps: Sequence[Jump]
) -> Answer | None:
    """The tension in the middle of the widest range with the most active contacts, and no stress above `limit` [Pa]; or None.

    rows: up to the first one above the limit. A range is a part of the path of one stage, or of stages that go on loading at one
    temperature; where several have the most contacts, one at one temperature comes first, and then the widest. A stage that holds
    the tension while the temperature changes has no range, and does not count.
    """
    parts = [part for part in _loadings(rows) if not _holds_tension(part)] or [list(rows)]
    every = [(found, part) for part in parts if (found := _best_of(part, limit, classes, closings, jumps)) is not None]
    if not every:
        return None

    def width(found: Answer) -> float:
        return mean_tension(Row(**found["high"])) - mean_tension(Row(**found["low"]))

    most = max(found["active_percent"] for found, _ in every)
    good = [(found, part) for found, part in every if found["active_percent"] >= most - DRIFT]
    best, _ = max(good, key=lambda one: (_temperatures(one[1]) == 1, width(one[0])))
    return best | {"stages": len({row.stage for row in rows[1:]})}


def margin(best: Answer, limit: float, first_yield: Answer | None) -> Answer:
    """How far the best tension is from yield: by its stress over the elastic `limit` [Pa], by the tension of `first_yield`."""
    times = None
    if first_yield is not None and first_yield["resolved"]:
        if first_yield["between"][1]["temperature_K"] == best["temperature_K"]:
            times = mean_tension(Row(**first_yield)) / mean_tension(Row(**best))
            times = times if times >= 1.0 - ROUND_OFF else None  # it yields where it is unloaded, or compressed
    return {"stress_over_limit": best["stress_max_Pa"] / limit, "first_yield_over_tension": times}


def _best_of(
    rows: Sequence[Row], limit: float, classes: Sequence[ContactClass], closings: Answer, jumps: Sequence[Jump]
) -> Answer | None:
    """The same of one part of the path.

    Contacts that are active in one record, and in neither of those beside it without a jump, do not count.
    """

    def share(row: Row) -> float:
        tensile = row.tension_weft_N_per_m > 0.0 and row.tension_warp_N_per_m > 0.0
        return float(row.active_percent) if tensile and row.stress_max_Pa <= limit * (1.0 + ROUND_OFF) else 0.0

    states = _path(rows, limit, classes, closings, jumps)
    shares = [share(row) for row in states]
    if max(shares) == 0.0:
        return None

    def shown(k: int) -> float:
        """The share of a record that one beside it has on the same branch; all of the first one, and of the last one."""
        near = [j for j in (k - 1, k + 1) if 0 <= j < len(rows) and not is_jump(rows[min(j, k)], rows[max(j, k)], jumps)]
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
        if at_limit and len(rows) > 1 and changes_unknown(rows[-2], rows[-1], classes, closings):
            return (rows[-2], rows[-1])  # contacts close at an unknown tension before the wire yields, or behind
        if at_limit or any(math.isclose(mean_tension(row), one, rel_tol=ROUND_OFF) for one in known):
            return None
        for last, beyond in ((begin, begin - 1), (end - 1, end)):
            if row is states[last] and 0 <= beyond < len(states):
                first, second = sorted((last, beyond))
                before = next(one for one in states[first::-1] if id(one) in recorded_at)
                after = next(one for one in states[second:] if id(one) in recorded_at)
                return (before, after) if mean_tension(before) <= mean_tension(after) else (after, before)
        return None

    recorded = [jump for jump in jumps if all(id(row) in recorded_at for row in jump)]
    above = [jump for jump in recorded if mean_tension(jump[1]) > max(mean_tension(jump[0]), mean_tension(best))]
    following = min(above, key=lambda jump: mean_tension(jump[1]), default=None)
    passed = [sorted(jump, key=mean_tension) for jump in jumps if all(id(row) in inside for row in jump)]
    between: Answer = {}
    for name, row in (("low", low), ("high", high)):
        sides = sides_of(row)
        between[f"{name}_between"] = None if sides is None else [state_of(one) for one in sides]
        between[f"{name}_jump"] = sides is not None and (is_jump(*sides, jumps) or is_jump(*sides[::-1], jumps))
    return between | {
        **state_of(best), "active_percent": best.active_percent, "stress_max_Pa": best.stress_max_Pa,
        "stress_with_grips_Pa": best.stress_with_grips_Pa, "stage": best.stage,
        "low": state_of(low), "high": state_of(high), "grows": grows,
        "open_low": any(low is one for one in (states[0], states[-1])),
        "open_high": any(high is one for one in (states[0], states[-1])),
        "next_jump": None if following is None else [state_of(row) for row in following],
        "jumps": [[state_of(row) for row in jump] for jump in passed],
    }  # fmt: skip


def _loadings(rows: Sequence[Row]) -> list[list[Row]]:
    """The rows of each stage, or of stages together that go on loading at one temperature."""
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


def _path(
    rows: Sequence[Row], limit: float, classes: Sequence[ContactClass], closings: Answer, jumps: Sequence[Jump]
) -> list[Row]:
    """The records of a stage, with states between them where there is no jump: at even steps of the mean tension, and where
    contacts close or the stress reaches `limit` [Pa]."""
    step = float(np.ptp([mean_tension(row) for row in rows])) / (DRIFT_STATES - 1)
    path = list(rows[:1])
    for before, after in pairwise(rows):
        low, high = mean_tension(before), mean_tension(after)
        if not is_jump(before, after, jumps) and step > 0.0:
            tensions = np.linspace(low, high, math.ceil(abs(high - low) / step) + 1).tolist()
            tensions += [mean_tension(Row(**one)) for one in closings.values() if one and one["between"][1] == state_of(after)]
            if before.stress_max_Pa < limit < after.stress_max_Pa:
                tensions.append(
                    low + (limit - before.stress_max_Pa) / (after.stress_max_Pa - before.stress_max_Pa) * (high - low)
                )
            inside = sorted({one for one in tensions if min(low, high) < one < max(low, high)}, reverse=high < low)
            path += [interpolated(before, after, tension, classes, closings) for tension in inside]
        path.append(after)
    return path
