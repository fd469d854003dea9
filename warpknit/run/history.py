"""The rows of history.csv, one a recorded state, and the energy balance over them."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from .. import measure
from ..files import write_aside
from ..planar.hook_contact import HookContact, hook_contact
from ..solve.simulate import Record


@dataclass
class Row:
    """One recorded state in SI units; the columns of history.csv."""

    index: int
    stage: str
    load_factor: float
    strain_weft: float
    strain_warp: float
    shear: float
    clamp_rotation: float  # [rad]
    temperature_K: float
    active_pairs: int
    active_percent: float
    active_rhombus_percent: float
    tension_weft_N_per_m: float
    tension_warp_N_per_m: float
    stress_max_Pa: float
    contact_force_max_N: float
    energy_stretch_J: float
    energy_bend_J: float
    energy_contact_J: float
    energy_kinetic_J: float
    work_J: float
    edge_work_J: float  # of it, by pulls at the edge, cords and uneven warmth
    dissipated_J: float  # by the damping of a ramp, or by friction
    residual: float
    penetration: float
    steps: int
    steady: bool
    nominal_weft_N_per_m: float  # work-conjugate of strain_weft, per rest width
    nominal_shear_N_per_m: float
    nominal_warp_N_per_m: float
    clamp_couple_N_per_m: float  # work-conjugate of clamp_rotation, per rest area
    length_factor: float  # 1 + alpha (T - T0)
    thermal_force_J: float  # work-conjugate of length_factor

    @property
    def stored(self) -> float:
        """[J]"""
        return self.energy_stretch_J + self.energy_bend_J + self.energy_contact_J


@dataclass
class HookRow(Row):
    """The same of two hooked wires; see hook_contact.py."""

    displacement_m: float
    drive_force_N: float
    force_left_N: float
    force_right_N: float
    arc_left_m: float
    arc_right_m: float
    slide_left_m: float  # way of the closed contact along the wire, there and back
    slide_right_m: float
    ground_force_N: float
    body_x_m: float
    body_y_m: float

    @property
    def is_closed(self) -> bool:
        return self.force_left_N > 0.0 and self.force_right_N > 0.0


def row_of(record: Record) -> Row:
    """What history.csv keeps of a record; `work_J` is filled in by `account_work` unless the drive kept account, and the way of
    a hook's contact by `account_sliding`."""
    row = _mesh_row(record)
    if record.observables.model.scene.hook is None:
        return row
    return hook_row(row, hook_contact(record.observables))


def hook_row(row: Row, hook: HookContact) -> HookRow:
    """The row of two hooked wires, before `account_sliding`."""
    return HookRow(
        **asdict(row),
        displacement_m=hook.displacement,
        drive_force_N=hook.drive_force,
        force_left_N=hook.force_left,
        force_right_N=hook.force_right,
        arc_left_m=hook.arc_left,
        arc_right_m=hook.arc_right,
        slide_left_m=0.0,
        slide_right_m=0.0,
        ground_force_N=hook.ground_force,
        body_x_m=float(hook.body[0]),
        body_y_m=float(hook.body[1]),
    )


def account_sliding(rows: Sequence[Row]) -> None:
    """Fill in how far a hook's contact has slid at the last row, from the rows before."""
    if len(rows) < 2:
        return
    before, now = rows[-2:]
    if isinstance(before, HookRow) and isinstance(now, HookRow):
        slides = before.is_closed and now.is_closed
        now.slide_left_m = before.slide_left_m + slides * abs(now.arc_left_m - before.arc_left_m)
        now.slide_right_m = before.slide_right_m + slides * abs(now.arc_right_m - before.arc_right_m)


