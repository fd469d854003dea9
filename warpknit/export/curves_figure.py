"""Active contacts, tension, energies and residual of a run against its load."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpknit.export.plots import BLUE, GREEN, GREY, ORANGE, PURPLE, figure_of, save_figure, scale_of
from warpknit.export.stage_curves import History, columns_of, draw_curves, history_rows, stage_legend, stage_slices
from warpknit.text import ZERO_CELSIUS

__all__ = ["curves_figure"]

SIDES = ("weft", "warp")
LEAST_FOLD = 1e-3  # of the range of a strain: less does not count as going back
IMPOSED_STRAIN, IMPOSED_TENSION = 1e-6, 0.02  # of its range in a stage: departure from a straight line over the load factor


def curves_figure(history: History, path: str | os.PathLike[str]) -> Path:
    """Draw active contacts, tension, energies and residual of a run, from history.csv or its rows.

    Under given tensions these are the abscissa, and strains are drawn in their place.
    """
    rows = history_rows(history)
    columns = columns_of(rows)

    def column(name: str) -> NDArray[Any]:
        return columns.get(name, np.full(len(rows), np.nan))

    stages = stage_slices([str(row.get("stage", "")) for row in rows])
    abscissa, abscissa_label = _abscissa(columns, stages, len(rows))

    tension = {side: column(f"tension_{side}_N_per_m") for side in ("weft", "warp")}
    strain = {side: 100.0 * column(f"strain_{side}") for side in ("weft", "warp")}
    energies = {name: column(f"energy_{name}_J") for name in ("bend", "stretch", "contact", "kinetic")}
    (to_tension, tension_unit), (to_energy, energy_unit) = scale_of("N/m", *tension.values()), scale_of("J", *energies.values())
    figure = figure_of(10.5, 7.6)
    panels = figure.subplots(2, 2, sharex=True).ravel()
    panel_curves: tuple[tuple[str, bool, tuple[tuple[str, str, NDArray[Any]], ...]], ...] = (
        ("active contacts [% of pairs]", False, (("", GREEN, column("active_percent")),)),
        ("strain [%]", False, (("weft", BLUE, strain["weft"]), ("warp", ORANGE, strain["warp"])))
        if _is_by_tension(columns, stages)
        else (
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
        draw_curves(axes, abscissa, stages, curves, is_logarithmic)
        axes.set_ylabel(label)
    panels[0].set_ylim(-3.0, 103.0)
    if not any(np.any(values < 0.0) for _, _, values in panel_curves[1][2]):
        panels[1].set_ylim(bottom=0.0)
    for axes in panels[2:]:
        axes.set_xlabel(abscissa_label)
    if len(stages) > 1:
        stage_legend(figure, [name for name, _ in stages])
    return save_figure(figure, path)


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
        return columns["temperature_K"] - ZERO_CELSIUS, "temperature [degC]"
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
            line = part[:, :1] + (part[:, -1:] - part[:, :1]) * load
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
