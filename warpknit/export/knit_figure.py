"""Plan view of the knit: wires by guide bar, over and under each other, clasps, and one rhombus with its bodies."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.patheffects import withStroke
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from warpknit.base.text import counted
from warpknit.export import plots
from warpknit.export.plots import LineLook, copied, figure_of, frame_plan_axes, over_under, plan_scale, save_figure, tile_copies
from warpknit.knit.cloth import CLASS_NAMES, Cloth

MM = 1e3  # millimetres to a metre
REPEATS = 2  # drawn each way
LONG_SIDE, SHORT_SIDE = 8.0, 3.4  # [inch] of the mesh, and the least that its shorter side is given
BESIDE = (0.9, 1.2)  # [inch] beside and below it: labels, title of the legend
LEGEND_COLUMN, LEGEND_ROW = 2.1, 0.2  # [inch]
LEGEND: dict[str, Any] = {"frameon": False, "fontsize": "small", "alignment": "left", "columnspacing": 1.0, "handlelength": 1.5}
EVERY = 3  # samples of a thread to a piece of the drawn wire
THINNEST = 1.2  # [pt] line that is still legible
BAR_COLOURS = (plots.BLUE, plots.ORANGE, plots.GREEN, plots.PURPLE, plots.GREY, "#56B4E9")
MARK_SIZE, MARK_SPACING = 7.0, 8.0  # [pt] of a contact, and between those at one place
NEARLY = 1.0 - 1e-6
EDGE_ROOM = 0.8  # of the size of a mark: from its middle to the edge of the picture
HALO = [withStroke(linewidth=2.5, foreground="white")]
BODY_COLOUR, RHOMBUS_COLOUR = "#111111", "#B00058"


def knit_figure(cloth: Cloth, thickness: float, path: Path) -> Path:
    """Draw REPEATS repeats each way of a cloth. thickness: of the yarn [m]; lines are never thinner than legible."""
    size = REPEATS * cloth.size * MM
    low, high, period = np.zeros(2), size, MM * np.diag(cloth.size)
    margin = 0.1 * size
    inches = LONG_SIDE / max(size)
    figure = figure_of(*(np.maximum(inches * size, SHORT_SIDE) + BESIDE))
    axes = figure.subplots()
    frame_plan_axes(axes, low, high)
    handles: list[Artist] = []
    bars = sorted({thread.bar for thread in cloth.threads})
    for bar in bars:
        where = {0: ", back", len(bars) - 1: ", front"}.get(bar, "") if len(bars) > 1 else ""
        handles.append(Line2D([], [], color=_colour(bar), linewidth=1.8, label=f"guide bar {bar + 1}{where}"))

    bodies = np.array([clasp.position for clasp in cloth.clasps]).reshape(-1, 2)
    classes = cloth.classes
    mark: LineLook = {"color": BODY_COLOUR, "linestyle": "none", "markersize": MARK_SIZE, "markeredgewidth": 0.0}
    styles: list[LineLook] = []
    for number in np.unique(classes).tolist():
        letter = rf"$\mathbf{{{CLASS_NAMES[number]}}}$"
        styles.append({**mark, "marker": letter, "path_effects": HALO})
        count = int(np.count_nonzero(classes == number))
        label = f"class {CLASS_NAMES[number]}: {counted(count, 'clasp')}, {2 * count} pairs"
        handles.append(Line2D([], [], label=label, **styles[-1]))
    if cloth.rhombus is not None:
        middle = 0.5 * REPEATS * cloth.size
        cell = np.round((middle - cloth.rhombus.opening.centre) / cloth.size)
        clasps = cloth.rhombus.clasps
        outline = (cloth.rhombus.opening.outline + cell * cloth.size) * MM
        axes.add_patch(Polygon(outline, facecolor=RHOMBUS_COLOUR, alpha=0.12, edgecolor="none", zorder=0.5))
        mine = (bodies[clasps[:, 0]] + (clasps[:, 1:] + cell) * cloth.size) * MM
        (rings,) = axes.plot(mine[:, 0], mine[:, 1], "o", color=RHOMBUS_COLOUR, fillstyle="none", markersize=14, zorder=4)
        rings.set_label(f"the {len(clasps)} clasps of one rhombus")
        handles += [rings, Patch(facecolor=RHOMBUS_COLOUR, alpha=0.12, label="its opening")]

    title = f"{REPEATS} x {REPEATS} repeats of {cloth.wales} x {cloth.courses} stitches (wales x courses)"
    title += f"\n{cloth.wire_length * MM:.3g} mm of wire per loop ({cloth.stitch_length * MM:.3g} mm in plan view)"
    title += f"\nper repeat {counted(len(cloth.clasps), 'clasp')}, {2 * len(cloth.clasps)} pairs"
    title += "\nseen from the technical face\na letter is midway between the two wires of its clasp"
    wide = int(np.clip(figure.get_figwidth() // LEGEND_COLUMN, 1, len(handles)))
    figure.legend(handles=handles, title=title, ncols=wide, loc="outside lower center", **LEGEND)
    figure.set_figheight(figure.get_figheight() + LEGEND_ROW * -(-len(handles) // wide))
    points_per_mm = plan_scale(figure, axes)
    inset = EDGE_ROOM * MARK_SIZE / points_per_mm
    places, stack = _places(MM * bodies, classes, MARK_SPACING / points_per_mm, period)
    everywhere = places[:, None] + tile_copies(places, period, low - margin, high + margin)
    left_bottom, right_top = np.transpose([axes.get_xlim(), axes.get_ylim()])
    within = np.all((everywhere > left_bottom + inset) & (everywhere < right_top - inset), axis=2)
    is_whole = np.array([within[stack == one].all(axis=0) for one in stack], dtype=bool).reshape(within.shape)
    for number, style in zip(np.unique(classes), styles, strict=True):
        axes.plot(*everywhere[is_whole & (classes == number)[:, None]].T, zorder=3, **style)
    line_width = max(THINNEST, thickness * MM * points_per_mm)
    axes.add_collection(over_under(*_wires(cloth, period, low - margin, high + margin), line_width, points_per_mm))
    return save_figure(figure, path)


def _places(bodies: np.ndarray, classes: np.ndarray, spacing: float, period: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (body, 2) [mm] of the marks of bodies (body, 2) [mm], and number (body,) of their stack.

    Marks that would meet, also of the next repeat, stand one above the other. period: [mm] along weft and warp.
    """
    size, stack = np.diag(period), np.arange(len(bodies))
    while len(bodies):
        moved = np.empty_like(bodies)
        numbers, first, which = np.unique(stack, return_index=True, return_inverse=True)
        for number, beside in enumerate(first):
            (mine,) = np.nonzero(which == number)
            apart = bodies[mine] - bodies[beside]
            place = bodies[beside] + apart - size * np.round(apart / size)
            mine = mine[np.lexsort((classes[mine], -np.round(place[:, 1] / spacing)))]
            moved[mine] = place.mean(axis=0)
            moved[mine, 1] -= spacing * (np.arange(len(mine)) - 0.5 * (len(mine) - 1))
        near = cKDTree(moved % size % size, boxsize=size).query_pairs(NEARLY * spacing, output_type="ndarray")
        one, other = np.concatenate([near, np.stack([np.arange(len(bodies)), first[which]], axis=1)]).T
        joined = coo_array((np.ones(len(one)), (one, other)), shape=(len(bodies), len(bodies)))
        count, stack = connected_components(joined, directed=False)
        if count == len(numbers):
            return moved, stack
    return bodies, stack


def _wires(cloth: Cloth, period: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pieces (piece, 2, 3) [mm] of all wires between low and high [mm]; their colours (piece, 4)."""
    pieces, colours = [], []
    for thread in cloth.threads:
        line = MM * thread.stretch(0.0, thread.length, cloth.size[1])[::EVERY]
        pieces.append(np.stack([line[:-1], line[1:]], axis=1))
        colours.append(np.tile(to_rgba(_colour(thread.bar)), (len(line) - 1, 1)))
    every = np.concatenate(pieces)
    shown, number = copied(every, tile_copies(every[:, :, :2].reshape(-1, 2), period, low, high), low, high)
    return shown, np.concatenate(colours)[number]


def _colour(bar: int) -> str:
    return BAR_COLOURS[bar % len(BAR_COLOURS)]
