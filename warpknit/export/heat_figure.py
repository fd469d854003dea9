"""What heat does: contacts, tension, strain and stress against temperature."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from warpknit.base.text import ZERO_CELSIUS
from warpknit.export.plots import BLUE, GREEN, ORANGE, figure_of, save_figure, scale_of
from warpknit.export.stage_curves import (
    STRESS_COLUMNS,
    History,
    columns_of,
    draw_curves,
    history_rows,
    is_behind_jump,
    stage_legend,
    stage_slices,
    stress_columns,
)

__all__ = ["heat_figure"]

SIDE_COLOURS = (("weft", BLUE), ("warp", ORANGE))
LEAST_SPAN = 0.1  # of a value: shortest axis of a quantity against temperature
HELD = 1e-6  # strain: a change of less is none
LEAST_CHANGE = 0.1  # [%] of strain: shortest axis
TICKS = [digit * 10.0**power for power in range(-2, 3) for digit in (1.0, 2.0, 5.0)]  # [%] of an axis with jumps
MARGIN = 1.2  # of the limits of such an axis over its values
FLAT = 0.1  # of the axis: what changes by less between jumps is hard to see


def heat_figure(histories: Sequence[History], path: str | os.PathLike[str]) -> Path | None:
    """Draw active contacts, tension, change of strain and largest stress against temperature, for the stages that change it.

    None without such a stage. histories: each a history.csv or its rows; lines to rows with a `jump` are dotted. The change of a
    strain is over one plus the strain at the begin of the stage; strains of stages that hold them are left out.
    """
    found = []  # a stage each
    for history in histories:
        rows = history_rows(history)
        columns = columns_of(rows)
        columns["jump"] = is_behind_jump(columns, len(rows))
        columns["temperature_C"] = columns.get("temperature_K", np.zeros(len(rows))) - ZERO_CELSIUS
        for name, part in stage_slices([str(row.get("stage", "")) for row in rows]):
            if np.ptp(columns["temperature_C"][part]) > 1e-6:
                found.append((name, {key: values[part] for key, values in columns.items()}))
    if not found:
        return None
    unknown = [np.full(len(stage["temperature_C"]), np.nan) for _, stage in found]
    ends = np.cumsum([len(one) for one in unknown])
    stages = [(name, slice(end - len(one), end)) for (name, _), one, end in zip(found, unknown, ends, strict=True)]

    def all_of(name: str, changes: bool = False) -> np.ndarray:
        parts = [stage.get(name, none) for (_, stage), none in zip(found, unknown, strict=True)]
        return np.concatenate([(part - part[0]) / (1.0 + part[0]) if changes else part for part in parts])

    strain = {side: 100.0 * all_of(f"strain_{side}", changes=True) for side, _ in SIDE_COLOURS}
    held = [part for _, part in stages if all(np.ptp(values[part]) <= 100.0 * HELD for values in strain.values())]
    for part in held:
        for values in strain.values():
            values[part] = np.nan
    tension = {side: all_of(f"tension_{side}_N_per_m") for side, _ in SIDE_COLOURS}
    stress = {name: all_of(name) for name in STRESS_COLUMNS}
    (to_tension, tension_unit), (to_stress, stress_unit) = scale_of("N/m", *tension.values()), scale_of("Pa", *stress.values())
    figure = figure_of(10.5, 7.6)
    panels = figure.subplots(2, 2, sharex=True).ravel()
    for axes, label, curves, least, is_held in zip(
        panels,
        (
            "active contacts [% of pairs]",
            f"tension [{tension_unit}]",
            "strain, change in the stage [%]" + ("\nwhere it is not held" if 0 < len(held) < len(stages) else ""),
            f"largest wire stress [{stress_unit}]",
        ),
        (
            (("", GREEN, all_of("active_percent")),),
            tuple((side, colour, to_tension * tension[side]) for side, colour in SIDE_COLOURS),
            tuple((side, colour, strain[side]) for side, colour in SIDE_COLOURS),
            tuple((label, colour, to_stress * stress[name]) for label, colour, name in stress_columns(stress)),
        ),
        (0.0, 0.0, LEAST_CHANGE, 0.0),
        (False, False, bool(held), False),
        strict=True,
    ):
        nothing = "held" if is_held else "not recorded"
        draw_curves(axes, all_of("temperature_C"), stages, curves, all_of("jump"), nothing=nothing)
        axes.set_ylabel(label)
        if axes.lines:
            if least and (smooth := _smooth_span(curves, stages, all_of("jump"))) < FLAT * np.ptp(axes.get_ylim()):
                linear = next(tick for tick in TICKS if tick >= max(smooth, 0.5 * least))
                _stretch_zero(axes, linear)
                axes.set_ylabel(f"{label}\nlogarithmic beyond ±{linear:g} %")
                continue
            axes.yaxis.get_major_formatter().set_useOffset(False)
            _widen(axes, least)
    panels[0].set_ylim(-3.0, 103.0)
    for axes in panels[2:]:
        axes.set_xlabel("temperature [°C]")
    stage_legend(figure, [name for name, _ in stages])
    return save_figure(figure, path)


def _smooth_span(
    curves: Sequence[tuple[str, str, NDArray[Any]]], stages: Sequence[tuple[str, slice]], jumped: NDArray[np.bool_]
) -> float:
    """Largest change of the curves between two jumps."""
    parts = [
        part
        for _, _, values in curves
        for _, rows in stages
        for part in np.split(values[rows], np.flatnonzero(jumped[rows][1:]) + 1)
    ]
    return max((float(np.ptp(part)) for part in parts if np.isfinite(part).all() and len(part)), default=0.0)


def _stretch_zero(axes: Axes, linear: float) -> None:
    """A vertical axis that is linear up to `linear` about zero, and logarithmic beyond: jumps leave room for small changes."""
    low, high = axes.get_ylim()
    axes.set_yscale("symlog", linthresh=linear)
    ticks = [0.0, *(sign * tick for tick in (0.5 * linear, *TICKS) if tick >= 0.5 * linear for sign in (-1.0, 1.0))]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_yticks([], minor=True)
    axes.set_ylim(min(MARGIN * low, -linear), max(MARGIN * high, linear))


def _widen(axes: Axes, least: float) -> None:
    """Widen the vertical axis to LEAST_SPAN of its middle, and to `least`, so that scatter does not look like a trend."""
    low, high = axes.get_ylim()
    middle = 0.5 * (low + high)
    half = 0.5 * max(high - low, LEAST_SPAN * abs(middle), least)
    axes.set_ylim(middle - half, middle + half)
