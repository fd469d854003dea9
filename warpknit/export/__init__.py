"""What a run leaves behind, in the forms that other programs read.

`export_run` reads a run's directory; `usd`, `vtk`, `plots` and `tables` know layouts and frames only. Each is imported
when it is asked for, so that a run needs none of their libraries.
"""

import csv
import json
import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warpknit.errors import ExportError
from warpknit.frame import Frame, WireLayout, drawn_frame, drawn_layout

__all__ = ["FORMATS", "ExportError", "export_run"]

FORMATS = ("usd", "vtk", "csv", "png")


def export_run(run_dir: str | os.PathLike[str], to: str) -> list[Path]:
    """Write a finished run, or what an interrupted one has, in another form into its directory; the paths.

    usd: scene.usda and its layers; vtk: vtk/wires.pvd, vtk/contacts.pvd; csv: tables/*.csv;
    png: figures/mesh*.png, figures/curves.png.
    """
    if to not in FORMATS:
        raise ExportError(f"--to {to}: {', '.join(FORMATS)} are possible")
    record = _read_record(Path(run_dir))
    try:
        return {"usd": _export_usd, "vtk": _export_vtk, "csv": _export_tables, "png": _export_figures}[to](record)
    except ModuleNotFoundError as error:
        raise ExportError(f"--to {to}: needs the package {error.name}, which is not installed") from error


@dataclass(frozen=True)
class _Record:
    """The directory of a run, read."""

    directory: Path
    summary: dict[str, Any]
    layout: WireLayout
    states: tuple[Path, ...]

    def frames(self) -> Iterator[Frame]:
        """One frame after the other: they need not fit in memory together."""
        for path in self.states:
            try:
                frame = Frame.load(path)
                frame.require_layout(self.layout)
                frame.require_finite()
            except (OSError, ValueError) as error:
                raise ExportError(f"{path}: {_one_line(error)}") from error
            yield frame

    def history(self) -> list[dict[str, str]]:
        path = self.directory / "history.csv"
        try:
            with open(path, newline="", encoding="utf-8") as file:
                rows = list(csv.DictReader(file))
        except (OSError, ValueError, csv.Error) as error:
            raise ExportError(f"{path}: {_one_line(error)}") from error
        if not rows:
            raise ExportError(f"{path}: no record")
        return rows

    def quantity(self, *names: str) -> float | None:
        """A positive number of the summary, the largest over its stages, or None."""
        values = [_item(part, names) for part in (self.summary, *(_item(self.summary, ("stages",)) or ()))]
        numbers = [float(value) for value in values if isinstance(value, int | float) and math.isfinite(value)]
        return max((number for number in numbers if number > 0.0), default=None)


def _read_record(directory: Path) -> _Record:
    if not directory.is_dir():
        raise ExportError(f"{directory}: no such directory; the directory of a run is expected")
    layout_path, summary_path = directory / "layout.npz", directory / "summary.json"
    states = sorted(
        (path for path in (directory / "states").glob("state_*.npz") if re.fullmatch(r"state_\d+", path.stem)),
        key=lambda path: int(path.stem[6:]),
    )
    if not layout_path.is_file() and not summary_path.is_file():
        raise ExportError(f"{directory}: not the directory of a run: it has no layout.npz and no summary.json")
    if not summary_path.is_file():
        raise ExportError(f"{directory}: the run has not ended: it has no summary.json; go on with --resume")
    if not layout_path.is_file() or not states:
        raise ExportError(f"{directory}: the run left no states to export")
    try:
        summary = json.loads(summary_path.read_text(encoding="utf-8"))
        layout = WireLayout.load(layout_path)
    except (OSError, ValueError) as error:  # JSONDecodeError is a ValueError
        raise ExportError(f"{directory}: {_one_line(error)}") from error
    if not isinstance(summary, dict) or not isinstance(_item(summary, ("scene", "name")), str):
        raise ExportError(f"{summary_path}: not the summary of a run: it has no scene name")
    return _Record(directory, summary, layout, tuple(states))


def _export_usd(record: _Record) -> list[Path]:
    from warpknit.export.usd import StageWriter

    writer = StageWriter(
        record.directory,
        drawn_layout(record.layout),
        scene_name=record.summary["scene"]["name"],
        scene_hash=str(_item(record.summary, ("scene", "hash")) or ""),
        version=str(record.summary.get("version", "")),
        colour_stress_max=record.quantity("wire", "stress_max_Pa"),
        streaming=True,
    )
    frames = [writer.add_frame(drawn_frame(record.layout, frame)) for frame in record.frames()]
    writer.close(complete=record.summary.get("stop_reason") in ("steady", "finished"))
    return [writer.path, *frames]


def _export_vtk(record: _Record) -> list[Path]:
    from warpknit.export.vtk import write_vtk

    frames = (drawn_frame(record.layout, frame) for frame in record.frames())
    return write_vtk(record.directory / "vtk", drawn_layout(record.layout), frames)


def _export_tables(record: _Record) -> list[Path]:
    from warpknit.export.tables import write_tables

    return write_tables(record.directory / "tables", record.layout, record.frames())


def _export_figures(record: _Record) -> list[Path]:
    """The mesh at the end, and at the end of each stage where there are several; the curves."""
    from warpknit.export.curves_figure import curves_figure
    from warpknit.export.mesh_figure import mesh_figure

    history = record.history()
    if "displacement_m" in history[0]:
        from warpknit.export.hook_figure import hook_figure

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
    paths = [curves_figure(history, folder / "curves.png")]
    for name, frame in wanted:
        tables = {kind: record.directory / "panel" / f"{kind}_{frame.index:06d}.csv" for kind in ("map", "edge", "surface")}
        if tables["map"].is_file():
            from warpknit.export.panel_figure import panel_figure

            title = f"{frame.stage}: strain {frame.strain_weft:.3g} in weft, {frame.strain_warp:.3g} in warp"
            paths.append(panel_figure(tables, folder / name.replace("mesh", "panel"), title))
        tension = _tension(rows.get(str(frame.index)))
        paths.append(mesh_figure(record.layout, frame, folder / name, yield_stress=yield_stress, tension=tension))
    return paths


def _tension(row: dict[str, str] | None) -> tuple[float, float] | None:
    try:
        tension = tuple(float((row or {})[f"tension_{name}_N_per_m"]) for name in ("weft", "warp"))
    except (KeyError, TypeError, ValueError):
        return None
    return (tension[0], tension[1]) if all(map(math.isfinite, tension)) else None


def _item(tree: Any, names: tuple[str, ...]) -> Any:
    for name in names:
        tree = tree.get(name) if isinstance(tree, dict) else None
    return tree


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
