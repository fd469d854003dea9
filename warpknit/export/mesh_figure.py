"""Figure of the deformed mesh: wires coloured by stress, and contacts; for a large mesh, maps of both."""

import math
import os
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from warpknit.export.plots import BLUE, GREEN, figure_of, frame_plan_axes, save_figure, scale_of
from warpknit.frame import Frame, WireLayout, curve_position, drawn_frame, drawn_layout
from warpknit.hermite import hermite
from warpknit.text import ZERO_CELSIUS

__all__ = ["mesh_figure"]

SEGMENTS_DRAWN = 200_000  # above, single wires cannot be told apart: a map is drawn
PARTS_DRAWN = 4  # of the curve of a wire between two nodes
NEIGHBOURS_DRAWN = 2_000  # segments of a periodic tile up to which the tiles around it are drawn, pale
ROOM = 293.15  # [K]  a temperature other than this is said in the title


def mesh_figure(
    layout: WireLayout,
    frame: Frame,
    path: str | os.PathLike[str],
    *,
    yield_stress: float | None = None,
    tension: tuple[float, float] | None = None,
) -> Path:
    """Draw the deformed mesh in plan view: wires coloured by stress, active and open contacts, the central rhombus.

    `yield_stress` [Pa]: stress beyond it is drawn in cyan. `tension` [N/m], weft and warp: said in the title.
    """
    frame.require_finite()
    position = 1e3 * curve_position(layout, frame)[:, :2]
    segment = layout.curve_segment
    if segment.size > SEGMENTS_DRAWN:
        return _mesh_map(layout, frame, path, position, yield_stress, tension)
    low, high = position.min(axis=0), position.max(axis=0)
    figure, (axes,), points_per_mm = _plan_figure(high - low, 1, _title(frame, tension))
    stress = 1e-6 * np.asarray(frame.node_stress, dtype=float)[layout.curve_node]
    colours, scale = _stress_colours(stress, yield_stress)
    lines: Any = _lines(layout, frame, position, segment)
    pieces, colour = (lines, 0.5 * (stress[segment] + stress[segment + 1])) if layout.curve_parts == 1 else _pieces(layout, frame)
    wires = LineCollection(
        pieces,
        array=colour,
        cmap=colours,
        norm=scale,
        linewidths=max(1e3 * layout.diameter * points_per_mm, 0.9),
        capstyle="round",
        zorder=1,
    )
    axes.add_collection(wires)
    if layout.wire_closed.any() and segment.size <= NEIGHBOURS_DRAWN:
        _draw_neighbours(axes, lines, 1e3 * frame.deformation @ np.diag(layout.period))
    _stress_bar(figure, axes, wires, yield_stress)
    _draw_contacts(figure, axes, layout, frame, points_per_mm)
    frame_plan_axes(axes, low, high)
    return save_figure(figure, path)


def _lines(layout: WireLayout, frame: Frame, position: NDArray[Any], segment: NDArray[Any]) -> NDArray[Any]:
    """(segment, point, 2) [mm] curves of the wires between their nodes, as recorded or smooth through the nodes."""
    if layout.curve_parts == 1:
        return _smooth(position, segment)
    begin, end = position[segment][:, None], position[segment + 1][:, None]
    between = 1e3 * np.asarray(frame.between, dtype=float)[layout.curve_node[segment], :, :2]
    return np.concatenate([begin, begin + between, end], axis=1)


def _pieces(layout: WireLayout, frame: Frame) -> tuple[Any, NDArray[Any]]:
    """(piece, 2, 2) [mm] pieces of the recorded curves, the lowest first, and the stress [MPa] of each."""
    drawn, shown = drawn_layout(layout), drawn_frame(layout, frame)
    position, first = 1e3 * curve_position(drawn, shown), drawn.curve_segment
    stress = 1e-6 * np.asarray(shown.node_stress, dtype=float)[drawn.curve_node]
    order = first[np.argsort(position[first, 2] + position[first + 1, 2], kind="stable")]
    return np.stack([position[order, :2], position[order + 1, :2]], axis=1), 0.5 * (stress[order] + stress[order + 1])


def _smooth(position: NDArray[Any], segment: NDArray[Any]) -> NDArray[Any]:
    """(segment, point, 2) Catmull-Rom curves of the wires between their nodes."""
    has_before, has_after = np.isin(segment - 1, segment), np.isin(segment + 1, segment)
    begin, end = position[segment], position[segment + 1]
    before = np.where(has_before[:, None], position[segment - 1], 2.0 * begin - end)
    after = np.where(has_after[:, None], position[np.minimum(segment + 2, len(position) - 1)], 2.0 * end - begin)
    u = np.linspace(0.0, 1.0, PARTS_DRAWN + 1)[None, :, None]
    at_begin, at_end = (0.5 * (far - near)[:, None] for far, near in ((end, before), (after, begin)))
    h10, h01, h11 = hermite(u)
    return np.asarray(begin[:, None] + h10 * at_begin + h01 * (end - begin)[:, None] + h11 * at_end)


