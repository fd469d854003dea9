"""The picture of an experiment as predicted: readings against tension in both models, with the band of what was not published."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from study import COLOURS, new_figure, tidy

MODELS = ("planar", "spatial")
SIDES = ("weft", "warp")
PANELS = (  # title, columns by side, unit of the axis, logarithmic
    ("tension against strain", "strain_{}", "strain from the lowest tension on", False),
    ("tangent stiffness", "stiffness_{}", "N/m", True),
    ("Poisson's ratio", "poisson_{}", "", False),
    ("active contacts", "active_percent", "%", False),
    ("contact resistance, median", "contact_ohm", "Ohm", True),
    ("sheet resistance", "sheet_{}_ohm", "Ohm", True),
)


def draw(path: Path, rows: Sequence[Any], titles: dict[str, str]) -> None:
    """Write the picture: a row of panels for each sample, by name, and a column for each reading."""
    shown = [name for name in titles if any(row.sample == name for row in rows)]
    figure, panels = new_figure(19.0, 3.6 * len(shown), len(shown), len(PANELS))
    for line, name in enumerate(shown):
        for panel, (title, column, unit, logarithmic) in zip(panels[line], PANELS, strict=True):
            for number, side in enumerate(SIDES if "{}" in column else ("",)):
                for model in MODELS:
                    here = [row for row in rows if (row.sample, row.model) == (name, model)]
                    _draw_band(panel, here, column.format(side), number, model, side)
            against = column.startswith("strain")
            panel.set_title(title, fontsize=9)
            panel.set_yscale("log" if logarithmic else "linear")
            panel.set_xlabel(unit if against else "tension [N/m]", fontsize=8)
            panel.set_ylabel("tension [N/m]" if against else unit, fontsize=8)
        panels[line, 0].set_title(f"{titles[name]}\n{PANELS[0][0]}", fontsize=9)
    tidy(panels)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def _draw_band(panel: Axes, rows: Sequence[Any], column: str, number: int, model: str, side: str) -> None:
    """The base case of a model and the band of all cases."""
    tensions = sorted({row.tension for row in rows})
    curves = {case: readings(rows, case, column) for case in {row.case for row in rows}}
    values = [[curve[tension] for curve in curves.values() if tension in curve] for tension in tensions]
    low, high = ([pick(of_all) for of_all in values] for pick in (np.nanmin, np.nanmax))
    base = list(curves["base"].items())
    colour, dash = COLOURS[number], "-" if model == "spatial" else "--"
    label = f"{side} {model}".strip()
    fill = {"color": colour, "alpha": 0.25 if model == "spatial" else 0.12, "lw": 0}
    if column.startswith("strain"):
        panel.fill_betweenx(tensions, low, high, **fill)
        panel.plot([v for _, v in base], [t for t, _ in base], color=colour, ls=dash, label=label)
    else:
        panel.fill_between(tensions, low, high, **fill)
        panel.plot([t for t, _ in base], [v for _, v in base], color=colour, ls=dash, label=label)


def readings(rows: Sequence[Any], case: str, column: str) -> dict[float, float]:
    """A reading of a case by tension; strains from the state under the lowest tension on, as a laboratory has them."""
    found = {row.tension: float(getattr(row, column)) for row in rows if row.case == case}
    first = found[min(found)] if column.startswith("strain") else 0.0
    return {tension: value - first for tension, value in found.items()}
