"""Pictures of a contact map: a quantity over weft strain or tension (horizontal) and that in warp (vertical), as figure 8 of the
paper.

R. Guglielmini, A. Marotta, P. Salvini, IOP Conf. Ser.: Mater. Sci. Eng. 1214 (2022) 012033, figure 8.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colorbar import Colorbar
from matplotlib.contour import ContourSet
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.path import Path as Line
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox
from scipy.spatial import cKDTree

from warpknit.base.text import of_sides
from warpknit.export.plots import few_ticks, figure_of, save_figure, scale_of

PERCENT_LEVELS = (10.0, 25.0, 50.0, 75.0, 90.0)
SHARES, FORCES = "% of pairs", ("N/m", "Pa")  # units
BEYOND_LIMIT = 1.25  # of the largest force below the elastic limit: last colour
LEAST_LEVEL = 0.02  # of the largest value: lines of less are left out
LIMIT_COLOUR, OPTIMUM_COLOUR = "#D55E00", "white"
LIMIT_WIDTH = 2.4  # [pt]
JUMP_WIDTH = 1.6  # [pt] of the edge between two cells
PLACE_MARKERS = "osD^v"
LEGEND_COLUMNS, WIDE_LABEL, WIDEST_LABEL = 3, 28, 44  # columns, one less where a label has more characters, and one more
LEAST_LINE = 0.75  # cells: shorter pieces of lines between jumps are left out
LINES_APART = 10.0  # [pt] between lines of equal value, which is the height of a name: nearer ones are left out
LINES: Mapping[str, Any] = {"colors": "white", "linewidths": 0.9}
LOAD_SIZE = 10.0  # [pt2] of the dot at a load
UNDER_TEXT: Mapping[str, Any] = {"linewidth": 2.0, "foreground": "#404040"}
ON_COLOURS: Mapping[str, Any] = {"linewidth": 3.0, "foreground": "white"}
STEP = 1e-5  # of the map, on either side of the edge of a cell
REACHES = 1e-9  # of the largest share: a share this little below a line has reached it
FEW_LOADS = 36  # of a map: their values are written beside them, in place of lines of equal value
VALUE_AWAY = 9.0  # [pt] of a value from its load, on the side of the middle of the map
ON_MAP: Mapping[str, Any] = {"color": "white", "fontsize": "small", "zorder": 6.0}
TITLE_PAD = 14.0  # [pt] room for the mark of an optimum at the upper edge
TICK_PAD = 8.0  # [pt] the same at the other edges
WARNING_WIDTH = 100  # characters of a line


@dataclass(frozen=True)
class Marks:
    """Marks of every map."""

    stress: np.ndarray  # (warp, weft) [Pa] largest wire stress, nan where unknown
    yield_stress: float  # [Pa]
    is_assumed: bool = field(default=False, kw_only=True)  # whether the scene leaves it out
    optimum: tuple[float, float] | None  # load, weft and warp
    # others: label, load, and the value there; without a load they are outside the map, and in the legend alone
    places: tuple[tuple[str, tuple[float, float] | None, float], ...] = ()
    jumps: Sequence[tuple[tuple[float, float], tuple[float, float]]] = ()  # loads of neighbouring cells with a jump between
    optimum_note: str = ""  # in the legend, after its load


def map_figure(
    path: Path,
    weft: Sequence[float],
    warp: Sequence[float],
    values: np.ndarray,
    *,
    title: str,
    label: str,
    unit: str,
    marks: Marks,
    warnings: Sequence[str] = (),
    by_tension: bool = False,
) -> Path:
    """Draw `values` (warp, weft) over loads, which are strains or (`by_tension`) tensions [N/m]; nan stays blank.

    unit: of the values, which are in SI; percent otherwise. Shares (SHARES) have colours from 0 to 100, and lines along the edges
    of cells. Lines of other quantities and of the elastic limit go between the loads, and colours too where all loads are known
    and no jumps. Maps of few loads have tiles, and the values beside the loads. Colours of forces end at the largest below the
    elastic limit. A tile is one cell, half of it at the edges.
    `warnings` stand on top.
    """
    x, y = np.asarray(weft, dtype=float), np.asarray(warp, dtype=float)
    of_load = scale_of("N/m", x, y) if by_tension else (100.0, "%")
    x, y, quantity = of_load[0] * x, of_load[0] * y, "tension" if by_tension else "strain"
    figure = figure_of(7.0, 5.9)
    axes = figure.subplots()
    known, percent = np.ma.masked_invalid(values), unit == SHARES
    low, top = _range_of(known, unit, marks)
    if unit in FORCES:
        factor, unit = scale_of(unit, np.array([low, top]))
        known, low, top = factor * known, factor * low, factor * top
    look: dict[str, Any] = {"cmap": "viridis", "vmin": low, "vmax": top}
    few = known.size <= FEW_LOADS
    if few or percent or known.mask.any() or marks.jumps or min(values.shape) < 2:
        tiles = axes.pcolormesh(_edges(x), _edges(y), known, **look)
    else:  # colours between the loads, as the lines
        tiles = axes.pcolormesh(x, y, known, shading="gouraud", **look)
    dots: dict[str, Any] = {"color": "white", "edgecolors": "#404040", "linewidths": 0.5, "clip_on": False}
    loads = [axes.scatter(*np.meshgrid(x, y), s=LOAD_SIZE, zorder=4.5, label="loads of the map", **dots)]
    bar = figure.colorbar(tiles, ax=axes, pad=0.02, extend="max" if known.count() and float(known.max()) > top else "neither")
    bar.set_label(f"{label} [{unit}]")
    if known.mask.all():
        axes.text(0.5, 0.5, "no converged state", transform=axes.transAxes, ha="center", va="center")
    elif float(known.min()) == float(known.max()) and not few:
        one = f"{float(known.min()):.3g} {unit}{'' if known.mask.any() else ' at every load'}"
        axes.text(0.5, 0.5, one, transform=axes.transAxes, ha="center", va="center", path_effects=[withStroke(**ON_COLOURS)])
    lines = None
    if few:
        _write_values(axes, x, y, known)
    elif known.count() and min(values.shape) > 1:
        lines = _draw_levels(axes, bar, x, y, known if percent else _smooth(known, x, y, marks, of_load[0]), top, percent)
    handles = loads + _draw_marks(axes, x, y, marks, tiles.to_rgba, of_load)
    if known.mask.any():
        axes.set_facecolor("#E8E8E8")
        handles.append(Patch(facecolor="#E8E8E8", edgecolor="#909090", label="not converged, or not run"))
    if handles:
        legend = {"facecolor": "#B0B0B0", "edgecolor": "none", "framealpha": 1.0, "fontsize": "small"}
        widest = max(len(str(handle.get_label())) for handle in handles)
        columns = min(len(handles), LEGEND_COLUMNS - (widest > WIDE_LABEL) - (widest > WIDEST_LABEL))
        axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=columns, **legend)
    for limits, ticks in ((axes.set_xlim, x), (axes.set_ylim, y)):
        if len(ticks) > 1:  # cells at the edge are shown by half: strains that were not run are not in the picture
            limits(ticks[0], ticks[-1])
    axes.yaxis.set_major_locator(few_ticks())
    axes.tick_params(pad=TICK_PAD)
    axes.set_xlabel(f"weft {quantity} [{of_load[1]}]")
    axes.set_ylabel(f"warp {quantity} [{of_load[1]}]")
    axes.set_title(title, fontsize="medium", pad=TITLE_PAD)
    if warnings:
        texts = "\n".join(fill(warning, WARNING_WIDTH) for warning in warnings)
        figure.suptitle(texts, fontsize="small", color=LIMIT_COLOUR)
    if lines is not None:
        _name_lines(axes, *lines)
    return save_figure(figure, path)


def _range_of(known: np.ma.MaskedArray[Any, Any], unit: str, marks: Marks) -> tuple[float, float]:
    """Values of the first and the last colour."""
    if unit == SHARES:
        return 0.0, 100.0
    low, high = (0.0, 0.0) if known.mask.all() else (min(0.0, float(known.min())), float(known.max()))
    elastic = np.ma.masked_where(~(np.nan_to_num(marks.stress, nan=np.inf) <= marks.yield_stress), known)
    if unit in FORCES and elastic.count() and float(elastic.max()) > 0.0:
        high = min(high, BEYOND_LIMIT * float(elastic.max()))
    return low, high if high > low else low + 1.0


def _draw_levels(
    axes: Axes, bar: Colorbar, x: np.ndarray, y: np.ndarray, known: np.ma.MaskedArray[Any, Any], top: float, percent: bool
) -> tuple[ContourSet, dict[float, str]] | None:
    """Draw lines of equal value, also on the colour bar; return them with the names of their levels."""
    low, high = float(known.min()), min(top, float(known.max()))
    # what is small beside the largest wanders about zero, and a line at zero with it
    levels = PERCENT_LEVELS if percent else [v for v in MaxNLocator(7).tick_values(low, high) if abs(v) > LEAST_LEVEL * high]
    same: dict[Any, float] = {}  # shares whose lines run round the same cells: the highest
    for level in levels:
        if low < level < high or (percent and level == high):
            same[(known.filled(-np.inf) >= level).tobytes() if percent else level] = level
    shown = list(same.values()) if percent else _levels_apart(axes, x, y, known, list(same.values()))
    if not shown:
        return None
    # a share that reaches a line is on its upper side
    drawn = axes.contour(*(_steps(x, y, known + REACHES * high) if percent else (x, y, known)), levels=shown, **LINES)
    bar.add_lines(drawn)
    if not percent:
        _drop_stubs(drawn, x, y)
    return drawn, {level: f"{level:g}{' %' if percent else ''}" for level in shown}


def _write_values(axes: Axes, x: np.ndarray, y: np.ndarray, known: np.ma.MaskedArray[Any, Any]) -> None:
    """Write each known value (warp, weft) beside its load."""
    for row, column in np.argwhere(~np.ma.getmaskarray(known)).tolist():
        right, up = (int(k == 0) - int(k == n - 1) if n > 1 else 0 for k, n in ((column, len(x)), (row, len(y))))
        place, away = (x[column], y[row]), (VALUE_AWAY * right, VALUE_AWAY * (up or 1))
        side: dict[str, Any] = {"ha": {0: "center", 1: "left", -1: "right"}[right], "va": "top" if up < 0 else "bottom"}
        axes.annotate(
            f"{known[row, column]:.3g}", place, away, textcoords="offset points", path_effects=[withStroke(**UNDER_TEXT)], **side,
            **ON_MAP,
        )  # fmt: skip


def _drop_stubs(drawn: ContourSet, x: np.ndarray, y: np.ndarray) -> bool:
    """Remove open lines of equal value shorter than LEAST_LINE cells; whether any is left."""
    cell = np.array([np.ptp(x) / (len(x) - 1), np.ptp(y) / (len(y) - 1)])
    kept = []
    for path in drawn.get_paths():
        path.should_simplify = False
        parts = [np.asarray(part) for part in path.to_polygons(closed_only=False)]
        lengths = [np.linalg.norm(np.diff(part / cell, axis=0), axis=1).sum() for part in parts]
        is_closed = [np.array_equal(part[0], part[-1]) for part in parts]
        kept.append([part for part, length, ring in zip(parts, lengths, is_closed, strict=True) if ring or length >= LEAST_LINE])
    drawn.set_paths([Line.make_compound_path(*map(Line, parts)) for parts in kept])
    return any(kept)


def _levels_apart(axes: Axes, x: np.ndarray, y: np.ndarray, known: Any, levels: Sequence[float]) -> list[float]:
    """Rising levels whose lines leave room for their names."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    size = 72.0 * np.array(axes.get_position().size) * figure.get_size_inches() / [np.ptp(x), np.ptp(y)]  # [pt] of a unit
    kept: list[float] = []
    before = np.zeros((0, 2))
    for level in levels:
        drawn = axes.contour(x, y, known, levels=[level])
        places = size * np.concatenate([path.vertices for path in drawn.get_paths()])
        drawn.remove()
        if not len(before) or (len(places) and np.median(cKDTree(before).query(places)[0]) >= LINES_APART):
            kept.append(level)
            before = places
    return kept