def _draw_neighbours(axes: Axes, lines: NDArray[Any], period: NDArray[Any]) -> None:
    """Draw the eight tiles around a periodic one, pale; the columns of `period` (2, 2) [mm] lead to the next tile."""
    steps = [np.array(step) for step in np.ndindex(3, 3) if step != (1, 1)]
    copies = np.concatenate([lines + period @ (step - 1) for step in steps])
    axes.add_collection(LineCollection(list(copies), colors="#D8D8D8", linewidths=0.9, zorder=0.5))


def _mesh_map(
    layout: WireLayout,
    frame: Frame,
    path: str | os.PathLike[str],
    position: NDArray[Any],
    yield_stress: float | None,
    tension: tuple[float, float] | None,
) -> Path:
    """Draw a large mesh as two maps on a grid: the largest stress, and the fraction of active pairs."""
    low, high = position.min(axis=0), position.max(axis=0)
    size = high - low
    figure, (left, right), _ = _plan_figure(size, 2, _title(frame, tension))

    shape = _cells(size, position.shape[0] / 100.0, 500)
    extent = (low[0], high[0], low[1], high[1])
    stress = np.full(math.prod(shape), np.nan)
    np.fmax.at(stress, _cell_of(position, low, size, shape), 1e-6 * np.abs(frame.node_stress)[layout.curve_node])
    colours, scale = _stress_colours(stress, yield_stress)
    image = left.imshow(stress.reshape(shape), origin="lower", extent=extent, cmap=colours, norm=scale, interpolation="nearest")
    _stress_bar(figure, left, image, yield_stress, "highest wire stress in each cell [MPa]")

    body = 1e3 * np.asarray(frame.body_position)[:, :2]
    # repeats count from the corner of the mesh; loops at the edge reach a little beyond it
    corner = np.zeros(2) if layout.repeats.all() else low
    whole = 1e3 * np.diag(frame.deformation) * layout.period if layout.repeats.all() else size
    shape, covered = _cells_of_repeats(layout.repeats, whole, body.shape[0] / 12.0, 250)
    extent = (corner[0], corner[0] + covered[0], corner[1], corner[1] + covered[1])
    cell = _cell_of(body, corner, covered, shape)
    pairs = 2.0 * np.bincount(cell, minlength=math.prod(shape))
    active = np.bincount(cell, frame.pair_active.reshape(-1, 2).sum(axis=1), minlength=math.prod(shape))
    share = np.divide(100.0 * active, pairs, out=np.full(pairs.shape, np.nan), where=pairs > 0.0)
    image = right.imshow(
        share.reshape(shape), origin="lower", extent=extent, cmap="viridis", clim=(0.0, 100.0), interpolation="nearest"
    )
    _colour_bar(figure, right, image, "active contacts [% of the pairs in each cell]")
    rhombus = body[layout.rhombus_bodies]
    ring: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 11, "markerfacecolor": "none"}
    for axes in (left, right):
        if rhombus.size:
            for colour, width in (("black", 3.5), ("white", 1.5)):
                axes.plot(*rhombus.mean(axis=0), **ring, markeredgecolor=colour, markeredgewidth=width)
        frame_plan_axes(axes, low, high)
    if rhombus.size:
        ring = {**ring, "markeredgecolor": "black", "markeredgewidth": 1.5}
        handle = Line2D([], [], **ring, label="central rhombus")
        figure.legend(handles=[handle], loc="outside lower center", frameon=False)
    return save_figure(figure, path)


def _cells(size: NDArray[Any], count: float, most: int) -> tuple[int, int]:
    """Rows and columns of a grid of about `count` square cells, `most` a side at most."""
    edge = max(math.sqrt(size[0] * size[1] / max(count, 1.0)), max(size) / most)
    return max(1, round(size[1] / edge)), max(1, round(size[0] / edge))


