"""Figure of the deformed mesh: wires coloured by stress, and contacts; for a large or crowded mesh, maps of both."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke
from scipy.spatial import cKDTree

from warpknit.base.text import ZERO_CELSIUS, alike, engineering
from warpknit.export import plots
from warpknit.export.plots import LineLook, figure_of, frame_plan_axes, plan_scale, save_figure
from warpknit.results.frame import Frame, WireLayout, curve_position, drawn_frame, drawn_layout

SEGMENTS_DRAWN = 200_000  # above, single wires are indistinguishable: a map is drawn
OVER_UNDER = 100_000  # pieces of drawn curves above which wires are drawn without gaps in those below
COPIED, COPIES = 2_000, 2  # segments of a periodic tile up to which this many copies are drawn each way
THINNEST = 0.9  # [pt] line that is still legible
ROOM = 293.15  # [K]  another temperature stands in the title
OPEN_SIZE = 1.8  # of the mark of an active contact: the mark of an open one
SMALLEST_MARK, LARGEST_MARK = 2.4, 7.0  # [pt] of an active contact; where marks had to be smaller, maps are drawn
MARK, MARK_IN_PLACE = 0.2, 0.4  # of the mean distance of the drawn marks, and of the places of contact
LEAST_ROOM, ENOUGH_ROOM = 15.0, 22.0  # [pt] between contacts: no white edges and open contacts below; all of the edge above
PLAN_SIZE = 8.0  # [inch] of the larger side of a plan view
LEGEND_COLUMN = 2.5  # [inch]
ONE_TENSION = 4e-3  # of a tension: what the search of one may leave between weft and warp
PEAK: LineLook = {"linestyle": "none", "marker": "*", "markersize": 13, "markerfacecolor": "none",  # a contact shows in it
                  "markeredgecolor": "black", "markeredgewidth": 0.9,
                  "path_effects": [withStroke(linewidth=2.0, foreground="white")]}  # fmt: skip
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
OUTLINE: LineLook = {"color": "#404040", "linewidth": 1.2, "linestyle": "--"}
ELSEWHERE: LineLook = {"linestyle": "none", "marker": "D", "markerfacecolor": "none", "markeredgecolor": plots.AMBER}
ELSEWHERE_SIZE = 0.75  # of the marks of hooks: the smaller marks between stitches
DARK = 0.26  # of the mark: the dark line about it
RING: LineLook = {"markerfacecolor": "none", "markeredgecolor": plots.GREEN, "linestyle": "none", "marker": "o"}


def mesh_figure(
    layout: WireLayout,
    frame: Frame,
    path: Path,
    title: str,
    *,
    yield_stress: float | None = None,
    peak: Sequence[float] | None = None,
) -> Path:
    """Draw the deformed mesh in plan view: wires coloured by stress, contacts, the central rhombus.

    A periodic tile is drawn in copies that fill the picture. The origin is the corner of the mesh, as in the tables.
    `yield_stress` [Pa]: stress beyond it is drawn in cyan. peak: the largest stress [Pa] and
    its place in weft and warp [m], which is marked.
    """
    frame.require_finite()
    if layout.curve_segment.size > SEGMENTS_DRAWN or _is_crowded(layout, frame):
        return _mesh_map(layout, frame, path, title, yield_stress, peak)
    pieces, stress = _pieces(layout, frame)
    bodies = 1e3 * np.asarray(frame.body_position)[:, :2]
    offsets, tile = np.zeros((1, 2)), None
    if layout.wire_closed.any():
        tile = 1e3 * frame.deformation @ np.diag(layout.period)
        corners = _copies(layout) * SQUARE @ tile.T
        low, high = corners.min(axis=0), corners.max(axis=0)
        offsets = plots.tile_copies(pieces[:, :, :2].reshape(-1, 2), tile, *_with_margin(low, high))
    else:
        low, high = pieces[:, :, :2].min(axis=(0, 1)), pieces[:, :, :2].max(axis=(0, 1))
    figure, (axes,) = _plan_figure(high - low, 1, title)
    colours, scale = stress_colours(stress, yield_stress)
    frame_plan_axes(axes, low, high)
    wires = ScalarMappable(scale, colours)
    wires.set_array(1e-6 * np.asarray(frame.node_stress))
    _stress_bar(figure, axes, wires, yield_stress)
    spacing = _spacing(bodies, layout.body_count)
    shows_open = spacing * plan_scale(figure, axes) >= LEAST_ROOM  # else they would hide the loops
    _legend(figure, layout, frame, shows_open, _draw_peak(axes, peak))
    if tile is not None:
        axes.add_patch(Polygon(SQUARE @ tile.T, fill=False, zorder=2, **OUTLINE))
    points_per_mm = plan_scale(figure, axes)  # the legend takes room
    width = max(1e3 * layout.diameter * points_per_mm, THINNEST)
    colour = wires.to_rgba(stress)
    if len(pieces) > OVER_UNDER:
        axes.add_collection(LineCollection(list(pieces[:, :, :2]), colors=colour, linewidths=width))
    else:
        shown, number = plots.copied(pieces, offsets, *_with_margin(low, high))
        edge = plots.EDGE * float(np.clip((spacing * points_per_mm - LEAST_ROOM) / (ENOUGH_ROOM - LEAST_ROOM), 0.0, 1.0))
        axes.add_collection(plots.over_under(shown, colour[number], width, points_per_mm, edge))
    size = points_per_mm * min(
        MARK * _spacing(pieces.reshape(-1, 3), _mark_count(layout, frame, shows_open)),
        MARK_IN_PLACE * spacing,
        _nearest(bodies, offsets) / OPEN_SIZE,
    )
    _draw_contacts(axes, layout, frame, bodies, offsets, min(max(size, SMALLEST_MARK), LARGEST_MARK), shows_open)
    return save_figure(figure, path)


def _mark_count(layout: WireLayout, frame: Frame, shows_open: bool) -> int:
    return int(layout.body_count if shows_open else np.count_nonzero(frame.body_active)) + frame.elsewhere_force.size


def _copies(layout: WireLayout) -> int:
    """Number of copies of a periodic tile each way."""
    return COPIES if layout.wire_closed.any() and layout.curve_segment.size <= COPIED else 1


def _is_crowded(layout: WireLayout, frame: Frame) -> bool:
    """Whether the marks of the active contacts would be smaller than SMALLEST_MARK."""
    position = 1e3 * np.asarray(frame.node_position)[:, :2]
    points_per_mm = 72.0 * PLAN_SIZE / (_copies(layout) * float(np.ptp(position, axis=0).max()))
    return MARK * _spacing(position, _mark_count(layout, frame, shows_open=False)) * points_per_mm < SMALLEST_MARK


def _draw_peak(axes: Axes, peak: Sequence[float] | None) -> list[Line2D]:
    """Mark the largest stress; its legend entry, if any."""
    if peak is None:
        return []
    stress, weft, warp = peak
    return axes.plot(1e3 * weft, 1e3 * warp, **PEAK, zorder=5, label=f"largest wire stress: {engineering(stress, 'Pa')}")


def _pieces(layout: WireLayout, frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Straight pieces (piece, 2, 3) [mm] of the drawn curves of wires, and stress [piece] [MPa] at their middles."""
    drawn, shown = drawn_layout(layout), drawn_frame(layout, frame)
    ends = np.stack([drawn.curve_segment, drawn.curve_segment + 1], axis=1)
    stress = 1e-6 * np.asarray(shown.node_stress, dtype=float)[drawn.curve_node]
    return 1e3 * curve_position(drawn, shown)[ends], stress[ends].mean(axis=1)


