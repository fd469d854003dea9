"""Plan view of the knit: wires by guide bar, over and under each other, clasps, and one rhombus with its bodies."""

import os
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from warpknit.export.over_under import copied, over_under, tile_copies
from warpknit.export.plots import figure_of, frame_plan_axes, plan_scale, save_figure
from warpknit.knit.clasp_classes import CLASS_NAMES
from warpknit.knit.cloth import Cloth

__all__ = ["knit_figure"]

MM = 1e3  # millimetres to a metre
LONG_SIDE, SHORT_SIDE = 8.0, 3.2  # [inch] of the mesh, and the least that its shorter side is given
BESIDE = (3.6, 1.1)  # [inch] beside and above it: labels, legend, title
EVERY = 3  # samples of a thread to a piece of the drawn wire
THINNEST = 1.2  # [pt] line that is still legible
# Okabe and Ito's colours, distinct without red-green vision.
BAR_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#606060", "#56B4E9")
MARK_SIZE, MARK_SPACING = 7.0, 8.0  # [pt] of a contact, and between those at one place
HALO = [withStroke(linewidth=2.5, foreground="white")]
BODY_COLOUR, RHOMBUS_COLOUR = "#111111", "#B00058"


def knit_figure(
    cloth: Cloth,
    thickness: float,
    path: str | os.PathLike[str],
    columns: int = 2,
    rows: int = 2,
    *,
    classes: NDArray[np.intp] | None = None,
) -> Path:
    """Draw `columns` x `rows` repeats of a cloth to a PNG file.

    thickness: of the yarn [m]. classes: [clasp] number of its class of contact; default: one for all. Lines are never thinner
    than legible, so a thin wire looks thicker than it is.
    """
    size = np.array([columns, rows]) * cloth.size * MM
    low, high, period = np.zeros(2), size, MM * np.diag(cloth.size)
    margin = 0.1 * size
    inches = LONG_SIDE / max(size)
    figure = figure_of(*(np.maximum(inches * size, SHORT_SIDE) + BESIDE))
    axes = figure.subplots()
    axes.set_title(f"{columns} x {rows} repeats of {cloth.wales} x {cloth.courses} stitches (wales x courses)", fontsize="medium")
    frame_plan_axes(axes, low, high)
    handles: list[Artist] = []
    bars = sorted({thread.bar for thread in cloth.threads})
    for bar in bars:
        where = {0: ", back", len(bars) - 1: ", front"}.get(bar, "") if len(bars) > 1 else ""
        handles.append(Line2D([], [], color=_colour(bar), linewidth=1.8, label=f"guide bar {bar + 1}{where}"))

    bodies = np.array([clasp.position for clasp in cloth.clasps]).reshape(-1, 2)
    classes = np.zeros(len(bodies), dtype=np.intp) if classes is None else classes
    styles: list[dict[str, Any]] = []
    for number in np.unique(classes).tolist():
        letter = rf"$\mathbf{{{CLASS_NAMES[number]}}}$"
        styles.append({"marker": letter, "color": BODY_COLOUR, "linestyle": "none", "markeredgewidth": 0.0, "path_effects": HALO})
        count = np.count_nonzero(classes == number)
        label = f"contact {CLASS_NAMES[number]}, {count} places ({2 * count} pairs) a repeat"
        handles.append(Line2D([], [], markersize=MARK_SIZE, label=label, **styles[-1]))
    if cloth.rhombus is not None:
        middle = 0.5 * np.array([columns, rows]) * cloth.size
        cell = np.round((middle - cloth.rhombus.centre) / cloth.size)
        clasps = cloth.rhombus.clasps
        outline = (cloth.rhombus.opening.outline + cell * cloth.size) * MM
        axes.add_patch(Polygon(outline, facecolor=RHOMBUS_COLOUR, alpha=0.12, edgecolor="none", zorder=0.5))
        mine = (bodies[clasps[:, 0]] + (clasps[:, 1:] + cell) * cloth.size) * MM
        (rings,) = axes.plot(mine[:, 0], mine[:, 1], "o", color=RHOMBUS_COLOUR, fillstyle="none", markersize=14, zorder=4)
        rings.set_label(f"the {len(clasps)} contacts of one rhombus")
        handles += [rings, Patch(facecolor=RHOMBUS_COLOUR, alpha=0.12, label="its opening")]

    note = f"{len(cloth.clasps)} contacts per repeat\n{cloth.wire_length * MM:.3g} mm of wire per loop"
    note += f"\n({cloth.stitch_length * MM:.3g} mm in plan view)"
    handles.append(Patch(facecolor="none", edgecolor="none", label=note))
    figure.legend(handles=handles, loc="outside right upper", frameon=False)
    points_per_mm = plan_scale(figure, axes)
    inset = 0.5 * MARK_SIZE / points_per_mm
    for places, style in zip(_places(MM * bodies, classes, MARK_SPACING / points_per_mm, period), styles, strict=True):
        everywhere = (places[:, None] + tile_copies(places, period, low - margin, high + margin)).reshape(-1, 2)
        left_bottom, right_top = np.transpose([axes.get_xlim(), axes.get_ylim()])
        within = np.all((everywhere > left_bottom + inset) & (everywhere < right_top - inset), axis=1)
        axes.plot(*everywhere[within].T, markersize=MARK_SIZE, zorder=3, **style)
    line_width = max(THINNEST, thickness * MM * points_per_mm)
    axes.add_collection(over_under(*_wires(cloth, period, low - margin, high + margin), line_width, points_per_mm))
    return save_figure(figure, path)


def _places(bodies: NDArray[Any], classes: NDArray[np.intp], spacing: float, period: NDArray[Any]) -> list[NDArray[Any]]:
    """[class] (body, 2) [mm] where the marks of the bodies (body, 2) [mm] of each class stand, side by side if near, also to one
    of a repeat beside; period: [mm] along weft and warp."""
    size = np.diag(period)

    def apart(one: int, others: list[int]) -> NDArray[Any]:
        between = bodies[others] - bodies[one]
        return np.asarray(between - size * np.round(between / size))

    moved = bodies.copy()
    left = list(range(len(bodies)))
    while left:
        near: list[int] = []
        more = left[:1]
        while more:
            near += more
            more = [one for one in left if one not in near and np.linalg.norm(apart(one, near), axis=1).min() < spacing]
        place = dict(zip(near, bodies[near[0]] + apart(near[0], near), strict=True))
        near.sort(key=lambda body: (round(place[body][0] / spacing), classes[body]))
        middle = np.mean([place[body][0] for body in near])
        moved[near] = [place[body] for body in near]
        moved[near, 0] = middle + spacing * (np.arange(len(near)) - 0.5 * (len(near) - 1))
        left = [body for body in left if body not in near]
    return [moved[classes == number] for number in np.unique(classes)]


def _wires(cloth: Cloth, period: NDArray[Any], low: NDArray[Any], high: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Pieces (piece, 2, 3) [mm] of all wires between low and high [mm], and the colour (piece, 4) of each."""
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
