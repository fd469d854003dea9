"""The contact map: one cell for each pair of strains, with what the mesh carries at rest there.

Rows of map.csv and map_details.csv, the mean over meshes of scattered loops, and the optimum. NumPy and plain numbers only.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from ..files import write_aside

STEADY = "steady"
SAME_SHARE = 0.01  # points of %: shares of contacts that differ by less are the same


@dataclass(frozen=True)
class Cell:
    """One pair of strains; None where the mesh did not come to rest."""

    strain_weft: float
    strain_warp: float
    active_percent: float | None  # of all pairs
    tension_weft_N_per_m: float | None
    tension_warp_N_per_m: float | None
    stress_max_Pa: float | None
    yield_fraction: float | None  # share of the wire above the yield stress
    stop_reason: str


@dataclass(frozen=True)
class Detail:
    """More of the same cell; what seeds differ by is 0 where there is one."""

    strain_weft: float
    strain_warp: float
    active_percent_deviation: float | None  # standard deviation over the seeds
    active_bodies_percent: float | None  # bodies both of whose pairs are active
    active_rhombus_percent: float | None  # of the pairs at the central rhombus
    contact_force_max_N: float | None
    stress_interior_max_Pa: float | None  # away from the grips
    residual: float | None
    seeds: int  # meshes at rest that the row stands for
    steps: int
    message: str  # why there is no state at rest


@dataclass(frozen=True)
class MapRow:
    """All that is known of one pair of strains."""

    cell: Cell
    detail: Detail

    @property
    def strains(self) -> tuple[float, float]:
        """Weft and warp."""
        return self.cell.strain_weft, self.cell.strain_warp


def write_map(rows: Sequence[MapRow], path: Path, details: Path) -> None:
    """Write both tables; each file is whole or as it was before."""
    for kind, target, part in ((Cell, path, "cell"), (Detail, details, "detail")):
        with write_aside(target) as file:
            writer = csv.DictWriter(file, [field.name for field in fields(kind)])
            writer.writeheader()
            writer.writerows(asdict(getattr(row, part)) for row in rows)


def read_map(path: Path, details: Path) -> list[MapRow]:
    """Rows that `write_map` wrote; none where the files are absent. Numbers come back to the bit."""
    if not (path.exists() and details.exists()):
        return []
    cells, more = (_read(kind, file) for kind, file in ((Cell, path), (Detail, details)))
    there = {(detail.strain_weft, detail.strain_warp): detail for detail in more}
    return [MapRow(cell, there[key]) for cell in cells if (key := (cell.strain_weft, cell.strain_warp)) in there]


def _read(kind: type, path: Path) -> list[Any]:
    def value(text: str, annotation: str) -> Any:
        if annotation == "str":
            return text
        if annotation == "int":
            return int(text)
        return float(text) if text else None

    kinds = {field.name: str(field.type) for field in fields(kind)}
    with open(path, newline="", encoding="utf-8") as file:
        return [kind(**{name: value(text, kinds[name]) for name, text in row.items()}) for row in csv.DictReader(file)]


def mean_map(maps: Sequence[Sequence[MapRow]]) -> list[MapRow]:
    """One map of many: means over the seeds that came to rest; of stresses the largest, so that the elastic limit holds for
    all. Strains at which no seed has a row yet are left out."""
    by_strains: dict[tuple[float, float], list[MapRow]] = {}
    for rows in maps:
        for row in rows:
            by_strains.setdefault(row.strains, []).append(row)
    return [_mean(rows) if len(maps) > 1 else rows[0] for rows in by_strains.values()]


def _mean(rows: Sequence[MapRow]) -> MapRow:
    steady = [row for row in rows if row.cell.stop_reason == STEADY]
    weft, warp = rows[0].strains
    reason = STEADY if len(steady) == len(rows) else f"{len(steady)} of {len(rows)} seeds steady" if steady else "diverged"

    def over(part: str, name: str, how: Any = np.mean) -> float | None:
        values = [getattr(getattr(row, part), name) for row in steady]
        return float(how(values)) if values and None not in values else None

    cell = Cell(
        weft, warp, over("cell", "active_percent"), over("cell", "tension_weft_N_per_m"), over("cell", "tension_warp_N_per_m"),
        over("cell", "stress_max_Pa", np.max), over("cell", "yield_fraction"), reason,
    )  # fmt: skip
    deviation = over("cell", "active_percent", lambda values: np.std(values, ddof=1)) if len(steady) > 1 else None
    detail = Detail(
        weft, warp, deviation, over("detail", "active_bodies_percent"), over("detail", "active_rhombus_percent"),
        over("detail", "contact_force_max_N", np.max), over("detail", "stress_interior_max_Pa", np.max),
        over("detail", "residual", np.max), len(steady), sum(row.detail.steps for row in rows),
        next((row.detail.message for row in rows if row.detail.message), ""),
    )  # fmt: skip
    return MapRow(cell, detail)


def grid(rows: Sequence[MapRow], name: str, weft: Sequence[float], warp: Sequence[float]) -> np.ndarray:
    """Values (warp, weft) of a column of map.csv or map_details.csv; nan where there is none."""
    part = "cell" if name in {field.name for field in fields(Cell)} else "detail"
    values = {row.strains: getattr(getattr(row, part), name) for row in rows}
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
    weft = sorted({row.cell.strain_weft for row in rows})
    warp = sorted({row.cell.strain_warp for row in rows})
    active = np.nan_to_num(grid(rows, "active_percent", weft, warp))
    bearable = grid(rows, "stress_max_Pa", weft, warp) <= yield_stress  # not where it is unknown
    padded = np.pad(np.where(bearable, active, 0.0), 1)
    height, width = active.shape
    around = np.stack([padded[i : i + height, j : j + width] for i, j in np.ndindex(3, 3)])
    kept = np.sum(around >= active - SAME_SHARE, axis=0)
    best: tuple[tuple[float, float, float], Optimum] | None = None
    for row in rows:
        cell = row.cell
        numbers = (cell.active_percent, cell.tension_weft_N_per_m, cell.tension_warp_N_per_m, cell.stress_max_Pa)
        share, tension_weft, tension_warp, stress = (math.nan if number is None else number for number in numbers)
        tensile = share > 0.0 and tension_weft > 0.0 and tension_warp > 0.0
        if not (tensile and stress <= yield_stress and cell.stop_reason == STEADY):
            continue
        neighbours = int(kept[warp.index(cell.strain_warp), weft.index(cell.strain_weft)])
        order = (round(share / SAME_SHARE), neighbours, -stress)
        if best is None or order > best[0]:
            margin = 1.0 - stress / yield_stress
            best = order, Optimum(*row.strains, tension_weft, tension_warp, share, stress, margin)
    return None if best is None else best[1]
