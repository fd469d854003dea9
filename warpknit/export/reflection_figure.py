"""Pictures of the reflection loss: against the tension of the mesh, and against the frequency."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from warpknit.base.text import engineering
from warpknit.export.plots import BLUE, GREEN, ORANGE, PURPLE, WIDTHS, LineLook, figure_of, plain, save_figure, scale_of
from warpknit.results.row import Columns

COLOURS = (BLUE, ORANGE, GREEN, PURPLE)
SIDES = (("te", "TE"), ("tm", "TM"))
AT_NORMAL = {"TE": "field along warp (TE)", "TM": "field along weft (TM)"}
LEAST_LOSS = 1e-4  # [dB] drawn


def tension_figure(rows: Columns, frequencies: Sequence[float], path: str | os.PathLike[str], title: str) -> Path:
    """Draw the loss under tension against the mean tension, a curve for each frequency [Hz].

    rows: columns of reflection.csv. Thin lines: all contacts open, and all closed.
    """
    figure = figure_of(10.5, 4.6)
    figure.suptitle(title, fontsize="medium")
    tension = 0.5 * (rows["tension_weft_N_per_m"] + rows["tension_warp_N_per_m"])
    tight = np.minimum(rows["tension_weft_N_per_m"], rows["tension_warp_N_per_m"]) > 0.0
    scale, unit = scale_of("N/m", tension[tight])
    for axes, (side, name) in zip(figure.subplots(1, 2, sharey=True), SIDES, strict=True):
        for frequency, colour in zip(frequencies, COLOURS, strict=False):
            here = tight & (rows["frequency_Hz"] == frequency)
            _draw_loss(axes, scale * tension, rows, here, side, colour, engineering(frequency, "Hz", 4))
        axes.set_xlabel(f"tension, mean of weft and warp [{unit}]")
        _finish(axes, rows, name)
    _add_legend(figure, rows)
    return save_figure(figure, path)


def frequency_figure(rows: Columns, record: int, path: str | os.PathLike[str], title: str) -> Path:
    """Draw the loss of one record against the frequency; the rest as in `tension_figure`."""
    figure = figure_of(10.5, 4.6)
    here = rows["record"] == record
    first = np.flatnonzero(here)[0]
    tensions = [rows[f"tension_{side}_N_per_m"][first] for side in ("weft", "warp")]
    figure.suptitle(f"{title}, weft tension {tensions[0]:.3g} N/m, warp tension {tensions[1]:.3g} N/m", fontsize="medium")
    for axes, (side, name) in zip(figure.subplots(1, 2, sharey=True), SIDES, strict=True):
        _draw_loss(axes, 1e-9 * rows["frequency_Hz"], rows, here, side, BLUE, "contacts as computed")
        axes.set_xlabel("frequency [GHz]")
        _finish(axes, rows, name)
    _add_legend(figure, rows)
    return save_figure(figure, path)


def _draw_loss(
    axes: Axes, place: NDArray[np.float64], rows: Columns, here: NDArray[np.bool_], side: str, colour: str, label: str
) -> None:
    """Draw the loss of rows: computed, open and closed contacts."""
    loss = np.maximum(rows[f"loss_{side}_dB"], LEAST_LOSS)
    states = {name: np.flatnonzero(here & (rows["contacts"] == name)) for name in ("computed", "open", "closed")}
    states = {name: those[np.argsort(place[those], kind="stable")] for name, those in states.items() if len(those)}
    for name, dashes in (("open", ":"), ("closed", "--")):
        if name in states:
            look: LineLook = {"color": colour, "linestyle": dashes, "linewidth": 1.0, "marker": "o", "markersize": 2.0}
            axes.plot(place[states[name]], loss[states[name]], **look)
    name, those = next(iter(states.items()), ("", np.zeros(0, dtype=int)))
    axes.plot(place[those], loss[those], color=colour, linewidth=WIDTHS[1], marker="o", markersize=3.5, label=label)


def _finish(axes: Axes, rows: Columns, name: str) -> None:
    """Scales and labels of one polarisation."""
    is_normal = not rows["theta"].any() and not rows["phi"].any()
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_ylabel("reflection loss [dB]")
    axes.set_title(AT_NORMAL[name] if is_normal else name, fontsize="medium")
    plain(axes)


def _add_legend(figure: Figure, rows: Columns) -> None:
    """One legend below both polarisations."""
    handles: list[Artist] = [*figure.axes[0].get_legend_handles_labels()[0]]
    if {"open", "computed"} <= set(rows["contacts"]):
        for state, dashes in (("open", ":"), ("closed", "--")):
            look: LineLook = {"color": "#404040", "linestyle": dashes, "linewidth": 1.0}
            handles.append(Line2D([], [], label=f"all contacts {state}", **look))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize="small")
