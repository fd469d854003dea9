"""Figures of a run: the mesh at the end of each stage, and curves against the load."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.tri import Triangulation
from scipy.ndimage import distance_transform_edt

from warpknit.export.curves_figure import curves_figure, heat_figure
from warpknit.export.mesh_figure import mesh_figure, state_title
from warpknit.export.plots import BLUE, GREEN, GREY, ORANGE, LineLook, figure_of, frame_plan_axes, plain, save_figure, scale_of
from warpknit.export.run_record import RunRecord
from warpknit.results.frame import Frame, WireLayout, drawn_frame, drawn_layout
from warpknit.results.row import Columns

SHOWN = (5.0, 90.0)  # [%] of the tiles, in the order of their stress or tension, between which the colours lie
LEAST_RANGE = 0.02  # of the largest value: values of tiles that differ by less are drawn alike
LONGEST = 2.5  # median edges: longer ones of a triangulation of points lie outside the panel
NET_NODES = 200  # places that hold a panel up to which each is marked
FLAT = 1e-3  # [mm] heights and [um] deviations that differ by less are drawn alike


def panel_figure(tables: Mapping[str, Columns], path: Path, title: str) -> Path:
    """Draw tables `map`, `edge` and `surface` of a panel, as strained, from its middle."""
    tiles, edge, surface = tables["map"], tables["edge"], tables.get("surface")
    scale, unit = scale_of("N/m", tiles["tension_weft_N_per_m"], tiles["tension_warp_N_per_m"])
    maps: list[tuple[np.ndarray, str, dict[str, Any]]] = [
        (tiles["active_percent"], "active contacts [% of the pairs]", {"vmin": 0.0, "vmax": 100.0, "cmap": "viridis"}),
    ]
    for values, label, colours in (
        (1e-6 * tiles["stress_max_Pa"], "largest wire stress [MPa]", "magma_r"),
        (scale * tiles["tension_weft_N_per_m"], f"tension in weft [{unit}]", "cividis"),
        (scale * tiles["tension_warp_N_per_m"], f"tension in warp [{unit}]", "cividis"),
    ):
        least, low, high, largest = np.percentile(values, (0.0, *SHOWN, 100.0)).tolist()
        high = max(high, low + LEAST_RANGE * float(np.abs(values).max()), low + 1e-12)
        ends = [f"{float(f'{end:.3g}'):g}" for end in (least, largest)]  # no exponent
        more = f"\nall tiles: {ends[0]} to {ends[1]}" if least < low or largest > high else ""
        # a few tiles at the edge do not leave the rest in one colour
        maps.append((values, f"{label}{more}", {"vmin": low, "vmax": high, "cmap": colours}))
    columns = 3 if surface is not None else 2
    round_ = 1e3 * np.stack([edge["x_m"], edge["y_m"]], axis=1)
    width, height = np.ptp(round_, axis=0)
    across = float(np.clip(4.2 * width / max(height, 1e-9), 2.6, 6.0))
    figure = figure_of(columns * (across + 1.4), 2 * 5.0 + 0.6)
    figure.suptitle(title, fontsize=12)
    axes = figure.subplots(2, columns, squeeze=False)
    for ax, (values, label, look) in zip(axes[:, :2].ravel(), maps, strict=True):
        image = _draw_tiles(ax, tiles, values, look)
        low, high = image.get_clim()
        extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get((values.min() < low, values.max() > high))
        figure.colorbar(image, ax=ax, shrink=0.85, aspect=32, pad=0.025, extend=extend).set_label(label)
        _draw_edge(ax, round_, edge["held"] > 0.0, image)
    if surface is not None:
        for ax, image in _draw_surface(figure, axes[:, 2], surface):
            _draw_edge(ax, round_, edge["held"] > 0.0, image)
    if axes[0, 0].get_legend_handles_labels()[1]:
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", frameon=False)
    return save_figure(figure, path)


def _draw_tiles(axes: Axes, tiles: Columns, values: np.ndarray, look: dict[str, Any]) -> Any:
    """Draw one parallelogram a tile; at the edge it is larger, and cut. Places without a value have their nearest tile's."""
    columns, column = np.unique(np.round(tiles["weft_m"], 9), return_inverse=True)
    rows, row = np.unique(np.round(tiles["warp_m"], 9), return_inverse=True)
    grid = np.full((len(columns) + 2, len(rows) + 2), np.nan)
    grid[column + 1, row + 1] = values
    step = np.array([np.diff(v).min() if len(v) > 1 else 1.0 for v in (columns, rows)])
    # from places as knitted to places as strained, in mm
    rest = np.stack([tiles["weft_m"], tiles["warp_m"]], axis=1)
    now = 1e3 * np.stack([tiles["x_m"], tiles["y_m"]], axis=1)
    strained = 1e3 * np.eye(2) + np.linalg.lstsq(rest, now - 1e3 * rest, rcond=None)[0]
    ix, iy = np.meshgrid(np.arange(len(columns) + 3), np.arange(len(rows) + 3), indexing="ij")
    corner = np.stack([columns[0] + (ix - 1.5) * step[0], rows[0] + (iy - 1.5) * step[1]], axis=-1) @ strained
    nearest = distance_transform_edt(np.isnan(grid), return_distances=False, return_indices=True)
    return axes.pcolormesh(corner[..., 0], corner[..., 1], grid[tuple(nearest)], **look)


