"""Figures of a run: the mesh at the end of each stage, and curves against the load."""

import math
import re
from pathlib import Path

from warpknit.export.curves_figure import curves_figure
from warpknit.export.heat_figure import heat_figure
from warpknit.export.hook_figure import hook_figure
from warpknit.export.mesh_figure import Peak, mesh_figure, state_title
from warpknit.export.panel_figure import panel_figure
from warpknit.export.run_record import RunRecord
from warpknit.results.frame import Frame

UNFINISHED = ("diverged", "interrupted")  # stop reasons

__all__ = ["export_figures", "tension_of"]


def export_figures(record: RunRecord) -> list[Path]:
    """Draw the mesh at the end of the run and of each stage, and the curves; the paths."""
    behind = {str(after) for _, after in record.summary.get("jumps") or ()}
    history = [row | {"jump": str(int(row.get("index") in behind))} for row in record.history()]
    if "displacement_m" in history[0]:
        return [hook_figure(record.layout, list(record.frames()), history, record.directory / "figures" / "hook.png")]
    rows = {row.get("index"): row for row in history}
    folder = record.directory / "figures"
    yield_stress = record.quantity("wire", "yield_stress_Pa")
    last: Frame | None = None
    stage_ends: list[Frame] = []
    for frame in record.frames():
        if last is not None and frame.stage != last.stage:
            stage_ends.append(last)
        last = frame
    assert last is not None  # a record has a state
    wanted = [("mesh.png", last)]
    if stage_ends:
        stage_ends.append(last)
        wanted += [
            (f"mesh_{number:02d}_{re.sub(r'[^A-Za-z0-9-]+', '_', frame.stage)}.png", frame)
            for number, frame in enumerate(stage_ends)
        ]
    unfinished = f"the run did not finish: {reason}" if (reason := record.summary.get("stop_reason")) in UNFINISHED else ""
    paths = [curves_figure(history, folder / "curves.png", yield_stress=yield_stress, title=unfinished)]
    if (heat := heat_figure([history], folder / "heat.png")) is not None:
        paths.append(heat)
    for name, frame in wanted:
        tables = {kind: record.directory / "panel" / f"{kind}_{frame.index:06d}.csv" for kind in ("map", "edge", "surface")}
        title = state_title(frame, tension_of(rows.get(str(frame.index))), names_stage=bool(stage_ends))
        if unfinished and frame is last:
            title = f"{title}\n{unfinished}"
        if tables["map"].is_file():
            paths.append(panel_figure(tables, folder / name.replace("mesh", "panel"), title))
        peak = _peak_of(rows.get(str(frame.index)))
        paths.append(mesh_figure(record.layout, frame, folder / name, title, yield_stress=yield_stress, peak=peak))
    return paths


def tension_of(row: dict[str, str] | None) -> tuple[float, float] | None:
    """Tension [N/m] in weft and warp in a row of the history; None where it has none."""
    found = _numbers(row, "tension_weft_N_per_m", "tension_warp_N_per_m")
    return None if found is None else (found[0], found[1])


def _peak_of(row: dict[str, str] | None) -> Peak | None:
    """The largest stress of a row of the history; None where it has none."""
    found = _numbers(row, "stress_max_Pa", "stress_max_x_m", "stress_max_y_m")
    return None if found is None or found[0] <= 0.0 else Peak(*found)


def _numbers(row: dict[str, str] | None, *names: str) -> list[float] | None:
    """The numbers of columns in a row of the history; None where one is missing."""
    try:
        values = [float((row or {})[name]) for name in names]
    except (KeyError, TypeError, ValueError):
        return None
    return values if all(map(math.isfinite, values)) else None
