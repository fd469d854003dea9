"""The rows of history.csv, one a recorded state, and the energy balance over them."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..base.files import write_aside
from ..measure import MeshModel, table
from ..measure.table import Record


class Row(SimpleNamespace):
    """One recorded state in SI units: the columns of history.csv by their names (measure/table.py), in their order."""

    @property
    def stored(self) -> float:
        """[J]"""
        return float(self.energy_stretch_J + self.energy_bend_J + self.energy_contact_J)

    @property
    def is_hook(self) -> bool:
        """Whether the row is of two hooked wires."""
        return "displacement_m" in vars(self)

    @property
    def hook_is_closed(self) -> bool:
        """Whether both contacts of the hook carry force."""
        return bool(self.force_left_N > 0.0 and self.force_right_N > 0.0)


def row_of(record: Record) -> Row:
    """The row of a record; `add_work` (work.py) and `add_sliding` fill in work and sliding distance."""
    found = ((line, line.value(record)) for line in table.MEASURES if line.history)
    return Row(**{line.name: value for line, value in found if value is not None or line.may_be_empty})


def extra_columns(names: Iterable[str]) -> list[str]:
    """Columns that are no measures: those of probes."""
    known = {line.name for line in table.MEASURES}
    return [name for name in names if name not in known]


def history_columns(path: Path) -> list[str]:
    """Headings of a history.csv."""
    with open(path, newline="", encoding="utf-8") as file:
        return next(csv.reader(file), [])


def add_sliding(rows: Sequence[Row]) -> None:
    """Fill in the sliding distance of a hook's contact in the last row."""
    if len(rows) < 2 or not rows[-1].is_hook:
        return
    before, now = rows[-2:]
    slides = before.hook_is_closed and now.hook_is_closed
    now.slide_left_m = before.slide_left_m + slides * abs(now.arc_left_m - before.arc_left_m)
    now.slide_right_m = before.slide_right_m + slides * abs(now.arc_right_m - before.arc_right_m)


def missing_work(row: Row, model: MeshModel) -> float:
    """[J] work in less stored, dissipated and kinetic energy; a relaxation has no kinetic one."""
    kinetic = row.energy_kinetic_J if model.scene.solver.drive == "ramp" else 0.0
    return float(row.work_J - row.stored - row.dissipated_J - kinetic)


def mean_tension(row: Row) -> float:
    """[N/m] mean of weft and warp."""
    return float(0.5 * (row.tension_weft_N_per_m + row.tension_warp_N_per_m))


def stages_of(rows: Sequence[Row]) -> Iterator[list[Row]]:
    """The rows of each stage, after the last row of the stage before."""
    begin = 0
    while begin < len(rows) - 1:
        end = begin + 1
        while end + 1 < len(rows) and rows[end + 1].stage == rows[end].stage:
            end += 1
        yield list(rows[begin : end + 1])
        begin = end


def work_terms(rows: Sequence[Row], area: float) -> tuple[np.ndarray, np.ndarray]:
    """Forces and their displacements (row, component), whose products are work [J]. area [m2]: of the mesh as knitted."""
    force = np.array([[area * r.nominal_weft_N_per_m, area * r.nominal_shear_N_per_m, area * r.nominal_warp_N_per_m,
                       area * r.clamp_couple_N_per_m, r.thermal_force_J] for r in rows])  # fmt: skip
    place = np.array([[r.strain_weft, r.shear, r.strain_warp, r.clamp_rotation, r.length_factor] for r in rows])
    return force, place


def write_history(path: Path, rows: list[Row]) -> None:
    """Write all rows, atomically."""
    with write_aside(path) as file:
        writer = csv.DictWriter(file, list(vars(rows[0])))
        writer.writeheader()
        writer.writerows(vars(row) for row in rows)


def read_history(path: Path) -> list[Row]:
    """Rows of a history.csv that `write_history` wrote, bit-identical; columns of probes are numbers or None."""
    kinds = {line.name: line.kind for line in table.MEASURES}

    def value(name: str, text: str) -> Any:
        return kinds.get(name, table.number_or_none)(text)

    with open(path, newline="", encoding="utf-8") as file:
        return [Row(**{name: value(name, text) for name, text in row.items()}) for row in csv.DictReader(file)]
