"""The answers of a run in words: rows of its table, and of the report."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from ..base.text import (
    alike,
    between,
    both,
    celsius,
    counted,
    engineering,
    exact,
    is_at_grips,
    listed,
    of_sides,
    percent,
    place_text,
    sides_text,
    span,
)
from ..mechanics.driven_strain import TOLERANCE
from ..results.finding import Finding
from ..results.row import Row, Values
from .answers import HEATED, SERVICE_TENSIONS, Answers, ClassAnswer, Heat, Service
from .best_tension import SAME, Best
from .branches import Event
from .history import mean_tension

LEAST_SHARE = 1e-4  # of the larger of both: smaller tensions are scatter about zero
LEAST_CHANGE = 1e-7  # of a strain
LEAST_STRESS = 1e-9  # of the elastic limit: less is round-off
OPEN = "open"
PEAK_ON_THE_WAY = 1.02  # of the stress at begin and end of a change of temperature: it is shown too


def answer_findings(answers: Answers, yield_stress: float, *, failed: bool = False) -> Iterator[Finding]:
    """The answers as rows.

    yield_stress [Pa]: elastic limit of the wire. failed: the relaxation did not converge beyond the largest tension.
    """
    answers = _without_scatter(answers, answers.tension_tolerance_N_per_m)
    reached = f"up to {_tension(answers.largest_tension)}"
    if failed:
        reached += ", beyond which the relaxation did not converge"
    of_mean = " (mean tension)" if " weft" in _tension(answers.largest_tension) else ""
    yield Finding("classes closed", _classes(answers.contacts), where=of_mean, short=True)
    for one in answers.contacts:
        name = f"  class {one.name}" if len(answers.contacts) > 1 else "  contacts"
        yield Finding(name, f"{_closing(one, reached)} ({counted(one.pairs, 'pair')})")
    for point in answers.service:
        several = sum(one.tension_N_per_m == point.tension_N_per_m for one in answers.service) > 1
        where = f", in {point.stage!r}" if several else ""
        is_asked = point.tension_N_per_m not in SERVICE_TENSIONS
        yield Finding(f"active at {exact(point.tension_N_per_m, 'N/m')}", _service(point, reached) + where, short=is_asked)
    yield Finding("first yield", _yield(answers, yield_stress, reached))
    if away := _inside(answers):
        inner = answers.first_yield_interior
        yield Finding(f" {away}", f"none {reached}" if inner is None else _where(inner))
    for stage in answers.heat:
        yield from _heat(stage)
    yield from _best(answers, yield_stress, failed)


def _classes(contacts: Sequence[ClassAnswer]) -> str:
    """Mean tension at which each class closes: A and C below 0.1 N/m, B at 1.58 N/m; D open."""
    if len(contacts) == 1:
        return _closed_at(contacts[0])
    names: dict[str, list[str]] = {}
    for one in contacts:
        names.setdefault(_closed_at(one), []).append(one.name)
    closed = [f"{listed(group)} {text}" for text, group in names.items() if text != OPEN]
    opened = [f"{listed(names[OPEN])} {OPEN}"] if OPEN in names else []
    return "; ".join([", ".join(closed)] * bool(closed) + opened)


def _closed_at(one: ClassAnswer) -> str:
    closes = one.closes
    if closes is None:
        return OPEN
    found = "as knitted" if closes.as_knitted else _place_of(closes, _mean)
    if _closed_before(one):
        found += " (also before)"
    return found if closes.opens is None else f"{found} (open again)"


def _place_of(one: Event, shown: Callable[[Row], str]) -> str:
    """Tension of an event, `shown` in words; of both records if they are far apart."""
    if one.resolved:
        return f"at {shown(one)}"
    low, high = one.between
    return f"below {shown(high)}" if one.slack and not one.jump else between(shown(low), shown(high))


def _mean(state: Row) -> str:
    return engineering(max(mean_tension(state), 0.0), "N/m")


def _service(point: Service, reached: str) -> str:
    """Share of active contacts at a service tension; of both records around it if they differ."""
    if sides := point.jump or point.get("between"):
        where = "snap-through" if point.jump else "use more load levels, output.frames"
        share = between(*(percent(0.01 * one.active_percent) for one in sides))
        return f"{share} (records at {both(*map(_tension, sides))}; {where})"
    if point.state is None or point.active_percent is None:
        return point.get("why") or f"not reached; {reached}"
    tension = _tension(point.state)
    mean = f"at a mean of {tension}, " if " weft" in tension else ""
    return f"{percent(0.01 * point.active_percent)}, {mean}{_strain(point.state)}"


def _inside(answers: Answers) -> str:
    """Words for a first yield away from the grips; empty where the yield at the grips is the same."""
    first_yield, inner = answers.first_yield, answers.first_yield_interior
    differs = first_yield is not None and (inner is None or mean_tension(inner) > mean_tension(first_yield))
    return " away from the grips" if differs else ""


def unreached_text(answers: Answers) -> str:
    """Largest converged tension of a run that failed, and the requested tension."""
    answers = _without_scatter(answers, answers.tension_tolerance_N_per_m)
    top, asked = answers.largest_tension, answers.asked_tension_N_per_m
    of_asked = "" if asked is None else f" of the {exact(asked, 'N/m')} in the scene"
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


def _tension(state: Row) -> str:
    """Tension in weft and warp; their mean where they differ by no more than their tolerance."""
    both = [state[f"tension_{side}_N_per_m"] for side in ("weft", "warp")]
    if abs(both[0] - both[1]) <= 2.0 * TOLERANCE * max(map(abs, both)):
        both = 2 * [0.5 * (both[0] + both[1])]
    least = LEAST_SHARE * max(map(abs, both))
    return sides_text([value if abs(value) > least else 0.0 for value in both], "N/m")


def _strain(state: Row) -> str:
    return f"strain {of_sides([percent(state[f'strain_{side}']) for side in ('weft', 'warp')])}"


def _closing(one: ClassAnswer, reached: str) -> str:
    closes = one.closes
    if closes is None:
        some = f", {percent(0.01 * one.active_percent)} active" if one.active_percent else ""
        return f"open {reached}{some}"
    found = "closed as knitted" if closes.as_knitted else f"closes {_where(closes)}"
    if before := _closed_before(one):
        found += f", also closed {before}"
    if (opens := closes.opens) is None:
        return found
    heated = opens.temperature_K != closes.between[1].temperature_K
    return f"{found}, open again at {_tension(opens)}" + (f" and {celsius(opens.temperature_K)}" if heated else "")


def _closed_before(one: ClassAnswer) -> str:
    """The first range in which a class was closed before it opened again; empty where one record alone has it."""
    if one.closes is None or one.closes.first_touch is None:
        return ""
    first, last = (_mean(one.closed[0][side]) for side in ("from", "to"))
    return "" if first == last else f"from {first} to {last}"


def _where(one: Event) -> str:
    """Tension and strain of an event; of both records if they are far apart, or around a snap-through."""
    shown, (low, high) = _place_of(one, _tension), one.between
    if one.resolved:
        return f"{shown}, {_strain(one)}"
    if one.slack and not one.jump:
        return f"{shown} (the mesh is slack up to {_strain(high)})"
    if shown.startswith("at ") and low.temperature_K != high.temperature_K:
        shown = f"between {celsius(low.temperature_K)} and {celsius(high.temperature_K)} {shown}"
    strain = both(_strain(low), _strain(high)).replace("and strain ", "and ")
    return f"{shown}, {strain}{', a snap-through' if one.jump else ''}"


def _yield(answers: Answers, limit: float, reached: str) -> str:
    found = answers.first_yield
    if found is None:
        peak = answers.largest_stress
        if peak.stress_max_Pa < LEAST_STRESS * limit:
            return f"none {reached}: no stress"
        stress = engineering(peak.stress_max_Pa, "Pa")
        return f"none {reached}: {stress}, {percent(peak.stress_max_Pa / limit, 0)} of yield, {_place(peak)}"
    return f"{'as knitted' if found.as_knitted else _where(found)}, {_place(found)}"


def _place(peak: Row) -> str:
    part = peak.stress_max_part
    position = place_text(peak.stress_max_x_m, peak.stress_max_y_m)
    where = f"wire {peak.stress_max_wire}, node {peak.stress_max_node} at {position} from the corner"
    return f"{where}" if part is None else f"in the {part}, {where}"


def _heat(stage: Heat) -> Iterator[Finding]:
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
        parts.append(f"largest {engineering(peak.stress_max_Pa, 'Pa')} at {celsius(peak.temperature_K)}")
    if stage.jump_between is not None:
        before, after = stage.jump_between
        there = between(*(celsius(one.temperature_K) for one in (before, after)))
        alone = f": {_change(begin, before)} up to there" if before.temperature_K != begin.temperature_K else ""
        parts.append(f"snap-through to another equilibrium {there}, which heat alone does not cause{alone}")
    yield Finding(f"heat, {celsius(begin.temperature_K).split()[0]} to {celsius(end.temperature_K)}", held + ", ".join(parts))


def _change(begin: Row, end: Row) -> str:
    """Change of the strain in weft and warp, over one plus the strain before; both with the same digits."""
    changes = [100.0 * (end[name] - begin[name]) / (1.0 + begin[name]) for name in ("strain_weft", "strain_warp")]
    digits = max(len(f"{change:.2g}".partition(".")[2]) for change in changes)
    return of_sides([f"{change:+.{digits}f} %" for change in changes])


def _best(answers: Answers, limit: float, failed: bool) -> Iterator[Finding]:
    best, unknown = answers.best, ""
    if failed and answers.first_yield_interior is None:
        unknown = f"; not known beyond {_tension(answers.largest_tension)}, where the relaxation did not converge"
    if best is None:
        yield Finding("best tension", f"none: no record has active contacts under tension below yield{unknown}", short=True)
        return
    low, high, here = best.low, best.high, mean_tension(best)
    away = " away from the grips" if is_at_grips(best.stress_max_Pa, best.stress_with_grips_Pa) else ""
    of_mean, stage = " (mean)" if " weft" in _tension(best) else "", f" in {best.stage!r}" if best.stages > 1 else ""
    active = f"{percent(0.01 * best.active_percent, 0)} active (the most under this load)"
    valid = f"valid from {'at most ' * best.open_low}{_mean(low)} to {'at least ' * best.open_high}{_mean(high)}"
    if low == high:
        larger = "at the grips the wire yields" if best.stress_with_grips_Pa > limit else "a larger load may be better"
        beyond = "beyond it the relaxation did not converge" if failed else larger
        valid = f"{beyond if best.grows else 'valid in one record only'}{unknown}"
    found = f"{active}, {engineering(best.stress_max_Pa, 'Pa')}{away}"
    yield Finding("best tension", f"{_mean(best)}{of_mean}{stage}: {found}", where=f"; {valid}", short=True)
    share = f"stress{away} at {percent(best.stress_over_limit, 0)} of yield"
    ahead = ahead_texts(best, answers.first_yield_interior, best.next_jump, _inside(answers))
    yield Finding("  margin", "; ".join((share, *([_at_grips(answers, best)] if away else []), *ahead)))
    if low == high:
        return

    def end_of(name: str, last: str) -> str:
        end, sides = best[name], best[f"{name}_between"]
        outside = "" if sides is None else f"; {_tension(sides[name == 'high'])} is outside"
        snap = ", a snap-through" * best[f"{name}_jump"]
        text = f"{_tension(end)} ({percent(mean_tension(end) / here - 1.0, 0, signed=True)}{outside}{outside and snap})"
        return f"{text}, {last}" if best[f"open_{name}"] else text

    lowest = end_of("low", "the first record,")
    highest = end_of("high", "beyond which the relaxation did not converge" if failed else "the end of the load")
    snaps = "; ".join(between(*map(_tension, jump)) for jump in best.jumps)
    yield Finding("  valid", f"from {lowest} to {highest}{f'; snap-through {snaps}' if snaps else ''}{unknown}")
    error = answers.tension_error_percent
    if error is not None and min(abs(mean_tension(one) / here - 1.0) for one in (low, high)) < 0.01 * error:
        text = f"tensions at this preset are within {error:g} %, more than this range: set solver.preset = 'reference'"
        yield Finding("  accuracy", text)


def ahead_texts(here: Row, first_yield: Event | None, jump: Sequence[Row] | None, inside: str = "") -> Iterator[str]:
    """Tension up to the next snap-through and first yield, over a state's.

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
        where = ", a snap-through" if first_yield.jump else ""
        yield f"first yield{inside} at {_span(low, high)}{where}, {_times(low, here)}"


def _span(low: Row, high: Row) -> str:
    return span(*alike([mean_tension(low), mean_tension(high)], "N/m"))


def _times(there: Row, here: Row) -> str:
    return f"{mean_tension(there) / mean_tension(here):.3g} times this tension"


def _at_grips(answers: Answers, best: Best) -> str:
    stress = f"{engineering(best.stress_with_grips_Pa, 'Pa')} at the grips"
    first_yield = answers.first_yield
    if first_yield is None or not _inside(answers):
        return stress
    return f"{stress}, where the wire first yields {'as knitted' if first_yield.as_knitted else 'at ' + _tension(first_yield)}"
