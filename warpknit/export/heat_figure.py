"""Curves of load steps that change the temperature, against it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from warpknit.base.text import ZERO_CELSIUS
from warpknit.export import curve_axes
from warpknit.export.plots import GREEN, figure_of, save_figure, scale_of
from warpknit.results.row import Columns

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
