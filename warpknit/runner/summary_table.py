"""The short table at the end of a run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import click

from ..base.text import alike, celsius, duration, engineering, is_at_grips, percent, short_percent
from ..results.finding import Finding, warning_lines
from ..results.row import Row, Values
from .answers_table import LEAST_SHARE, LEAST_STRESS, answer_rows, unreached_text
from .other_model import SpatialMeans
from .strength import assumed_note
from .summary import Estimate, Summary
from .variants import Means
from .warnings_of import CARRIED, fragment_share

SIDES = ("weft", "warp")
# contacts that are counted in pairs, and the others
PLACES = {"knit": ("at clasps", "between stitches"), "wires": ("at crossings", "elsewhere")}
LEAST_SPREAD = 5e-3  # of the mean of a figure: a smaller range is not shown
TIMED = "for steps, checks and files"  # what the wall time of a run or map includes: neither the model nor compilation


def summary_findings(result: Summary, directory: Path) -> Iterator[Finding]:
    """The lines of the table of a run, for the measures that it has."""
    end, model, solver, answers = result.end, result.model, result.solver, result.answers
    yield from warning_lines(result.model_warnings)
    yield from model_findings(model)
    diverged = result.stop_reason == "diverged"
    if len(result.stages) > 1:
        place = "last record in stage" if diverged else "at the end of stage"
        at = "" if "temperature_K" not in end else f", at {celsius(end.temperature_K)}"
        yield Finding(place, end.stage, where=f"{at} ({len(result.stages)} stages; summary.json has all)")
        for stage in result.stages[:-1]:
            yield from _earlier_stage(stage)
    if diverged and answers is not None:
        yield Finding("load not reached", unreached_text(answers))
    if result.variants is not None:
        yield from _variants_findings(result.variants)
    here, between = PLACES.get(model.source, PLACES["wires"])
    if end.is_hook:
        yield from _hook_findings(end)
    elif "strain_weft" in end:
        yield from _mesh_findings(result, here, between)
    if "stress_max_Pa" in end:
        yield from _stress_findings(end, end.is_hook or model.boundary == "gripped", result.variants)
    if answers is not None:
        ends_at_top = diverged and end.tension_warp_N_per_m == answers.largest_tension.tension_warp_N_per_m
        yield from (Finding(*row) for row in answer_rows(answers, end.yield_stress_Pa, gave_up=ends_at_top))
    if result.estimate.error is not None:
        yield Finding("estimated error", short_percent(result.estimate.error), where=_error_parts(result.estimate))
    if (other := result.spatial_model) is not None:
        yield _spatial_finding(other)
    yield Finding("time steps", f"{solver.steps:,} of {model.nodes:,} nodes")
    before = f"; before it {duration(solver.compile_s, 3)} to compile the kernels" if solver.compile_s > 1.0 else ""
    yield Finding("wall time", f"{duration(solver.wall_s, 3)} {TIMED}", where=before)
    yield Finding("stopped", result.stop_reason)
    yield from warning_lines(result.other_warnings)
    yield Finding("results in", str(directory))


def _spatial_finding(other: SpatialMeans) -> Finding:
    """What the spatial model gives under the load of a planar tile."""
    tension = " / ".join(alike((other.tension_weft_N_per_m, other.tension_warp_N_per_m), "N/m"))
    strain = " / ".join(percent(one, 2) for one in (other.strain_weft, other.strain_warp))
    stress, active = engineering(other.stress_max_Pa, "Pa"), percent(0.01 * other.active_percent)
    return Finding("in the spatial model", f"{strain}, {tension}, {active} active, {stress} (mean of {other.meshes} meshes)")


def _error_parts(estimate: Estimate) -> str:
    """The parts of the estimated error of means."""
    parts = {"friction": estimate.friction, "nodes": estimate.nodes, "number of meshes": estimate.standard_error}
    found = [f"{name} {short_percent(value)}" for name, value in parts.items() if value is not None]
    return f" ({', '.join(found)})" if found else ""


def _variants_findings(variants: Means) -> Iterator[Finding]:
    """How many meshes the figures are means of, how well these are known, and whether they are of one kind."""
    error = "" if variants.standard_error is None else f", standard error {short_percent(variants.standard_error)}"
    yield Finding("meshes", f"{variants.count}", where=f" with scattered loops{error}; in brackets: the range of eight in ten")
    if branch := variants.branch:
        name = branch.figure.removesuffix("_N_per_m").removesuffix("_Pa").replace("_", " ")
        unit = "Pa" if branch.figure.endswith("Pa") else "N/m"
        strain = branch.figure.startswith("strain")
        here, others = (percent(one, 2) if strain else engineering(one, unit) for one in (branch.mean, branch.others))
        text = (
            f"{branch.count} of {variants.count} meshes: {name} {here}, not {others}; {engineering(branch.stress_max_Pa, 'Pa')}"
        )
        yield Finding("  on another branch", text)


def _spread(variants: Means | None, *names: str, factor: float = 1.0, unit: str = "") -> str:
    """The range of figures of the meshes, in brackets, in a unit or by a factor; empty where it is nothing."""
    found = [variants[name] for name in names if variants is not None and name in variants]
    if not any(one.p90 - one.p10 > LEAST_SPREAD * abs(one.mean) for one in found):
        return ""
    if unit:
        return f" ({' / '.join(' to '.join(alike((one.p10, one.p90), unit)) for one in found)})"
    return f" ({' / '.join(f'{factor * one.p10:.3g} to {factor * one.p90:.3g}' for one in found)})"


def _mesh_findings(result: Summary, here: str, between: str) -> Iterator[Finding]:
    """Strain, contacts and tension of a mesh; here, between: where its contacts are that are counted in pairs, and the others."""
    end, panel = result.end, result.end.get("panel") or {}
    variants = result.variants
    strains, tensions = (
        tuple(f"{what}_{side}{unit}" for side in SIDES) for what, unit in (("strain", ""), ("tension", "_N_per_m"))
    )
    strain = " / ".join(percent(end[name], 2) for name in strains)
    yield Finding("strain, weft / warp", strain, where=_spread(variants, *strains, factor=100.0))
    others = end.get("elsewhere")
    digits = "d" if variants is None else ".3g"  # means are no whole numbers
    more = f"; {others:{digits}} more contact{'s' * (others != 1)} {between}" if others else ""
    count = f"{end.active:{digits}} of {end.pairs} pairs" + (f" {here}" if others else "")
    spread = _spread(variants, "active_percent")
    yield Finding(
        "active contacts", f"{end.active_percent:.3g} %", where=f"{spread}, {count}{more}" if spread else f" ({count}{more})"
    )
    zero = 0.0 if result.answers is None else result.answers.tension_tolerance_N_per_m
    least = max(LEAST_SHARE * max(map(abs, end.tension)), zero)
    shown = tuple(part if abs(part) > least else 0.0 for part in end.tension)
    yield Finding("tension, weft / warp", shown, "N/m", where=_spread(variants, *tensions, unit="N/m"))
    if max(fragment_share(end, side) for side in SIDES) > CARRIED:
        parts = tuple(end[f"fragment_tension_{side}_N_per_m"] for side in SIDES)
        yield Finding("  of pieces at the grips", parts, "N/m")
    if "tension_median_weft_N_per_m" in panel:
        yield Finding("  median of the panel", tuple(panel[f"tension_median_{side}_N_per_m"] for side in SIDES), "N/m")
    if force := end.get("elsewhere_force_max_N"):
        more = f" {here}; {engineering(force, 'N')} {between}"
    yield Finding("largest contact force", end.force_max_N, "N", where=more if force else "")


def _stress_findings(end: Row, has_grips: bool, variants: Means | None) -> Iterator[Finding]:
    """Largest stress, and what of the wire has yielded."""
    stress, limit = end.stress_max_Pa, end.yield_stress_Pa
    note = assumed_note("wire.yield_stress", end.yield_stress_assumed)
    shown = stress * (stress > LEAST_STRESS * limit)
    spread = _spread(variants, "stress_max_Pa", unit="Pa")
    yield Finding("largest stress", shown, "Pa", where=f"{spread}, {percent(stress / limit, 0)} of the elastic limit", sure=note)
    if has_grips and is_at_grips(end.stress_interior_max_Pa, shown):
        yield Finding("  away from the grips", end.stress_interior_max_Pa, "Pa")
    if end.stress_max_so_far_Pa > 1.01 * shown:
        yield Finding("  largest so far", end.stress_max_so_far_Pa, "Pa")
    if end.yield_fraction and end.get("plastic_fraction") is None:
        where = " of the wire; elastic, without a permanent set"
        yield Finding("  above the elastic limit", short_percent(end.yield_fraction), where=where)
    if plastic := end.get("plastic_fraction"):
        where = f" of the wire, plastic strain up to {short_percent(end.plastic_strain_max or 0.0)}"
        yield Finding("yielded", short_percent(plastic), where=where)


def _earlier_stage(end: Row) -> Iterator[Finding]:
    """The line of a stage before the last one; none of two hooked wires."""
    if end.is_hook:
        return
    strains, tensions = " / ".join(percent(end[f"strain_{side}"], 2) for side in SIDES), " / ".join(alike(end.tension, "N/m"))
    text = f"{strains}, {tensions}, {percent(0.01 * end.active_percent)} active, {engineering(end.stress_max_Pa, 'Pa')}"
    yield Finding(f"  end of {end.stage}", text, where=f", at {celsius(end.temperature_K)}")


def model_findings(model: Values) -> Iterator[Finding]:
    """The kind of model and why it is of this kind, and the friction of its wires."""
    yield Finding("model", model.kind, where=f" ({model.kind_reason})")
    if friction := model.get("friction"):
        yield Finding("friction", f"{friction:.3g}", sure=assumed_note("contact.friction", bool(model.get("friction_assumed"))))


def _hook_findings(hook: Row) -> Iterator[Finding]:
    """The lines of two hooked wires."""
    by = f", by a force of {engineering(hook.drive_force_N, 'N')}"
    yield Finding("displacement", hook.displacement_m, "m", where=by)
    left, right = hook.force_left_N, hook.force_right_N
    both = f"{engineering(left, 'N')} on the left wire, {engineering(right, 'N')} on the right one"
    yield Finding("contact force", both)
    if min(left, right) <= 0.0:
        yield Finding("contact at", "none: the wires do not touch")
        return
    places = [f"{engineering(hook[f'arc_{side}_m'], 'm')} on the {side} wire" for side in ("left", "right")]
    yield Finding("contact at", ", ".join(places), where=" from the lower clamp")
    yield Finding("slid since it closed", (hook.slide_left_m, hook.slide_right_m), "m")
    if hook.ground_force_N > 0.0:
        yield Finding("force from the ground", hook.ground_force_N, "N")


def print_table(findings: Iterable[Finding]) -> None:
    """Print names and texts to stdout."""
    from rich.console import Console
    from rich.table import Table

    console, lines = Console(highlight=False, markup=False), [(finding.name, finding.text) for finding in findings]
    if not console.is_terminal:
        width = max((len(heading) for heading, _text in lines), default=0)
        for heading, text in lines:
            click.echo(f"{heading:{width}}  {text}")
        return
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for heading, text in lines:
        table.add_row(heading, text, style="yellow" if heading == "warning" else None)
    console.print(table)
