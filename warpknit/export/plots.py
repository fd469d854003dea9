"""Common parts of all figures: size, colours, axes and output; wires in plan view that pass over and under each other.

Matplotlib's objects on an Agg canvas, without pyplot's state: figures can be drawn in any thread and without a screen.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from warpknit.base.files import path_aside

DOTS_PER_INCH = 150
# Okabe and Ito's colours, distinct without red-green vision.
BLUE, ORANGE, GREEN, PURPLE, GREY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#606060"
AMBER = "#E69F00"  # of contacts where no wires hook
WIDTHS = (3.4, 1.6, 1.6, 1.6)  # [pt] of curves in one panel: the first is wider, and shows beside an equal one drawn over it


LineLook: TypeAlias = Mapping[str, Any]  # of a line and its marks, as keywords of matplotlib


def figure_of(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), dpi=DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: Path) -> Path:
    for axes in figure.axes:
        if axes.get_xlabel() and axes.get_xscale() == "linear":
            axes.xaxis.set_major_locator(few_ticks())
    with path_aside(path) as aside:
        FigureCanvasAgg(figure).print_png(aside)  # `savefig` would lay the figure out in a drawing of its own
    return path


def plain(axes: Axes) -> None:
    """A light grid, and no frame at the top and the right."""
    axes.grid(color="#DDDDDD", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def few_ticks() -> MaxNLocator:
    """Ticks of an axis whose labels have room."""
    return MaxNLocator(8, steps=[1, 2, 5, 10])


def scale_of(unit: str, *values: np.ndarray) -> tuple[float, str]:
    """Factor and prefixed unit for at most three digits before the point. (1e3, "mN/m") of "N/m" for a largest value of 0.25."""
    known = [np.abs(some[np.isfinite(some)]).max(initial=0.0) for some in values]
    size = float(max(known, default=0.0))
    for scale, prefix in ((1e-9, "G"), (1e-6, "M"), (1e-3, "k"), (1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n")):
        if size * scale >= 1.0:
            return scale, prefix + unit
    return 1.0, unit


def frame_plan_axes(axes: Axes, low: np.ndarray, high: np.ndarray) -> None:
    margin = 0.03 * np.maximum(high - low, 1e-9)
    axes.set(xlim=(low[0] - margin[0], high[0] + margin[0]), ylim=(low[1] - margin[1], high[1] + margin[1]))
    axes.set(xlabel="weft [mm]", ylabel="warp [mm]")
    axes.set_aspect("equal", adjustable="box")


def plan_scale(figure: Figure, axes: Axes) -> float:
    """Points of paper a mm of a plan view; call it last."""
    figure.draw_without_rendering()
    return float(72.0 * axes.bbox.width / figure.dpi / np.ptp(axes.get_xlim()))


EDGE = 1.3  # [pt] white on either side of a wire: a gap in the wires below it
OVERLAP = 0.3  # of its width, by which a piece of wire reaches over its neighbours: no seam between them
EDGE_OVERLAP = 0.25  # [pt] the same of its white edge: less, for the wire to cover what it hides of its neighbours


def over_under(pieces: np.ndarray, colours: Any, width: float, points_per_mm: float, edge: float = EDGE) -> LineCollection:
    """Straight pieces (piece, 2, 3) [mm] of wires in `colours` (piece, 4); the lowest first, each on a wider white one.

    width: of the wires [pt]; edge: of the white on either side [pt].
    """
    order = np.argsort(pieces[:, :, 2].sum(axis=1), kind="stable")
    plan = pieces[order, :, :2]
    along = plan[:, 1] - plan[:, 0]
    along /= points_per_mm * np.maximum(np.hypot(*along.T), 1e-12)[:, None]  # [mm]  a point of paper
    ends = np.stack([-along, along], axis=1)
    lines = np.stack([plan + EDGE_OVERLAP * ends, plan + OVERLAP * width * ends], axis=1).reshape(-1, 2, 2)
    white = np.ones((len(plan), 4))
    drawn = np.stack([white, np.asarray(colours)[order]], axis=1).reshape(-1, 4)
    widths = np.tile([width + 2.0 * edge, width], len(plan))
    return LineCollection(list(lines), colors=drawn, linewidths=widths, capstyle="butt", zorder=1)


def tile_copies(points: np.ndarray, period: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Offsets (copy, 2), by the columns of `period` (2, 2). Copies of `points` (point, 2) show between `low` and `high`."""
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
    place, window = (np.linalg.solve(period, some.T).T for some in (points, corners))
    first = np.floor(window.min(axis=0) - place.max(axis=0)).astype(int)
    last = np.ceil(window.max(axis=0) - place.min(axis=0)).astype(int)
    grid = np.meshgrid(np.arange(first[0], last[0] + 1), np.arange(first[1], last[1] + 1), indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, 2) @ period.T


def copied(pieces: np.ndarray, offsets: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, Any]:
    """Visible copies of pieces (piece, 2, 3) between `low` and `high`, and the index of their piece."""
    shift = np.concatenate([offsets, np.zeros((len(offsets), 1))], axis=1)
    every = (pieces + shift[:, None, None]).reshape(-1, 2, 3)
    shows = np.all((every[:, :, :2].max(axis=1) > low) & (every[:, :, :2].min(axis=1) < high), axis=1)
    return every[shows], np.tile(np.arange(len(pieces)), len(offsets))[shows]
