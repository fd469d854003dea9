"""Answers from the rows of a run: closing contacts, service tensions, yield, heat, best tension.

Answers are read from the records. An event between two records has the state of the second one, and both as its bounds. With
`output.frames = "auto"` the two are within `output.load_tolerance` of the load. Tensions are known to a tolerance: smaller ones
are zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from .. import measure
from ..measure import MeshModel
from ..measure.contact_classes import classes_of
from ..mesh.tight_loops import tension_error
from ..results.row import Row, Values
from .best_tension import Best, best_tension
from .branches import Event, Jump, Rows, state_of
from .closings import ClassAnswer, class_answer
from .heat import Heat, heat_of
from .history import mean_tension
from .service_tensions import Service, asked_tension, service_shares

PEAK = ("stress_max_part", "stress_max_wire", "stress_max_node", "stress_max_x_m", "stress_max_y_m")
ZERO_TENSION = 0.01  # of EI/C^3: tensions of loose meshes are found to the tolerance of this (mechanics/driven_strain.py)


class Answers(Values):
    """The section `answers` of summary.json, in SI units."""

    contacts: Sequence[ClassAnswer]  # classes of contact
    service: Sequence[Service]  # where the mean of weft and warp first reaches a tension, in each load step
    first_yield: Event | None  # the first record with a largest stress above the yield stress; None: there is none
    first_yield_interior: Event | None  # first yield away from the grips; without a place
    largest_stress: Row  # the largest stress of the run, and its place
    largest_tension: Row  # the state of the largest tension
    asked_tension_N_per_m: float | None  # largest mean tension in the scene; None: no load step gives both
    tension_tolerance_N_per_m: float  # smaller tensions are zero within the tolerance of the equilibria
    tension_error_percent: float | None  # known error of tensions at the preset; None: not known
    heat: Sequence[Heat]  # load steps that change the temperature only: values at begin and end of each
    best: Best | None  # middle of the widest range of tensions with the most active contacts, up to first yield


def zero_tension(model: MeshModel) -> float:
    """Tension [N/m] below which a tension is zero within the tolerance of the equilibria."""
    return ZERO_TENSION * model.scene.solver.residual_tolerance * measure.tension_scale(model)


def answers_of(model: MeshModel, rows: Sequence[Row], jumps: Sequence[Jump] = ()) -> Answers | None:
    """The answers from the rows of a run; None of two hooked wires, which have no tension.

    jumps: neighbouring rows of different branches of equilibria (branches.py).
    """
    if not rows or model.scene.hook is not None:
        return None
    run, scene = Rows(rows, jumps, model.scene.output.load_tolerance), model.scene
    threshold, limit = measure.active_threshold(model), scene.wire.yield_stress
    inner = "stress_interior_max_Pa" if "stress_interior_max_Pa" in rows[0] else "stress_max_Pa"
    first, inside = (next((k for k, row in enumerate(rows) if row[name] > limit), None) for name in ("stress_max_Pa", inner))
    inner_yield = None if inside is None else run.first(inside).changed(stress_max_Pa=rows[inside][inner])
    known = run if inside is None else replace(run, rows=rows[: inside + 1])  # larger loads do not change the best tension
    return Answers(
        contacts=[class_answer(run, name, pairs, threshold, inside) for name, pairs in classes_of(model).items()],
        service=service_shares(run, scene),
        first_yield=None if first is None else run.first(first).changed(**vars(_peak(rows[first]))),
        first_yield_interior=inner_yield,
        largest_stress=_peak(max(rows, key=lambda row: row.stress_max_Pa)),
        largest_tension=state_of(max(rows, key=mean_tension)),
        asked_tension_N_per_m=asked_tension(scene.stages),
        tension_tolerance_N_per_m=zero_tension(model),
        tension_error_percent=tension_error(scene),
        heat=heat_of(rows, scene.stages, jumps),
        best=best_tension(known, limit, inner, inner_yield),
    )


def _peak(row: Row) -> Row:
    """Place and value of the largest stress."""
    return Row(stress_max_Pa=row.stress_max_Pa, **{name: row.get(name) for name in PEAK})
