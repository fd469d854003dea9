"""Active contacts, tension, energies and residual of a run against its load."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from warpknit.base.text import ZERO_CELSIUS, engineering
from warpknit.export.plots import AMBER, BLUE, GREEN, GREY, ORANGE, PURPLE, WIDTHS, figure_of, save_figure, scale_of
from warpknit.export.stage_curves import (
    DECADES_DRAWN,
    History,
    columns_of,
    draw_curves,
    history_rows,
    is_behind_jump,
    stage_legend,
    stage_slices,
    stress_columns,
)

__all__ = ["curves_figure"]

SIDES = ("weft", "warp")
SIDE_COLOURS = tuple(zip(SIDES, (BLUE, ORANGE), strict=True))
ENERGY_COLOURS = (("bend", BLUE), ("stretch", ORANGE), ("contact", GREEN), ("kinetic", PURPLE))
LOGARITHMIC = 4  # first of the panels with a logarithmic axis
LEAST_RESIDUAL = 1e-4  # of the median: that of an unloaded mesh is nearly nothing, and flattens the others
NEAR_LIMIT = 2.0  # of the axis of stress: an elastic limit beyond is not drawn, and does not flatten the curve
LEAST_FOLD = 1e-3  # of the range of a strain: less does not count as going back
HELD_STRAIN = 2e-3  # a frame expands by less over 200 K
IMPOSED_STRAIN, IMPOSED_TENSION = 1e-6, 0.02  # of its range in a stage: departure from a straight line over the load factor


def curves_figure(
    history: History,
    path: str | os.PathLike[str],
    *,
    yield_stress: float | None = None,
    title: str = "",
) -> Path:
    """Draw contacts, tension, stress, energies and residual of a run, from history.csv or its rows.

    Under given tensions these are the abscissa, and strains are drawn in their place. Stages that change the temperature alone
    are left out beside others: they are in heat_figure.py. Lines to rows with a `jump` are dotted. yield_stress: [Pa] elastic
    limit of the wire. title: over the stages.
    """
    rows = history_rows(history)
    columns = columns_of(rows)

    def column(name: str) -> NDArray[Any]:
        return columns.get(name, np.full(len(rows), np.nan))

    def scaled(unit: str, curves: Sequence[tuple[str, str, str]]) -> tuple[str, tuple[tuple[str, str, NDArray[Any]], ...]]:
        """Unit with its prefix, and the curves (label, colour, column) in it."""
        scale, prefixed = scale_of(unit, *(column(name) for _, _, name in curves))
        return prefixed, tuple((label, colour, scale * column(name)) for label, colour, name in curves)

    every = stage_slices([str(row.get("stage", "")) for row in rows])
    stages = [stage for stage in every if not _heats_alone(columns, stage[1])] or every
    abscissa, abscissa_label = _abscissa(columns, stages, len(rows))
    unit, tensions = scaled("N/m", [(side, colour, f"tension_{side}_N_per_m") for side, colour in SIDE_COLOURS])
    across = f"boundary tension [{unit}]", tensions
    if _is_by_tension(columns, stages):
        across = "strain [%]", tuple((side, colour, 100.0 * column(f"strain_{side}")) for side, colour in SIDE_COLOURS)
    stress_unit, stress = scaled("Pa", stress_columns(columns))
    forces = [("where wires hook", GREEN, "contact_force_max_N"), ("elsewhere", AMBER, "elsewhere_force_max_N")]
    if not np.nan_to_num(column("elsewhere_force_max_N")).any():
        forces = [("", *forces[0][1:])]
    force_unit, force = scaled("N", forces)
    energy_unit, energies = scaled("J", [(name, colour, f"energy_{name}_J") for name, colour in ENERGY_COLOURS])
    elsewhere = column("contacts_elsewhere")
    touches = bool(np.nan_to_num(elsewhere).any())
    panel_curves = (
        ("active contacts [% of pairs]", (("where wires hook" if touches else "", GREEN, column("active_percent")),)),
        across,
        (f"largest wire stress [{stress_unit}]", stress),
        (f"largest contact force [{force_unit}]", force),
        (f"energy [{energy_unit}]", energies),
        ("residual over mean boundary force", (("", GREY, column("residual")),)),
    )
    jumped = is_behind_jump(columns, len(rows))
    residual = column("residual")[column("residual") > 0.0]
    least: list[float | None] = [None] * LOGARITHMIC
    least += [
        DECADES_DRAWN * max(float(values.max(initial=0.0, where=np.isfinite(values))) for *_, values in energies),
        LEAST_RESIDUAL * float(np.median(residual)) if len(residual) else 0.0,
    ]
    figure = figure_of(10.5, 10.4)
    panels = figure.subplots(3, 2, sharex=True).ravel()
    for axes, (label, curves), smallest in zip(panels, panel_curves, least, strict=True):
        draw_curves(axes, abscissa, stages, curves, jumped, least=smallest, beneath=touches and axes is panels[0])
        axes.set_ylabel(label)
    panels[0].set_ylim(-3.0, 103.0)
    if touches:
        _draw_count(panels[0], abscissa, stages, elsewhere, jumped)
    for axes, (_, curves) in zip(panels[1:LOGARITHMIC], panel_curves[1:], strict=False):
        if not any(np.any(values < 0.0) for *_, values in curves):
            axes.set_ylim(bottom=0.0)
    if yield_stress is not None and stress[0][2].max(initial=0.0, where=np.isfinite(stress[0][2])) > 0.0:
        limit = yield_stress * scale_of("Pa", column("stress_max_Pa"))[0]
        label = f"elastic limit, {engineering(yield_stress, 'Pa')}"
        if limit < panels[2].get_ylim()[1] * NEAR_LIMIT:
            panels[2].axhline(limit, color=ORANGE, linestyle="--", linewidth=1.0)
            panels[2].set_ylim(top=max(panels[2].get_ylim()[1], 1.05 * limit))
            at, colour = limit / panels[2].get_ylim()[1] - 0.01, ORANGE
        else:
            label, at, colour = f"{label}, is beyond the axis", 0.97, GREY
        side = ("right", 0.98) if np.nanmax(column("stress_max_Pa")) > yield_stress else ("left", 0.02)  # where no curve is
        panels[2].text(side[1], at, label, transform=panels[2].transAxes, ha=side[0], va="top", color=colour)
    for axes in panels[-2:]:
        axes.set_xlabel(abscissa_label)
    stage_legend(figure, _stage_names(columns, stages), title)
    return save_figure(figure, path)


def _draw_count(
    axes: Axes,
    abscissa: NDArray[Any],
    stages: Sequence[tuple[str, slice]],
    count: NDArray[Any],
    jumped: NDArray[np.bool_],
) -> None:
    """Draw the number of active contacts where no wires hook, on an axis of its own at the right: they have no pairs."""
    right = axes.twinx()
    draw_curves(right, abscissa, stages, [("", AMBER, count)], jumped)
    right.grid(visible=False)
    right.spines["right"].set(visible=True, color=AMBER)
    right.tick_params(axis="y", color=AMBER)
    right.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    right.set_ylim(np.array(axes.get_ylim()) / 100.0 * max(1.1 * np.nanmax(count), 1.0))
    right.set_ylabel("number of active contacts elsewhere")
    handles = [Line2D([], [], color=AMBER, linewidth=WIDTHS[1], label="elsewhere, right axis")]
    right.legend(handles=handles, loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, borderaxespad=0.2)


def _stage_names(columns: Mapping[str, NDArray[Any]], stages: Sequence[tuple[str, slice]]) -> list[str]:
    """Names of the stages, with the temperature at their ends where these differ."""
    ends = [float(columns["temperature_K"][rows][-1]) if "temperature_K" in columns else 0.0 for _, rows in stages]
    shows = max(ends) - min(ends) > 1e-6
    return [name + (f", {end - ZERO_CELSIUS:.4g} °C" if shows else "") for (name, _), end in zip(stages, ends, strict=True)]


def _heats_alone(columns: Mapping[str, NDArray[Any]], rows: slice) -> bool:
    """Whether a stage changes the temperature, and neither strain nor tension in weft and warp."""
    temperature = columns.get("temperature_K")
    if temperature is None or not np.ptp(temperature[rows]) > 1e-6:
        return False
    return all(
        np.ptp(columns[f"strain_{side}"][rows]) <= HELD_STRAIN
        or np.ptp(tension[rows]) <= IMPOSED_TENSION * np.abs(tension[rows]).max()
        for side in SIDES
        for tension in [columns[f"tension_{side}_N_per_m"]]
    )


def _abscissa(columns: Mapping[str, NDArray[Any]], stages: Sequence[tuple[str, slice]], count: int) -> tuple[NDArray[Any], str]:
    """Abscissa of a run and its label: the tension where it is given, a strain if it varies in each stage, else the progress
    along the stages.

    Also the progress where the strain goes back within a stage, as it may under given tensions. In a single stage without strain:
    shear, temperature, the load factor, or the number of the record.
    """
    if _is_by_tension(columns, stages):
        both = np.array([columns[f"tension_{side}_N_per_m"] for side in SIDES])
        scale, unit = scale_of("N/m", both)
        equal = float(np.abs(np.diff(both, axis=0)).max()) <= IMPOSED_TENSION * float(np.abs(both).max())
        label = "tension, weft and warp" if equal else "mean tension of weft and warp"
        return scale * both.mean(axis=0), f"{label} [{unit}]"
    held = [
        all(float(np.ptp(columns[name][rows])) < 1e-9 for name in ("strain_weft", "strain_warp") if name in columns)
        for _, rows in stages
    ]
    if len(stages) > 1 and any(held) and "load_factor" in columns:
        return _along_stages(columns["load_factor"], stages)
    spread = {name: float(np.ptp(values)) if np.isfinite(values).all() else 0.0 for name, values in columns.items()}
    weft, warp = (columns.get(f"strain_{side}") for side in SIDES)
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
        return columns["temperature_K"] - ZERO_CELSIUS, "temperature [°C]"
    if spread.get("load_factor", 0.0) > 0.0:
        return columns["load_factor"], "load factor"
    return np.arange(count, dtype=float), "record"


def _is_by_tension(columns: Mapping[str, NDArray[Any]], stages: Sequence[tuple[str, slice]]) -> bool:
    """Whether tensions, not strains, grow in proportion to the load factor in each stage."""
    names = [f"{quantity}_{side}{unit}" for quantity, unit in (("strain", ""), ("tension", "_N_per_m")) for side in SIDES]
    if "load_factor" not in columns or not all(name in columns for name in names):
        return False
    strain, tension = (np.array([columns[name] for name in two]) for two in (names[:2], names[2:]))

    def imposed(values: NDArray[Any], share: float) -> bool:
        """Whether each side follows the load factor, to a share of its range, in each stage; and changes."""
        for _, rows in stages:
            load, part = columns["load_factor"][rows].copy(), values[:, rows]
            load[0] = 0.0
            line = part[:, :1] + (part[:, -1:] - part[:, :1]) * load / (load[-1] or 1.0)  # a run that diverged ends before 1
            span = np.ptp(part, axis=1, keepdims=True)
            if part.shape[1] < 3 or not np.all(np.abs(part - line) <= share * span) or not np.any(span > 0.0):
                return False
        return True

    return imposed(tension, IMPOSED_TENSION) and not any(imposed(one[None], IMPOSED_STRAIN) for one in strain)


def _along_stages(load_factor: NDArray[Any], stages: Sequence[tuple[str, slice]]) -> tuple[NDArray[Any], str]:
    """Progress along the stages, and its label."""
    stage = np.searchsorted([rows.stop for _, rows in stages], np.arange(len(load_factor)), side="right")
    return stage + load_factor, "stage and its load factor" if len(stages) > 1 else "load factor"


def _folds(values: NDArray[Any]) -> bool:
    """Whether values go both up and down, by more than round-off."""
    steps = np.diff(values)
    least = LEAST_FOLD * float(np.ptp(values)) if len(values) and np.isfinite(values).all() else np.inf
    return bool((steps > least).any() and (steps < -least).any())