def _cells_of_repeats(repeats: NDArray[Any], size: NDArray[Any], count: float, most: int) -> tuple[tuple[int, int], NDArray[Any]]:
    """Rows and columns of a grid of whole repeats of the knit, and the size that it covers: cells that cut repeats in
    two would show a pattern that the mesh does not have. About `count` square cells where there is no knit."""
    if not repeats.all():
        return _cells(size, count, most), size
    together = -(-int(repeats.max()) // most)
    cells = -(-repeats // together)
    return (int(cells[1]), int(cells[0])), size * cells * together / repeats


def _cell_of(position: NDArray[Any], low: NDArray[Any], size: NDArray[Any], shape: tuple[int, int]) -> NDArray[Any]:
    """[point]  the number, row by row, of the cell that each point lies in."""
    column_row = ((position - low) / size * (shape[1], shape[0])).astype(np.int64)
    column, row = np.clip(column_row, 0, (shape[1] - 1, shape[0] - 1)).T
    return np.asarray(row * shape[1] + column)


def _draw_contacts(figure: Figure, axes: Axes, layout: WireLayout, frame: Frame, points_per_mm: float) -> None:
    """Fill active bodies, or contacts where there are none, leave open ones hollow, and ring those of the central rhombus."""
    if not layout.body_count:
        return
    position = 1e3 * np.asarray(frame.body_position)[:, :2]
    area = max(float(np.ptp(position[:, 0]) * np.ptp(position[:, 1])), 1e-12)
    size = float(np.clip(0.2 * math.sqrt(area / layout.body_count) * points_per_mm, 2.0, 7.0))  # [pt]
    active = frame.body_active
    kind = "bodies" if layout.body_radius else "contacts"
    in_rhombus = np.isin(np.arange(layout.body_count), layout.rhombus_bodies)
    style: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": size, "zorder": 3}
    kinds: tuple[tuple[str, NDArray[Any], dict[str, Any]], ...] = (
        ("active", active, {"markerfacecolor": BLUE, "markeredgecolor": "white", "markeredgewidth": 0.12 * size}),
        ("open", ~active, {"markerfacecolor": "white", "markeredgecolor": BLUE, "markeredgewidth": 0.16 * size}),
    )
    handles = []
    for name, chosen, look in kinds:
        axes.plot(*position[chosen].T, **style, **look)
        look = {**look, "markersize": 6.5, "markeredgewidth": 1.0}
        handles.append(Line2D([], [], label=f"{kind} {name}: {np.count_nonzero(chosen)}", **{**style, **look}))
    if in_rhombus.any():
        ring: dict[str, Any] = {"markerfacecolor": "none", "markeredgecolor": GREEN, "linestyle": "none", "marker": "o"}
        axes.plot(*position[in_rhombus].T, **ring, markersize=2.1 * size, markeredgewidth=0.3 * size, zorder=4)
        if not layout.wire_closed.any():  # on a periodic tile its bodies may lie at opposite edges
            spoke = position[in_rhombus] - position[in_rhombus].mean(axis=0)
            outline = position[in_rhombus][np.argsort(np.arctan2(spoke[:, 1], spoke[:, 0]))]
            axes.fill(*outline.T, color=GREEN, alpha=0.15, linewidth=0.0, zorder=0)
        both = np.count_nonzero(active & in_rhombus)
        label = f"central rhombus: {both} of {np.count_nonzero(in_rhombus)} active"
        handles.append(Line2D([], [], label=label, **ring, markersize=10, markeredgewidth=1.5))
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, handletextpad=0.3)


def _plan_figure(size: NDArray[Any], panels: int, title: str) -> tuple[Figure, NDArray[Any], float]:
    """A figure for `panels` plan views of `size` [mm] side by side, its axes, and how many points of paper a mm has."""
    width, height = 1.06 * np.maximum(size, 1e-9)
    inches = min(8.0 / width, 8.0 / height)
    across, up = max(inches * width, 3.2), max(inches * height, 3.2)
    figure = figure_of(panels * (across + 1.7), up + 1.5)
    figure.suptitle(title, fontsize=12)
    axes = np.atleast_1d(figure.subplots(1, panels))
    return figure, axes, inches * 72.0


def _stress_colours(stress: NDArray[Any], yield_stress: float | None) -> tuple[Colormap, Normalize]:
    """A map from light sand to near black, cyan beyond the yield stress; and the scale of the stress [MPa].

    The scale goes by the square root, so that a peak at a grip does not leave the rest of the mesh in one colour.
    """
    table = matplotlib.colormaps["magma_r"](np.linspace(0.16, 0.95, 256))
    colours = LinearSegmentedColormap.from_list("stress", table, N=256).with_extremes(over="#00CFFF", bad="white")
    highest = float(np.nanmax(stress, initial=0.0))
    if yield_stress is not None:
        highest = min(highest, 1e-6 * yield_stress)
    return colours, PowerNorm(0.5, vmin=0.0, vmax=highest if highest > 0.0 else 1.0)


def _stress_bar(
    figure: Figure,
    axes: Axes,
    mappable: Any,
    yield_stress: float | None,
    label: str = "wire stress [MPa]",
) -> None:
    if yield_stress is not None:
        label += f", yield at {1e-6 * yield_stress:.4g}"
    is_beyond = yield_stress is not None and float(np.ma.max(mappable.get_array())) > mappable.norm.vmax
    _colour_bar(figure, axes, mappable, label, extend="max" if is_beyond else "neither")


def _colour_bar(figure: Figure, axes: Axes, mappable: Any, label: str, **options: Any) -> None:
    bar = figure.colorbar(mappable, ax=axes, shrink=0.85, aspect=32, pad=0.025, **options)
    bar.set_label(label)
    bar.outline.set_linewidth(0.5)


def _title(frame: Frame, tension: tuple[float, float] | None) -> str:
    load = [f"strain weft {100.0 * frame.strain_weft:.4g} %, warp {100.0 * frame.strain_warp:.4g} %"]
    if frame.shear:
        load.append(f"shear {100.0 * frame.shear:.4g} %")
    answer = []
    if tension is not None:
        scale, unit = scale_of("N/m", np.array(tension))
        answer.append(f"tension weft {scale * tension[0]:.3g} {unit}, warp {scale * tension[1]:.3g} {unit}")
    if abs(frame.temperature - ROOM) > 0.05:
        answer.append(f"{frame.temperature - ZERO_CELSIUS:.4g} °C")
    return "\n".join("   ".join(parts) for parts in (load, answer) if parts)
