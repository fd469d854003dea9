"""Pictures of a contact map: a quantity over weft strain or tension (horizontal) and that in warp (vertical), as figure 8 of the
paper.

R. Guglielmini, A. Marotta, P. Salvini, IOP Conf. Ser.: Mater. Sci. Eng. 1214 (2022) 012033, figure 8.
"""

from __future__ import annotations

import os
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
from numpy.typing import NDArray
from scipy.spatial import cKDTree

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
NAME_ROOM = 3.0  # [pt] about the name of a line
PLACES_APART = 2.0  # [pt] along a line, where its name may stand
PLACES = 200  # of colours and lines between the loads, along a side
LOAD_SIZE = 10.0  # [pt2] of the dot at a load
ON_COLOURS: dict[str, Any] = {"linewidth": 3.0, "foreground": "white"}
STEP = 1e-5  # of the map, on either side of the edge of a cell
REACHES = 1e-9  # of the largest share: a share this little below a line has reached it
TITLE_PAD = 14.0  # [pt] room for the mark of an optimum at the upper edge
TICK_PAD = 8.0  # [pt] the same at the other edges
WARNING_WIDTH = 100  # characters of a line


@dataclass(frozen=True)
class Marks:
    """Marks of every map."""

    stress: NDArray[Any]  # (warp, weft) [Pa] largest wire stress, nan where unknown
    yield_stress: float  # [Pa]
    is_assumed: bool = field(default=False, kw_only=True)  # whether the scene leaves it out
    optimum: tuple[float, float] | None  # load, weft and warp
    # others: label, load, and the value there; without a load they are outside the map, and in the legend alone
    places: tuple[tuple[str, tuple[float, float] | None, float], ...] = ()
    jumps: Sequence[tuple[tuple[float, float], tuple[float, float]]] = ()  # loads of neighbouring cells with a jump between
    optimum_note: str = ""  # in the legend, after its load


def map_figure(
    path: str | os.PathLike[str],
    weft: Sequence[float],
    warp: Sequence[float],
    values: NDArray[Any],
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
    and no jumps. Colours of forces end at the largest below the elastic limit. A tile is one cell, half of it at the edges.
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
    if percent or known.mask.any() or marks.jumps or min(values.shape) < 2:
        tiles = axes.pcolormesh(_edges(x), _edges(y), known, **look)
    else:  # colours between the loads, as the lines
        tiles = axes.pcolormesh(*_between(x, y, known), shading="nearest", **look)
    dots: dict[str, Any] = {"color": "white", "edgecolors": "#404040", "linewidths": 0.5, "clip_on": False}
    loads = [axes.scatter(*np.meshgrid(x, y), s=LOAD_SIZE, zorder=4.5, label="loads of the map", **dots)]
    bar = figure.colorbar(tiles, ax=axes, pad=0.02, extend="max" if known.count() and float(known.max()) > top else "neither")
    bar.set_label(f"{label} [{unit}]")
    if known.mask.all():
        axes.text(0.5, 0.5, "no converged state", transform=axes.transAxes, ha="center", va="center")
    elif float(known.min()) == float(known.max()):
        one = f"{float(known.min()):.3g} {unit}{'' if known.mask.any() else ' at every load'}"
        axes.text(0.5, 0.5, one, transform=axes.transAxes, ha="center", va="center", path_effects=[withStroke(**ON_COLOURS)])
    names = {}
    if known.count() and min(values.shape) > 1:
        names = _draw_levels(axes, bar, x, y, known if percent else _smooth(known, x, y, marks, of_load[0]), top, percent)
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
        lines = "\n".join(fill(warning, WARNING_WIDTH) for warning in warnings)
        figure.suptitle(lines, fontsize="small", color=LIMIT_COLOUR)
    _name_lines(axes, names)
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
    axes: Axes, bar: Colorbar, x: NDArray[Any], y: NDArray[Any], known: np.ma.MaskedArray[Any, Any], top: float, percent: bool
) -> dict[float, str]:
    """Draw lines of equal value, also on the colour bar; return the names of levels."""
    low, high = float(known.min()), min(top, float(known.max()))
    # what is small beside the largest wanders about zero, and a line at zero with it
    levels = PERCENT_LEVELS if percent else [v for v in MaxNLocator(7).tick_values(low, high) if abs(v) > LEAST_LEVEL * high]
    same: dict[Any, list[float]] = {}  # levels of one line: shares whose lines run round the same cells
    for level in levels:
        if low < level < high or (percent and level == high):
            same.setdefault((known.filled(-np.inf) >= level).tobytes() if percent else level, []).append(level)
    if not same:
        return {}
    if not percent:
        same = {level: [level] for level in _levels_apart(axes, x, y, known, [some[0] for some in same.values()])}
    names = {some[-1]: f"{some[-1]:g}{' %' if percent else ''}" for some in same.values()}  # of several levels the highest
    # a share that reaches a line is on its upper side
    shown = (x, y, known) if known.mask.any() else _between(x, y, known)
    if percent:
        shown = _steps(x, y, known + REACHES * high)
    drawn = axes.contour(*shown, levels=list(names), colors="white", linewidths=0.9)
    bar.add_lines(drawn)
    if not percent:
        _drop_stubs(drawn, x, y)
    return names


