"""Pictures of the reflection loss: against the tension of the mesh, and against the frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.lines import Line2D
from matplotlib.typing import LineStyleType

from warpknit.base.text import engineering
from warpknit.export.plots import BLUE, GREEN, ORANGE, PURPLE, WIDTHS, LineLook, figure_of, plain, save_figure, scale_of
from warpknit.results.row import Columns

COLOURS = (BLUE, ORANGE, GREEN, PURPLE)
SIDES = (("te", "TE"), ("tm", "TM"))
STATES: dict[str, LineStyleType] = {"computed": "-", "open": ":", "closed": "--"}  # of the contacts
THICK: LineLook = {"linewidth": WIDTHS[1], "markersize": 3.5}
THIN: LineLook = {"linewidth": 1.0, "markersize": 2.0}
AT_NORMAL = {"TE": "field along warp (TE)", "TM": "field along weft (TM)"}
LEAST_LOSS = 1e-4  # [dB] drawn


def tension_figure(rows: Columns, frequencies: Sequence[float], path: Path, title: str) -> Path:
    """Draw the loss against the mean tension, at frequencies [Hz]. rows: of reflection.csv. Thin: contacts all open, closed."""
    tension = 0.5 * (rows["tension_weft_N_per_m"] + rows["tension_warp_N_per_m"])
    tight = np.minimum(rows["tension_weft_N_per_m"], rows["tension_warp_N_per_m"]) > 0.0
    scale, unit = scale_of("N/m", tension[tight])
    curves = {engineering(one, "Hz", 4): tight & (rows["frequency_Hz"] == one) for one in frequencies}
    return _loss_figure(rows, curves, scale * tension, f"tension, mean of weft and warp [{unit}]", title, path)


def frequency_figure(rows: Columns, record: int, path: Path, title: str) -> Path:
    """Draw the loss of one record against the frequency; the rest as in `tension_figure`."""
    here = rows["record"] == record
    weft, warp = (rows[f"tension_{side}_N_per_m"][here][0] for side in ("weft", "warp"))
    title = f"{title}, weft tension {weft:.3g} N/m, warp tension {warp:.3g} N/m"
    return _loss_figure(rows, {"contacts as computed": here}, 1e-9 * rows["frequency_Hz"], "frequency [GHz]", title, path)


def _loss_figure(
    rows: Columns, curves: Mapping[str, np.ndarray], place: np.ndarray, axis: str, title: str,
    path: Path,
) -> Path:  # fmt: skip
    """Draw the loss of both polarisations. curves: by their names the rows of each."""
    figure = figure_of(10.5, 4.6)
    figure.suptitle(title, fontsize="medium")
    is_normal = not rows["theta"].any() and not rows["phi"].any()
    for axes, (side, name) in zip(figure.subplots(1, 2, sharey=True), SIDES, strict=True):
        loss = np.maximum(rows[f"loss_{side}_dB"], LEAST_LOSS)
        for (label, here), colour in zip(curves.items(), COLOURS, strict=False):
            states = {state: np.flatnonzero(here & (rows["contacts"] == state)) for state in STATES}
            look, named = THICK, label
            for state, those in states.items():
                if those.size:  # the first state there is by a thick line, others by thin ones
                    those = those[np.argsort(place[those], kind="stable")]
                    axes.plot(place[those], loss[those], color=colour, linestyle=STATES[state], marker="o", label=named, **look)
                    look, named = THIN, ""
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.set_xlabel(axis)
        axes.set_ylabel("reflection loss [dB]")
        axes.set_title(AT_NORMAL[name] if is_normal else name, fontsize="medium")
        plain(axes)
    handles: list[Artist] = [*figure.axes[0].get_legend_handles_labels()[0]]
    if {"open", "computed"} <= set(rows["contacts"]):
        for state in ("open", "closed"):
            label = f"all contacts {state}"
            handles.append(Line2D([], [], color="#404040", linewidth=1.0, linestyle=STATES[state], label=label))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize="small")
    return save_figure(figure, path)
