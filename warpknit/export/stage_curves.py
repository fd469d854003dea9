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

from warpknit.base.text import is_at_grips
from warpknit.export.plots import BLUE, GREY, PURPLE, WIDTHS

__all__ = [
    "DECADES_DRAWN", "STRESS_COLUMNS", "History", "columns_of", "draw_curves", "draw_line", "history_rows", "is_behind_jump",
    "jump_handles", "stage_legend", "stage_slices", "stress_columns",
]  # fmt: skip

History = Iterable[Mapping[str, Any]] | str | os.PathLike[str]
STRESS_COLUMNS = ("stress_max_Pa", "stress_interior_max_Pa")  # of history.csv: anywhere, and away from the grips
DECADES_DRAWN = 1e-9  # of the largest value of a logarithmic axis: less is not drawn, and does not flatten the others
FEW_DECADES = 1e3  # of a logarithmic axis: with fewer, 2 and 5 have ticks as well
JUMP = "jump to another equilibrium"
JUMP_STYLE: dict[str, Any] = {"linestyle": ":", "linewidth": 1.2, "gid": JUMP}  # no state is interpolated over a jump
WIDER_MARK, WIDER_MARKS = 0.8, 3  # [pt] of a stage than of the next one, that may lie on it; of so many before the last
LEGEND_WIDTH, HANDLE_WIDTH = 11.5, 9  # characters of a legend to an inch, and of the line before a name
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


def is_behind_jump(columns: Mapping[str, NDArray[Any]], count: int) -> NDArray[np.bool_]:
    """(row,) whether the mesh has jumped to another equilibrium since the row before: the column `jump`, where there is one."""
    return np.asarray(columns.get("jump", np.zeros(count)) > 0.0)


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


def stress_columns(columns: Mapping[str, NDArray[Any]]) -> list[tuple[str, str, str]]:
    """Label, colour and column of the largest stress; where that away from the grips is well below, of both."""
    everywhere, interior = STRESS_COLUMNS
    if any(map(is_at_grips, columns.get(interior, ()), columns.get(everywhere, ()))):
        return [("anywhere", PURPLE, everywhere), ("away from the grips", BLUE, interior)]
    return [("", PURPLE, everywhere)]


def draw_curves(
    axes: Axes,
    abscissa: NDArray[Any],
    stages: Sequence[tuple[str, slice]],
    curves: Sequence[tuple[str, str, NDArray[Any]]],
    jumped: NDArray[np.bool_],
    *,
    least: float | None = None,
    nothing: str = "not recorded",
    beneath: bool = False,
) -> None:
    """Draw one line per quantity (colour) and stage (dashes and marks), dotted to a row that the mesh has `jumped` to.

    least: of the values on a logarithmic axis, smaller ones are not drawn. nothing: what is written where there is no value.
    beneath: the first line is wide, as others are drawn over it, also where these are on another axis.
    """
    handles = []
    for (label, colour, values), width in zip(curves, WIDTHS if beneath or len(curves) > 1 else WIDTHS[1:], strict=False):
        shown = np.isfinite(values) & (least is None or values > least)
        if not shown.any():
            continue
        values = np.where(shown, values, np.nan)
        for number, (_, rows) in enumerate(stages):
            style, marker = STAGE_STYLES[number % len(STAGE_STYLES)]
            size = 2.5 + width + WIDER_MARK * min(len(stages) - 1 - number, WIDER_MARKS)
            look: dict[str, Any] = {"color": colour, "linestyle": style, "marker": marker, "markersize": size}
            face = colour if number % 2 == 0 else "white"
            draw_line(axes, abscissa[rows], values[rows], jumped[rows], linewidth=width, markerfacecolor=face, **look)
        if label:
            handles.append(Line2D([], [], color=colour, linewidth=width, label=label))
    if not axes.lines:
        axes.text(0.5, 0.5, nothing, transform=axes.transAxes, ha="center", va="center", color=GREY)
        axes.set_yticks([])
    elif least is not None:
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
    for point in jumps[np.isfinite(values[jumps - 1] + values[jumps])]:
        axes.plot(abscissa[point - 1 : point + 1], values[point - 1 : point + 1], color=look["color"], **JUMP_STYLE)


def jump_handles(figure: Figure) -> list[Line2D]:
    """The dots over a jump, for a legend, where the figure has some."""
    is_drawn = any(line.get_gid() == JUMP for axes in figure.axes for line in axes.lines)
    return [Line2D([], [], color=GREY, label=JUMP, **JUMP_STYLE)] if is_drawn else []


def stage_legend(figure: Figure, names: Sequence[str], title: str = "") -> None:
    """Legend of the dashes and marks of the stages, where there are several or a title; and of the dots over a jump."""
    title = title or ("stage" if len(names) > 1 else "")
    handles = []
    for number, name in enumerate(names if title else ()):
        style, marker = STAGE_STYLES[number % len(STAGE_STYLES)]
        face = GREY if number % 2 == 0 else "white"
        look: dict[str, Any] = {"linestyle": style, "marker": marker, "markersize": 4.5, "markerfacecolor": face}
        handles.append(Line2D([], [], color=GREY, label=name, **look))
    handles += jump_handles(figure)
    if handles:
        widest = max(len(str(handle.get_label())) for handle in handles)
        columns = int(np.clip(LEGEND_WIDTH * figure.get_figwidth() // (widest + HANDLE_WIDTH), 1, 6))
        figure.legend(handles=handles, title=title, loc="outside upper center", ncols=columns, frameon=False)
