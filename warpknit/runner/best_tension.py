"""The best tension: the middle of the widest range with the most active contacts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..results.row import Row
from .branches import HELD_TENSION, Event, Rows, ranges_of, row_between, state_of
from .history import mean_tension, stages_of

DRIFT = 1.0  # percentage points of contacts that may open while the tension drifts, or half a pair
SAME = 1e-9  # of a tension: round-off


class Best(Row):
    """State of the best tension, and its range of records."""

    low: Row  # lower end of the range; of a single record where one percentage point of contacts opens
    open_low: bool  # true where the records begin there
    low_jump: bool  # true where a snap-through lies between the records of `low_between`
    low_between: Sequence[Row] | None  # records on both sides of the lower end; None: near, or the records end there
    high: Row  # upper end of this range
    open_high: bool  # true where the records end there
    high_jump: bool  # the same as `low_jump` of the upper end
    high_between: Sequence[Row] | None  # the same as `low_between` of the upper end
    stress_with_grips_Pa: float  # the largest stress of this state, at the grips as well
    stage: str  # load step of this state
    grows: bool  # true where only the last record is in the range; `best` is then this record
    next_jump: Sequence[Row] | None  # states around the first snap-through at a larger tension, up to first yield
    jumps: Sequence[Sequence[Row]]  # states on both sides of each snap-through within the range
    stages: int  # number of load steps that were searched, up to first yield
    stress_over_limit: float  # the stress away from the grips over the elastic limit
    first_yield_over_tension: float | None  # mean tension of first yield away from the grips, over the tension here


def best_tension(run: Rows, limit: float, stress: str, first_yield: Event | None) -> Best | None:
    """Middle of the widest tension range with the most active contacts; or None. No stress there exceeds `limit` [Pa].

    run: up to the first row above the limit. stress: the column that counts; first_yield: of this stress. A range is a part of
    the path of one stage, or of stages that continue loading at one temperature. Of several ranges with the most contacts, a
    range at one temperature comes first, then the widest. A stage that holds the tension while the temperature changes does not
    count.
    """
    parts = [part for part in _loadings(run.rows) if not _holds_tension(part)] or [list(run.rows)]
    every = [(found, part) for part in parts if (found := _best_of(replace(run, rows=part), limit, stress)) is not None]
    if not every:
        return None

    def rank(one: tuple[Best, Sequence[Row]]) -> tuple[bool, float]:
        return _temperatures(one[1]) == 1, mean_tension(one[0].high) - mean_tension(one[0].low)

    most = max(found.active_percent for found, _ in every)
    best, _ = max((one for one in every if one[0].active_percent >= most - DRIFT), key=rank)
    return best.changed(
        stages=len({row.stage for row in run.rows[1:]}),
        stress_over_limit=best.stress_max_Pa / limit,
        first_yield_over_tension=_times_to_yield(best, first_yield),
    )


def _times_to_yield(best: Best, first_yield: Event | None) -> float | None:
    """Tension of `first_yield` over the best one; None where it is not known, smaller, or at another temperature."""
    if first_yield is None or not first_yield.resolved or first_yield.between[1].temperature_K != best.temperature_K:
        return None
    times = mean_tension(first_yield) / mean_tension(best)
    return times if times >= 1.0 - SAME else None  # it yields where it is unloaded, or compressed


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
    tensions = np.array([mean_tension(row) for row in rows])
    good = max(ranges_of([0.0 < one >= most - drift for one in shares]), key=lambda one: float(np.ptp(tensions[one])))
    low, high = (find(good, key=tensions.__getitem__) for find in (min, max))
    begin, end = good.start, good.stop
    grows = begin == len(rows) - 1
    best = rows[high] if grows else _middle(replace(run, rows=rows[begin:end]), stress)
    above = [jump for jump in run.jumps if mean_tension(jump[1]) > max(mean_tension(jump[0]), mean_tension(best))]
    within = {id(row) for row in rows}
    following = min((jump for jump in above if id(jump[1]) in within), key=lambda jump: mean_tension(jump[1]), default=None)
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
        **found, **vars(state_of(best, "active_percent")), stress_max_Pa=best[stress],
        stress_with_grips_Pa=best.stress_max_Pa, stage=best.stage, grows=grows,
        next_jump=None if following is None else [state_of(row) for row in following],
        jumps=[_sorted(pair) for pair in pairwise(rows[begin:end]) if run.is_jump(*pair)],
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
    return mean_tension(part[-1]) > mean_tension(part[0]) and _temperatures(part) == 1


def _holds_tension(part: Sequence[Row]) -> bool:
    """Whether a stage changes the temperature under one tension."""
    tensions = [mean_tension(row) for row in part]
    return _temperatures(part) > 1 and float(np.ptp(tensions)) <= HELD_TENSION * float(np.abs(tensions).max())


def _temperatures(part: Sequence[Row]) -> int:
    return len({row.temperature_K for row in part})
