"""Tension-strain curves: equal strain in both directions, and one direction strained with the other held."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .. import measure
from ..errors import Diverged
from ..measure import Observables
from ..sweep.states import Mesh
from .fine_states import states_at
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


def tension_strain(model: Mesh, weft: float, warp: float, watch: Callable[[float], None] = lambda _: None) -> list[CurvePoint]:
    """The curves of all LOADS up to the strains `weft` and `warp`; with equal strain, up to the smaller one.

    `watch` is called with the share of them that is found.
    """
    wanted = []
    for name, along_weft, along_warp in LOADS:
        end = min(weft, warp) if along_weft and along_warp else weft if along_weft else warp
        shares = np.linspace(0.0, 1.0, POINTS + 1)
        wanted += [(name, float(along_weft * end * share), float(along_warp * end * share)) for share in shares]
    states = states_at(model, [np.diag([1.0 + x, 1.0 + y]) for _, x, y in wanted], watch)
    return [_point(*place, state) for place, state in zip(wanted, states, strict=True)]


def loading_path(model: Mesh, weft: float, warp: float, watch: Callable[[float], None] = lambda _: None) -> list[CurvePoint]:
    """States in proportion to the strains `weft` and `warp`, up to one step beyond; without the two ends of the way there.

    `watch` is called with the share of them that is found.
    """
    shares = [k / POINTS for k in range(1, POINTS + 2) if k != POINTS]
    states = states_at(model, [np.diag([1.0 + share * weft, 1.0 + share * warp]) for share in shares], watch)
    return [_point("loading", share * weft, share * warp, state) for share, state in zip(shares, states, strict=True)]


def _point(load: str, weft: float, warp: float, state: Observables | Diverged) -> CurvePoint:
    if isinstance(state, Diverged):
        return CurvePoint(load, weft, warp, None, None, None, None, None, None)
    active, stress = measure.contacts(state).active_percent, measure.stress_extremes(state)[0]
    return CurvePoint(load, weft, warp, *measure.mesh_tension(state), active, stress, *sheet_resistance(state))
