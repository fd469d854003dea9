"""Tension-strain curves: both directions strained together, and one strained with the other held."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..base.errors import Diverged
from ..measure import Observables, table
from ..measure.network import sheet_resistance
from ..results.finding import ResultWarning
from ..results.row import Row
from ..runner.branches import jumps_of
from ..runner.history import row_of
from ..runner.variants import mean_row
from .load_path import Load, Meshes, Monitor, follow, levels_of, under_strain

POINTS = 12  # of a curve, in addition to the mesh as knitted
MEASURED = ("tension_weft_N_per_m", "tension_warp_N_per_m", "active_percent", "stress_max_Pa")
LOADS = (("both", 1.0, 1.0), ("weft_alone", 1.0, 0.0), ("warp_alone", 0.0, 1.0))


def tension_strain(meshes: Meshes, weft: float, warp: float, monitor: Monitor = lambda _: None) -> list[Row]:
    """The curves of all LOADS up to the strains `weft` and `warp`; both together grow in proportion.

    Curves of several meshes are means with the ranges of eight in ten. `monitor` is called with the completed share.
    """
    meshes = replace(meshes, models={place: meshes.models[place] for place in meshes.own}, again={})
    scene, points = meshes.scene, []
    levels = math.ceil(scene.output.levels / POINTS)  # of the way from one point to the next
    ends = [(name, under_strain(scene, np.diag([1.0 + x * weft, 1.0 + y * warp]))) for name, x, y in LOADS]
    followed = iter(
        follow([Load(place, mesh, end) for _, end in ends for place, mesh in meshes.models.items()], levels * POINTS, monitor)
    )
    for name, along_weft, along_warp in LOADS:
        found: dict[int, list[Observables]] = {}
        rows: list[Row] = []
        with suppress(Diverged):
            for k, records in enumerate(levels_of({place: next(followed) for place in meshes.models}, meshes)):
                rows.append(row_of(next(iter(records.values()))))
                if k % levels == 0:
                    found[k // levels] = [record.observables for record in records.values()]
        behind = {math.ceil(after.index / levels) for _, after in meshes.jumps(jumps_of, rows)}
        for k, share in enumerate(np.linspace(0.0, 1.0, POINTS + 1).tolist()):
            strains = along_weft * weft * share, along_warp * warp * share
            points.append(_mean_point([_point(name, *strains, state, k in behind) for state in found.get(k, [None])]))
    columns = dict.fromkeys(name for point in points for name in vars(point))
    return [Row(**dict.fromkeys(columns) | vars(point)) for point in points]


def _mean_point(points: Sequence[Row]) -> Row:
    """The mean of points of several meshes, with its ranges."""
    if len(points) == 1:
        return points[0]
    mean = mean_row([point.changed(variant=None, steps=0) for point in points], 0)
    ranges = (f"{end}_{name}" for name in MEASURED for end in ("p10", "p90"))
    return Row(**{name: mean[name] for name in (*vars(points[0]), *ranges)})


def missing_points(curves: Sequence[Row]) -> Iterator[ResultWarning]:
    """Warning on missing states of the curves."""
    if missing := sum(point.tension_weft_N_per_m is None for point in curves):
        yield ResultWarning("W58", f"{missing} of {len(curves)} states of the curves of tension against strain are missing.")


def _point(load: str, weft: float, warp: float, state: Observables | None, is_behind_jump: bool) -> Row:
    """A row of tension_strain.csv; None where the mesh did not converge, or does not conduct."""
    found = dict.fromkeys(MEASURED) if state is None else table.values(state, MEASURED)
    sheet = (None, None) if state is None else sheet_resistance(state)
    resistances = {f"sheet_resistance_{side}_ohm": value for side, value in zip(("weft", "warp"), sheet, strict=True)}
    # jump: 1 after a snap-through since the previous point
    return Row(load=load, strain_weft=weft, strain_warp=warp, **found, **resistances, jump=int(is_behind_jump))