def _draw_edge(axes: Axes, edge: np.ndarray, held: np.ndarray, image: Any) -> None:
    """Draw the outline, which clips `image`, with a dot at each net node."""
    outline = Polygon(edge, closed=True, fill=False, edgecolor="black", linewidth=0.8)
    axes.add_patch(outline)
    image.set_clip_path(outline)
    if held.sum() <= NET_NODES and not held.all():
        axes.plot(*edge[held].T, "o", color="black", markersize=3.0, label="net node")
    frame_plan_axes(axes, edge.min(axis=0), edge.max(axis=0))


def _draw_surface(figure: Any, axes: np.ndarray, surface: Columns) -> Iterator[tuple[Axes, Any]]:
    """Height, and deviation from the paraboloid."""
    x, y = 1e3 * surface["x_m"], 1e3 * surface["y_m"]
    mesh = Triangulation(x, y)
    corner = np.stack([x, y], axis=1)[mesh.triangles]
    edge = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    mesh.set_mask(edge > LONGEST * np.median(edge))
    for ax, name, scale, label, cmap in (
        (axes[0], "height_m", 1e3, "height [mm]", "Greys_r"),
        (axes[1], "deviation_m", 1e6, "height above the paraboloid [um]", "RdBu_r"),
    ):
        values = scale * surface[name]
        middle = 0.0 if cmap == "RdBu_r" else 0.5 * float(values.min() + values.max())
        half = max(float(np.abs(values - middle).max()), FLAT)
        image = ax.tripcolor(mesh, values, shading="gouraud", cmap=cmap, vmin=middle - half, vmax=middle + half)
        figure.colorbar(image, ax=ax, shrink=0.85, aspect=32, pad=0.025).set_label(label)
        yield ax, image


WIRES = (("left", BLUE), ("right", ORANGE))
BETWEEN = 4  # states drawn pale between rest and the last
TOUCHING = 1e-3  # of the largest force: with less the wires just graze, at places that mean nothing


def hook_figure(layout: WireLayout, frames: Sequence[Frame], history: Columns, path: Path) -> Path:
    """Draw the frames of a hook; the columns of its history have a value for each."""
    figure = figure_of(12.0, 5.6)
    panels = figure.subplot_mosaic([["hook", "force"], ["hook", "place"]], width_ratios=(1.0, 1.15))
    _draw_hook(panels["hook"], layout, frames)
    displacement = 1e3 * history["displacement_m"]
    force = panels["force"]
    scale, unit = scale_of("N", *(history[f"{name}_N"] for name in ("force_left", "force_right", "drive_force", "ground_force")))
    for side, colour in WIRES:
        style: LineLook = {"linewidth": 3.0 if side == "left" else 1.5, "alpha": 0.55 if side == "left" else 1.0}
        force.plot(displacement, scale * history[f"force_{side}_N"], color=colour, label=f"contact, {side} wire", **style)
    force.plot(displacement, scale * history["drive_force_N"], color=GREY, linestyle="--", label="driven end, lateral")
    if np.any(history["ground_force_N"] > 0.0):
        force.plot(displacement, scale * history["ground_force_N"], color=GREEN, linestyle=":", label="ground on the body")
    force.set_ylabel(f"force [{unit}]")
    place = panels["place"]
    least = np.minimum(history["force_left_N"], history["force_right_N"])
    closed = least > TOUCHING * least.max(initial=0.0)
    for side, colour in WIRES:
        arc = 1e3 * history[f"arc_{side}_m"]
        place.plot(displacement, np.where(closed, arc, np.nan), color=colour, marker="o", markersize=3, label=f"{side} wire")
    place.set(ylabel="contact position [mm from the clamp]", xlabel="displacement of the driven end [mm]")
    place.set_xlim(force.get_xlim())
    for axes in (force, place):
        plain(axes)
        axes.legend(frameon=True, framealpha=0.8, edgecolor="none", loc="best")
    return save_figure(figure, path)


