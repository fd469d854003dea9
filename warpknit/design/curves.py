"""Tension-strain curves: equal strain in both directions, and one direction strained with the other held."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from .. import measure
from ..errors import Diverged
from ..measure import Observables
from ..runner.branches import jumps_of
from ..runner.history import Row, row_of
from ..studies.states import Mesh
from .load_path import LoadPath, part_of, under_strain
from .network import sheet_resistance

POINTS = 12  # of a curve, in addition to the mesh as knitted
LOADS = (("equal", 1.0, 1.0), ("weft_alone", 1.0, 0.0), ("warp_alone", 0.0, 1.0))


@dataclass(frozen=True)
class CurvePoint:
    """A row of tension_strain.csv; None where the mesh did not converge, or does not conduct."""

    load: str  # equal | weft_alone | warp_alone
    strain_weft: float
    strain_warp: float
    tension_weft_N_per_m: float | None  # force per current width
    tension_warp_N_per_m: float | None
    active_percent: float | None
    stress_max_Pa: float | None
    sheet_resistance_weft_ohm: float | None
    sheet_resistance_warp_ohm: float | None
    jump: int  # 1 where the mesh jumps to another equilibrium between the point before and this one


def tension_strain(model: Mesh, weft: float, warp: float, watch: Callable[[float], None] = lambda _: None) -> list[CurvePoint]:
    """The curves of all LOADS up to the strains `weft` and `warp`; with equal strain, up to the smaller one.

    `watch` is called with the share of them that is found.
    """
    levels = math.ceil(model.scene.output.levels / POINTS)  # of the way from one point to the next
    points = []
    for number, (name, along_weft, along_warp) in enumerate(LOADS):
        end = min(weft, warp) if along_weft and along_warp else weft if along_weft else warp
        path = LoadPath(model)
        stage = under_strain(model.scene, np.diag([1.0 + along_weft * end, 1.0 + along_warp * end]))
        found: dict[int, Observables] = {}
        rows: list[Row] = []
        with suppress(Diverged):
            for k, record in enumerate(path.load(stage, levels * POINTS, part_of(watch, number, len(LOADS)))):
                rows.append(row_of(record))
                if k % levels == 0:
                    found[k // levels] = record.observables
        behind = {math.ceil(after.index / levels) for _, after in jumps_of(model, rows)}
        for k, share in enumerate(np.linspace(0.0, 1.0, POINTS + 1).tolist()):
            points.append(_point(name, along_weft * end * share, along_warp * end * share, found.get(k), k in behind))
    return points


def _point(load: str, weft: float, warp: float, state: Observables | None, is_behind_jump: bool) -> CurvePoint:
    jump = int(is_behind_jump)
    if state is None:
        return CurvePoint(load, weft, warp, None, None, None, None, None, None, jump)
    active, stress = measure.contacts(state).active_percent, measure.largest_stress(state)
    return CurvePoint(load, weft, warp, *measure.mesh_tension(state), active, stress, *sheet_resistance(state), jump)
