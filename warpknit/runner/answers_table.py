"""The answers of a run in words: rows of its table, and of the report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ..base.text import alike, between, both, celsius, engineering, exact, is_at_grips, percent, place_text
from ..mechanics.driven_strain import TOLERANCE
from ..results.row import Row, Values
from .answers import HEATED, Answers, ClassAnswer, Heat, Service
from .best_tension import Best
from .branches import Event
from .history import mean_tension

LEAST_SHARE = 1e-4  # of the larger of both: smaller tensions are scatter about zero
LEAST_CHANGE = 1e-7  # of a strain
LEAST_STRESS = 1e-9  # of the elastic limit: less is round-off
SAME = 1e-9  # of a tension: round-off of a state found twice
PEAK_ON_THE_WAY = 1.02  # of the stress at begin and end of a change of temperature: more is told


def answer_rows(answers: Answers, yield_stress: float, *, gave_up: bool = False) -> Iterator[tuple[str, str]]:
    """Pairs of a heading and a text.

    yield_stress [Pa]: elastic limit of the wire. gave_up: the relaxation did not converge beyond the largest tension.
    """
    answers = _without_scatter(answers, answers.tension_tolerance_N_per_m)
    reached = f"up to {_tension(answers.largest_tension)}"
    if gave_up:
        reached += ", beyond which the relaxation did not converge"
    for one in answers.contacts:
        name = f"contacts {one.name}" if len(answers.contacts) > 1 else "contacts"
        yield f"{name} close at", f"{_closing(one, reached)} ({_pairs(one)})"
    for point in answers.service:
        several = sum(one.tension_N_per_m == point.tension_N_per_m for one in answers.service) > 1
        where = f", in stage '{point.stage}'" if several else ""
        yield f"active at {exact(point.tension_N_per_m, 'N/m')}", _service(point, reached) + where
    yield "first yield at", _yield(answers, yield_stress, reached)
    if away := _inside(answers):
        inner = answers.first_yield_interior
        yield f" {away}", f"not {reached}" if inner is None else _where(inner)
    for stage in answers.heat:
        yield from _heat(stage)
    yield from _best(answers, gave_up)


def _service(point: Service, reached: str) -> str:
    """The share of active contacts at a service tension; those of the records on both sides where they differ."""
    there, why = point.state, point.get("why", "")
    if sides := point.jump or point.get("between"):
        low, high = sides
        where = "where the mesh jumps" if point.jump else "more output.frames narrow it"
        share = between(*(percent(0.01 * one.active_percent) for one in (low, high)))
        return f"{share}, records at {both(_tension(low), _tension(high))}; {where}"
    if there is None or point.active_percent is None:
        return why or f"not reached; {reached}"
    return f"{percent(0.01 * point.active_percent)}, {_pair_of(there)}" + (f", {why}" if why else "")


def _inside(answers: Answers) -> str:
    """That a first yield is that away from the grips; empty where it is the same at them."""
    first_yield, inner = answers.first_yield, answers.first_yield_interior
    differs = first_yield is not None and (inner is None or mean_tension(inner) > mean_tension(first_yield))
    return " away from the grips" if differs else ""


def unreached_text(answers: Answers) -> str:
    """How far a run that did not converge got, of the tension that it was asked for."""
    answers = _without_scatter(answers, answers.tension_tolerance_N_per_m)
    top, asked = answers.largest_tension, answers.asked_tension_N_per_m
    of_asked = "" if asked is None else f" of the {exact(asked, 'N/m')} that the scene asks for"
    return f"the relaxation converged up to {_tension(top)}{of_asked}, {_strain(top)}"


def _without_scatter(part: Any, least: float, is_tension: bool = False) -> Any:
    """A part of the answers in which tensions below `least` [N/m] are zero."""
    if isinstance(part, Values):
        sides = ("tension_weft", "tension_warp")
        values = {name: _without_scatter(value, least, name.startswith(sides)) for name, value in vars(part).items()}
        return part.changed(**values)
    if isinstance(part, list):
        return [_without_scatter(one, least, is_tension) for one in part]
    return part * (abs(part) > least) if is_tension else part


def _tension(state: Row, digits: int = 3) -> str:
    """Tension in weft and warp; their mean where they differ by no more than their tolerance."""
    both = [state[f"tension_{side}_N_per_m"] for side in ("weft", "warp")]
    if abs(both[0] - both[1]) <= 2.0 * TOLERANCE * max(map(abs, both)):
        both = 2 * [0.5 * (both[0] + both[1])]
    least = LEAST_SHARE * max(map(abs, both))
    return " / ".join(dict.fromkeys(alike([value if abs(value) > least else 0.0 for value in both], "N/m", digits)))


def _pair_of(state: Row) -> str:
    """Strain of a state whose mean tension is known, after the tensions in weft and warp where they differ."""
    tension = _tension(state)
    return f"mean of {tension} in weft / warp, {_strain(state)}" if " / " in tension else _strain(state)


def _strain(state: Row) -> str:
    return "strain " + " / ".join(percent(state[f"strain_{side}"]) for side in ("weft", "warp"))


def _closing(one: ClassAnswer, reached: str) -> str:
    closes = one.closes
    if closes is None:
        some = f", {percent(0.01 * one.active_percent)} active" if one.active_percent else ""
        return f"not closed {reached}{some}"
    found = "closed as knitted" if closes.as_knitted else _where(closes)
    if (opens := closes.opens) is None:
        return found
    heated = opens.temperature_K != closes.between[1].temperature_K
    stage = f" in stage '{opens.stage}'" if opens.stage != closes.stage else ""
    again = f", in all closed {len(one.closed)} times" if len(one.closed) > 1 else ""
    at = f" and {celsius(opens.temperature_K)}" if heated else ""
    return f"{found}, open again at {_tension(opens)}{at}{stage}{again}"


def _pairs(one: ClassAnswer) -> str:
    """Number of pairs of a class, with the share that closes where it does, and that at the end if it is another."""
    closes, pairs = one.closes, f"{one.pairs} pairs"
    if closes is None or closes.closed_percent == 100.0:
        return pairs
    there, last = (f"{share:.0f} %" for share in (closes.closed_percent, one.active_percent))
    return f"{there} of {pairs}" if there == last else f"{there} of {pairs} there, {last} at the end"


def _where(one: Event) -> str:
    """The record in which something has happened; both records where they are far apart, or the mesh jumps between them."""
    low, high = one.between
    if one.resolved:
        return f"{_tension(one)}, {_strain(one)}"
    if one.slack and not one.jump:
        return f"below {_tension(high)}, once the slack is taken up, {_strain(low)} to {_strain(high).removeprefix('strain ')}"
    tensions, strain = _both(low, high), both(_strain(low), _strain(high)).replace("and strain ", "and ")
    return f"{'between' if ' and ' in tensions else 'at'} {tensions}, {strain}{', where the mesh jumps' if one.jump else ''}"


def _both(low: Row, high: Row) -> str:
    """The tensions of two records; their temperatures where these differ and the tensions do not."""
    shown = [_tension(one) for one in (low, high)]
    if shown[0] == shown[1] and low.temperature_K != high.temperature_K:
        return f"{celsius(low.temperature_K)} and {celsius(high.temperature_K)} at {shown[0]}"
    return both(*shown)


def _yield(answers: Answers, limit: float, reached: str) -> str:
    found = answers.first_yield
    if found is None:
        peak = answers.largest_stress
        if peak.stress_max_Pa < LEAST_STRESS * limit:
            return f"not {reached}: without stress"
        stress = engineering(peak.stress_max_Pa, "Pa")
        return f"not {reached}: {stress}, {percent(peak.stress_max_Pa / limit, 0)} of the limit, {_place(peak)}"
    return f"{'as knitted' if found.as_knitted else _where(found)}, {_place(found)}"


def _place(peak: Row) -> str:
    """Where a stress is: part of the loop, wire and node, position in weft and warp."""
    part = peak.stress_max_part
    position = place_text(peak.stress_max_x_m, peak.stress_max_y_m)
    where = f"wire {peak.stress_max_wire}, node {peak.stress_max_node} at {position} from the corner"
    return f"{where}" if part is None else f"in the {part}, {where}"


def _heat(stage: Heat) -> Iterator[tuple[str, str]]:
    begin, end = (Row(**{name: stage[name][k] for name in HEATED}) for k in (0, 1))
    by_tension = {one == "tension" for one in stage.held}
    held = "" if len(by_tension) > 1 else "tension held: " if True in by_tension else "frame held: "
    parts = [f"active {percent(0.01 * begin.active_percent)} to {percent(0.01 * end.active_percent)}"]
    parts.append(f"tension {_tension(begin)}" + ("" if by_tension == {True} else f" to {_tension(end)}"))
    moves = any(abs(end[name] - begin[name]) > LEAST_CHANGE for name in ("strain_weft", "strain_warp"))
    parts.append(f"{_strain(begin)}" + (f", changed by {_change(begin, end)}" if moves else ""))
    parts.append(f"stress {' to '.join(alike([one.stress_max_Pa for one in (begin, end)], 'Pa'))}")
    peak = stage.peak
    if peak.stress_max_Pa > PEAK_ON_THE_WAY * max(begin.stress_max_Pa, end.stress_max_Pa):
        parts.append(f"{engineering(peak.stress_max_Pa, 'Pa')} at {celsius(peak.temperature_K)} on the way")
    if stage.jump_between is not None:
        before, after = stage.jump_between
        there = between(*(celsius(one.temperature_K) for one in (before, after)))
        alone = f": {_change(begin, before)} up to there" if before.temperature_K != begin.temperature_K else ""
        parts.append(f"the mesh jumps to another equilibrium {there}, which is not what heat alone does{alone}")
    yield f"heat, {celsius(begin.temperature_K).split()[0]} to {celsius(end.temperature_K)}", held + ", ".join(parts)


def _change(begin: Row, end: Row) -> str:
    """Change of the strain in weft and warp, over one plus the strain before it, both to as many digits."""
    changes = [100.0 * (end[name] - begin[name]) / (1.0 + begin[name]) for name in ("strain_weft", "strain_warp")]
    digits = max(len(f"{change:.2g}".partition(".")[2]) for change in changes)
    return " / ".join(f"{change:+.{digits}f}" for change in changes) + " %"


def _best(answers: Answers, gave_up: bool) -> Iterator[tuple[str, str]]:
    best = answers.best
    is_short = gave_up and answers.first_yield_interior is None
    top = _tension(answers.largest_tension)
    short = f"; not known beyond {top}, where the relaxation did not converge" if is_short else ""
    if best is None:
        yield "best tension", f"none: no tensile state with an active contact is below the elastic limit{short}"
        return
    low, high = best.low, best.high
    begins, ends = best.open_low, best.open_high and not short
    cut = " and ".join(["starts below the first record"] * begins + ["goes on beyond the last record"] * ends)
    incomplete = f" (the range {cut})" if cut else ""
    middle = "" if best.grows or low == high else f", the middle of its range{incomplete}"
    stress = engineering(best.stress_max_Pa, "Pa")
    away = " away from the grips" if is_at_grips(best.stress_max_Pa, best.stress_with_grips_Pa) else ""
    stage = f" in stage '{best.stage}'" if best.stages > 1 else ""
    active = percent(0.01 * best.active_percent)
    yield "best tension", f"{_tension(best)}{stage}{middle}: {active} active, {stress}{away}{short}"
    share = f"stress{away} at {percent(best.stress_over_limit, 0)} of the elastic limit"
    ahead = ahead_texts(best, answers.first_yield_interior, best.next_jump, _inside(answers))
    yield "  margin", "; ".join((share, *([_at_grips(answers, best)] if away else []), *ahead))
    if low == high:
        more = "beyond it the relaxation did not converge" if gave_up else "a larger load extends it"
        yield "  may drift", f"unknown: a single record has this share{f'; {more}' if best.grows else ''}"
        return
    of_mean = " of the mean" if " / " in _tension(best) else ""
    lowest, highest = (
        f"{_tension(end)} ({percent(mean_tension(end) / mean_tension(best) - 1.0, 0, signed=True)}{of_mean}"
        + (f"; {_sides(best, name)}" if best[f"{name}_between"] else "") + ")"
        for name, end in (("low", low), ("high", high))
    )  # fmt: skip
    if best.open_low:
        lowest = f"at most {lowest}, where the records begin,"
    if best.open_high:
        highest = f"at least {highest}, {'beyond which the relaxation did not converge' if gave_up else 'where the records end'}"
    snaps = "; ".join(between(*map(_tension, jump)) for jump in best.jumps)
    yield "  may drift", f"from {lowest} to {highest}{f'; the mesh jumps {snaps}' if snaps else ''}"
    error = answers.tension_error_percent
    nearest = min(abs(mean_tension(one) / mean_tension(best) - 1.0) for one in (low, high))
    if error is not None and nearest < 0.01 * error:
        yield "  accuracy", f"tensions at this preset are within {error:g} %, more than it may drift: use a finer solver.preset"


def _sides(best: Best, name: str) -> str:
    """The record beyond an end of the range of the best tension, which is not in it."""
    tensions = [_tension(one) for one in best[f"{name}_between"]]
    return f"not {tensions[0] if name == 'low' else tensions[1]}{', where the mesh jumps' if best[f'{name}_jump'] else ''}"


def ahead_texts(here: Row, first_yield: Event | None, jump: Sequence[Row] | None, inside: str = "") -> Iterator[str]:
    """Distance in tension from a state to the next snap-through and to first yield, where they are above it.

    jump: the states on both sides of that snap-through. inside: where the first yield is, in words.
    """
    at_jump = first_yield is not None and jump is not None and [*jump] == first_yield.between
    if jump is not None and not at_jump:
        yield f"snap-through at {_span(*jump)}, {_times(jump[0], here)}"
    if first_yield is None or first_yield.between[1].temperature_K != here.temperature_K:
        return
    low, high = first_yield.between
    if first_yield.resolved and mean_tension(first_yield) >= (1.0 - SAME) * mean_tension(here):
        yield f"first yield{inside} at {_times(first_yield, here)}"
    if not first_yield.resolved and mean_tension(high) > mean_tension(here):
        where = ", where the mesh snaps through" if first_yield.jump else ""
        yield f"first yield{inside} at {_span(low, high)}{where}, {_times(low, here)}"


def _span(low: Row, high: Row) -> str:
    """The mean tensions of two states: 4.0 to 4.3 N/m."""
    first, second = alike([mean_tension(low), mean_tension(high)], "N/m")
    return f"{first.split()[0] if first.split()[1] == second.split()[1] else first} to {second}"


def _times(there: Row, here: Row) -> str:
    return f"{mean_tension(there) / mean_tension(here):.3g} times this tension"


def _at_grips(answers: Answers, best: Best) -> str:
    """Stress at the grips in the state of the best tension, and where the wire first yields there."""
    stress = f"{engineering(best.stress_with_grips_Pa, 'Pa')} at the grips"
    first_yield = answers.first_yield
    if first_yield is None or not _inside(answers):
        return stress
    return f"{stress}, where the wire first yields {'as knitted' if first_yield.as_knitted else 'at ' + _tension(first_yield)}"
