"""Changes of a run from one branch of equilibria to another, by the rules of measure/jumps.py."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..measure import MeshModel, energy_scale
from ..measure.jumps import STORED_FLOOR, jumps
from ..text import engineering
from .history import Row, mean_tension, stages_of, work_terms

FOLLOWING = (("strain_weft", "strain_warp"), ("tension_weft_N_per_m", "tension_warp_N_per_m"))
Jump = tuple[Row, Row]  # neighbouring states of different branches


def jumps_of(model: MeshModel, rows: Sequence[Row]) -> list[Jump]:
    """Jumps within the stages of a quasi-static run, each along its load factor; none of a hook, or of a ramp."""
    if model.scene.hook is not None or model.scene.solver.drive != "relax":
        return []
    paths = ((part, [0.0, *(row.load_factor for row in part[1:])]) for part in stages_of(rows))
    return [jump for part, path in paths for jump in jumps_along(model, part, np.array(path))]


def jumps_under_tension(model: MeshModel, rows: Sequence[Row]) -> list[Jump]:
    """Jumps of a mesh under equal tensions, along its mean tension; states that are not above all before are left out."""
    tensions = np.maximum.accumulate([mean_tension(row) for row in rows])
    rising = [row for row, more in zip(rows, np.diff(tensions, prepend=-1.0) > 0.0, strict=True) if more]
    return jumps_along(model, rising, np.array([mean_tension(row) for row in rising]))


def jumps_along(model: MeshModel, rows: Sequence[Row], path: np.ndarray) -> list[Jump]:
    """Jumps between neighbouring rows. path (row,): increasing parameter of the load."""
    if len(rows) < 2:
        return []
    force, place = work_terms(rows, model.panel.area)
    found = jumps(
        path,
        force,
        place,
        stored=np.array([row.stored for row in rows]),
        dissipated=np.array([row.dissipated_J - row.edge_work_J for row in rows]),
        values=[np.array([[vars(row)[name] for name in names] for row in rows]) for names in FOLLOWING],
        floor=STORED_FLOOR * energy_scale(model),
    )
    return [(rows[k], rows[k + 1]) for k in np.flatnonzero(found).tolist()]


def tensions_text(one: Row, other: Row) -> str:
    """Mean tensions of weft and warp of two rows."""
    return " and ".join(engineering(mean_tension(row), "N/m") for row in (one, other))
