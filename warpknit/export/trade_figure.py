"""Figure of a trade: error against cost, one panel per quantity, with the Pareto front."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import LogLocator

from warpknit.export.plots import BLUE, GREEN, GREY, ORANGE, figure_of, save_figure
from warpknit.results.row import Values

QUANTITIES = (
    "active contacts [points of %]",
    "tension, or strain where tension is given [%]",
    "sum of contact forces [%]",
    "largest stress [%]",
)
PERCENT = (1.0, 100.0, 100.0, 100.0)
LEAST = 1e-3  # [%] smaller errors stand at the foot of the axis
LABEL_PLACES = (
    ((-7, 0), "right"),
    ((0, -11), "center"),
    ((0, 11), "center"),
)  # of the cheapest preset, of others, of the dearest
GROUPS = {"alone": (GREY, "one setting changed"), "together": (BLUE, "several changed"), "preset": (ORANGE, "presets")}


def trade_figure(path: Path, rows: Sequence[Values], own: Sequence[float], *, title: str) -> Path:
    """Draw error against cost, both logarithmic, of rows of trade.csv.

    own: errors of the reference, the lower limit of what can be measured, in the order of QUANTITIES.
    """
    figure = figure_of(10.0, 8.0)
    axes = figure.subplots(2, 2, sharex=True).ravel()
    for number, (place, quantity) in enumerate(zip(axes, QUANTITIES, strict=True)):
        _panel(place, rows, number, PERCENT[number] * own[number])
        place.set_title(quantity, fontsize="medium")
        place.set_ylabel("error [%]" if number else "error [points of %], none at the foot")
    for place in axes[2:]:
        place.set_xlabel("node-steps (those in double precision 1.8 times)")
    handles = [Line2D([], [], marker="o", linestyle="none", color=colour, label=label) for colour, label in GROUPS.values()]
    handles.append(Line2D([], [], color=GREEN, marker="o", markerfacecolor="none", label="Pareto front"))
    handles.append(Line2D([], [], color=GREY, linestyle=":", label="error of the reference itself"))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize="small")
    figure.suptitle(f"{title}: error against cost", fontsize="medium")
    return save_figure(figure, path)


def _panel(place: Axes, rows: Sequence[Values], number: int, own: float) -> None:
    points = [(row.cost, max(LEAST, PERCENT[number] * astuple(row.errors)[number])) for row in rows]
    for group, (colour, _) in GROUPS.items():
        chosen = [k for k, row in enumerate(rows) if row.group == group]
        size = 60 if group == "preset" else 14
        costs, errors = [points[k][0] for k in chosen], [points[k][1] for k in chosen]
        place.scatter(costs, errors, s=size, color=colour, zorder=3 if group == "preset" else 2, linewidths=0)
        for k in chosen if group == "preset" else ():
            offset, align = LABEL_PLACES[min(chosen.index(k), 1) if k != chosen[-1] else 2]
            place.annotate(rows[k].preset, points[k], xytext=offset, ha=align, va="center",
                           textcoords="offset points", fontsize="small", color=colour, zorder=5,
                           path_effects=[withStroke(linewidth=3.0, foreground="white")])  # fmt: skip
    front: list[tuple[float, float]] = []
    for point in sorted(points):
        if not front or point[1] < front[-1][1]:
            front.append(point)
    place.plot(*zip(*front, strict=True), color=GREEN, marker="o", markerfacecolor="none", markersize=7, linewidth=1.2, zorder=4)
    if own > LEAST:
        place.axhline(own, color=GREY, linestyle=":", linewidth=1.0)
    place.set_xscale("log")
    place.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
    place.set_yscale("log")
    place.margins(0.12)  # labels of the outermost marks stay inside
    place.grid(which="major", color="#E0E0E0", linewidth=0.6)
