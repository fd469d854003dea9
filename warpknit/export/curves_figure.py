"""Active contacts, tension, energies and residual of a run against its load."""

import csv
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from warpknit.export.plots import BLUE, GREEN, GREY, ORANGE, PURPLE, WIDTHS, figure_of, save_figure, scale_of
from warpknit.text import ZERO_CELSIUS

__all__ = ["curves_figure", "heat_figure"]

SIDE_COLOURS = (("weft", BLUE), ("warp", ORANGE))
LEAST_FOLD = 1e-3  # of the range of a strain: less does not count as going back
LEAST_SPAN = 0.02  # of a value: shortest axis of a quantity against temperature
DECADES_DRAWN = 1e-9  # of the largest value of a logarithmic axis: less is not drawn, and does not flatten the others
STAGE_STYLES: tuple[tuple[str | tuple[int, tuple[float, ...]], str], ...] = (
    ("-", "o"),
    ((0, (5, 1.5)), "s"),
    ((0, (1.2, 1.2)), "^"),
    ((0, (5, 1.5, 1, 1.5)), "D"),
    ((0, (8, 3)), "v"),
    ((0, (3, 1, 1, 1, 1, 1)), "P"),
)


def curves_figure(history: Iterable[Mapping[str, Any]] | str | os.PathLike[str], path: str | os.PathLike[str]) -> Path:
    """Draw active contacts, tension, energies and residual of a run, from history.csv or its rows."""
    rows = _rows(history)
    names = {name for row in rows for name in row}
    columns = {name: np.array([_number(row.get(name)) for row in rows]) for name in names}

    def column(name: str) -> NDArray[Any]:
        return columns.get(name, np.full(len(rows), np.nan))

    stages = _stages([str(row.get("stage", "")) for row in rows])
    abscissa, abscissa_label = _abscissa(columns, stages, len(rows))

    tension = {side: column(f"tension_{side}_N_per_m") for side in ("weft", "warp")}
    energies = {name: column(f"energy_{name}_J") for name in ("bend", "stretch", "contact", "kinetic")}
    (to_tension, tension_unit), (to_energy, energy_unit) = scale_of("N/m", *tension.values()), scale_of("J", *energies.values())
    figure = figure_of(10.5, 7.6)
    panels = figure.subplots(2, 2, sharex=True).ravel()
    panel_curves: tuple[tuple[str, bool, tuple[tuple[str, str, NDArray[Any]], ...]], ...] = (
        ("active contacts [% of pairs]", False, (("", GREEN, column("active_percent")),)),
        (
            f"boundary tension [{tension_unit}]",
            False,
            (("weft", BLUE, to_tension * tension["weft"]), ("warp", ORANGE, to_tension * tension["warp"])),
        ),
        (
            f"energy [{energy_unit}]",
            True,
            tuple((name, c, to_energy * energies[name]) for name, c in zip(energies, (BLUE, ORANGE, GREEN, PURPLE), strict=True)),
        ),
        ("residual, relative to mean boundary force", True, (("", GREY, column("residual")),)),
    )
    for axes, (label, is_logarithmic, curves) in zip(panels, panel_curves, strict=True):
        _draw_curves(axes, abscissa, stages, curves, is_logarithmic)
        axes.set_ylabel(label)
    panels[0].set_ylim(-3.0, 103.0)
    if not any(np.any(values < 0.0) for _, _, values in panel_curves[1][2]):
        panels[1].set_ylim(bottom=0.0)
    for axes in panels[2:]:
        axes.set_xlabel(abscissa_label)
    if len(stages) > 1:
        _stage_legend(figure, [name for name, _ in stages])
    return save_figure(figure, path)


def _stage_legend(figure: Figure, names: Sequence[str]) -> None:
    """Legend of the dashes and marks of the stages."""
    handles = []
    for number, name in enumerate(names):
        style, marker = STAGE_STYLES[number % len(STAGE_STYLES)]
        face = GREY if number % 2 == 0 else "white"
        look: dict[str, Any] = {"linestyle": style, "marker": marker, "markersize": 4.5, "markerfacecolor": face}
        handles.append(Line2D([], [], color=GREY, label=name, **look))
    figure.legend(handles=handles, title="stage", loc="outside upper center", ncols=min(len(handles), 6), frameon=False)