def _drop_stubs(drawn: ContourSet, x: NDArray[Any], y: NDArray[Any]) -> bool:
    """Remove open lines of equal value shorter than LEAST_LINE cells; whether any is left."""
    cell = np.array([np.ptp(x) / (len(x) - 1), np.ptp(y) / (len(y) - 1)])
    kept = []
    for path in drawn.get_paths():
        path.should_simplify = False
        parts = [np.asarray(part) for part in path.to_polygons(closed_only=False)]
        kept.append([part for part in parts if np.array_equal(part[0], part[-1]) or _length(part / cell) >= LEAST_LINE])
    drawn.set_paths([Line.make_compound_path(*map(Line, parts)) for parts in kept])
    return any(kept)


def _length(line: NDArray[Any]) -> float:
    """Length of a line (n, 2)."""
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def _levels_apart(axes: Axes, x: NDArray[Any], y: NDArray[Any], known: Any, levels: Sequence[float]) -> list[float]:
    """Rising levels whose lines leave room for their names."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    size = 72.0 * np.array(axes.get_position().size) * figure.get_size_inches() / [np.ptp(x), np.ptp(y)]  # [pt] of a unit
    drawn = axes.contour(x, y, known, levels=levels)
    kept: list[float] = []
    before: NDArray[Any] | None = None
    for level, path in zip(levels, drawn.get_paths(), strict=True):
        parts = [_along(size * part, PLACES_APART) for part in path.to_polygons(closed_only=False)]
        places = np.concatenate([np.zeros((0, 2)), *parts])
        if before is None or (len(places) and np.median(cKDTree(before).query(places)[0]) >= LINES_APART):
            kept.append(level)
            before = places if len(places) else before
    drawn.remove()
    return kept


def _name_lines(axes: Axes, names: Mapping[float, str]) -> None:
    """Write the names of levels on their lines: in the map, over no mark and no other name, where the fewest other lines run.

    A line without such a place, or hardly longer than its name, has none.
    """
    figure = axes.get_figure(root=True)
    assert figure is not None
    figure.draw_without_rendering()  # all that takes room is in place
    figure.set_layout_engine("none")  # and stays there
    point = figure.dpi / 72.0
    taken = [
        (place, np.full(2, line.get_markersize() * point))
        for line in axes.get_lines()
        for place in axes.transData.transform(line.get_xydata())
    ]
    lines = [
        (names.get(level, ""), _along(np.asarray(part), PLACES_APART * point))
        for levels in axes.collections
        if isinstance(levels, ContourSet)
        for level, path in zip(levels.levels, levels.get_paths(), strict=True)
        for part in path.to_polygons(axes.transData, closed_only=False)
    ]
    lines.sort(key=lambda line: -len(line[1]))  # the longest first
    for k, (name, places) in enumerate(lines):
        style: dict[str, Any] = {"color": "white", "fontsize": "small", "ha": "center", "va": "center", "visible": bool(name)}
        label = axes.text(0.0, 0.0, name, path_effects=[withStroke(linewidth=2.0, foreground="#404040")], **style)
        size = np.array(label.get_window_extent().size) + NAME_ROOM * point
        free = np.all((places > axes.bbox.min + 0.5 * size) & (places < axes.bbox.max - 0.5 * size), axis=1)
        for place, other in taken:
            free &= np.any(np.abs(places - place) > 0.5 * (size + other), axis=1)
        if not name or not free.any() or len(places) * PLACES_APART * point < 2.0 * size[0]:
            label.remove()
            continue
        others = np.concatenate([np.zeros((0, 2)), *(other for j, (_, other) in enumerate(lines) if j != k)])
        near = cKDTree(2.0 * others / size).query_ball_point(2.0 * places[free] / size, 1.0, p=np.inf, return_length=True)
        from_middle = np.abs(np.flatnonzero(free) / len(places) - 0.5)
        place = places[free][np.argmin(near + from_middle)]
        label.set_position(tuple(axes.transData.inverted().transform(place)))
        taken.append((place, size))


def _along(line: NDArray[Any], apart: float) -> NDArray[Any]:
    """(place, 2) evenly along a line (n, 2)."""
    arc = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    places = np.linspace(0.0, arc[-1], max(2, round(arc[-1] / apart)))
    return np.stack([np.interp(places, arc, line[:, k]) for k in (0, 1)], axis=1)


def _steps(x: NDArray[Any], y: NDArray[Any], values: Any) -> tuple[NDArray[Any], NDArray[Any], Any]:
    """Places (2n) and values (2m, 2n) whose lines of equal value follow cell edges."""
    places = []
    for middle in (x, y):
        edges = _edges(middle)
        step = STEP * np.ptp(edges)
        places.append(np.stack([edges[:-1] + step, edges[1:] - step], axis=1).ravel())
    return places[0], places[1], np.ma.repeat(np.ma.repeat(values, 2, axis=0), 2, axis=1)


def _draw_marks(
    axes: Axes, x: NDArray[Any], y: NDArray[Any], marks: Marks, colour_of: Callable[[Any], Any], of_load: tuple[float, str]
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
        text = " / ".join(f"{value:.1f} {of_load[1]}" for value in place)
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


def _edge_between(x: NDArray[Any], y: NDArray[Any], one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
    """Ends (2, 2) of the edge between neighbouring cells with middles `one` and `other` (2,)."""
    across = 0 if abs(other[0] - one[0]) > abs(other[1] - one[1]) else 1
    middle = (x, y)[1 - across]
    cell = int(np.argmin(np.abs(middle - one[1 - across])))
    ends = np.empty((2, 2))
    ends[:, across], ends[:, 1 - across] = 0.5 * (one + other)[across], _edges(middle)[cell : cell + 2]
    return ends


def _smooth(values: Any, x: NDArray[Any], y: NDArray[Any], marks: Marks, factor: float) -> Any:
    """Values (warp, weft) without cells at a snap-through: no line of equal value crosses them."""
    shown = np.ma.array(values, copy=True)
    for cell in {tuple(cell) for pair in marks.jumps for cell in pair}:
        shown[np.argmin(np.abs(y - factor * cell[1])), np.argmin(np.abs(x - factor * cell[0]))] = np.ma.masked
    return shown


def _between(x: NDArray[Any], y: NDArray[Any], values: Any) -> tuple[NDArray[Any], NDArray[Any], Any]:
    """Places between the loads, and bilinear values there."""
    across, up = (_places_between(loads) for loads in (x, y))
    rows = np.array([np.interp(across, x, row) for row in np.ma.getdata(values)])
    return across, up, np.array([np.interp(up, y, column) for column in rows.T]).T


def _places_between(loads: NDArray[Any]) -> NDArray[Any]:
    """About PLACES along a side, with the loads among them."""
    steps = max(1, PLACES // (len(loads) - 1))
    return np.interp(np.arange(steps * (len(loads) - 1) + 1) / steps, np.arange(len(loads)), loads)


def _edges(middle: NDArray[Any]) -> NDArray[Any]:
    """Edges (n + 1,) of cells about their middles (n,)."""
    if len(middle) == 1:
        return np.array([middle[0] - 0.5, middle[0] + 0.5])
    between = 0.5 * (middle[1:] + middle[:-1])
    return np.concatenate([[2 * middle[0] - between[0]], between, [2 * middle[-1] - between[-1]]])