def _name_lines(axes: Axes, drawn: ContourSet, names: dict[float, str]) -> None:
    """Write the names of levels on their lines, over nothing else."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    figure.draw_without_rendering()  # all that takes room is in place
    figure.set_layout_engine("none")  # and stays there
    half = 0.5 * figure.dpi / 72.0
    taken = [
        Bbox([place - half * line.get_markersize(), place + half * line.get_markersize()])
        for line in axes.get_lines()
        for place in axes.transData.transform(line.get_xydata())
    ]
    for label in drawn.clabel(fmt=names, inline=False):
        label.set(rotation=0.0, path_effects=[withStroke(**UNDER_TEXT)], **ON_MAP)
        box = label.get_window_extent()
        if any(map(box.overlaps, taken)) or not all(axes.bbox.contains(*corner) for corner in box.corners()):
            label.remove()
        else:
            taken.append(box)


def _steps(x: np.ndarray, y: np.ndarray, values: Any) -> tuple[np.ndarray, np.ndarray, Any]:
    """Places (2n) and values (2m, 2n) whose lines of equal value follow cell edges."""
    places = []
    for middle in (x, y):
        edges = _edges(middle)
        step = STEP * np.ptp(edges)
        places.append(np.stack([edges[:-1] + step, edges[1:] - step], axis=1).ravel())
    return places[0], places[1], np.ma.repeat(np.ma.repeat(values, 2, axis=0), 2, axis=1)


def _draw_marks(
    axes: Axes, x: np.ndarray, y: np.ndarray, marks: Marks, colour_of: Callable[[Any], Any], of_load: tuple[float, str]
) -> list[Any]:
    """Draw elastic limit, optimum and other places in their colours; return legend entries.

    The limit lies between the middles of cells, those above it begin at an edge.

    of_load: factor of the loads to the axes, and unit there.
    """
    handles: list[Any] = []
    style: dict[str, Any]
    known = np.ma.masked_invalid(marks.stress)
    stress, above = _smooth(known, x, y, marks, of_load[0]), np.argwhere((known > marks.yield_stress).filled(fill_value=False))
    scale, unit = scale_of("Pa", np.array([marks.yield_stress]))
    limit = f"the elastic limit, {scale * marks.yield_stress:.3g} {unit}{' (assumed)' if marks.is_assumed else ''}"
    if min(stress.shape) > 1 and stress.count() and float(stress.min()) < marks.yield_stress < float(stress.max()):
        style = {"colors": LIMIT_COLOUR, "linewidths": LIMIT_WIDTH}
        if _drop_stubs(axes.contour(x, y, stress, levels=[marks.yield_stress], **style), x, y):
            label = "elastic limit, between middles of cells"
            handles.append(Line2D([], [], color=LIMIT_COLOUR, linewidth=LIMIT_WIDTH, label=label))
    if len(above):
        style = {"facecolor": "none", "edgecolor": LIMIT_COLOUR, "hatch": "///", "linewidth": 0.0}
        across, up = _edges(x), _edges(y)
        for row, column in above:
            corner, size = (across[column], up[row]), (np.diff(across)[column], np.diff(up)[row])
            axes.add_patch(Rectangle(corner, *size, zorder=1.5, **style))
        handles.append(Patch(label=f"cells above {limit}", **style))
    elif known.count():
        handles.append(Line2D([], [], linestyle="none", label=f"no cell above {limit}"))
    if marks.jumps:
        style = {
            "color": "black",
            "linewidth": JUMP_WIDTH,
            "path_effects": [withStroke(linewidth=2.0 * JUMP_WIDTH, foreground="white")],
        }
        pairs = of_load[0] * np.array(marks.jumps, dtype=float)
        axes.add_collection(LineCollection([_edge_between(x, y, *pair) for pair in pairs], zorder=4, **style))
        handles.append(Line2D([], [], label="snap-through to another equilibrium", **style))
    if marks.optimum is not None:
        style = {"marker": "*", "markersize": 15, "markeredgecolor": "black", "linestyle": "none"}
        place = of_load[0] * marks.optimum[0], of_load[0] * marks.optimum[1]
        text = of_sides([f"{value:.3g} {of_load[1]}" for value in place])
        axes.plot(*place, color=OPTIMUM_COLOUR, zorder=7, clip_on=False, **style)
        handles.append(Line2D([], [], color=OPTIMUM_COLOUR, label=f"optimum, {text}{marks.optimum_note}", **style))
    inside = [(label, load, value) for label, load, value in marks.places if load is not None]
    for (label, load, value), marker in zip(inside, cycle(PLACE_MARKERS), strict=False):
        style = {"marker": marker, "markersize": 9, "markeredgecolor": "black", "markeredgewidth": 1.6, "linestyle": "none"}
        style["color"] = tuple(colour_of(value))
        axes.plot(of_load[0] * load[0], of_load[0] * load[1], zorder=5, clip_on=False, **style)
        handles.append(Line2D([], [], label=label, **style))
    outside = [f"{label}, outside the map" for label, load, _ in marks.places if load is None]
    return handles + [Line2D([], [], color="black", marker="x", linestyle="none", label=label) for label in outside]


def _edge_between(x: np.ndarray, y: np.ndarray, one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Ends (2, 2) of the edge between neighbouring cells with middles `one` and `other` (2,)."""
    across = 0 if abs(other[0] - one[0]) > abs(other[1] - one[1]) else 1
    middle = (x, y)[1 - across]
    cell = int(np.argmin(np.abs(middle - one[1 - across])))
    ends = np.empty((2, 2))
    ends[:, across], ends[:, 1 - across] = 0.5 * (one + other)[across], _edges(middle)[cell : cell + 2]
    return ends


def _smooth(values: Any, x: np.ndarray, y: np.ndarray, marks: Marks, factor: float) -> Any:
    """Values (warp, weft) without cells at a snap-through: no line of equal value crosses them."""
    shown = np.ma.array(values, copy=True)
    for cell in {tuple(cell) for pair in marks.jumps for cell in pair}:
        shown[np.argmin(np.abs(y - factor * cell[1])), np.argmin(np.abs(x - factor * cell[0]))] = np.ma.masked
    return shown


def _edges(middle: np.ndarray) -> np.ndarray:
    """Edges (n + 1,) of cells about their middles (n,)."""
    if len(middle) == 1:
        return np.array([middle[0] - 0.5, middle[0] + 0.5])
    between = 0.5 * (middle[1:] + middle[:-1])
    return np.concatenate([[2 * middle[0] - between[0]], between, [2 * middle[-1] - between[-1]]])
