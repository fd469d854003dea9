"""The short table at the end of a map."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ..base.text import alike, duration, engineering, percent
from ..runner.strength import assumed_note
from ..runner.summary_table import TIMED, model_rows
from .contact_map import drift_text, optimum_note

LEAST_TOLD = 0.1  # [s] of a stage of a report: a map that was there takes less


def map_lines(summary: dict[str, Any]) -> Iterable[tuple[str, str]]:
    """Table of a map: pairs of a heading and a text."""
    for warning in summary["warnings"]:
        yield "warning", warning
    yield from model_rows(summary["model"])
    cells, solver, optimum = summary["cells"], summary["solver"], summary["optimum"]
    meshes = "" if summary["seeds"] == 1 else f", {summary['seeds']} meshes each"
    yield f"pairs of {summary.get('loads', 'strains')}", f"{cells['steady']} of {cells['wanted']} converged{meshes}"
    steps, nodes = solver["cell_steps"], summary["model"]["nodes"]
    yield "time steps", f"{steps:,} of {nodes:,} nodes, {solver['cell_steps_per_s']:,.0f} a second"
    if (report := summary.get("report")) is None:
        yield "wall time", f"{duration(solver['wall_s'], 3)} {TIMED}"
    else:
        stages = ", ".join(f"{name} {duration(took)}" for name, took in report["stages_s"].items() if took >= LEAST_TOLD)
        yield "wall time", f"{duration(report['wall_s'], 3)} for the report: {stages}"
    limit = summary["wire"]["yield_stress_Pa"]
    note = assumed_note("wire.yield_stress", summary["wire"].get("yield_stress_assumed", False))
    if optimum is None:
        below = f"below {engineering(limit, 'Pa')}{note}"
        yield "optimum", f"none: no tensile load of the map has an active contact and a stress {below}; another [sweep] may"
    else:
        note_of_optimum = optimum_note(tuple(optimum["load"]), summary["jumps"])
        strains = f"{percent(optimum['strain_weft'])} / {percent(optimum['strain_warp'])}"
        yield "optimum strain, weft / warp", strains + note_of_optimum
        tensions = [optimum[f"tension_{side}_N_per_m"] for side in ("weft", "warp")]
        yield "  tension, weft / warp", " / ".join(alike(tensions, "N/m"))
        yield "  active contacts", percent(0.01 * optimum["active_percent"])
        share = f"{percent(1.0 - optimum['stress_margin'], 0)} of the elastic limit"
        yield "  largest stress", f"{engineering(optimum['stress_max_Pa'], 'Pa')}, {share}{note}"
        for drift in optimum.get("drift", ()):
            yield f"  {drift['along']} may drift", drift_text(drift)
    yield "stopped", summary["stop_reason"]
