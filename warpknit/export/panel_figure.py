"""Figure of a panel: maps of active contacts, tensions, wire stress, and deviation from the target surface."""

import csv
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.tri import Triangulation
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from warpknit.export.plots import figure_of, frame_plan_axes, save_figure, scale_of

__all__ = ["panel_figure"]

SHADES = (2.0, 98.0)  # percentiles of the inner tiles, not next to a grip, between which the colours of a tension or stress lie
LONGEST = 2.5  # median edges: longer ones of a triangulation of points lie outside the panel
NET_NODES = 200  # places that hold a panel up to which each is marked
FLAT = 1e-3  # [mm] heights and [um] deviations that differ by less are drawn alike

Columns = dict[str, NDArray[Any]]


def panel_figure(tables: dict[str, Path], path: str | os.PathLike[str], title: str) -> Path:
    """Draw the map of a panel, its edge, and its surface where there is one: the tables `map`, `edge` and `surface` of a state.

    All of it is drawn as strained, from the middle of the panel.
    """
    tiles, edge = _columns(tables["map"]), _columns(tables["edge"])
    surface = _columns(tables["surface"]) if tables["surface"].is_file() else None
    scale, unit = scale_of("N/m", tiles["tension_weft_N_per_m"], tiles["tension_warp_N_per_m"])
    maps: list[tuple[NDArray[Any], str, dict[str, Any]]] = [
        (tiles["active_percent"], "active contacts [% of the pairs]", {"vmin": 0.0, "vmax": 100.0, "cmap": "viridis"}),
        (1e-6 * tiles["stress_max_Pa"], "highest wire stress [MPa]", {"cmap": "magma_r"}),
        (scale * tiles["tension_weft_N_per_m"], f"tension in weft [{unit}]", {"cmap": "cividis"}),
        (scale * tiles["tension_warp_N_per_m"], f"tension in warp [{unit}]", {"cmap": "cividis"}),
    ]
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
        below, above = values.min() < low, values.max() > high
        extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get((bool(below), bool(above)), "neither")
        figure.colorbar(image, ax=ax, shrink=0.85, aspect=32, pad=0.025, extend=extend).set_label(label)
        _draw_edge(ax, round_, edge["held"] > 0.0, image)
    if surface is not None:
        for ax, image in _draw_surface(figure, axes[:, 2], surface):
            _draw_edge(ax, round_, edge["held"] > 0.0, image)
    if axes[0, 0].get_legend_handles_labels()[1]:
        figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", frameon=False)
    return save_figure(figure, path)


def _draw_tiles(axes: Axes, tiles: Columns, values: NDArray[Any], look: dict[str, Any]) -> Any:
    """One parallelogram a tile, each a little larger at the edge of the panel, which cuts it."""
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
    if "vmax" not in look:
        whole = np.zeros(grid.shape, dtype=bool)
        whole[column + 1, row + 1] = tiles["inside"] > 0.999
        inner = values[binary_erosion(whole, np.ones((3, 3)))[column + 1, row + 1]]
        low, high = np.percentile(inner if len(inner) else values, SHADES)
        apart = max(float(high - low), 0.02 * float(np.abs(values).max()), 1e-12)
        look = {**look, "vmin": float(low), "vmax": float(low) + apart}
    return axes.pcolormesh(corner[..., 0], corner[..., 1], _spread(grid), **look)


def _spread(grid: NDArray[Any]) -> NDArray[Any]:
    """Tiles at the edge of the panel with the value of a neighbour, where they have none of their own."""
    padded = np.pad(grid, 1, constant_values=np.nan)
    size = grid.shape
    beside = [padded[1 + i : 1 + i + size[0], 1 + j : 1 + j + size[1]] for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    beside += [padded[1 + i : 1 + i + size[0], 1 + j : 1 + j + size[1]] for i in (-1, 1) for j in (-1, 1)]
    spread = grid
    for values in beside:
        spread = np.where(np.isnan(spread), values, spread)
    return spread


def _draw_edge(axes: Axes, edge: NDArray[Any], held: NDArray[Any], image: Any) -> None:
    """Draw the outline, which clips `image`, with a dot at each net node."""
    outline = Polygon(edge, closed=True, fill=False, edgecolor="black", linewidth=0.8)
    axes.add_patch(outline)
    image.set_clip_path(outline)
    if held.sum() <= NET_NODES and not held.all():
        axes.plot(*edge[held].T, "o", color="black", markersize=3.0, label="held place of the edge")
    frame_plan_axes(axes, edge.min(axis=0), edge.max(axis=0))


def _draw_surface(figure: Any, axes: NDArray[Any], surface: Columns) -> Iterator[tuple[Axes, Any]]:
    """Height, and deviation from the paraboloid."""
    x, y = 1e3 * surface["x_m"], 1e3 * surface["y_m"]
    mesh = Triangulation(x, y)
    corner = np.stack([x, y], axis=1)[mesh.triangles]
    edge = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    mesh.set_mask(edge > LONGEST * np.median(edge))
    for ax, name, scale, label, cmap in (
        (axes[0], "height_m", 1e3, "height [mm]", "Greys_r"),
        (axes[1], "deviation_m", 1e6, "height above the wanted paraboloid [um]", "RdBu_r"),
    ):
        values = scale * surface[name]
        middle = 0.0 if cmap == "RdBu_r" else 0.5 * float(values.min() + values.max())
        half = max(float(np.abs(values - middle).max()), FLAT)
        image = ax.tripcolor(mesh, values, shading="gouraud", cmap=cmap, vmin=middle - half, vmax=middle + half)
        figure.colorbar(image, ax=ax, shrink=0.85, aspect=32, pad=0.025).set_label(label)
        yield ax, image


def _columns(path: Path) -> Columns:
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
