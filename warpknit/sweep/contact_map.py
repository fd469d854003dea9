"""The contact map: one cell for each pair of strains, with the measures of its equilibrium.

Rows of map.csv and map_details.csv, the mean over meshes of scattered loops, and the optimum. NumPy and plain numbers only.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..files import write_aside
from ..measure import Observables, energy_scale, table
from ..measure.jumps import STORED_FLOOR, jumps
from ..measure.table import Measure
from ..mechanics import Model

STEADY = "steady"
SIDES = ("weft", "warp")
SAME_SHARE = 0.01  # percentage points: tolerance for equal shares of active contacts


class MapRow(SimpleNamespace):
    """One pair of strains: the columns of map.csv and map_details.csv (measure/table.py); None where not converged."""

    @property
    def strains(self) -> tuple[float, float]:
        """Weft and warp."""
        return self.strain_weft, self.strain_warp


TEXTS, COUNTS = ("stop_reason", "message"), ("seeds", "steps")


def measures_of(part: str) -> list[Measure]:
    """Measures of the part "map" or "details"."""
    return [line for line in table.MEASURES if line.map == part]


def columns_of(part: str) -> list[str]:
    """Columns of map.csv ("map") or map_details.csv ("details")."""
    names = [line.name for line in measures_of(part)]
    if part == "map":
        return ["strain_weft", "strain_warp", *names, "stop_reason"]
    return ["strain_weft", "strain_warp", "active_percent_deviation", *names, "seeds", "steps", "message"]


def map_row(strains: tuple[float, float], observables: Observables | None, *, steps: int, message: str = "") -> MapRow:
    """Row of an equilibrium, or of a failed load with its message."""
    lines = measures_of("map") + measures_of("details")
    measures = {
        line.name: None if observables is None else line.of(observables) for line in lines if not isinstance(line.of, str)
    }
    return MapRow(
        strain_weft=strains[0],
        strain_warp=strains[1],
        stop_reason="diverged" if observables is None else STEADY,
        active_percent_deviation=None,  # standard deviation over the seeds
        seeds=0 if observables is None else 1,  # number of converged meshes in the row
        steps=steps,
        message=message,  # why the load did not converge
        **measures,
    )


def write_map(rows: Sequence[MapRow], path: Path, details: Path) -> None:
    """Write both tables, atomically."""
    for target, part in ((path, "map"), (details, "details")):
        with write_aside(target) as file:
            writer = csv.DictWriter(file, columns_of(part), extrasaction="ignore")
            writer.writeheader()
            writer.writerows(vars(row) for row in rows)


def read_map(path: Path, details: Path) -> list[MapRow]:
    """Rows that `write_map` wrote; none where the files are absent. Values are bit-identical."""
    if not (path.exists() and details.exists()):
        return []
    more = {(row["strain_weft"], row["strain_warp"]): row for row in _read(details)}
    return [MapRow(**row | more[key]) for row in _read(path) if (key := (row["strain_weft"], row["strain_warp"])) in more]


def _read(path: Path) -> list[dict[str, Any]]:
    def value(name: str, text: str) -> Any:
        if name in TEXTS:
            return text
        if name in COUNTS:
            return int(text)
        return float(text) if text else None

    with open(path, newline="", encoding="utf-8") as file:
        return [{name: value(name, text) for name, text in row.items()} for row in csv.DictReader(file)]


def mean_map(maps: Sequence[Sequence[MapRow]]) -> list[MapRow]:
    """Mean of maps over the converged seeds; of stresses the largest. Strains without any row are left out."""
    by_strains: dict[tuple[float, float], list[MapRow]] = {}
    for rows in maps:
        for row in rows:
            by_strains.setdefault(row.strains, []).append(row)
    return [_mean(rows) if len(maps) > 1 else rows[0] for rows in by_strains.values()]


def _mean(rows: Sequence[MapRow]) -> MapRow:
    steady = [row for row in rows if row.stop_reason == STEADY]
    reason = STEADY if len(steady) == len(rows) else f"{len(steady)} of {len(rows)} seeds steady" if steady else "diverged"

    def over(name: str, how: Callable[[list[float]], Any]) -> float | None:
        values: list[Any] = [vars(row).get(name) for row in steady]
        return float(how(values)) if values and None not in values else None

    measures = {line.name: over(line.name, line.over_seeds) for line in measures_of("map") + measures_of("details")}
    return MapRow(
        strain_weft=rows[0].strain_weft,
        strain_warp=rows[0].strain_warp,
        stop_reason=reason,
        active_percent_deviation=over("active_percent", lambda values: np.std(values, ddof=1)) if len(steady) > 1 else None,
        seeds=len(steady),
        steps=sum(row.steps for row in rows),
        message=next((row.message for row in rows if row.message), ""),
        **measures,
    )


def model_warnings(mesh: Model, rows: Sequence[MapRow]) -> list[str]:
    """Where the states of a map are outside the validity of their model, a sentence each."""
    return list(mesh.warnings([{"wire": {"slid_max_m": vars(row).get("slid_max_m") or 0.0}} for row in rows]))


def grid(rows: Sequence[MapRow], name: str, weft: Sequence[float], warp: Sequence[float]) -> np.ndarray:
    """Values (warp, weft) of a column of map.csv or map_details.csv; nan where there is none."""
    values = {row.strains: vars(row).get(name) for row in rows}  # an earlier version had fewer columns
    cells = [[values.get((x, y)) for x in weft] for y in warp]
    return np.array([[math.nan if value is None else float(value) for value in line] for line in cells])


Jump = tuple[tuple[float, float], tuple[float, float]]  # strains, weft and warp, of two neighbouring cells


def find_jumps(mesh: Model, rows: Sequence[MapRow]) -> list[Jump]:
    """Neighbouring cells whose equilibria belong to different branches (measure/jumps.py), along weft and along warp."""
    if not rows:
        return []
    weft, warp = (sorted({row.strains[side] for row in rows}) for side in (0, 1))
    area, floor = mesh.panel.area, STORED_FLOOR * energy_scale(mesh)
    stored = np.sum([grid(rows, f"energy_{part}_J", weft, warp) for part in ("stretch", "bend", "contact")], axis=0)
    tensions = np.stack([grid(rows, f"tension_{side}_N_per_m", weft, warp) for side in SIDES], axis=-1)
    found: list[Jump] = []
    for side, path, axis in zip(SIDES, (weft, warp), (1, 0), strict=True):
        force = area * grid(rows, f"nominal_{side}_N_per_m", weft, warp)
        strain = np.array(path)
        for line in range(force.shape[1 - axis]):
            energy = stored.take(line, 1 - axis)
            jumped = jumps(
                strain,
                np.take(force, [line], 1 - axis).reshape(-1, 1),
                strain[:, None],
                stored=energy,
                dissipated=np.zeros_like(energy),
                values=tensions.take(line, 1 - axis),
                floor=floor,
            )
            for k in np.flatnonzero(jumped):
                ends = [(weft[k + more], warp[line]) if axis else (weft[line], warp[k + more]) for more in (0, 1)]
                found.append((ends[0], ends[1]))
    return found


def jump_warning(found: Sequence[Jump]) -> str | None:
    """What the jumps of a map mean, in a line; None without any."""
    if not found:
        return None
    first = " and ".join(f"{100.0 * weft:.3g} % / {100.0 * warp:.3g} %" for weft, warp in found[0])
    count = "neighbouring pairs of strains" if len(found) > 1 else "neighbouring pair of strains"
    return (
        f"the results jump between {len(found)} {count}, first {first} (weft / warp): several equilibria exist there, and the"
        " values on either side belong to different ones"
    )


@dataclass(frozen=True)
class Optimum:
    """The strains with the most active contacts and no wire above the elastic limit."""

    strain_weft: float
    strain_warp: float
    tension_weft_N_per_m: float
    tension_warp_N_per_m: float
    active_percent: float
    stress_max_Pa: float
    stress_margin: float  # 1 - stress over yield stress
    at_edge: tuple[str, ...] = ()  # directions (weft, warp) in which the map ends there: a wider one may have a better optimum

    @property
    def edge_warning(self) -> str | None:
        """What it means that the optimum is at the edge of the map."""
        if not self.at_edge:
            return None
        return f"the optimum is at the edge of the map in {' and '.join(self.at_edge)}: a wider [sweep] may have a better one"


def find_optimum(rows: Sequence[MapRow], yield_stress: float) -> Optimum | None:
    """The optimum among converged cells with tension in both directions and no stress above `yield_stress` [Pa], or None.

    A mesh of equal loops has few different shares of active contacts, so many cells tie. Ties are resolved by the number of
    equally good neighbours (robustness against strain errors), then by the smallest stress.
    """
    if not rows:
        return None
    weft = sorted({row.strain_weft for row in rows})
    warp = sorted({row.strain_warp for row in rows})
    active = np.nan_to_num(grid(rows, "active_percent", weft, warp))
    elastic = grid(rows, "stress_max_Pa", weft, warp) <= yield_stress  # False where unknown
    padded = np.pad(np.where(elastic, active, 0.0), 1)
    height, width = active.shape
    around = np.stack([padded[i : i + height, j : j + width] for i, j in np.ndindex(3, 3)])
    equal_neighbours = np.sum(around >= active - SAME_SHARE, axis=0)
    best: tuple[tuple[float, float, float], Optimum] | None = None
    for row in rows:
        values = (row.active_percent, row.tension_weft_N_per_m, row.tension_warp_N_per_m, row.stress_max_Pa)
        share, tension_weft, tension_warp, stress = (math.nan if value is None else value for value in values)
        tensile = share > 0.0 and tension_weft > 0.0 and tension_warp > 0.0
        if not (tensile and stress <= yield_stress and row.stop_reason == STEADY):
            continue
        neighbours = int(equal_neighbours[warp.index(row.strain_warp), weft.index(row.strain_weft)])
        order = (round(share / SAME_SHARE), neighbours, -stress)
        if best is None or order > best[0]:
            margin = 1.0 - stress / yield_stress
            edges = tuple(
                side
                for side, strain, axis in zip(("weft", "warp"), row.strains, (weft, warp), strict=True)
                if len(axis) > 1 and (strain == axis[-1] or strain == axis[0] != 0.0)
            )
            best = order, Optimum(*row.strains, tension_weft, tension_warp, share, stress, margin, edges)
    return None if best is None else best[1]
