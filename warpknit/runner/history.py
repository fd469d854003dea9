"""The rows of history.csv, one a recorded state, and the energy balance over them."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np

from .. import measure
from ..base.errors import InputError
from ..measure import MeshModel, table
from ..measure.jumps import STORED_FLOOR
from ..measure.table import Record
from ..results.row import Row, write_rows

Probe = Callable[[Record], float | None]  # a measure of one's own, as a further column

SLACK_STRAIN, SLACK_TENSION = 0.02, 0.1  # strain between two rows, and tension over the next row's, while the mesh is slack


def row_of(record: Record, probes: Mapping[str, Probe] | None = None) -> Row:
    """The row of a record, with its probes if any; `with_sums` adds what depends on the rows before."""
    found = ((line, line.value(record)) for line in table.MEASURES)
    values = {line.name: value for line, value in found if value is not None or line.may_be_empty}
    if probes is not None:
        values["probes"] = {name: probe_value(name, probe, record) for name, probe in probes.items()}
    return Row(**values)


def ends_of(rows: Sequence[Row]) -> list[Row]:
    """The last row of each stage."""
    return list({row.stage: row for row in rows}.values())


def with_slides(row: Row, before: Row) -> Row:
    """Row of a hook with its contact's sliding distance since the previous row."""
    slides = before.hook_is_closed and row.hook_is_closed
    left, right = (
        before[f"slide_{side}_m"] + slides * abs(row[f"arc_{side}_m"] - before[f"arc_{side}_m"]) for side in ("left", "right")
    )
    return row.changed(slide_left_m=left, slide_right_m=right)


def with_sums(rows: Sequence[Row], model: MeshModel) -> Row:
    """The last row with what is computed over all rows so far."""
    row = rows[-1]
    return row.changed(
        kinetic_to_internal=kinetic_to_internal(rows, model),
        energy_balance=missing_work(row, model) / max(row.stored, measure.energy_scale(model)),
        energy_balance_of_stored=energy_balance_of_stored(rows, model),
        penetration_max=max(each.penetration for each in rows),
        stress_max_so_far_Pa=max(each.stress_max_Pa for each in rows),
    )


def kinetic_to_internal(rows: Sequence[Row], model: MeshModel) -> float:
    """Largest kinetic over stored energy: of equilibria, or of a ramp after a tenth of its load."""
    counted = [row for row in rows if (row.steady or row.load_factor > 0.1) and row.stored > 0.0 and row.load_factor > 0.0]
    floor = 1e-12 * measure.energy_scale(model)
    return max((row.energy_kinetic_J / max(row.stored, floor) for row in counted), default=0.0)


def energy_balance_of_stored(rows: Sequence[Row], model: MeshModel) -> float:
    """Missing work, without slack steps, over the largest stored energy so far; 0 where almost none was stored."""
    largest = max(row.stored for row in rows)
    least = STORED_FLOOR * measure.energy_scale(model)
    return sum(missing_steps(rows, model), missing_work(rows[0], model)) / largest if largest > least else 0.0


def missing_steps(rows: Sequence[Row], model: MeshModel) -> list[float]:
    """[J] missing work between neighbouring rows; 0 while the mesh is slack, because two rows do not resolve its force."""
    return [0.0 if is_slack(a, b) else missing_work(b, model) - missing_work(a, model) for a, b in pairwise(rows)]


def missing_work(row: Row, model: MeshModel) -> float:
    """[J] work in less stored, dissipated and kinetic energy; a relaxation has no kinetic one.

    The damping of a ramp counts as dissipated; a relaxation follows equilibria, where damping dissipates nothing.
    """
    kinetic = row.energy_kinetic_J if model.scene.solver.drive == "ramp" else 0.0
    return float(row.work_J - row.stored - row.dissipated_J - kinetic)


def mean_tension(row: Row) -> float:
    """[N/m] mean of weft and warp."""
    return float(0.5 * (row.tension_weft_N_per_m + row.tension_warp_N_per_m))


def is_slack(before: Row, after: Row) -> bool:
    """Whether the mesh is slack for most of the way between two rows."""
    step = max(abs(after[name] - before[name]) for name in ("strain_weft", "strain_warp"))
    return step > SLACK_STRAIN and mean_tension(before) < SLACK_TENSION * mean_tension(after)


def stages_of(rows: Sequence[Row]) -> Iterator[list[Row]]:
    """The rows of each stage, after the last row of the stage before."""
    begin = 0
    for end in range(1, len(rows)):
        if end + 1 == len(rows) or rows[end + 1].stage != rows[end].stage:
            yield list(rows[begin : end + 1])
            begin = end


def work_terms(rows: Sequence[Row], area: float) -> tuple[np.ndarray, np.ndarray]:
    """Forces and their displacements (row, component), whose products are work [J]. area [m2]: of the mesh as knitted."""
    force = np.array([[area * r.nominal_weft_N_per_m, area * r.nominal_shear_N_per_m, area * r.nominal_warp_N_per_m,
                       area * r.clamp_couple_N_per_m, r.thermal_force_J] for r in rows])  # fmt: skip
    place = np.array([[r.strain_weft, r.shear, r.strain_warp, r.clamp_rotation, r.length_factor] for r in rows])
    return force, place


def write_history(path: Path, rows: Sequence[Row], *before: str) -> None:
    """Write all rows, atomically: columns `before`, measures of the first row, ranges of several meshes, and probes."""
    columns = [line.name for line in table.MEASURES if line.history and line.name in rows[0]]
    columns += [name for name in vars(rows[0]) if name.startswith(("p10_", "p90_")) and name[4:] in columns]
    write_rows(path, [row.changed(**row.probes) for row in rows], [*before, *columns, *rows[0].probes])


# --- probes


def checked_probes(functions: Mapping[str, Probe] | None) -> dict[str, Probe]:
    """Named functions of a `Record`. Raises `InputError` for the name of a column, and for a value that is no function."""
    if not isinstance(functions, Mapping | None):
        raise InputError(f"probes: {functions!r} is not a dict; give functions of a record by name, {{'name': function}}")
    taken = {line.name for line in table.MEASURES}
    for name, function in (functions or {}).items():
        if not isinstance(name, str) or not name.strip() or not name.isprintable() or name in taken:
            raise InputError(f"probes: {name!r} cannot name a column; give one line of text that is no column of history.csv")
        if not callable(function):
            raise InputError(f"probes: {name}: {function!r} is not a function; give a function of a record")
    return dict(functions or {})


def probe_value(name: str, probe: Probe, record: Record) -> float | None:
    """Value of a record; None, an empty cell of the history, for nan and infinity too. Raises `InputError` for no number."""
    value: object = probe(record)
    if hasattr(value, "item"):  # an array of one element, or a number of NumPy
        with suppress(ValueError, RuntimeError):
            value = value.item()
    if not isinstance(value, numbers.Real | None):
        raise InputError(f"probes: {name}: {value!r} at record {record.index} is not a number; return one, or None")
    return float(value) if value is not None and math.isfinite(value) else None