def heat_figure(history: Iterable[Mapping[str, Any]] | str | os.PathLike[str], path: str | os.PathLike[str]) -> Path | None:
    """Draw active contacts, tension, strain and largest stress against temperature, for the stages that change it.

    None without such a stage, from history.csv or its rows.
    """
    rows = _rows(history)
    names = ("temperature_K", "active_percent", "tension_weft_N_per_m", "tension_warp_N_per_m", "strain_weft", "strain_warp")
    columns = {name: np.array([_number(row.get(name)) for row in rows]) for name in (*names, "stress_max_Pa")}
    temperature = columns["temperature_K"] - ZERO_CELSIUS
    stages = [stage for stage in _stages([str(row.get("stage", "")) for row in rows]) if np.ptp(temperature[stage[1]]) > 1e-6]
    if not stages:
        return None
    shown = np.zeros(len(rows), dtype=bool)
    for _, part in stages:
        shown[part] = True
    tension = {side: np.where(shown, columns[f"tension_{side}_N_per_m"], np.nan) for side in ("weft", "warp")}
    stress = np.where(shown, columns["stress_max_Pa"], np.nan)
    (to_tension, tension_unit), (to_stress, stress_unit) = scale_of("N/m", *tension.values()), scale_of("Pa", stress)
    figure = figure_of(10.5, 7.6)
    panels = figure.subplots(2, 2, sharex=True).ravel()
    for axes, label, curves in zip(
        panels,
        ("active contacts [% of pairs]", f"tension [{tension_unit}]", "strain [%]", f"largest wire stress [{stress_unit}]"),
        (
            (("", GREEN, columns["active_percent"]),),
            tuple((side, c, to_tension * tension[side]) for side, c in SIDE_COLOURS),
            tuple((side, c, 100.0 * columns[f"strain_{side}"]) for side, c in SIDE_COLOURS),
            (("", PURPLE, to_stress * stress),),
        ),
        strict=True,
    ):
        _draw_curves(axes, temperature, stages, curves, is_logarithmic=False)
        axes.set_ylabel(label)
        axes.yaxis.get_major_formatter().set_useOffset(False)
        _widen(axes)
    panels[0].set_ylim(-3.0, 103.0)
    for axes in panels[2:]:
        axes.set_xlabel("temperature [degC]")
    if len(stages) > 1:
        _stage_legend(figure, [name for name, _ in stages])
    return save_figure(figure, path)


def _widen(axes: Axes) -> None:
    """Widen the vertical axis to LEAST_SPAN of its middle, so that round-off does not look like a trend."""
    low, high = axes.get_ylim()
    middle = 0.5 * (low + high)
    half = max(0.5 * (high - low), 0.5 * LEAST_SPAN * abs(middle))
    axes.set_ylim(middle - half, middle + half)


