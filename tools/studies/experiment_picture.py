"""The picture of an experiment as predicted: readings against tension in both models, with the band of what was not published."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, NullFormatter
from study import COLOURS, new_figure, tidy

MODELS = ("planar", "spatial")
SIDES = ("weft", "warp")
PANELS = (  # title, columns by side, unit of the axis, its factor, logarithmic
    ("tension against strain", "strain_{}", "strain from 0.5 N/m on [%]", 1e2, False),
    ("stiffness", "stiffness_{}", "N/m", 1.0, True),
    ("Poisson's ratio", "poisson_{}", "", 1.0, False),
    ("active contacts", "active_percent", "%", 1.0, False),
    ("contact resistance, median", "contact_ohm", "mOhm", 1e3, True),
    ("sheet resistance", "sheet_{}_ohm", "mOhm", 1e3, True),
)
POISSON = (-1.0, 2.5)  # beyond it the mesh snaps to another equilibrium between two readings
NO_SIDE = "#444444"  # colour of readings without a direction
ALPHA = {"planar": 0.12, "spatial": 0.25}  # of the bands
COLUMNS = 3  # of panels


def draw(path: Path, rows: Sequence[Any], titles: dict[str, str]) -> None:
    """Write the picture: lines of panels for each sample, by name, a panel for each reading."""
    shown = [name for name in titles if any(row.sample == name for row in rows)]
    lines_of_one = -(-len(PANELS) // COLUMNS)
    figure, panels = new_figure(12.0, 3.4 * lines_of_one * len(shown) + 0.6, lines_of_one * len(shown), COLUMNS)
    lines: dict[str, Any] = {}
    for number_of_sample, name in enumerate(shown):
        own = panels[lines_of_one * number_of_sample : lines_of_one * (number_of_sample + 1)]
        for panel, (title, column, unit, factor, logarithmic) in zip(own.ravel(), PANELS, strict=False):
            for number, side in enumerate(SIDES if "{}" in column else ("",)):
                for model in MODELS:
                    here = [row for row in rows if (row.sample, row.model) == (name, model)]
                    colour = COLOURS[number] if side else NO_SIDE
                    label = f"{side or 'without direction'}, {'space' if model == 'spatial' else 'plane'}"
                    lines[label] = _draw_band(panel, here, column.format(side), factor, colour, model)
            if title == "Poisson's ratio":
                bottom, top = panel.get_ylim()
                panel.set_ylim(max(bottom, POISSON[0]), min(top, POISSON[1]))
            against = column.startswith("strain")
            panel.set_title(title, fontsize=10)
            if logarithmic:
                panel.set_yscale("log")
                panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
                panel.yaxis.set_major_formatter("{x:g}")
                panel.yaxis.set_minor_formatter(NullFormatter())
            panel.set_xlabel(unit if against else "tension [N/m]", fontsize=9)
            panel.set_ylabel("tension [N/m]" if against else f"{title}{f' [{unit}]' if unit else ''}", fontsize=9)
        own[0, 0].set_title(f"{titles[name]}\n{PANELS[0][0]}", fontsize=10)
    tidy(panels, legend=False)
    labels = sorted(lines, key=lambda label: ("without" in label, label))
    bands = [Patch(color=NO_SIDE, alpha=ALPHA[model], lw=0) for model in MODELS]
    names = ["band of all cases, plane", "band of all cases, space"]
    figure.legend(
        [*(lines[label] for label in labels), *bands],
        [*labels, *names],
        loc="outside lower center",
        ncols=4,
        frameon=False,
        fontsize=10,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def _draw_band(panel: Axes, rows: Sequence[Any], column: str, factor: float, colour: str, model: str) -> Any:
    """The base case of a model and the band of all cases; returns the line of the base case."""
    tensions = sorted({row.tension for row in rows})
    curves = {
        case: {tension: factor * value for tension, value in readings(rows, case, column).items()}
        for case in {row.case for row in rows}
    }
    values = [[curve[tension] for curve in curves.values() if tension in curve] for tension in tensions]
    low, high = ([pick(of_all) for of_all in values] for pick in (np.nanmin, np.nanmax))
    base, dash = list(curves["base"].items()), "-" if model == "spatial" else "--"
    fill = {"color": colour, "alpha": ALPHA[model], "lw": 0}
    if column.startswith("strain"):
        panel.fill_betweenx(tensions, low, high, **fill)
        (line,) = panel.plot([v for _, v in base], [t for t, _ in base], color=colour, ls=dash)
    else:
        panel.fill_between(tensions, low, high, **fill)
        (line,) = panel.plot([t for t, _ in base], [v for _, v in base], color=colour, ls=dash)
    return line


def readings(rows: Sequence[Any], case: str, column: str) -> dict[float, float]:
    """A reading of a case by tension; strains from the state under the lowest tension on, as a laboratory has them."""
    found = {row.tension: float(getattr(row, column)) for row in rows if row.case == case}
    first = found[min(found)] if column.startswith("strain") else 0.0
    return {tension: value - first for tension, value in found.items()}
