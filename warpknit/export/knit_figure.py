"""Plan view of the knit: wires by guide bar, crossings, clasps, and one rhombus with its bodies.

The wire that lies behind is cut away for a little on both sides of each crossing, as in a knot diagram.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from warpknit.files import path_aside
from warpknit.knit.clasp_classes import CLASS_NAMES
from warpknit.knit.cloth import Cloth

__all__ = ["knit_figure"]

DOTS_PER_INCH = 150
MM = 1e3  # millimetres to a metre
LONG_SIDE = 8.0  # [inch] of the mesh
LEFT, BOTTOM, RIGHT, TOP = 0.75, 0.65, 3.0, 0.45  # [inch] round it: labels, legend, title
THINNEST = 1.2  # [pt] line that is still legible
# Okabe and Ito's colours, distinct without red-green vision.
BAR_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#606060", "#56B4E9")
CLASS_MARKERS = "os^Dv<>pPX*h"
BODY_COLOUR, RHOMBUS_COLOUR = "#111111", "#B00058"


def knit_figure(
    cloth: Cloth,
    diameter: float,
    path: str | os.PathLike[str],
    columns: int = 2,
    rows: int = 2,
    *,
    classes: NDArray[np.intp] | None = None,
) -> Path:
    """Draw `columns` x `rows` repeats of a cloth to a PNG file.

    diameter: of the wire [m]. classes: [clasp] number of its class of contact; default: one for all. Lines are never thinner than
    legible, so a thin wire looks thicker than it is.
    """
    width, height = np.array([columns, rows]) * cloth.size * MM
    margin = 0.04 * max(width, height)
    low, high = np.array([-margin, -margin]), np.array([width + margin, height + margin])
    scale = LONG_SIDE / max(high - low)  # [inch / mm]
    across, up = (high - low) * scale
    figure = Figure(figsize=(LEFT + across + RIGHT, BOTTOM + up + TOP), dpi=DOTS_PER_INCH)
    FigureCanvasAgg(figure)
    total = figure.get_size_inches()
    axes = figure.add_axes((LEFT / total[0], BOTTOM / total[1], across / total[0], up / total[1]))
    line_width = max(THINNEST, diameter * MM * scale * 72.0)
    cut = 2.0 * line_width / (72.0 * scale * MM)  # [m] half length of a gap in the wire behind

    handles: list[Artist] = []
    for bar in sorted({thread.bar for thread in cloth.threads}):
        colour = BAR_COLOURS[bar % len(BAR_COLOURS)]
        lines = _bar_lines(cloth, bar, low, high, cut)
        axes.add_collection(LineCollection(lines, colors=colour, linewidths=line_width, zorder=2, capstyle="butt"))
        handles.append(Line2D([], [], color=colour, linewidth=1.8, label=f"guide bar {bar + 1}"))

    bodies = np.array([clasp.position for clasp in cloth.clasps]).reshape(-1, 2)
    classes = np.zeros(len(bodies), dtype=np.intp) if classes is None else classes
    for number, (name, marker) in enumerate(zip(CLASS_NAMES, CLASS_MARKERS, strict=True)):
        mine = bodies[classes == number]
        if len(mine) == 0:
            continue
        everywhere = (mine[:, None] + _copies(cloth, low, high) * cloth.size).reshape(-1, 2) * MM
        style: dict[str, Any] = {"marker": marker, "color": BODY_COLOUR, "linestyle": "none"}
        axes.plot(everywhere[:, 0], everywhere[:, 1], markersize=4.0, zorder=3, **style)
        handles.append(Line2D([], [], markersize=5, label=f"contact {name}, {len(mine)} per repeat", **style))
    if cloth.rhombus is not None:
        middle = 0.5 * np.array([columns, rows]) * cloth.size
        cell = np.round((middle - cloth.rhombus.centre) / cloth.size)
        clasps = cloth.rhombus.clasps
        outline = (cloth.rhombus.opening.outline + cell * cloth.size) * MM
        axes.add_patch(Polygon(outline, facecolor=RHOMBUS_COLOUR, alpha=0.12, edgecolor="none", zorder=1))
        mine = (bodies[clasps[:, 0]] + (clasps[:, 1:] + cell) * cloth.size) * MM
        (rings,) = axes.plot(mine[:, 0], mine[:, 1], "o", color=RHOMBUS_COLOUR, fillstyle="none", markersize=8)
        rings.set_label(f"the {len(clasps)} bodies of one rhombus")
        handles += [rings, Patch(facecolor=RHOMBUS_COLOUR, alpha=0.12, label="its opening")]

    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(8, steps=[1, 2, 5, 10]))
    axes.set_xlabel("weft [mm]")
    axes.set_ylabel("warp [mm]")
    axes.set_title(f"{columns} x {rows} repeats of {cloth.wales} x {cloth.courses} stitches (wales x courses)", fontsize="medium")
    note = f"{len(cloth.clasps)} bodies per repeat\n{cloth.stitch_length * MM:.2f} mm of wire per loop"
    handles.append(Patch(facecolor="none", edgecolor="none", label=note))
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0 - RIGHT / total[0], 1.0 - TOP / total[1]), frameon=False)
    with path_aside(path) as aside:
        figure.savefig(aside, dpi=DOTS_PER_INCH, format="png")
    return Path(path)


def _copies(cloth: Cloth, low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.intp]:
    """Copies (k, 2) of the repeat whose wires or bodies may show between low and high [mm]."""
    points = np.concatenate([thread.points[:, :2] for thread in cloth.threads])
    first = np.floor((low / MM - points.max(axis=0)) / cloth.size).astype(int)
    last = np.ceil((high / MM - points.min(axis=0)) / cloth.size).astype(int)
    grid = np.meshgrid(np.arange(first[0], last[0] + 1), np.arange(first[1], last[1] + 1), indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, 2)


def _bar_lines(
    cloth: Cloth, bar: int, low: NDArray[np.float64], high: NDArray[np.float64], cut: float
) -> list[NDArray[np.float64]]:
    """Pieces (k, 2) [mm] of the wires of a guide bar, cut where they pass behind another wire."""
    pieces = []
    copies = _copies(cloth, low, high)
    for number, thread in enumerate(cloth.threads):
        if thread.bar != bar:
            continue
        for line in _visible_pieces(cloth, number, cut):
            for column, row in copies:
                moved = (line + [column, row] * cloth.size) * MM
                if np.all(moved.max(axis=0) > low) and np.all(moved.min(axis=0) < high):
                    pieces.append(moved)
    return pieces


def _visible_pieces(cloth: Cloth, number: int, cut: float) -> list[NDArray[np.float64]]:
    """Pieces (k, 2) [m] of one period of a thread between the places where it passes behind."""
    thread, crossings = cloth.threads[number], cloth.crossings
    behind = np.concatenate(
        [
            crossings.arc[(crossings.thread[:, 0] == number) & (crossings.over < 0), 0],
            crossings.arc[(crossings.thread[:, 1] == number) & (crossings.over > 0), 1],
        ]
    )
    cuts = np.sort(behind % thread.length)
    if len(cuts) == 0:
        return [thread.stretch(0.0, thread.length, cloth.size[1])[:, :2]]
    starts, ends = cuts + cut, np.append(cuts[1:], cuts[0] + thread.length) - cut
    return [thread.stretch(a, b, cloth.size[1])[:, :2] for a, b in zip(starts, ends, strict=True) if b - a > 2.0 * thread.spacing]
