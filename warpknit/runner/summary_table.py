"""The table at the end of a run."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import click

from ..base.text import celsius, duration, engineering, is_at_grips, of_sides, percent, short_percent, sides_text, span
from ..results.finding import Finding, ResultTable
from ..results.row import Row, Values
from ..scene.options import DEFAULT, GIVEN
from .answers_table import LEAST_SHARE, LEAST_STRESS, answer_findings, unreached_text
from .strength import assumed_note
from .summary import Estimate, Summary
from .variants import Means
from .warnings_of import CARRIED, fragment_share

SIDES = ("weft", "warp")
# contacts that are counted in pairs, and the others
PLACES = {"knit": ("at clasps", "between stitches"), "wires": ("at crossings", "elsewhere")}
LIGHT_PERCENT = 1.0  # of the pairs: fewer light contacts are not shown
LEAST_SPREAD = 5e-3  # of the mean of a figure: a smaller range is not shown
TIMED = "for steps, checks and files"  # part of the wall time; the others are the model and compilation
STATES = {"steady": "converged", "finished": "finished, not in equilibrium", "diverged": "did not converge"}
FOR_LOAD = 58  # columns of the load in the first line
LEAST_COLUMNS = 40  # for the texts, on a terminal


def summary_table(result: Summary, directory: Path, reflection: Iterable[Finding] = ()) -> ResultTable:
    """Table of a run with its measures and its reflection."""
    findings = (*summary_findings(result), *reflection, Finding("results", str(directory), short=True))
    return ResultTable(findings, tuple(result.warnings))


def summary_findings(result: Summary) -> Iterator[Finding]:
    """The rows of the table of a run."""
    end, model, answers, variants = result.end, result.model, result.answers, result.variants
    diverged = result.stop_reason == "diverged"
    state, invalid = STATES.get(result.stop_reason, result.stop_reason), model.get("warnings")
    valid = f", not valid ({', '.join(warning.code for warning in invalid)})" if invalid else ""
    yield heading(result.scene.name, result.scene.get("load", ""), state + valid)
    yield from _earlier_steps(result.stages)
    if diverged and answers is not None:
        yield Finding("load not reached", unreached_text(answers), short=True)
    here, between = PLACES.get(model.source, PLACES["wires"])
    if end.is_hook:
        yield from _hook_findings(end)
    elif "strain_weft" in end:
        yield from _mesh_findings(result, here, between)
    if "stress_max_Pa" in end:
        yield from _stress_findings(end, end.is_hook or model.boundary == "gripped", variants)
    if answers is not None:
        ends_at_top = diverged and end.tension_warp_N_per_m == answers.largest_tension.tension_warp_N_per_m
        yield from answer_findings(answers, end.yield_stress_Pa, failed=ends_at_top)
    if variants is not None:
        yield from _variants_findings(variants, end)
    if result.estimate.error is not None:
        yield _error_finding(result.estimate, end, all(result.scene.by_tension))
    elif model.get("one_of_many"):
        yield Finding("estimated error", "unknown for one mesh; leave out variants.count for a mean and its error", short=True)
    if result.spatial_model is not None:
        yield _spatial_finding(result.spatial_model)
    meshes = "" if variants is None else f" in each of {variants.count} meshes"
    cost = f"{model.nodes:,} nodes{meshes}, {result.solver.steps:,} steps, {duration(result.solver.wall_s, 3)}"
    yield from model_findings(model, cost)
    yield from _solver_findings(result)


def heading(name: str, text: str, state: str) -> Finding:
    """The first line: the scene, its load, and how it ended."""
    return Finding(name, f"{text:{FOR_LOAD}}  {state}".strip(), short=True)


def _earlier_steps(stages: Sequence[Row]) -> Iterator[Finding]:
    if len(stages) > 1:
        yield Finding("load step", stages[-1].stage, where=f", the last of {len(stages)}", short=True)
    for end in stages[:-1]:
        if not end.is_hook:
            strains = ", ".join(f"{percent(end[f'strain_{side}'], 2)} {side}" for side in SIDES)
            active, stress = percent(0.01 * end.active_percent, 0), engineering(end.stress_max_Pa, "Pa")
            text = f"{strains}; {sides_text(end.tension, 'N/m')}; {active} active; {stress}; {celsius(end.temperature_K)}"
            yield Finding(f"  end of {end.stage}", text, short=True)


def _solver_findings(result: Summary) -> Iterator[Finding]:
    solver = result.solver
    yield Finding("  wall time", f"{duration(solver.wall_s, 3)} {TIMED}")
    if solver.compile_s > 1.0:
        yield Finding("  compilation", duration(solver.compile_s, 3))
    if solver.get("preset"):
        known = result.answers and result.answers.tension_error_percent
        yield Finding("  preset", solver.preset, where=f", tensions within {known:g} %" if known else "")
    for note in (*(result.model.get("notes") or ()), *(solver.get("notes") or ())):
        yield Finding("  note", note)


def _spatial_finding(other: Row) -> Finding:
    strain = f"{percent(other.strain_weft, 2)} weft, {percent(other.strain_warp, 2)} warp"
    tension = sides_text((other.tension_weft_N_per_m, other.tension_warp_N_per_m), "N/m")
    active, stress = percent(0.01 * other.active_percent), engineering(other.stress_max_Pa, "Pa")
    text = f"strain {strain}; {tension}; {active} active; {stress} (mean of {other.meshes} meshes)"
    return Finding("in the spatial model", text, short=True)


def _error_finding(estimate: Estimate, end: Row, by_tension: bool) -> Finding:
    """The estimated error of each figure, and the largest part of it, of means.

    by_tension: whether both tensions are given, which then have no error.
    """
    force = None if by_tension else estimate.tension
    driver = {"force_N" if end.is_hook else "tension_N_per_m": force, "strain": estimate.strain}
    errors = {**driver, "active_percent": estimate.active_percent, "stress_max_Pa": estimate.stress}
    text = ", ".join(_changed(name, error, end) for name, error in errors.items() if error is not None)
    parts = {"friction": estimate.friction, "nodes": estimate.nodes, "the number of meshes": estimate.standard_error}
    known = {name: part for name, part in parts.items() if part is not None}
    return Finding("estimated error", text, where=f", mostly by {max(known, key=known.__getitem__)}" if known else "", short=True)


def _changed(name: str, change: float, end: Row, sign: str = "") -> str:
    """A change of a figure in its unit; change: relative to the larger of weft and warp, of active contacts in points."""
    what, _, side = name.removesuffix("_N_per_m").partition("_")
    if name == "active_percent":
        return f"active {change:{sign}.2g} points"
    if name == "force_N":
        return f"force {_signed(change * abs(end.drive_force_N), 'N', sign)}"
    if name == "stress_max_Pa":
        return f"stress {_signed(change * end.stress_max_Pa, 'Pa', sign)}"
    unit = "_N_per_m" if what == "tension" else ""
    largest = max(abs(end[f"{what}_{one}{unit}"]) for one in SIDES)
    text = _signed(change * largest, "N/m", sign) if unit else f"{100.0 * change * largest:{sign}.2g} points"
    return f"{what} {text}{f' {side}' if side else ''}"


def _signed(value: float, unit: str, sign: str) -> str:
    text = engineering(value, unit, 2)
    return f"+{text}" if sign and value > 0.0 else text


def _variants_findings(variants: Means, end: Row) -> Iterator[Finding]:
    figures = {
        "strain": ("strain_weft", "strain_warp"),
        "tension": ("tension_weft_N_per_m", "tension_warp_N_per_m"),
        "active": ("active_percent",),
        "stress": ("stress_max_Pa",),
    }
    ranges = [f"{name} {text}" for name, names in figures.items() if (text := _range(variants, names))]
    within = f"8 in 10 have {'; '.join(ranges)}" if ranges else "all alike"
    yield Finding(f"mean of {variants.count} meshes", within, short=True)
    if variants.standard_error is not None:
        yield Finding("  standard error", short_percent(variants.standard_error))
    if branch := variants.branch:
        name = branch.figure.removesuffix("_N_per_m").removesuffix("_Pa").replace("_", " ")
        here, others = (_shown(branch.figure, value) for value in (branch.mean, branch.others))
        stress = engineering(branch.stress_max_Pa, "Pa")
        text = f"{branch.count} of {variants.count} meshes: {name} {here} (others {others}), stress {stress}"
        yield Finding("  other equilibrium", text, short=True)
    if overshoot := variants.changes.get("overshoot"):
        changes = {name: 100.0 * change if name == "active_percent" else change for name, change in vars(overshoot).items()}
        text = ", ".join(_changed(name, change, end, "+") for name, change in changes.items())
        yield Finding("  change by overshoot", text, short=True)


def _range(variants: Means, names: Sequence[str]) -> str:
    """Range of eight in ten meshes, of one figure or in weft and warp; or empty."""
    found = [variants[name] for name in names if name in variants]
    if not any(one.p90 - one.p10 > LEAST_SPREAD * abs(one.mean) for one in found):
        return ""
    texts = [span(_shown(name, one.p10), _shown(name, one.p90)) for name, one in zip(names, found, strict=False)]
    return of_sides(texts) if len(texts) == len(SIDES) else texts[0]


def _shown(name: str, value: float) -> str:
    if name.endswith("percent") or name.startswith("strain"):
        return f"{value if name.endswith('percent') else 100.0 * value:.3g} %"
    return engineering(value, "Pa" if name.endswith("Pa") else "N/m")


def _mesh_findings(result: Summary, here: str, between: str) -> Iterator[Finding]:
    """Strain, tension and contacts of a mesh; here, between: words for contacts in pairs, and for other contacts."""
    end, panel, given = result.end, result.end.get("panel") or {}, result.scene.get("by_tension") or [True, False]
    weft, warp = (percent(end[f"strain_{side}"], 2) for side in SIDES)
    yield Finding("strain", f"{weft} weft, {warp} warp", short=any(given))
    zero = 0.0 if result.answers is None else result.answers.tension_tolerance_N_per_m
    least = max(LEAST_SHARE * max(map(abs, end.tension)), zero)
    shown = [part if abs(part) > least else 0.0 for part in end.tension]
    by_strain = not all(given) or result.stop_reason != "steady"
    yield Finding("tension", sides_text(shown, "N/m"), short=by_strain)
    if max(fragment_share(end, side) for side in SIDES) > CARRIED:
        parts = [end[f"fragment_tension_{side}_N_per_m"] for side in SIDES]
        yield Finding("  of cut wire ends", sides_text(parts, "N/m"))
    if "tension_median_weft_N_per_m" in panel:
        median = [panel[f"tension_median_{side}_N_per_m"] for side in SIDES]
        yield Finding("  median of the panel", sides_text(median, "N/m"), short=True)
    others = end.get("elsewhere")
    digits = "d" if result.variants is None else ".3g"  # means are no whole numbers
    more = f"; {others:{digits}} more {between}" if others else ""
    count = f"  ({end.active:{digits}} of {end.pairs}{f' {here}' if others else ' pairs'}{more})"
    yield Finding("active contacts", f"{end.active_percent:.3g} %", where=count, short=True)
    if (light := end.get("light_percent") or 0.0) > LIGHT_PERCENT:
        yield Finding(
            "  light ones", f"{light:.3g} %", where=" of the pairs, with less than a tenth of the mean force", short=True
        )
    more = ""
    if force := end.get("elsewhere_force_max_N"):
        more = f" {here}; {engineering(force, 'N')} {between}"
    yield Finding("  largest force", end.force_max_N, "N", where=more)


def _stress_findings(end: Row, has_grips: bool, variants: Means | None) -> Iterator[Finding]:
    stress, limit = end.stress_max_Pa, end.yield_stress_Pa
    shown = stress * (stress > LEAST_STRESS * limit)
    assumed = f" (assumed {engineering(limit, 'Pa')})" if end.yield_stress_assumed else ""
    at_grips = has_grips and is_at_grips(end.stress_interior_max_Pa, shown)
    part = "" if end.get("stress_max_part") is None or variants is not None else f", in the {end.stress_max_part}"
    place = f"; {engineering(end.stress_interior_max_Pa, 'Pa')} away from the grips" if at_grips else part
    where = f", {percent(stress / limit, 0)} of yield{assumed}{place}" if shown else ""
    yield Finding("largest wire stress", shown, "Pa", where=where, short=True)
    if end.stress_max_so_far_Pa > 1.01 * shown:
        yield Finding("  largest so far", end.stress_max_so_far_Pa, "Pa")
    if end.yield_fraction and end.get("plastic_fraction") is None:
        yield Finding("  above yield", short_percent(end.yield_fraction), where=" of the wire; elastic, without a permanent set")
    if plastic := end.get("plastic_fraction"):
        where = f" of the wire, plastic strain up to {short_percent(end.plastic_strain_max or 0.0)}"
        yield Finding("  yielded", short_percent(plastic), where=where, short=True)


def model_findings(model: Values, cost: str) -> Iterator[Finding]:
    """Kind of model with cost and reason, and the friction of its wires."""
    yield Finding(f"{model.kind} model", cost, short=True)
    yield Finding("  reason", model.kind_reason, short=model.kind_reason not in (GIVEN, DEFAULT))
    if friction := model.get("friction"):
        assumed = assumed_note("contact.friction", model.get("friction_assumed", False))
        yield Finding("  friction", f"{friction:.3g}", where=assumed, short=True)


def _hook_findings(hook: Row) -> Iterator[Finding]:
    yield Finding("displacement", hook.displacement_m, "m", where=f", force {engineering(hook.drive_force_N, 'N')}", short=True)
    left, right = hook.force_left_N, hook.force_right_N
    both = f"{engineering(left, 'N')} on the left wire, {engineering(right, 'N')} on the right wire"
    yield Finding("contact force", both, short=True)
    if min(left, right) <= 0.0:
        yield Finding("contact at", "none: the wires do not touch", short=True)
        return
    places = [f"{engineering(hook[f'arc_{side}_m'], 'm')} on the {side} wire" for side in ("left", "right")]
    yield Finding("contact at", ", ".join(places), where=" from the lower clamp", short=True)
    slid = [f"{engineering(hook[f'slide_{side}_m'], 'm')} on the {side} wire" for side in ("left", "right")]
    yield Finding("slid since closing", ", ".join(slid), short=True)
    if hook.ground_force_N > 0.0:
        yield Finding("force from the ground", hook.ground_force_N, "N", short=True)


def print_table(findings: Iterable[Finding]) -> None:
    """Print names and texts to stdout; on a terminal in two columns, warnings in colour."""
    lines = [(finding.name, finding.text) for finding in findings]
    width, columns = max((len(name) for name, _ in lines), default=0), shutil.get_terminal_size().columns
    for name, text in lines:
        line = f"{name:{width}}  {text}"
        if sys.stdout.isatty():
            behind = " " * (width + 2)
            line = textwrap.fill(line, max(columns, width + LEAST_COLUMNS), subsequent_indent=behind, break_on_hyphens=False)
        click.secho(line, fg="yellow" if name[1:].isdigit() else None)
