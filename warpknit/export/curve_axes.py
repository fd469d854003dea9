"""Curves on axes, and their legends. Quantities have colours, load steps dashes and marks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter

from warpknit.base.text import is_at_grips
from warpknit.export.plots import BLUE, GREY, ORANGE, PURPLE, WIDTHS, LineLook, plain
from warpknit.results.row import Columns

SIDE_COLOURS = (("weft", BLUE), ("warp", ORANGE))
STRESS_COLUMNS = ("stress_max_Pa", "stress_interior_max_Pa")  # of history.csv: anywhere, and away from the grips
FEW_DECADES = 1e3  # of a logarithmic axis: with fewer, 2 and 5 have ticks as well
JUMP = "snap-through to another equilibrium"
JUMP_STYLE: LineLook = {"linestyle": ":", "linewidth": 1.2, "gid": JUMP}  # no state is interpolated over a jump
WIDER_MARK, WIDER_MARKS = 0.8, 3  # [pt] of a load step more than of the next, which may cover it; number before the last
LEGEND_WIDTH, HANDLE_WIDTH = 11.5, 9  # characters of a legend to an inch, and of the line before a name
COMPRESSED, LEAST_COMPRESSION = "compressed: a real mesh wrinkles", 1e-3  # of the largest tension: less is scatter about zero
MESHES, BAND = "mean and eight in ten of the meshes", 0.15  # of its opacity
STAGE_STYLES: tuple[tuple[str | tuple[int, tuple[float, ...]], str], ...] = (
    ("-", "o"),
    ((0, (5, 1.5)), "s"),
    ((0, (1.2, 1.2)), "^"),
    ((0, (5, 1.5, 1, 1.5)), "D"),
    ((0, (8, 3)), "v"),
    ((0, (3, 1, 1, 1, 1, 1)), "P"),
)
Curve: TypeAlias = tuple[str, str, np.ndarray]  # label, colour, values


def is_behind_jump(columns: Columns) -> np.ndarray:
    """(row,) whether the mesh has jumped to another equilibrium since the row before: the column `jump`, where there is one."""
    return np.asarray(columns.get("jump", np.zeros(len(columns["stage"]))) > 0.0)


def stage_slices(names: Sequence[str]) -> list[tuple[str, slice]]:
    """Row ranges of the load steps; each begins with the previous last row."""
    first = [0, *(row for row in range(1, len(names)) if names[row] != names[row - 1])]
    end = [*first[1:], len(names)]
    return [(names[a] or "load", slice(max(a - 1, 0), b)) for a, b in zip(first, end, strict=True)]


def stress_columns(columns: Columns) -> list[tuple[str, str, str]]:
    """Label, colour and column of the largest stress; where that away from the grips is well below, of both."""
    everywhere, interior = STRESS_COLUMNS
    if any(map(is_at_grips, columns.get(interior, ()), columns.get(everywhere, ()))):
        return [("anywhere", PURPLE, everywhere), ("away from the grips", BLUE, interior)]
    return [("", PURPLE, everywhere)]


def draw_curves(
    axes: Axes,
    abscissa: np.ndarray,
    stages: Sequence[tuple[str, slice]],
    curves: Sequence[Curve],
    jumped: np.ndarray,
    *,
    least: float | None = None,
    nothing: str = "not recorded",
    beneath: bool = False,
) -> None:
    """Draw a line per quantity (colour) and load step (dashes and marks). Snap-throughs are dotted.

    least: smallest drawn value on a logarithmic axis. nothing: text where there is no value. beneath: whether other lines cover
    the first one, also from another axis; it is then wide.
    """
    handles = []
    for (label, colour, values), width in zip(curves, WIDTHS if beneath or len(curves) > 1 else WIDTHS[1:], strict=False):
        shown = np.isfinite(values) & (least is None or values > least)
        if not shown.any():
            continue
        values = np.where(shown, values, np.nan)
        for number, (_, rows) in enumerate(stages):
            size = 2.5 + width + WIDER_MARK * min(len(stages) - 1 - number, WIDER_MARKS)
            draw_line(axes, abscissa[rows], values[rows], jumped[rows], linewidth=width, **stage_look(number, colour, size))
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
    plain(axes)


def stage_look(number: int, colour: str, size: float) -> LineLook:
    """Dashes and marks of a load step. size: of its marks [pt]."""
    style, marker = STAGE_STYLES[number % len(STAGE_STYLES)]
    face = colour if number % 2 == 0 else "white"
    return {"color": colour, "linestyle": style, "marker": marker, "markersize": size, "markerfacecolor": face}


def draw_line(axes: Axes, abscissa: np.ndarray, values: np.ndarray, jumped: np.ndarray, **look: Any) -> None:
    """Draw a line through points, dotted to each row in `jumped`."""
    jumps = np.flatnonzero(jumped[1:]) + 1
    for part in np.split(np.arange(len(values)), jumps):
        axes.plot(abscissa[part], values[part], **look)
    for point in jumps[np.isfinite(values[jumps - 1] + values[jumps])]:
        axes.plot(abscissa[point - 1 : point + 1], values[point - 1 : point + 1], color=look["color"], **JUMP_STYLE)


def draw_range(
    axes: Axes, abscissa: np.ndarray, columns: Columns, name: str, colour: str, factor: float, rows: Any = slice(None)
) -> None:
    """Draw the range of eight in ten meshes of a column, times a factor; nothing without such a range."""
    if f"p10_{name}" in columns:
        low, high = (factor * columns[f"{end}_{name}"][rows] for end in ("p10", "p90"))
        axes.fill_between(abscissa, low, high, color=colour, alpha=BAND, linewidth=0.0, gid=MESHES)


def shade_compression(axes: Axes, tensions: Sequence[np.ndarray]) -> bool:
    """Shade negative tension, where a real mesh wrinkles; false where tensions are only about zero."""
    values = np.concatenate(tensions)
    values = values[np.isfinite(values)]
    is_compressed = bool(values.min(initial=0.0) < -LEAST_COMPRESSION * values.max(initial=0.0))
    if is_compressed:
        low, high = axes.get_ylim()
        axes.axhspan(2.0 * min(low, float(values.min())), 0.0, color="#E4E4E4", linewidth=0.0, zorder=0, label=COMPRESSED)
        axes.set_ylim(low, high)
    return is_compressed


def mark_handles(figure: Figure) -> list[Artist]:
    """Legend entries of drawn snap-throughs, and of bands of several meshes."""
    drawn = {artist.get_gid() for axes in figure.axes for artist in (*axes.lines, *axes.collections)}
    look: LineLook = {**JUMP_STYLE, "color": GREY}
    dots, bands = Line2D([], [], label=JUMP, **look), Patch(label=MESHES, color=GREY, alpha=BAND, linewidth=0.0)
    return [*[dots] * (JUMP in drawn), *[bands] * (MESHES in drawn)]


def stage_legend(figure: Figure, names: Sequence[str], title: str = "") -> None:
    """Legend of load steps (where there are several, or a title) and snap-throughs."""
    title = title or ("load step" if len(names) > 1 else "")
    shown = enumerate(names if title else ())
    handles = [*(Line2D([], [], label=name, **stage_look(number, GREY, 4.5)) for number, name in shown), *mark_handles(figure)]
    if handles:
        widest = max(len(str(handle.get_label())) for handle in handles)
        columns = int(np.clip(LEGEND_WIDTH * figure.get_figwidth() // (widest + HANDLE_WIDTH), 1, 6))
        figure.legend(handles=handles, title=title, loc="outside upper center", ncols=columns, frameon=False)
