"""The short table at the end of a run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import click

from ..base.text import alike, celsius, duration, engineering, is_at_grips, percent, short_percent
from .answers_table import LEAST_SHARE, LEAST_STRESS, answer_rows, unreached_text
from .strength import assumed_note
from .warnings_of import CARRIED, fragment_share

# contacts that are counted in pairs, and the others
PLACES = {"knit": ("at clasps", "between stitches"), "wires": ("at crossings", "elsewhere")}
TIMED = "for steps, checks and files"  # what the wall time of a run or map includes: neither the model nor compilation


def summary_rows(summary: Mapping[str, Any], directory: Path) -> Iterator[tuple[str, str]]:
    """Rows of the table: pairs of a heading and a text, for the keys that `summary.json` has."""

    def value(*keys: str) -> Any:
        entry: Any = summary
        for key in keys:
            entry = entry.get(key) if isinstance(entry, Mapping) else None
        return entry

    of_model = value("model", "warnings") or []
    yield from (("warning", warning) for warning in of_model)
    yield from model_rows(value("model"))
    stages = value("stages") or []
    diverged = value("stop_reason") == "diverged"
    if len(stages) > 1:
        place = "last record in stage" if diverged else "at the end of stage"
        temperature = value("mesh", "temperature_K")
        at = "" if temperature is None else f", at {celsius(temperature)}"
        yield place, f"{stages[-1].get('name')}{at} ({len(stages)} stages; summary.json has all)"
        for stage in stages[:-1]:
            yield from _earlier_stage(stage)
    if diverged and (reached := value("answers")) is not None:
        yield "load not reached", unreached_text(reached)
    hook = value("hook")
    if hook is not None:
        yield from _hook_rows(hook)
    if hook is None and (strain := value("mesh", "strain_weft")) is not None:
        yield "strain, weft / warp", f"{percent(strain, 2)} / {percent(value('mesh', 'strain_warp') or 0.0, 2)}"
    here, between = PLACES.get(value("model", "source"), PLACES["wires"])
    if hook is None and value("contacts", "active") is not None:
        yield "active contacts", _active(value("contacts"), here, between)
    if hook is None and (tension := value("mesh", "tension_weft_N_per_m")) is not None:
        warp = value("mesh", "tension_warp_N_per_m") or 0.0
        least = max(LEAST_SHARE * max(abs(tension), abs(warp)), value("answers", "tension_tolerance_N_per_m") or 0.0)
        yield "tension, weft / warp", " / ".join(alike([part if abs(part) > least else 0.0 for part in (tension, warp)], "N/m"))
        if max(fragment_share(value("mesh"), side) for side in ("weft", "warp")) > CARRIED:
            parts = [value("mesh", f"fragment_tension_{side}_N_per_m") for side in ("weft", "warp")]
            yield "  of pieces at the grips", " / ".join(alike(parts, "N/m"))
        medians = [value("panel", f"tension_median_{side}_N_per_m") for side in ("weft", "warp")]
        if None not in medians:
            yield "  median of the panel", " / ".join(alike(medians, "N/m"))
    if hook is None and (force := value("contacts", "force_max_N")) is not None:
        others = value("contacts", "elsewhere_force_max_N")
        more = f" {here}; {engineering(others, 'N')} {between}" if others else ""
        yield "largest contact force", engineering(force, "N") + more
    if (stress := value("wire", "stress_max_Pa")) is not None:
        limit = value("wire", "yield_stress_Pa")
        of_limit = f", {percent(stress / limit, 0)} of the elastic limit" if limit else ""
        stress *= stress > LEAST_STRESS * (limit or 0.0)
        note = assumed_note("wire.yield_stress", bool(value("wire", "yield_stress_assumed")))
        yield "largest stress", engineering(stress, "Pa") + of_limit + note
        has_grips = hook is not None or value("model", "boundary") == "gripped"
        interior = value("wire", "stress_interior_max_Pa") if has_grips else None
        if interior is not None and is_at_grips(interior, stress):
            yield "  away from the grips", engineering(interior, "Pa")
    if (peak := value("wire", "stress_max_so_far_Pa")) is not None and stress is not None and peak > 1.01 * stress:
        yield "  largest so far", engineering(peak, "Pa")
    if (above := value("wire", "yield_fraction")) and value("wire", "plastic_fraction") is None:
        yield "  above the elastic limit", f"{short_percent(above)} of the wire; elastic, without a permanent set"
    if plastic := value("wire", "plastic_fraction"):
        strain = value("wire", "plastic_strain_max") or 0.0
        yield "yielded", f"{short_percent(plastic)} of the wire, plastic strain up to {short_percent(strain)}"
    if (answers := value("answers")) is not None:
        ends_at_top = diverged and value("mesh", "tension_warp_N_per_m") == answers["largest_tension"]["tension_warp_N_per_m"]
        yield from answer_rows(answers, value("wire", "yield_stress_Pa"), gave_up=ends_at_top)
    if (error := value("quality", "estimated_error")) is not None:
        yield "estimated error", short_percent(error)
    if (steps := value("solver", "steps")) is not None:
        yield "time steps", f"{steps:,} of {value('model', 'nodes') or 0:,} nodes"
    if (wall := value("solver", "wall_s")) is not None:
        compiling = value("solver", "compile_s")
        before = f"; before it {duration(compiling, 3)} to compile the kernels" if compiling and compiling > 1.0 else ""
        yield "wall time", f"{duration(wall, 3)} {TIMED}{before}"
    yield "stopped", str(value("stop_reason"))
    yield from (("warning", str(warning)) for warning in value("warnings") or [] if warning not in of_model)
    yield "results in", str(directory)


def _active(contacts: Mapping[str, Any], here: str, between: str) -> str:
    """Share and number of the active contacts, from the section `contacts` of a summary, and the number of others."""
    count, share, others = (
        f"{contacts['active']} of {contacts['pairs']} pairs",
        contacts.get("active_percent"),
        contacts.get("elsewhere"),
    )
    if others:
        count += f" {here}; {others} more contact{'s' * (others != 1)} {between}"
    return count if share is None else f"{share:.3g} % ({count})"


def _earlier_stage(stage: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Row of a stage before the last one, from its part of `stages` in a summary; none of two hooked wires."""
    mesh, contacts, wire = (stage.get(part) or {} for part in ("mesh", "contacts", "wire"))
    if "strain_weft" not in mesh or "active_percent" not in contacts or "stress_max_Pa" not in wire:
        return
    strains = " / ".join(percent(mesh[f"strain_{side}"], 2) for side in ("weft", "warp"))
    tensions = " / ".join(alike([mesh[f"tension_{side}_N_per_m"] for side in ("weft", "warp")], "N/m"))
    share, stress = contacts["active_percent"], engineering(wire["stress_max_Pa"], "Pa")
    text = f"{strains}, {tensions}, {percent(0.01 * share)} active, {stress}"
    yield f"  end of {stage.get('name')}", f"{text}, at {celsius(mesh['temperature_K'])}"


