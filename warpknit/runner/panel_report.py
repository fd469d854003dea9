"""Results of a panel: maps as tables, and the section `panel` of summary.json.

Of gripped meshes of a dozen repeats or more, and of those on cords."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ..measure.observables import PanelMap
from ..measure.surface import find_surface
from ..measure.table import Record
from ..mesh.rim import Rim, build_rim
from ..results.row import Columns

Value: TypeAlias = float | str | None
PanelValues: TypeAlias = dict[str, Value | dict[str, float]]  # the section of summary.json


@dataclass(frozen=True)
class PanelReport:
    """Tables and summary of one recorded state of a panel."""

    tables: dict[str, Columns]  # of panel/map_*.csv, edge_*.csv and, of a panel with a target shape, surface_*.csv
    summary: PanelValues


def _map_table(m: PanelMap, mean_gradient: np.ndarray) -> Columns:
    """One value for each tile that is mostly mesh.

    Positions are those of the tile centres from the centre of the panel, undeformed and in the mean deformation.
    """
    known = m.known
    now = m.place[known] @ mean_gradient.T
    return {
        "x_m": now[:, 0],
        "y_m": now[:, 1],
        "weft_m": m.place[known][:, 0],
        "warp_m": m.place[known][:, 1],
        "inside": m.inside[known],
        "strain_weft": m.gradient[known][:, 0, 0] - 1.0,
        "strain_warp": m.gradient[known][:, 1, 1] - 1.0,
        "shear": m.gradient[known][:, 0, 1] + m.gradient[known][:, 1, 0],
        "tension_weft_N_per_m": m.tension[known][:, 0, 0],
        "tension_warp_N_per_m": m.tension[known][:, 1, 1],
        "active_percent": np.nan_to_num(m.active_percent[known]),
        "stress_max_Pa": m.stress_max[known],
    }


def cord_values(rim: Rim, gradient: np.ndarray, stations: np.ndarray) -> dict[str, float]:
    """Summary of the cords, from the displacement (station, 2) [m] of the stations; empty without cords."""
    if not rim.is_free:
        return {}
    tension = rim.cord_forces(gradient, stations)[1]
    return {
        "cord_tension_max_N": float(tension.max()),  # largest tension of the edge cords
        "cord_tension_min_N": float(tension.min()),  # smallest tension of the edge cords
        "cord_displacement_max_m": float(np.hypot(stations[:, 0], stations[:, 1]).max()),  # largest displacement of the edge
        # cords
    }


def cord_summary(record: Record) -> PanelValues | None:
    """Summary of the edge of a mesh on cords, else None."""
    model = record.observables.model
    if model.scene.panel.cord is None:
        return None
    rim = build_rim(model.panel, model.scene)
    cords = cord_values(rim, record.observables.stretch, _stations(record, rim))
    return {"outline": model.scene.panel.outline, "area_m2": model.panel.area, **cords}


def _stations(record: Record, rim: Rim) -> np.ndarray:
    """(station, 2) [m] displacement of the rim, zero where it is fixed."""
    return record.stations if len(record.stations) else np.zeros((len(rim.arc), 2))


def report_panel(record: Record) -> PanelReport | None:
    """The report of a gripped panel; None for a mesh without a map."""
    r = record.observables
    panel_map = r.panel_map
    if panel_map is None:
        return None
    model = r.model
    options = model.scene.panel
    least = np.minimum(panel_map.tension[..., 0, 0], panel_map.tension[..., 1, 1])[panel_map.known]
    values: PanelValues = {
        "outline": options.outline,  # `panel.outline`
        "area_m2": model.panel.area,  # area as knitted
        "tension_median_weft_N_per_m": float(np.median(panel_map.tension[panel_map.known][:, 0, 0])),  # median of the repeats;
        # the mean of `mesh` includes the short taut wires at the grips
        "tension_median_warp_N_per_m": float(np.median(panel_map.tension[panel_map.known][:, 1, 1])),  # the same in warp
        "tension_least_N_per_m": float(least.min()),  # smallest tension of a repeat in weft or warp
        "tension_threshold_N_per_m": options.tension_threshold,  # `panel.tension_threshold`
        "area_below_tension_percent": None,  # share of the area below that tension
        "active_threshold_percent": options.active_threshold,  # `panel.active_threshold`
        "area_below_active_percent": None,  # share of the area below that share of active contacts
    }
    with np.errstate(invalid="ignore"):
        if options.tension_threshold is not None:
            slack = np.minimum(panel_map.tension[..., 0, 0], panel_map.tension[..., 1, 1]) < options.tension_threshold
            values["area_below_tension_percent"] = 100.0 * panel_map.area_share(slack)
        if options.active_threshold is not None:
            values["area_below_active_percent"] = 100.0 * panel_map.area_share(
                panel_map.active_percent < options.active_threshold
            )
    rim = build_rim(model.panel, model.scene)
    stations = _stations(record, rim)
    values |= cord_values(rim, r.stretch, stations)
    tables: dict[str, Columns] = {"map": _map_table(panel_map, r.stretch)}
    if options.focal_length is not None:
        middle = model.panel.low + 0.5 * model.panel.size
        surface = find_surface(panel_map, rim, r.stretch, stations, middle, options.focal_length)
        x, y = surface.point.T
        tables["surface"] = {"x_m": x, "y_m": y, "height_m": surface.height, "deviation_m": surface.deviation}
        values["surface"] = {
            "focal_length_m": options.focal_length,  # `panel.focal_length`
            "rms_deviation_m": surface.rms_deviation,  # root mean square deviation from the paraboloid
            "rms_best_fit_m": surface.rms_best_fit,  # the same after the best shift and tilt
            "pillowing_m": surface.pillowing,  # largest deviation from the paraboloid
            "slope_max": float(np.hypot(*surface.point.T).max() / (2.0 * options.focal_length)),  # slope of the paraboloid at
            # the edge
        }
    position = (rim.place - model.panel.low - 0.5 * model.panel.size) @ r.stretch.T + stations
    tables["edge"] = {"x_m": position[:, 0], "y_m": position[:, 1], "held": rim.given.astype(int)}
    return PanelReport(tables, values)
