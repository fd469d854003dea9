"""The maps of a panel as one picture: active contacts, tensions, wire stress, and the deviation from the wanted surface."""

import csv
import os
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from warpknit.export.plots import figure_of, frame_plan_axes, save_figure

__all__ = ["panel_figure"]

MEDIANS = 2.5  # that the colours of a tension or stress end at: single tiles at grips are far above
LONGEST = 2.5  # median edges: longer ones of a triangulation of points lie outside the panel


def panel_figure(map_file: Path, surface_file: Path, path: str | os.PathLike[str], title: str) -> Path:
    """Draw the map of a panel, and its surface where that file is there."""
    table = _columns(map_file)
    surface = _columns(surface_file) if surface_file.is_file() else None
    x, y = 1e3 * table["weft_m"], 1e3 * table["warp_m"]
    maps: list[tuple[NDArray[Any], str, dict[str, Any]]] = [
        (table["active_percent"], "active contacts [% of the pairs]", {"vmin": 0.0, "vmax": 100.0, "cmap": "viridis"}),
        (1e-6 * table["stress_max_Pa"], "highest wire stress [MPa]", {"cmap": "magma_r"}),
        (1e3 * table["tension_weft_N_per_m"], "tension in weft [mN/m]", {"cmap": "cividis"}),
        (1e3 * table["tension_warp_N_per_m"], "tension in warp [mN/m]", {"cmap": "cividis"}),
    ]
    columns = 3 if surface is not None else 2
    width, height = np.ptp(x), np.ptp(y)
    across = float(np.clip(4.2 * width / max(height, 1e-9), 2.6, 6.0))
    figure = figure_of(columns * (across + 1.4), 2 * 5.0 + 0.6)
    figure.suptitle(title, fontsize=12)
    axes = figure.subplots(2, columns, squeeze=False)
    low, high = np.array([x.min(), y.min()]), np.array([x.max(), y.max()])
    for ax, (values, label, look) in zip(axes[:, :2].ravel(), maps, strict=True):
        _draw_tiles(ax, x, y, values, look)
        image = ax.collections[0] if ax.collections else ax.images[0]
        extend = "max" if "vmax" not in look and values.max() > image.norm.vmax else "neither"
        figure.colorbar(image, ax=ax, shrink=0.85, aspect=32, pad=0.025, extend=extend).set_label(label)
        frame_plan_axes(ax, low, high)
    if surface is not None:
        _draw_surface(figure, axes[:, 2], surface)
    return save_figure(figure, path)


def _draw_tiles(axes: Axes, x: NDArray[Any], y: NDArray[Any], values: NDArray[Any], look: dict[str, Any]) -> None:
    """One rectangle a tile."""
    columns, column = np.unique(np.round(x, 6), return_inverse=True)
    rows, row = np.unique(np.round(y, 6), return_inverse=True)
    grid = np.full((len(rows), len(columns)), np.nan)
    grid[row, column] = values
    half = [0.5 * (np.diff(v).min() if len(v) > 1 else 1.0) for v in (columns, rows)]
    extent = (columns[0] - half[0], columns[-1] + half[0], rows[0] - half[1], rows[-1] + half[1])
    if "vmax" not in look:
        middle = float(np.median(np.abs(values)))
        highest = min(float(values.max()), MEDIANS * middle) if middle > 0.0 else float(values.max())
        look = {**look, "vmin": min(0.0, float(values.min())), "vmax": max(highest, 1e-12)}
    axes.imshow(grid, origin="lower", extent=extent, interpolation="nearest", **look)


def _draw_surface(figure: Any, axes: NDArray[Any], surface: dict[str, NDArray[Any]]) -> None:
    """Height, and deviation from the paraboloid."""
    x, y = 1e3 * surface["x_m"], 1e3 * surface["y_m"]
    mesh = Triangulation(x, y)
    corner = np.stack([x, y], axis=1)[mesh.triangles]
    edge = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    mesh.set_mask(edge > LONGEST * np.median(edge))
    low, high = np.array([x.min(), y.min()]), np.array([x.max(), y.max()])
    for ax, name, scale, label, cmap in (
        (axes[0], "height_m", 1e3, "height [mm]", "Greys_r"),
        (axes[1], "deviation_m", 1e6, "height above the wanted paraboloid [um]", "RdBu_r"),
    ):
        values = scale * surface[name]
        most = max(float(np.abs(values).max()), 1e-9)
        limits = {"vmin": -most, "vmax": most} if cmap == "RdBu_r" else {}
        image = ax.tripcolor(mesh, values, shading="gouraud", cmap=cmap, **limits)
        figure.colorbar(image, ax=ax, shrink=0.85, aspect=32, pad=0.025).set_label(label)
        frame_plan_axes(ax, low, high)


def _columns(path: Path) -> dict[str, NDArray[Any]]:
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