def model_rows(model: Mapping[str, Any] | None) -> Iterator[tuple[str, str]]:
    """Row of the kind of model, from the section `model` of a summary; none for one without a reason."""
    if model is not None and "kind_reason" in model:
        yield "model", f"{model['kind']} ({model['kind_reason']})"


def _hook_rows(hook: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Rows of two hooked wires."""
    yield "displacement", f"{engineering(hook['displacement_m'], 'm')}, by a force of {engineering(hook['drive_force_N'], 'N')}"
    left, right = hook["force_left_N"], hook["force_right_N"]
    yield "contact force", f"{engineering(left, 'N')} on the left wire, {engineering(right, 'N')} on the right one"
    if min(left, right) <= 0.0:
        yield "contact at", "none: the wires do not touch"
        return
    places = [f"{engineering(hook[f'arc_{side}_m'], 'm')} on the {side} wire" for side in ("left", "right")]
    yield "contact at", f"{places[0]}, {places[1]} from the lower clamp"
    slides = alike([hook[f"slide_{side}_m"] for side in ("left", "right")], "m")
    yield "slid since it closed", " / ".join(slides)
    if hook["ground_force_N"] > 0.0:
        yield "force from the ground", engineering(hook["ground_force_N"], "N")


def print_summary(summary: Mapping[str, Any], directory: Path) -> None:
    """Print the table to stdout."""
    print_table(summary_rows(summary, directory))


def print_table(rows: Iterable[tuple[str, str]]) -> None:
    """Print headings and texts to stdout."""
    from rich.console import Console
    from rich.table import Table

    console, lines = Console(highlight=False, markup=False), list(rows)
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
