"""Curves of a run, each quantity in a colour and each stage in dashes and marks."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter
from numpy.typing import NDArray

from warpknit.export.plots import GREY, WIDTHS

__all__ = [
    "History", "columns_of", "draw_curves", "draw_line", "history_rows", "jump_handle", "stage_legend", "stage_slices",
]  # fmt: skip

History = Iterable[Mapping[str, Any]] | str | os.PathLike[str]
DECADES_DRAWN = 1e-9  # of the largest value of a logarithmic axis: less is not drawn, and does not flatten the others
FEW_DECADES = 1e3  # of a logarithmic axis: with fewer, 2 and 5 have ticks as well
JUMP_STYLE: dict[str, Any] = {"linestyle": ":", "linewidth": 1.2}  # no state is interpolated over a jump
STAGE_STYLES: tuple[tuple[str | tuple[int, tuple[float, ...]], str], ...] = (
    ("-", "o"),
    ((0, (5, 1.5)), "s"),
    ((0, (1.2, 1.2)), "^"),
    ((0, (5, 1.5, 1, 1.5)), "D"),
    ((0, (8, 3)), "v"),
    ((0, (3, 1, 1, 1, 1, 1)), "P"),
)


def history_rows(history: History) -> list[Mapping[str, Any]]:
    if isinstance(history, str | os.PathLike):
        with open(history, newline="", encoding="utf-8") as file:
            rows: list[Mapping[str, Any]] = list(csv.DictReader(file))
    else:
        rows = list(history)
    if not rows:
        raise ValueError("history: no row to draw")
    return rows


def columns_of(rows: Sequence[Mapping[str, Any]]) -> dict[str, NDArray[Any]]:
    """(row,) numbers of each column; nan where there is none."""
    return {name: np.array([_number(row.get(name)) for row in rows]) for name in {name for row in rows for name in row}}


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan


def stage_slices(names: Sequence[str]) -> list[tuple[str, slice]]:
    """Row ranges of the stages, each starting with the last row of the stage before, for continuous curves."""
    first = [0, *(row for row in range(1, len(names)) if names[row] != names[row - 1])]
    end = [*first[1:], len(names)]
    return [(names[a] or "load", slice(max(a - 1, 0), b)) for a, b in zip(first, end, strict=True)]


def draw_curves(
    axes: Axes,
    abscissa: NDArray[Any],
    stages: Sequence[tuple[str, slice]],
    curves: Sequence[tuple[str, str, NDArray[Any]]],
    is_logarithmic: bool,
    jumped: NDArray[np.bool_] | None = None,
) -> None:
    """Draw one line per quantity (colour) and stage (dashes and marks), dotted to a row that the mesh has `jumped` to."""
    handles = []
    least = DECADES_DRAWN * max((float(values[np.isfinite(values)].max(initial=0.0)) for *_, values in curves), default=0.0)
    for (label, colour, values), width in zip(curves, WIDTHS if len(curves) > 1 else WIDTHS[1:], strict=False):
        shown = np.isfinite(values) & ((values > least) if is_logarithmic else True)
        if not shown.any():
            continue
        values = np.where(shown, values, np.nan)
        for number, (_, rows) in enumerate(stages):
            style, marker = STAGE_STYLES[number % len(STAGE_STYLES)]
            look: dict[str, Any] = {"color": colour, "linestyle": style, "marker": marker, "markersize": 2.5 + width}
            face = colour if number % 2 == 0 else "white"
            behind = np.zeros(len(values), dtype=bool) if jumped is None else jumped
            draw_line(axes, abscissa[rows], values[rows], behind[rows], linewidth=width, markerfacecolor=face, **look)
        if label:
            handles.append(Line2D([], [], color=colour, linewidth=width, label=label))
    if not axes.lines:
        axes.text(0.5, 0.5, "not recorded", transform=axes.transAxes, ha="center", va="center", color=GREY)
    elif is_logarithmic:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        if high < 10.0 * low:
            low, high = np.sqrt(low * high / 10.0), np.sqrt(10.0 * low * high)  # a decade
            axes.set_ylim(low, high)
        if high < FEW_DECADES * low:
            axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.yaxis.set_major_formatter(LogFormatterSciNotation(minor_thresholds=(np.inf, np.inf)))
            axes.yaxis.set_minor_formatter(NullFormatter())
    if handles:
        axes.legend(
            handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(handles), frameon=False, borderaxespad=0.2
        )
    axes.grid(color="#DDDDDD", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def draw_line(axes: Axes, abscissa: NDArray[Any], values: NDArray[Any], jumped: NDArray[np.bool_], **look: Any) -> None:
    """Draw a line through points, dotted to each one that the mesh has `jumped` to."""
    jumps = np.flatnonzero(jumped[1:]) + 1
    for part in np.split(np.arange(len(values)), jumps):
        axes.plot(abscissa[part], values[part], **look)
    for point in jumps:
        axes.plot(abscissa[point - 1 : point + 1], values[point - 1 : point + 1], color=look["color"], **JUMP_STYLE)


def jump_handle(colour: str) -> Line2D:
    """The dots over a jump, for a legend."""
    return Line2D([], [], color=colour, label="jump to another equilibrium", **JUMP_STYLE)


def stage_legend(figure: Figure, names: Sequence[str], title: str = "stage") -> None:
    """Legend of the dashes and marks of the stages."""
    handles = []
    for number, name in enumerate(names):
        style, marker = STAGE_STYLES[number % len(STAGE_STYLES)]
        face = GREY if number % 2 == 0 else "white"
        look: dict[str, Any] = {"linestyle": style, "marker": marker, "markersize": 4.5, "markerfacecolor": face}
        handles.append(Line2D([], [], color=GREY, label=name, **look))
    figure.legend(handles=handles, title=title, loc="outside upper center", ncols=min(len(handles), 6), frameon=False)
