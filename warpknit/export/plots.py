"""Common parts of all figures: size, colours, axes and output.

Matplotlib's objects on an Agg canvas, without pyplot's state: figures can be drawn in any thread and without a screen.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from warpknit.base.files import path_aside

__all__ = [
    "AMBER", "BLUE", "GREEN", "GREY", "ORANGE", "PURPLE", "WIDTHS",
    "figure_of", "frame_plan_axes", "plan_scale", "save_figure", "scale_of",
]  # fmt: skip

DOTS_PER_INCH = 150
# Okabe and Ito's colours, distinct without red-green vision.
BLUE, ORANGE, GREEN, PURPLE, GREY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#606060"
AMBER = "#E69F00"  # of contacts where no wires hook
WIDTHS = (3.4, 1.6, 1.6, 1.6)  # [pt] of curves in one panel: the first is wider, and shows beside an equal one drawn over it


def figure_of(width: float, height: float) -> Figure:
    figure = Figure(figsize=(width, height), dpi=DOTS_PER_INCH, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> Path:
    path = Path(path)
    for axes in figure.axes:
        if axes.get_xlabel() and axes.get_xscale() == "linear":
            axes.xaxis.set_major_locator(few_ticks())
    with path_aside(path) as aside:
        FigureCanvasAgg(figure).print_png(aside)  # `savefig` would lay the figure out in a drawing of its own
    return path


def few_ticks() -> MaxNLocator:
    """Ticks of an axis whose labels have room."""
    return MaxNLocator(8, steps=[1, 2, 5, 10])


def scale_of(unit: str, *values: NDArray[Any]) -> tuple[float, str]:
    """Factor and prefixed unit with which the largest value has at most three digits before the point.

    (1e3, "mN/m") of "N/m" for a largest value of 0.25.
    """
    known = [np.abs(some[np.isfinite(some)]).max(initial=0.0) for some in values]
    size = float(max(known, default=0.0))
    for scale, prefix in ((1e-9, "G"), (1e-6, "M"), (1e-3, "k"), (1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n")):
        if size * scale >= 1.0:
            return scale, prefix + unit
    return 1.0, unit


def frame_plan_axes(axes: Axes, low: NDArray[Any], high: NDArray[Any]) -> None:
    margin = 0.03 * np.maximum(high - low, 1e-9)
    axes.set(xlim=(low[0] - margin[0], high[0] + margin[0]), ylim=(low[1] - margin[1], high[1] + margin[1]))
    axes.set(xlabel="weft [mm]", ylabel="warp [mm]")
    axes.set_aspect("equal", adjustable="box")


def plan_scale(figure: Figure, axes: Axes) -> float:
    """Points of paper a mm of a plan view has, when all that takes room beside it is in place."""
    figure.draw_without_rendering()
    return float(72.0 * axes.bbox.width / figure.dpi / np.ptp(axes.get_xlim()))
