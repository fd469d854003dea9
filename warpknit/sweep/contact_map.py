"""The contact map: one cell for each pair of strains, with what the mesh carries at rest there.

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
from ..measure import Observables, table
from ..measure.table import Measure

STEADY = "steady"
SAME_SHARE = 0.01  # points of %: shares of contacts that differ by less are the same


class MapRow(SimpleNamespace):
    """One pair of strains: the columns of map.csv and map_details.csv by their names, of measures those of the table of measures
    (measure/table.py). None where the mesh did not come to rest."""

    @property
    def strains(self) -> tuple[float, float]:
        """Weft and warp."""
        return self.strain_weft, self.strain_warp


TEXTS, COUNTS = ("stop_reason", "message"), ("seeds", "steps")


def measures_of(part: str) -> list[Measure]:
    """Lines of the table of measures that stand in "map" or "details"."""
    return [line for line in table.MEASURES if line.map == part]


def columns_of(part: str) -> list[str]:
    """Columns of map.csv ("map") or map_details.csv ("details")."""
    names = [line.name for line in measures_of(part)]
    if part == "map":
        return ["strain_weft", "strain_warp", *names, "stop_reason"]
    return ["strain_weft", "strain_warp", "active_percent_deviation", *names, "seeds", "steps", "message"]


def map_row(strains: tuple[float, float], observables: Observables | None, *, steps: int, message: str = "") -> MapRow:
    """What is kept of a state at rest, or of none and why."""
    lines = measures_of("map") + measures_of("details")
    found = {line.name: None if observables is None else line.of(observables) for line in lines if not isinstance(line.of, str)}
    return MapRow(
        strain_weft=strains[0],
        strain_warp=strains[1],
        stop_reason="diverged" if observables is None else STEADY,
        active_percent_deviation=None,  # standard deviation over the seeds
        seeds=0 if observables is None else 1,  # meshes at rest that the row stands for
        steps=steps,
        message=message,  # why there is no state at rest
        **found,
    )


def write_map(rows: Sequence[MapRow], path: Path, details: Path) -> None:
    """Write both tables; each file is whole or as it was before."""
    for target, part in ((path, "map"), (details, "details")):
        with write_aside(target) as file:
            writer = csv.DictWriter(file, columns_of(part), extrasaction="ignore")
            writer.writeheader()
            writer.writerows(vars(row) for row in rows)


def read_map(path: Path, details: Path) -> list[MapRow]:
    """Rows that `write_map` wrote; none where the files are absent. Numbers come back to the bit."""
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
    """One map of many: means over the seeds that came to rest; of stresses the largest, so that the elastic limit holds for
    all. Strains at which no seed has a row yet are left out."""
    by_strains: dict[tuple[float, float], list[MapRow]] = {}
    for rows in maps:
        for row in rows:
            by_strains.setdefault(row.strains, []).append(row)
    return [_mean(rows) if len(maps) > 1 else rows[0] for rows in by_strains.values()]


def _mean(rows: Sequence[MapRow]) -> MapRow:
    steady = [row for row in rows if row.stop_reason == STEADY]
    reason = STEADY if len(steady) == len(rows) else f"{len(steady)} of {len(rows)} seeds steady" if steady else "diverged"

    def over(name: str, how: Callable[[list[float]], Any]) -> float | None:
        values = [getattr(row, name) for row in steady]
        return float(how(values)) if values and None not in values else None

    found = {line.name: over(line.name, line.over_seeds) for line in measures_of("map") + measures_of("details")}
    return MapRow(
        strain_weft=rows[0].strain_weft,
        strain_warp=rows[0].strain_warp,
        stop_reason=reason,
        active_percent_deviation=over("active_percent", lambda values: np.std(values, ddof=1)) if len(steady) > 1 else None,
        seeds=len(steady),
        steps=sum(row.steps for row in rows),
        message=next((row.message for row in rows if row.message), ""),
        **found,
    )


def grid(rows: Sequence[MapRow], name: str, weft: Sequence[float], warp: Sequence[float]) -> np.ndarray:
    """Values (warp, weft) of a column of map.csv or map_details.csv; nan where there is none."""
    values = {row.strains: getattr(row, name) for row in rows}
    found = [[values.get((x, y)) for x in weft] for y in warp]
    return np.array([[math.nan if value is None else float(value) for value in line] for line in found])


@dataclass(frozen=True)
class Optimum:
    """The strains of most active contacts that no wire passes the elastic limit at."""

    strain_weft: float
    strain_warp: float
    tension_weft_N_per_m: float
    tension_warp_N_per_m: float
    active_percent: float
    stress_max_Pa: float
    stress_margin: float  # share of the yield stress that is left


def find_optimum(rows: Sequence[MapRow], yield_stress: float) -> Optimum | None:
    """The optimum among the cells under tension in both directions, none of whose wires is stressed beyond `yield_stress` [Pa]
    and all of whose seeds came to rest; None where there is no such cell, or none with an active contact.

    A mesh of equal loops has few different shares, so many cells tie: of these the ones count first that have the most of their
    eight neighbours on the grid as good as themselves, as strains are never set exactly, and then the one of the least stress.
    """
    if not rows:
        return None
    weft = sorted({row.strain_weft for row in rows})
    warp = sorted({row.strain_warp for row in rows})
    active = np.nan_to_num(grid(rows, "active_percent", weft, warp))
    bearable = grid(rows, "stress_max_Pa", weft, warp) <= yield_stress  # not where it is unknown
    padded = np.pad(np.where(bearable, active, 0.0), 1)
    height, width = active.shape
    around = np.stack([padded[i : i + height, j : j + width] for i, j in np.ndindex(3, 3)])
    kept = np.sum(around >= active - SAME_SHARE, axis=0)
    best: tuple[tuple[float, float, float], Optimum] | None = None
    for row in rows:
        numbers = (row.active_percent, row.tension_weft_N_per_m, row.tension_warp_N_per_m, row.stress_max_Pa)
        share, tension_weft, tension_warp, stress = (math.nan if number is None else number for number in numbers)
        tensile = share > 0.0 and tension_weft > 0.0 and tension_warp > 0.0
        if not (tensile and stress <= yield_stress and row.stop_reason == STEADY):
            continue
        neighbours = int(kept[warp.index(row.strain_warp), weft.index(row.strain_weft)])
        order = (round(share / SAME_SHARE), neighbours, -stress)
        if best is None or order > best[0]:
            margin = 1.0 - stress / yield_stress
            best = order, Optimum(*row.strains, tension_weft, tension_warp, share, stress, margin)
    return None if best is None else best[1]