def _with_margin(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    margin = 0.1 * (high - low)
    return low - margin, high + margin


def _mesh_map(
    layout: WireLayout, frame: Frame, path: Path, title: str, yield_stress: float | None, peak: Sequence[float] | None
) -> Path:
    """Draw a large mesh as two maps on a grid: the largest stress, and the fraction of active pairs."""
    position = 1e3 * curve_position(layout, frame)[:, :2]
    low, high = position.min(axis=0), position.max(axis=0)
    size = high - low
    figure, (left, right) = _plan_figure(size, 2, title)

    # repeats count from the corner of the mesh; loops at the edge reach a little beyond it
    corner = np.zeros(2) if layout.repeats.all() else low
    whole = 1e3 * np.diag(frame.deformation) * layout.period if layout.repeats.all() else size
    shape, covered = _cells_of_repeats(layout.repeats, whole, position.shape[0] / 100.0, 250)
    extent = (corner[0], corner[0] + covered[0], corner[1], corner[1] + covered[1])
    drawn: dict[str, Any] = {"origin": "lower", "extent": extent, "interpolation": "nearest"}
    stress = np.full(math.prod(shape), np.nan)
    np.fmax.at(stress, _cell_of(position, corner, covered, shape), 1e-6 * np.abs(frame.node_stress)[layout.curve_node])
    colours, scale = stress_colours(stress, yield_stress)
    image = left.imshow(stress.reshape(shape), cmap=colours, norm=scale, **drawn)
    _stress_bar(figure, left, image, yield_stress, "largest stress at nodes in each cell [MPa]")

    body = 1e3 * np.asarray(frame.body_position)[:, :2]
    cell = _cell_of(body, corner, covered, shape)
    pairs = 2.0 * np.bincount(cell, minlength=math.prod(shape))
    active = np.bincount(cell, frame.pair_active.reshape(-1, 2).sum(axis=1), minlength=math.prod(shape))
    share = np.divide(100.0 * active, pairs, out=np.full(pairs.shape, np.nan), where=pairs > 0.0)
    image = right.imshow(share.reshape(shape), cmap="viridis", clim=(0.0, 100.0), **drawn)
    _colour_bar(figure, right, image, "active contacts [% of the pairs in each cell]")
    rhombus = body[layout.rhombus_bodies]
    ring: LineLook = {"linestyle": "none", "marker": "o", "markersize": 11, "markerfacecolor": "none"}
    for axes in (left, right):
        if rhombus.size:
            for colour, width in (("black", 3.5), ("white", 1.5)):
                axes.plot(*rhombus.mean(axis=0), **ring, markeredgecolor=colour, markeredgewidth=width)
        frame_plan_axes(axes, low, high)
    handles = _draw_peak(left, peak)
    if rhombus.size:
        ring = {**ring, "markeredgecolor": "black", "markeredgewidth": 1.5}
        handles.append(Line2D([], [], **ring, label="central rhombus"))
    if count := frame.elsewhere_force.size:
        handles.append(Line2D([], [], linestyle="none", label=f"active contacts between stitches: {count}, not drawn"))
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    return save_figure(figure, path)


def _cells(size: np.ndarray, count: float, most: int) -> tuple[int, int]:
    """Rows and columns of about `count` square cells, `most` a side at most."""
    edge = max(math.sqrt(size[0] * size[1] / max(count, 1.0)), max(size) / most)
    return max(1, round(size[1] / edge)), max(1, round(size[0] / edge))


def _cells_of_repeats(repeats: np.ndarray, size: np.ndarray, count: float, most: int) -> tuple[tuple[int, int], np.ndarray]:
    """Rows and columns of a grid of whole repeats (without a knit, about `count` square cells), and its size."""
    if not repeats.all():
        return _cells(size, count, most), size
    together = -(-int(repeats.max()) // most)
    cells = -(-repeats // together)
    return (int(cells[1]), int(cells[0])), size * cells * together / repeats


def _cell_of(position: np.ndarray, low: np.ndarray, size: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Number, row by row, of the cell of each point [point]."""
    column_row = ((position - low) / size * (shape[1], shape[0])).astype(np.int64)
    column, row = np.clip(column_row, 0, (shape[1] - 1, shape[0] - 1)).T
    return np.asarray(row * shape[1] + column)


def _legend(figure: Figure, layout: WireLayout, frame: Frame, shows_open: bool, handles: list[Line2D]) -> None:
    """Add the numbers of active and open contacts (and in the rhombus) to a legend of `handles`."""
    for chosen, name, _, look in _kinds(frame) if layout.body_count else ():
        label, is_drawn = f"{name} clasps: {np.count_nonzero(chosen)}", name == "active" or shows_open
        shown = {**look, "markersize": 6.5, "markeredgewidth": 1.0} if is_drawn else {"linestyle": "none"}
        handles.append(Line2D([], [], label=label if is_drawn else f"{label}, not drawn", **shown))
    if count := frame.elsewhere_force.size:
        handles.append(Line2D([], [], label=f"active contacts between stitches: {count}", **_elsewhere(LARGEST_MARK)))
    if layout.body_count and layout.wire_closed.any():
        handles.append(Line2D([], [], **OUTLINE, label="the tile that is counted"))
    elif layout.rhombus_bodies.size:
        both = np.count_nonzero(frame.body_active[layout.rhombus_bodies])
        label = f"central rhombus: {both} of {layout.rhombus_bodies.size} active"
        ring: LineLook = {**RING, "markersize": 10, "markeredgewidth": 1.5}
        handles.append(Line2D([], [], label=label, **ring))
    if not handles:
        return
    columns = int(np.clip(figure.get_figwidth() / LEGEND_COLUMN, 1, len(handles)))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, handletextpad=0.5)


def _draw_contacts(
    axes: Axes, layout: WireLayout, frame: Frame, position: np.ndarray, offsets: np.ndarray, size: float, shows_open: bool
) -> None:
    """Fill active contacts at `position` (body, 2) [mm], circle open ones, ring the central rhombus.

    Active contacts between stitches are hollow diamonds, beneath the others. size [pt] of the marks.
    """
    elsewhere = (1e3 * frame.elsewhere_position[:, None, :2] + offsets).reshape(-1, 2)
    axes.plot(*elsewhere.T, **_elsewhere(size), zorder=3.1)
    if not layout.body_count:
        return
    for chosen, name, edge, look in reversed(
        _kinds(frame)
    ):  # the circle of an open contact shows about an active one at its place
        if name == "open" and not shows_open:
            continue
        shown = (position[chosen][:, None] + offsets).reshape(-1, 2)
        mark = size if name == "active" else OPEN_SIZE * size
        axes.plot(*shown.T, **look, markersize=mark, markeredgewidth=edge * size, zorder=3.2 if name == "active" else 3.0)
    if layout.rhombus_bodies.size and not layout.wire_closed.any():  # on a periodic tile they may lie at opposite edges
        mine = position[layout.rhombus_bodies]
        axes.plot(*mine.T, **RING, markersize=2.1 * size, markeredgewidth=0.3 * size, zorder=4)
        spoke = mine - mine.mean(axis=0)
        around = mine[np.argsort(np.arctan2(spoke[:, 1], spoke[:, 0]))]
        axes.fill(*around.T, color=plots.GREEN, alpha=0.15, linewidth=0.0, zorder=0)


def _elsewhere(size: float) -> LineLook:
    """Look of an active contact between stitches, for marks of a size [pt]; its dark edge scales with it."""
    dark = [withStroke(linewidth=DARK * size, foreground="black")]
    return {**ELSEWHERE, "markersize": ELSEWHERE_SIZE * size, "markeredgewidth": 0.18 * size, "path_effects": dark}


def _spacing(position: np.ndarray, count: int) -> float:
    """Mean distance [mm] of `count` contacts at `position` [mm]; of none infinity. On a narrow strip they are in a row."""
    if not count:
        return math.inf
    size = np.ptp(position[:, :2], axis=0)
    return max(math.sqrt(float(np.prod(size)) / count), float(size.max()) / count)


def _nearest(bodies: np.ndarray, offsets: np.ndarray) -> float:
    """Median distance [mm] of a body (body, 2) [mm] to the nearest other body; without bound for a single one."""
    every = (bodies[None] + offsets[:, None]).reshape(-1, 2)
    if len(every) < 2 or not len(bodies):
        return math.inf
    return float(np.median(cKDTree(every).query(bodies, 2)[0][:, 1]))


def _kinds(frame: Frame) -> tuple[tuple[np.ndarray, str, float, LineLook], ...]:
    """Active and open clasps: which, the name, the width of the edge over the size of the mark, and its look."""
    active = frame.body_active
    mark: LineLook = {"linestyle": "none", "marker": "o"}
    halo = [withStroke(linewidth=3.0, foreground="white")]
    return (
        (active, "active", 0.12, {**mark, "markerfacecolor": plots.BLUE, "markeredgecolor": "white"}),
        (~active, "open", 0.16, {**mark, "markerfacecolor": "none", "markeredgecolor": plots.BLUE, "path_effects": halo}),
    )


def _plan_figure(size: np.ndarray, panels: int, title: str) -> tuple[Figure, np.ndarray]:
    """A figure with axes for `panels` plan views of `size` [mm] side by side."""
    width, height = 1.06 * np.maximum(size, 1e-9)
    inches = min(PLAN_SIZE / width, PLAN_SIZE / height)
    across, up = max(inches * width, 3.2), max(inches * height, 3.2)
    figure = figure_of(panels * (across + 1.7), up + 1.5)
    figure.suptitle(title, fontsize=12)
    return figure, np.atleast_1d(figure.subplots(1, panels))


def stress_colours(stress: np.ndarray, yield_stress: float | None) -> tuple[Colormap, Normalize]:
    """Colour map of the stress, cyan beyond the yield stress; scale [MPa].

    The scale ends at the yield stress, so that pictures of one wire compare, or at the largest stress where it is unknown.
    The scale goes by the square root, so that a peak at a grip does not leave the rest of the mesh in one colour.
    """
    table = matplotlib.colormaps["magma_r"](np.linspace(0.16, 0.95, 256))
    colours = LinearSegmentedColormap.from_list("stress", table, N=256).with_extremes(over="#00CFFF", bad="white")
    highest = float(np.nanmax(stress, initial=0.0)) if yield_stress is None else 1e-6 * yield_stress
    return colours, PowerNorm(0.5, vmin=0.0, vmax=highest if highest > 0.0 else 1.0)


def _stress_bar(
    figure: Figure, axes: Axes, mappable: Any, yield_stress: float | None, label: str = "stress at nodes [MPa]"
) -> None:
    largest = float(np.ma.max(np.ma.masked_invalid(mappable.get_array())))
    label += f", square-root scale\nlargest there {float(f'{largest:.3g}'):g}"  # no exponent
    if yield_stress is not None:
        label += f", yield at {1e-6 * yield_stress:.4g}"
    is_beyond = yield_stress is not None and largest > mappable.norm.vmax
    _colour_bar(figure, axes, mappable, label, extend="max" if is_beyond else "neither")


def _colour_bar(figure: Figure, axes: Axes, mappable: Any, label: str, **options: Any) -> None:
    bar = figure.colorbar(mappable, ax=axes, shrink=0.85, aspect=32, pad=0.025, **options)
    bar.set_label(label)
    bar.outline.set_linewidth(0.5)


def state_title(frame: Frame, tension: Sequence[float] | None, *, names_stage: bool = False) -> str:
    """Load of a state and its tension [N/m], weft and warp."""
    stage = f"{frame.stage}: " if names_stage else ""
    load = [f"{stage}strain weft {100.0 * frame.strain_weft:.1f} %, warp {100.0 * frame.strain_warp:.1f} %"]
    if frame.shear:
        load.append(f"shear {100.0 * frame.shear:.1f} %")
    answer = []
    if tension is not None:
        is_one = abs(tension[0] - tension[1]) <= ONE_TENSION * max(map(abs, tension))
        one = f"{engineering(0.5 * sum(tension), 'N/m')} in weft and warp"
        weft, warp = alike(tension, "N/m")
        answer.append(f"tension {one if is_one else f'weft {weft}, warp {warp}'}")
    if abs(frame.temperature - ROOM) > 0.05:
        answer.append(f"{frame.temperature - ZERO_CELSIUS:.4g} °C")
    return "\n".join("   ".join(parts) for parts in (load, answer) if parts)
