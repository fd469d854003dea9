"""Rows of a run, its snap-throughs by measure/jumps.py, and their work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from ..base.text import both, engineering
from ..measure import MeshModel, energy_scale
from ..measure.jumps import STORED_FLOOR, jumps
from ..results.row import Row
from .history import is_slack, mean_tension, stages_of, work_terms

FOLLOWING = (("strain_weft", "strain_warp"), ("tension_weft_N_per_m", "tension_warp_N_per_m"))
HEAT_JUMP = 20.0  # strain of a mesh over free wire's, beyond which another equilibrium was found
HELD_STRAIN, HELD_TENSION = 2e-3, 0.02  # a frame expands by less over 200 K; tensions are found to less, of themselves
STATE = ("strain_weft", "strain_warp", "tension_weft_N_per_m", "tension_warp_N_per_m", "temperature_K")
Jump = tuple[Row, Row]  # neighbouring states of different branches
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(3)  # exact for the fifth degree: a cubic force times the slope of a cubic


class Event(Row):
    """An event between two records: state and load step of the second, and its uncertainty."""

    as_knitted: bool  # true where the event is already in the first record
    resolved: bool  # false where the records `between` are farther apart than `output.load_tolerance`, at a snap-through
    # between them, or where the mesh is slack
    between: Sequence[Row]  # the records before and after the event
    jump: bool  # whether there is a snap-through between them
    slack: bool  # whether the mesh is slack for most of the way between them


def state_of(row: Row, *names: str) -> Row:
    """Strains, tensions and temperature of a row, and its columns `names`."""
    return Row(**{name: row[name] for name in (*STATE, *names)})


def row_between(before: Row, after: Row, share: float, *names: str) -> Row:
    """State, stress and columns `names` between two rows; contacts of the nearest row."""
    values = {name: (1.0 - share) * before[name] + share * after[name] for name in (*STATE, "stress_max_Pa", *names)}
    return Row(**values, stage=after.stage, active_percent=(before if share < 0.5 else after).active_percent)


def ranges_of(flags: Sequence[bool]) -> list[range]:
    """Ranges of neighbouring rows whose flag is set."""
    return [range(*ends) for ends in np.flatnonzero(np.diff([False, *flags, False])).reshape(-1, 2).tolist()]


@dataclass(frozen=True)
class Rows:
    """Rows of a run in order, the source of answers."""

    rows: Sequence[Row]
    jumps: Sequence[Jump] = ()
    tolerance: float = 0.02  # share of the load of a stage: two rows so near give the place of what happens between them

    def is_jump(self, before: Row, after: Row) -> bool:
        """Whether a snap-through lies between two neighbouring rows."""
        return any(one is before and other is after for one, other in self.jumps)

    def is_near(self, before: Row, after: Row) -> bool:
        """Whether two rows are near enough to locate an event between them."""
        begin = before.load_factor if before.stage == after.stage else 0.0
        is_narrow = after.load_factor - begin <= self.tolerance * (1.0 + 1e-9)
        return is_narrow and not self.is_jump(before, after) and not is_slack(before, after)

    def first(self, k: int) -> Event:
        """Event between row k and the previous row."""
        before, after = self.rows[max(k - 1, 0)], self.rows[k]
        return Event(
            **vars(state_of(after, "stage")), as_knitted=k == 0, resolved=k == 0 or self.is_near(before, after),
            between=[state_of(before), state_of(after)], jump=self.is_jump(before, after),
            slack=k > 0 and is_slack(before, after),
        )  # fmt: skip


def jumps_of(model: MeshModel, rows: Sequence[Row]) -> list[Jump]:
    """Jumps within the stages of a quasi-static run, each along its load factor; none of a hook, or of a ramp."""
    if model.scene.hook is not None or model.scene.solver.drive != "relax":
        return []
    found: list[Jump] = []
    for part in stages_of(rows):
        along = jumps_along(model, part, np.array([0.0, *(row.load_factor for row in part[1:])]))
        behind = {id(after) for _, after in (*along, *jumps_in_heat(part, model.scene.wire.expansion))}
        found += [(before, after) for before, after in pairwise(part) if id(after) in behind]
    return found


def is_heated(part: Sequence[Row]) -> bool:
    """Whether a load step changes only temperature: strain or tension is held both ways."""
    begin, end = part[0], part[-1]
    held = [abs(end[name] - begin[name]) <= HELD_STRAIN for name in FOLLOWING[0]]  # no strain but the frame's
    pulled = [abs(end[name] - begin[name]) <= HELD_TENSION * max(abs(begin[name]), abs(end[name])) for name in FOLLOWING[1]]
    return begin.temperature_K != end.temperature_K and all(map(any, zip(held, pulled, strict=True)))


def jumps_in_heat(part: Sequence[Row], expansion: float) -> list[Jump]:
    """Neighbouring rows of a heated load step with far more strain than free wire (`expansion` [1/K])."""

    def jumped(before: Row, after: Row) -> bool:
        free = abs(expansion * (after.temperature_K - before.temperature_K))
        strain = max(abs(after.strain_weft - before.strain_weft), abs(after.strain_warp - before.strain_warp))
        return strain > max(HEAT_JUMP * free, HELD_STRAIN)

    return [both for both in pairwise(part) if jumped(*both)] if is_heated(part) else []


def jumps_under_tension(model: MeshModel, rows: Sequence[Row]) -> list[Jump]:
    """Jumps of a mesh under equal tensions, along its mean tension; only states above all earlier ones count."""
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
        values=[np.array([[row[name] for name in names] for row in rows]) for names in FOLLOWING],
        floor=STORED_FLOOR * energy_scale(model),
    )
    return [(rows[k], rows[k + 1]) for k in np.flatnonzero(found).tolist()]


def tensions_text(one: Row, other: Row) -> str:
    """Mean tensions of weft and warp of two rows."""
    return both(*(engineering(mean_tension(row), "N/m") for row in (one, other)))


def with_work(rows: Sequence[Row], model: MeshModel) -> list[Row]:
    """Rows of a relaxation with the work of its load, along branches and between.

        W = integral of A0 P : dF + (thermal force) d(length factor),      the work of a quasi-static load.

    Along one branch forces and displacements are monotone cubics (PCHIP) through the states. Where both are monotone between two
    states, so are the curves, and their work lies within the bounds of measure/jumps.py. Between two branches the curve is
    unknown, and the work is computed from the mean force. Energy lost there shows as a difference from the stored energy.
    """
    if model.scene.solver.drive != "relax" or not rows:
        return list(rows)
    behind = {id(after) for _, after in jumps_of(model, rows)}
    done = [rows[0].changed(work_J=rows[0].stored)]
    for part in stages_of(rows):
        force, place = work_terms(part, model.panel.area)
        jumps = np.array([id(row) in behind for row in part[1:]])
        for after, step in zip(part[1:], work_steps(force, place, jumps).tolist(), strict=True):
            done.append(after.changed(work_J=done[-1].work_J + step + after.edge_work_J - done[-1].edge_work_J))
    return done


def work_steps(force: NDArray[np.float64], place: NDArray[np.float64], jumps: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(state - 1,) [J] work from each state to the next.

    force (state, component), place (state, component): their products are energies [J]. jumps: (state - 1,) whether a state and
    the next are of different branches.
    """
    work = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(place, axis=0), axis=1)
    ends = [0, *(np.flatnonzero(jumps) + 1).tolist(), len(force)]
    for begin, end in pairwise(ends):
        if end - begin > 2:
            work[begin : end - 1] = _along_branch(force[begin:end], place[begin:end])
    return work


def _along_branch(force: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """(state - 1,) [J] work between neighbouring states of one branch."""
    path = np.arange(len(force), dtype=float)
    inside = path[:-1, None] + 0.5 * (1.0 + POINTS)
    power = np.sum(PchipInterpolator(path, force)(inside) * PchipInterpolator(path, place).derivative()(inside), axis=2)
    return np.asarray(power @ (0.5 * WEIGHTS))