def _draw_curves(
    axes: Axes,
    abscissa: NDArray[Any],
    stages: Sequence[tuple[str, slice]],
    curves: Sequence[tuple[str, str, NDArray[Any]]],
    is_logarithmic: bool,
) -> None:
    """Draw one line per quantity (colour) and stage (dashes and marks)."""
    handles = []
    least = DECADES_DRAWN * max((float(values[np.isfinite(values)].max(initial=0.0)) for *_, values in curves), default=0.0)
    for (label, colour, values), width in zip(curves, WIDTHS if len(curves) > 1 else WIDTHS[1:], strict=False):
        shown = np.isfinite(values) & ((values > least) if is_logarithmic else True)
        if not shown.any():
            continue
        values = np.where(shown, values, np.nan)
        for number, (_, rows) in enumerate(stages):
            style, marker = STAGE_STYLES[number % len(STAGE_STYLES)]
            look: dict[str, Any] = {"color": colour, "linestyle": style, "marker": marker, "markersize": 2.5 + width}
            face = colour if number % 2 == 0 else "white"
            axes.plot(abscissa[rows], values[rows], linewidth=width, markerfacecolor=face, **look)
        if label:
            handles.append(Line2D([], [], color=colour, linewidth=width, label=label))
    if not axes.lines:
        axes.text(0.5, 0.5, "not recorded", transform=axes.transAxes, ha="center", va="center", color=GREY)
    elif is_logarithmic:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        if high < 10.0 * low:
            axes.set_ylim(np.sqrt(low * high / 10.0), np.sqrt(10.0 * low * high))  # a decade
    if handles:
        axes.legend(
            handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(handles), frameon=False, borderaxespad=0.2
        )
    axes.grid(color="#DDDDDD", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def _abscissa(columns: Mapping[str, NDArray[Any]], stages: Sequence[tuple[str, slice]], count: int) -> tuple[NDArray[Any], str]:
    """Abscissa of a run and its label: a strain if it varies in each stage, else the progress along the stages.

    Also the progress where the strain goes back within a stage, as it may under given tensions. In a single stage without strain:
    shear, temperature, the load factor, or the number of the record.
    """
    held = [
        all(float(np.ptp(columns[name][rows])) < 1e-9 for name in ("strain_weft", "strain_warp") if name in columns)
        for _, rows in stages
    ]
    if len(stages) > 1 and any(held) and "load_factor" in columns:
        return _along_stages(columns["load_factor"], stages)
    spread = {name: float(np.ptp(values)) if np.isfinite(values).all() else 0.0 for name, values in columns.items()}
    weft, warp = columns.get("strain_weft"), columns.get("strain_warp")
    weft_spread, warp_spread = spread.get("strain_weft", 0.0), spread.get("strain_warp", 0.0)
    largest = warp if warp_spread > weft_spread else weft
    folds = largest is not None and "load_factor" in columns and any(_folds(largest[rows]) for _, rows in stages)
    if folds:
        return _along_stages(columns["load_factor"], stages)
    if weft is not None and warp is not None and (count == 1 or max(weft_spread, warp_spread) > 1e-9):
        if np.allclose(weft, warp, rtol=0.0, atol=1e-9):
            return 100.0 * weft, "strain, weft and warp [%]"
        name = "weft" if weft_spread >= warp_spread else "warp"
        other = "warp" if name == "weft" else "weft"
        label = f"{name} strain [%]"
        values = 100.0 * columns[f"strain_{other}"]
        value_range = f"{values.min():.3g} to {values.max():.3g}" if np.ptp(values) > 1e-7 else f"{values[0]:.3g}"
        label += f", {other} {value_range} %"
        return 100.0 * columns[f"strain_{name}"], label
    if spread.get("shear", 0.0) > 1e-9:
        return 100.0 * columns["shear"], "shear [%]"
    if spread.get("clamp_rotation", 0.0) > 1e-9:
        return np.degrees(columns["clamp_rotation"]), "rotation of the clamps [deg]"
    if spread.get("temperature_K", 0.0) > 1e-6:
        return columns["temperature_K"] - ZERO_CELSIUS, "temperature [degC]"
    if spread.get("load_factor", 0.0) > 0.0:
        return columns["load_factor"], "load factor"
    return np.arange(count, dtype=float), "record"


def _along_stages(load_factor: NDArray[Any], stages: Sequence[tuple[str, slice]]) -> tuple[NDArray[Any], str]:
    """Progress along the stages, and its label."""
    stage = np.searchsorted([rows.stop for _, rows in stages], np.arange(len(load_factor)), side="right")
    return stage + load_factor, "stage and its load factor" if len(stages) > 1 else "load factor"


def _folds(values: NDArray[Any]) -> bool:
    """Whether values go both up and down, by more than round-off."""
    steps = np.diff(values)
    least = LEAST_FOLD * float(np.ptp(values)) if len(values) and np.isfinite(values).all() else np.inf
    return bool((steps > least).any() and (steps < -least).any())


def _stages(names: Sequence[str]) -> list[tuple[str, slice]]:
    """Row ranges of the stages, each starting with the last row of the stage before, for continuous curves."""
    first = [0, *(row for row in range(1, len(names)) if names[row] != names[row - 1])]
    end = [*first[1:], len(names)]
    return [(names[a] or "load", slice(max(a - 1, 0), b)) for a, b in zip(first, end, strict=True)]


def _rows(history: Iterable[Mapping[str, Any]] | str | os.PathLike[str]) -> list[Mapping[str, Any]]:
    if isinstance(history, str | os.PathLike):
        with open(history, newline="", encoding="utf-8") as file:
            rows: list[Mapping[str, Any]] = list(csv.DictReader(file))
    else:
        rows = list(history)
    if not rows:
        raise ValueError("history: no row to draw")
    return rows


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan
