"""Curves of a run against its load, and against the temperature."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from warpknit.base.text import ZERO_CELSIUS, engineering
from warpknit.export import curve_axes
from warpknit.export.plots import AMBER, BLUE, GREEN, GREY, ORANGE, PURPLE, WIDTHS, figure_of, save_figure, scale_of
from warpknit.results.row import Columns

SIDES = ("weft", "warp")
ENERGY_COLOURS = (("bend", BLUE), ("stretch", ORANGE), ("contact", GREEN), ("kinetic", PURPLE))
DECADES_DRAWN = 1e-9  # of the largest value of a logarithmic axis: less is not drawn, and does not flatten the others
LEAST_RESIDUAL = 1e-4  # of the median: an unloaded mesh has nearly none, and flattens the others
NEAR_LIMIT = 2.0  # of the axis of stress: an elastic limit beyond is not drawn, and does not flatten the curve
LEAST_FOLD = 1e-3  # of the range of a strain: less does not count as going back
HELD_STRAIN = 2e-3  # a frame expands by less over 200 K
IMPOSED_STRAIN, IMPOSED_TENSION = 1e-6, 0.02  # of its range in a stage: departure from a straight line over the load factor


def curves_figure(columns: Columns, path: Path, *, yield_stress: float | None = None, title: str = "") -> Path:
    """Draw contacts, tension, stress, energies and residual against the load.

    Under given tensions these are the abscissa, and strains are drawn in their place. Stages that change the temperature alone
    are left out beside others: they are in `heat_figure`. Lines to rows with a `jump` are dotted. yield_stress: [Pa] elastic
    limit of the wire. title: over the stages.
    """
    count = len(columns["stage"])

    def column(name: str) -> np.ndarray:
        return columns.get(name, np.full(count, np.nan))

    every = curve_axes.stage_slices(columns["stage"].tolist())
    stages = [stage for stage in every if not _heats_alone(columns, stage[1])] or every
    abscissa, abscissa_label = _abscissa(columns, stages)
    is_by_tension, jumped = _is_by_tension(columns, stages), curve_axes.is_behind_jump(columns)
    tensions = [(side, colour, f"tension_{side}_N_per_m") for side, colour in curve_axes.SIDE_COLOURS]
    strains = [(side, colour, f"strain_{side}") for side, colour in curve_axes.SIDE_COLOURS]
    forces = [("where wires hook", GREEN, "contact_force_max_N"), ("other contacts", AMBER, "elsewhere_force_max_N")]
    if not np.nan_to_num(column("elsewhere_force_max_N")).any():
        forces = [("", *forces[0][1:])]
    energies = [(name, colour, f"energy_{name}_J") for name, colour in ENERGY_COLOURS]
    most = max(float(column(name).max(initial=0.0, where=np.isfinite(column(name)))) for *_, name in energies)
    elsewhere, residual = column("contacts_elsewhere"), column("residual")[column("residual") > 0.0]
    middle, touches = float(np.median(residual)) if len(residual) else 0.0, bool(np.nan_to_num(elsewhere).any())
    # label; unit or factor; curves: label, colour and column; smallest drawn value of a logarithmic axis
    quantities: tuple[tuple[str, str | float, list[tuple[str, str, str]], float | None], ...] = (
        ("active contacts [% of pairs]", 1.0, [("where wires hook" if touches else "", GREEN, "active_percent")], None),
        ("strain [%]", 100.0, strains, None) if is_by_tension else ("boundary tension [{}]", "N/m", tensions, None),
        ("largest wire stress [{}]", "Pa", curve_axes.stress_columns(columns), None),
        ("largest contact force [{}]", "N", forces, None),
        ("energy [{}]", "J", energies, DECADES_DRAWN * most),
        ("residual over mean boundary force", 1.0, [("", GREY, "residual")], LEAST_RESIDUAL * middle),
    )
    figure = figure_of(10.5, 10.4)
    panels = figure.subplots(3, 2, sharex=True).ravel()
    for axes, (label, unit, names, least) in zip(panels, quantities, strict=True):
        values = [column(name) for *_, name in names]
        scale, prefixed = scale_of(unit, *values) if isinstance(unit, str) else (unit, "")
        for _, colour, name in names if least is None else ():
            for _, rows in stages:
                curve_axes.draw_range(axes, abscissa[rows], columns, name, colour, scale, rows)
        curves = [(text, colour, scale * one) for (text, colour, _), one in zip(names, values, strict=True)]
        smallest = None if least is None else scale * least
        curve_axes.draw_curves(axes, abscissa, stages, curves, jumped, least=smallest, beneath=touches and axes is panels[0])
        axes.set_ylabel(label.format(prefixed))
        if least is None and not any(np.any(one < 0.0) for one in values):
            axes.set_ylim(bottom=0.0)
    panels[0].set_ylim(-3.0, 103.0)
    if touches:
        _draw_count(panels[0], abscissa, stages, elsewhere, jumped)
    if not is_by_tension:
        scale, _ = scale_of("N/m", *(column(name) for *_, name in tensions))
        if curve_axes.shade_compression(panels[1], [scale * column(name) for *_, name in tensions]):
            panels[1].text(0.02, 0.02, curve_axes.COMPRESSED, transform=panels[1].transAxes, color=GREY, fontsize="small")
    stress = column("stress_max_Pa")
    if yield_stress is not None and stress.max(initial=0.0, where=np.isfinite(stress)) > 0.0:
        limit = yield_stress * scale_of("Pa", stress)[0]
        label = f"elastic limit, {engineering(yield_stress, 'Pa')}"
        if limit < panels[2].get_ylim()[1] * NEAR_LIMIT:
            panels[2].axhline(limit, color=ORANGE, linestyle="--", linewidth=1.0)
            panels[2].set_ylim(top=max(panels[2].get_ylim()[1], 1.05 * limit))
            at, colour = limit / panels[2].get_ylim()[1] - 0.01, ORANGE
        else:
            label, at, colour = f"{label}, is beyond the axis", 0.97, GREY
        side = ("right", 0.98) if np.nanmax(stress) > yield_stress else ("left", 0.02)  # where no curve is
        panels[2].text(side[1], at, label, transform=panels[2].transAxes, ha=side[0], va="top", color=colour)
    for axes in panels[-2:]:
        axes.set_xlabel(abscissa_label)
    curve_axes.stage_legend(figure, _stage_names(columns, stages), title)
    return save_figure(figure, path)


def _draw_count(
    axes: Axes, abscissa: np.ndarray, stages: Sequence[tuple[str, slice]], count: np.ndarray, jumped: np.ndarray
) -> None:
    """Draw the number of active contacts between stitches; its axis is at the right."""
    right = axes.twinx()
    curve_axes.draw_curves(right, abscissa, stages, [("", AMBER, count)], jumped)
    right.grid(visible=False)
    right.spines["right"].set(visible=True, color=AMBER)
    right.tick_params(axis="y", color=AMBER)
    right.yaxis.set_major_locator(MaxNLocator(5, integer=True))
    right.set_ylim(np.array(axes.get_ylim()) / 100.0 * max(1.1 * np.nanmax(count), 1.0))
    right.set_ylabel("active contacts between stitches")
    handles = [Line2D([], [], color=AMBER, linewidth=WIDTHS[1], label="other contacts, right axis")]
    right.legend(handles=handles, loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False, borderaxespad=0.2)


def _stage_names(columns: Columns, stages: Sequence[tuple[str, slice]]) -> list[str]:
    """Names of the load steps, with temperatures where they differ."""
    ends = [float(columns["temperature_K"][rows][-1]) if "temperature_K" in columns else 0.0 for _, rows in stages]
    shows = max(ends) - min(ends) > 1e-6
    return [name + (f", {end - ZERO_CELSIUS:.4g} °C" if shows else "") for (name, _), end in zip(stages, ends, strict=True)]


def _heats_alone(columns: Columns, rows: slice) -> bool:
    """Whether a load step changes the temperature alone."""
    temperature = columns.get("temperature_K")
    if temperature is None or not np.ptp(temperature[rows]) > 1e-6:
        return False
    return all(
        np.ptp(columns[f"strain_{side}"][rows]) <= HELD_STRAIN
        or np.ptp(tension[rows]) <= IMPOSED_TENSION * np.abs(tension[rows]).max()
        for side in SIDES
        for tension in [columns[f"tension_{side}_N_per_m"]]
    )


def _abscissa(columns: Columns, stages: Sequence[tuple[str, slice]]) -> tuple[np.ndarray, str]:
    """Abscissa of a run and its label: the tension where it is given, a strain if it varies in each stage, else the progress
    along the stages.

    The progress, too, where the strain goes back within a load step. In a single load step without strain: shear, temperature,
    the load factor, or the number of the record.
    """
    if _is_by_tension(columns, stages):
        both = np.array([columns[f"tension_{side}_N_per_m"] for side in SIDES])
        scale, unit = scale_of("N/m", both)
        equal = float(np.abs(np.diff(both, axis=0)).max()) <= IMPOSED_TENSION * float(np.abs(both).max())
        label = "tension, weft and warp" if equal else "mean tension of weft and warp"
        return scale * both.mean(axis=0), f"{label} [{unit}]"
    count = len(next(iter(columns.values())))
    strains = [columns[name] for name in ("strain_weft", "strain_warp") if name in columns]
    is_held = any(all(float(np.ptp(strain[rows])) < 1e-9 for strain in strains) for _, rows in stages)
    spread = [float(np.ptp(strain)) if np.isfinite(strain).all() else 0.0 for strain in strains]
    folds = bool(strains) and any(_folds(strains[int(np.argmax(spread))][rows]) for _, rows in stages)
    if "load_factor" in columns and (folds or (len(stages) > 1 and is_held)):
        stage = np.searchsorted([rows.stop for _, rows in stages], np.arange(count), side="right")
        return stage + columns["load_factor"], "load step and its load factor" if len(stages) > 1 else "load factor"
    if len(strains) == 2 and (count == 1 or max(spread) > 1e-9):
        if np.allclose(strains[0], strains[1], rtol=0.0, atol=1e-9):
            return 100.0 * strains[0], "strain, weft and warp [%]"
        name, other = SIDES if spread[0] >= spread[1] else SIDES[::-1]
        values = 100.0 * columns[f"strain_{other}"]
        value_range = f"{values.min():.3g} to {values.max():.3g}" if np.ptp(values) > 1e-7 else f"{values[0]:.3g}"
        return 100.0 * columns[f"strain_{name}"], f"{name} strain [%], {other} {value_range} %"
    for name, factor, offset, label in (
        ("shear", 100.0, 0.0, "shear [%]"),
        ("clamp_rotation", np.degrees(1.0), 0.0, "rotation of the clamps [deg]"),
        ("temperature_K", 1.0, -ZERO_CELSIUS, "temperature [°C]"),
        ("load_factor", 1.0, 0.0, "load factor"),
    ):
        if name in columns and np.ptp(columns[name]) > 1e-9:
            return factor * columns[name] + offset, label
    return np.arange(count, dtype=float), "record"


def _is_by_tension(columns: Columns, stages: Sequence[tuple[str, slice]]) -> bool:
    """Whether tensions, not strains, grow with the load factor in each load step."""
    names = [f"{quantity}_{side}{unit}" for quantity, unit in (("strain", ""), ("tension", "_N_per_m")) for side in SIDES]
    if "load_factor" not in columns or not all(name in columns for name in names):
        return False
    strain, tension = (np.array([columns[name] for name in two]) for two in (names[:2], names[2:]))

    def imposed(values: np.ndarray, share: float) -> bool:
        """Whether each side changes and follows the load factor in each load step."""
        for _, rows in stages:
            load, part = columns["load_factor"][rows].copy(), values[:, rows]
            load[0] = 0.0
            line = part[:, :1] + (part[:, -1:] - part[:, :1]) * load / (load[-1] or 1.0)  # a run that diverged ends before 1
            span = np.ptp(part, axis=1, keepdims=True)
            if part.shape[1] < 3 or not np.all(np.abs(part - line) <= share * span) or not np.any(span > 0.0):
                return False
        return True

    return imposed(tension, IMPOSED_TENSION) and not any(imposed(one[None], IMPOSED_STRAIN) for one in strain)


def _folds(values: np.ndarray) -> bool:
    """Whether values go both up and down, by more than round-off."""
    steps = np.diff(values)
    least = LEAST_FOLD * float(np.ptp(values)) if len(values) and np.isfinite(values).all() else np.inf
    return bool((steps > least).any() and (steps < -least).any())


LEAST_SPAN = 0.1  # of a value: shortest axis of a quantity against temperature
HELD = 1e-6  # strain: a change of less is none
LEAST_CHANGE = 0.1  # [%] of strain: shortest axis
TICKS = [digit * 10.0**power for power in range(-2, 3) for digit in (1.0, 2.0, 5.0)]  # [%] of an axis with jumps
MARGIN = 1.2  # of the limits of such an axis over its values
FLAT = 0.1  # of the axis: what changes by less between jumps is hard to see


def heat_figure(histories: Sequence[Columns], path: Path) -> Path | None:
    """Draw contacts, tension, strain and stress against temperature, or nothing at a constant one.

    None without such a stage. histories: columns of each; lines to rows with a `jump` are dotted. The change of a
    strain is over one plus the strain at the begin of the stage; strains of stages that hold them are left out.
    """
    found = []  # a stage each
    for history in histories:
        celsius = history.get("temperature_K", np.zeros(len(history["stage"]))) - ZERO_CELSIUS
        columns = {**history, "jump": curve_axes.is_behind_jump(history), "temperature_C": celsius}
        for name, part in curve_axes.stage_slices(history["stage"].tolist()):
            if np.ptp(celsius[part]) > 1e-6:
                found.append((name, {key: values[part] for key, values in columns.items()}))
    if not found:
        return None
    unknown = [np.full(len(stage["temperature_C"]), np.nan) for _, stage in found]
    ends = np.cumsum([len(one) for one in unknown])
    stages = [(name, slice(end - len(one), end)) for (name, _), one, end in zip(found, unknown, ends, strict=True)]

    def all_of(name: str, changes: bool = False) -> np.ndarray:
        parts = [stage.get(name, none) for (_, stage), none in zip(found, unknown, strict=True)]
        return np.concatenate([(part - part[0]) / (1.0 + part[0]) if changes else part for part in parts])

    strain = {side: 100.0 * all_of(f"strain_{side}", changes=True) for side, _ in curve_axes.SIDE_COLOURS}
    held = [part for _, part in stages if all(np.ptp(values[part]) <= 100.0 * HELD for values in strain.values())]
    for part in held:
        for values in strain.values():
            values[part] = np.nan
    tension = {side: all_of(f"tension_{side}_N_per_m") for side, _ in curve_axes.SIDE_COLOURS}
    stress = {name: all_of(name) for name in curve_axes.STRESS_COLUMNS}
    (to_tension, tension_unit), (to_stress, stress_unit) = scale_of("N/m", *tension.values()), scale_of("Pa", *stress.values())
    figure = figure_of(10.5, 7.6)
    panels = figure.subplots(2, 2, sharex=True).ravel()
    strains = [(side, colour, strain[side]) for side, colour in curve_axes.SIDE_COLOURS]
    tensions = [(side, colour, to_tension * tension[side]) for side, colour in curve_axes.SIDE_COLOURS]
    stresses = [(text, colour, to_stress * stress[name]) for text, colour, name in curve_axes.stress_columns(stress)]
    abscissa, jumped = all_of("temperature_C"), all_of("jump")
    where = "\nwhere it is not held" if 0 < len(held) < len(stages) else ""
    shown: tuple[tuple[str, list[curve_axes.Curve], float], ...] = (
        ("active contacts [% of pairs]", [("", GREEN, all_of("active_percent"))], 0.0),
        (f"tension [{tension_unit}]", tensions, 0.0),
        (f"strain, change in the load step [%]{where}", strains, LEAST_CHANGE),
        (f"largest wire stress [{stress_unit}]", stresses, 0.0),
    )
    for axes, (label, curves, least) in zip(panels, shown, strict=True):
        curve_axes.draw_curves(axes, abscissa, stages, curves, jumped, nothing="held" if least and held else "not recorded")
        axes.set_ylabel(label)
        if axes.lines:
            if least and (smooth := _smooth_span(curves, stages, jumped)) < FLAT * np.ptp(axes.get_ylim()):
                linear = next(tick for tick in TICKS if tick >= max(smooth, 0.5 * least))
                _stretch_zero(axes, linear)
                axes.set_ylabel(f"{label}\nlogarithmic beyond ±{linear:g} %")
                continue
            axes.yaxis.get_major_formatter().set_useOffset(False)
            _widen(axes, least)
    panels[0].set_ylim(-3.0, 103.0)
    for axes in panels[2:]:
        axes.set_xlabel("temperature [°C]")
    curve_axes.stage_legend(figure, [name for name, _ in stages])
    return save_figure(figure, path)


def _smooth_span(curves: Sequence[curve_axes.Curve], stages: Sequence[tuple[str, slice]], jumped: np.ndarray) -> float:
    """Largest change of the curves between two jumps."""
    sections = [(rows, np.flatnonzero(jumped[rows][1:]) + 1) for _, rows in stages]
    parts = [part for *_, values in curves for rows, jumps in sections for part in np.split(values[rows], jumps)]
    return max((float(np.ptp(part)) for part in parts if np.isfinite(part).all() and len(part)), default=0.0)


def _stretch_zero(axes: Axes, linear: float) -> None:
    """Make the vertical axis linear up to `linear` about zero, and logarithmic beyond."""
    low, high = axes.get_ylim()
    axes.set_yscale("symlog", linthresh=linear)
    ticks = [0.0, *(sign * tick for tick in (0.5 * linear, *TICKS) if tick >= 0.5 * linear for sign in (-1.0, 1.0))]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_yticks([], minor=True)
    axes.set_ylim(min(MARGIN * low, -linear), max(MARGIN * high, linear))


def _widen(axes: Axes, least: float) -> None:
    """Widen the vertical axis to LEAST_SPAN of its middle and to `least`: scatter is no trend."""
    low, high = axes.get_ylim()
    middle = 0.5 * (low + high)
    half = 0.5 * max(high - low, LEAST_SPAN * abs(middle), least)
    axes.set_ylim(middle - half, middle + half)