def _draw_hook(axes: Axes, layout: WireLayout, frames: Sequence[Frame]) -> None:
    """Draw both wires at start, half-way and end, with the body."""
    drawn = drawn_layout(layout)
    shown = np.unique(np.linspace(0, len(frames) - 1, BETWEEN + 2).round().astype(int))
    for index in shown:
        frame = frames[index]
        last = index == shown[-1]
        for wire, (_, colour) in enumerate(WIRES):
            # a segment beyond either clamp only carries the contact curve
            points = slice(drawn.wire_start[wire] + layout.curve_parts, drawn.wire_start[wire + 1] - layout.curve_parts)
            x, y = 1e3 * np.asarray(drawn_frame(layout, frame).node_position)[points, :2].T
            axes.plot(x, y, color=colour, linewidth=2.0 if last else 0.9, alpha=1.0 if last else 0.35)
            if index == shown[0]:
                axes.plot(x[0], y[0], color="black", marker="s", markersize=6)
            if last:
                axes.plot(x[-1], y[-1], color=colour, marker="^" if wire == 0 else ">", markersize=8)
        body = 1e3 * np.asarray(frame.body_position)[0, :2]
        axes.plot(*body, color=GREEN, marker="o", markersize=6 if last else 3, alpha=1.0 if last else 0.5)
    kinds = (
        ("lower ends, clamped", "black", "s"),
        ("left upper end, slides up and down", BLUE, "^"),
        ("right upper end, driven sideways", ORANGE, ">"),
        ("contact", GREEN, "o"),
    )
    handles = [Line2D([], [], color=colour, marker=marker, linestyle="none", label=name) for name, colour, marker in kinds]
    axes.legend(handles=handles, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, fontsize=9)
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    axes.set_aspect("equal", adjustable="datalim")


UNFINISHED = ("diverged", "interrupted")  # stop reasons
TENSIONS = ("tension_weft_N_per_m", "tension_warp_N_per_m")


def export_figures(record: RunRecord) -> list[Path]:
    """Draw the mesh at the ends of load steps, and the curves; return the paths."""
    history = record.history()
    if "displacement_m" in history:
        return [hook_figure(record.layout, list(record.frames()), history, record.directory / "figures" / "hook.png")]
    folder = record.directory / "figures"
    stage_ends = [deque(frames, maxlen=1)[0] for _, frames in groupby(record.frames(), attrgetter("stage"))]
    wanted = [("mesh.png", stage_ends[-1])]
    if len(stage_ends) > 1:
        names = [re.sub(r"[^A-Za-z0-9-]+", "_", frame.stage) for frame in stage_ends]
        wanted += [(f"mesh_{number:02d}_{name}.png", stage_ends[number]) for number, name in enumerate(names)]
    unfinished = f"the run did not finish: {reason}" if (reason := record.stop_reason) in UNFINISHED else ""
    paths = [curves_figure(history, folder / "curves.png", yield_stress=record.yield_stress, title=unfinished)]
    if (heat := heat_figure([history], folder / "heat.png")) is not None:
        paths.append(heat)
    for name, frame in wanted:
        title = state_title(frame, numbers_of(history, frame.index, *TENSIONS), names_stage=len(stage_ends) > 1)
        if "p10_stress_max_Pa" in history:  # of several meshes
            title = f"{title}\nthe median mesh; tension and stress are means"
        if unfinished and frame is stage_ends[-1]:
            title = f"{title}\n{unfinished}"
        if tables := record.panel(frame.index):
            paths.append(panel_figure(tables, folder / name.replace("mesh", "panel"), title))
        found = numbers_of(history, frame.index, "stress_max_Pa", "stress_max_x_m", "stress_max_y_m")
        peak = found if found and found[0] > 0.0 else None
        paths.append(mesh_figure(record.layout, frame, folder / name, title, yield_stress=record.yield_stress, peak=peak))
    return paths


def numbers_of(history: Columns, index: int, *names: str) -> list[float] | None:
    """The values of columns at a record; None where one is missing."""
    row = np.flatnonzero(history.get("index", np.zeros(0)) == index)
    if not len(row) or any(name not in history for name in names):
        return None
    values = [float(history[name][row[0]]) for name in names]
    return values if all(map(math.isfinite, values)) else None