def _mesh_row(record: Record) -> Row:
    r = record.observables
    f = r.stretch
    energy = measure.energies(r)
    contact = measure.contacts(r)
    rhombus = measure.contacts(r, r.model.panel.rhombus_bodies)
    tension = measure.mesh_tension(r)
    nominal = measure.boundary_stress(r)
    return Row(
        index=record.index,
        stage=record.stage,
        load_factor=record.load_factor,
        strain_weft=float(f[0, 0] - 1.0),
        strain_warp=float(f[1, 1] - 1.0),
        shear=float(f[0, 1]),
        clamp_rotation=r.clamp_rotation,
        temperature_K=record.temperature,
        active_pairs=contact.active,
        active_percent=contact.active_percent,
        active_rhombus_percent=rhombus.active_percent,
        tension_weft_N_per_m=tension[0],
        tension_warp_N_per_m=tension[1],
        stress_max_Pa=measure.stress_extremes(r)[0],
        contact_force_max_N=float(r.pair_force.max(initial=0.0)),
        energy_stretch_J=energy.stretch,
        energy_bend_J=energy.bend,
        energy_contact_J=energy.contact,
        energy_kinetic_J=energy.kinetic,
        work_J=record.work if record.work is not None else 0.0,
        edge_work_J=record.edge_work,
        dissipated_J=record.dissipated,
        residual=measure.residual(r),
        penetration=measure.penetration(r),
        steps=record.steps,
        steady=record.steady,
        nominal_weft_N_per_m=float(nominal[0, 0]),
        nominal_shear_N_per_m=float(nominal[0, 1]),
        nominal_warp_N_per_m=float(nominal[1, 1]),
        clamp_couple_N_per_m=measure.clamp_couple(r),
        length_factor=r.length_factor,
        thermal_force_J=measure.thermal_force(r),
    )


def account_work(rows: list[Row], model: Any) -> None:
    """Fill in the work of a relaxation: the work along the steady states, by a cubic spline through each stage's rows.

    W = integral of A0 P : dF + (thermal force) d(length factor). The states are steady, so this is the work of a load put on
    slowly; what a snap from one state to another loses shows as a difference to the stored energy.
    """
    if model.scene.solver.drive != "relax" or not rows:
        return
    area = model.panel.area
    rows[0].work_J = rows[0].stored
    begin = 0
    while begin < len(rows) - 1:
        end = begin + 1
        while end + 1 < len(rows) and rows[end + 1].stage == rows[end].stage:
            end += 1
        part = rows[begin : end + 1]  # the last row of the stage before starts this one
        force = np.array([[area * r.nominal_weft_N_per_m, area * r.nominal_shear_N_per_m, area * r.nominal_warp_N_per_m,
                           area * r.clamp_couple_N_per_m, r.thermal_force_J] for r in part])  # fmt: skip
        place = np.array([[r.strain_weft, r.shear, r.strain_warp, r.clamp_rotation, r.length_factor] for r in part])
        path = np.arange(len(part), dtype=float)
        if len(part) > 3:
            speed = CubicSpline(path, place).derivative()
            power = CubicSpline(path, np.sum(force * speed(path), axis=1))
            work = np.array([power.integrate(0.0, s) for s in path])
        else:
            work = np.concatenate([[0.0], np.cumsum(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(place, axis=0), axis=1))])
        for r, w in zip(part[1:], work[1:], strict=True):
            r.work_J = part[0].work_J + float(w) + r.edge_work_J - part[0].edge_work_J
        begin = end


def write_history(path: Path, rows: list[Row]) -> None:
    """Write all rows; the file is whole or as it was before."""
    with write_aside(path) as file:
        writer = csv.DictWriter(file, [f.name for f in fields(rows[0] if rows else Row)])
        writer.writeheader()
        writer.writerows(asdict(r) for r in rows)


def read_history(path: Path) -> list[Row]:
    """Rows of a history.csv that `write_history` wrote; numbers come back to the bit."""
    types: dict[str, Callable[[str], Any]] = {"int": int, "float": float, "str": str, "bool": lambda v: v == "True"}
    with open(path, newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        kind = HookRow if "displacement_m" in (reader.fieldnames or ()) else Row
        kinds = {f.name: types[str(f.type)] for f in fields(kind)}
        return [kind(**{name: kinds[name](value) for name, value in row.items()}) for row in reader]
