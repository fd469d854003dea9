"""Knots and clasps of elastic rods, against published theory and measurements.

    python tools/studies/knots.py knots [DIR] [--jobs N]   # 40 min, --quick 2: overhand knots of one to four turns, with friction
    python tools/studies/knots.py friction [DIR]           # 2 min: friction by the spacing of nodes and the steps of an increment
    python tools/studies/knots.py clasp [DIR]              # 5 min: two hooked rods pulled apart: where they press
    python tools/studies/knots.py trefoil [DIR]            # 5 min: a closed trefoil that grows thicker

*knots* leaves knots.csv and goes on with the knots that are missing there; a new DIR runs all. --jobs computes several at once.

A knot is tied in a straight rod whose ends are clamped along x and moved apart. All lengths are over the radius h of the rod and
forces over B/h^2, so that material and diameter do not count, but for the stretch of the rod and the ratio of GJ to EI (Poisson's
ratio 0.3). The loop radius is R = S/(2 pi) with the end-to-end shortening S, the length of the rod less the distance of its ends,
and e^2 = h/R. Theory: knot_braid.py (loose knots), knot_long.py (long ones that slide).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from clasps import clasp_rows, draw_clasp
from knot_braid import braid
from knot_curves import DIAMETER, overhand, pulled
from knot_long import sliding_contact_force
from knot_pictures import draw_knots, draw_trefoil
from study import add_directory, picture_path, read_rows, run_one_of, show_rows, table_path, write_rows
from trefoil import tightened_trefoil

from warpknit.base.errors import Diverged
from warpknit.compute.device import start_warp
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Record, Simulation
from warpknit.spatial import mechanics
from warpknit.spatial.contact_arrays import Contacts
from warpknit.spatial.model import SpatialModel

RADIUS = 0.5 * DIAMETER
TAIL = 4.0  # loop radii; the deflection of a tail falls as exp(-s/(1.4 R)) or faster


@dataclass(frozen=True)
class Case:
    """A knot that is pulled tight: loop radius at the start [d], end strain, node spacing [d], friction coefficient."""

    turns: int
    radius: float
    strain: float
    spacing: float
    friction: float = 0.0
    levels: int = 6
    loosened: float | None = None  # strain to which it goes back
    tolerance: float = 5e-3

    @property
    def key(self) -> tuple[float, ...]:
        return self.turns, self.radius, self.spacing, self.friction, self.tolerance


FRICTIONS = (0.1, 0.2, 0.3)
SPACINGS = (1.5, 2.0, 3.0)  # [d]
LOAD_STEPS = (200, 1600)  # the usual number, and eight times that number
CASES = (
    *(Case(4, 80.0, 0.05, 1.5, friction, 2, tolerance=2e-2) for friction in FRICTIONS),
    *(Case(3, 60.0, 0.075, 1.5, friction, 3, tolerance=2e-2) for friction in FRICTIONS),
    *(Case(2, 20.0, 0.20, 1.0, friction, 4, tolerance=1e-2) for friction in FRICTIONS),
    Case(2, 40.0, 0.50, 1.0, levels=4, tolerance=1e-2),
    Case(4, 80.0, 0.42, 2.0, levels=3, tolerance=1e-2),
    Case(3, 60.0, 0.45, 1.5, levels=3, tolerance=1e-2),
    Case(1, 40.0, 0.25, 1.0, levels=3),
    Case(2, 400.0, 0.01, 4.0, levels=1, tolerance=1e-2),
    Case(1, 12.0, 0.50, 0.5, levels=4, loosened=0.38),
    Case(2, 20.0, 0.30, 1.0, levels=3, tolerance=1e-2),
    Case(2, 150.0, 0.01, 2.0, levels=1, tolerance=1e-2),
    Case(1, 20.0, 0.58, 1.0, levels=8),
    Case(1, 12.0, 0.50, 1.0, levels=4, loosened=0.38),
    Case(1, 400.0, 0.01, 4.0, levels=1),
    Case(1, 150.0, 0.01, 2.0, levels=1),
    Case(1, 12.0, 0.50, 1.0, 0.1, 2, 0.38),
    *(Case(1, 20.0, 0.58, 1.0, friction, 3) for friction in FRICTIONS),
)
LENGTHS = (24.0, 21.0, 19.0, 18.0, 17.5, 17.0, 16.8, 16.6, 16.5, 16.4, 16.3)  # L/d of the closed trefoil
QUICK = (Case(1, 12.0, 0.4, 1.0, 0.0, 3), Case(1, 12.0, 0.4, 1.0, 0.2, 3))


@dataclass(frozen=True)
class Row:
    """One state of one knot. Forces are over B/h^2."""

    turns: int
    friction: float
    way: str  # tighten | loosen
    radius_d: float  # of the loop as drawn
    spacing_d: float
    tolerance: float
    e: float  # sqrt(h/R)
    loop_radius_h: float
    force: float
    force_radius: float  # F R^2/B
    energy_force: float  # F R^2/B without friction at this e, -dE/dS by the energies of all states with this number of turns
    theory: float  # F h^2/B to first order in e and friction
    long_knot: float  # F h^2/B of a long knot that slides, knot_long.py; 0 without friction
    contact_force: float  # of all contacts
    friction_share: float  # what friction adds to the energy force, over friction times contact force
    energy: float  # of bending and twist, h/B
    line_share: float  # of the contact force, at contacts along a line
    contacts: int
    overlap_d: float
    steps: int
    cpu_s: float  # of the processor, since the knot was drawn

    @property
    def key(self) -> tuple[float, ...]:
        """Key of its case."""
        return self.turns, self.radius_d, self.spacing_d, self.friction, self.tolerance


def end_force(record: Record) -> float:
    """[N] pull along x, mean of both clamps."""
    pull = record.observables.edge_force[:, 0]
    return float(0.5 * (pull[-1] - pull[0]))


def row_of(model: SpatialModel, record: Record, case: Case, way: str, cpu: float) -> Row:
    o, b = record.observables, model.rods.section.bending_stiffness
    shortening = float(model.rods.wire_length[0] - np.linalg.norm(o.position[-1] - o.position[0]))
    e = float(np.sqrt(2.0 * np.pi * RADIUS / shortening))
    force, signed = end_force(record) * RADIUS**2 / b, case.friction if way == "tighten" else -case.friction
    return Row(
        case.turns, case.friction, way, case.radius, case.spacing, case.tolerance, e, e**-2, force, force / e**4, np.nan,
        float(braid(case.turns).force(e, signed)), signed * float(sliding_contact_force(case.turns, e)),
        float(o.touching.force.sum()) * RADIUS**2 / b, np.nan, o.energies.stored * RADIUS / b, line_share(o.touching),
        len(o.touching.force), o.penetration, record.steps, cpu,
    )  # fmt: skip


def line_share(t: Contacts) -> float:
    """Share of the contact force at contacts along a line, bounded by nodes."""
    along = np.any((t.place <= 0.0) | (t.place >= 1.0), axis=1)
    return float(t.force[along].sum() / t.force.sum())


def pulled_knot(case: Case, points: np.ndarray) -> SpatialModel:
    """The model of a knot drawn through points (m, 3) [d]."""
    strains = [case.strain] if case.loosened is None else [case.strain, case.loosened]
    with tempfile.TemporaryDirectory() as folder:
        return build_model(
            pulled(
                Path(folder), [points], spacing=case.spacing, friction=case.friction, strains=strains, levels=case.levels,
                tolerance=case.tolerance,
            )
        )  # fmt: skip


def tightened(case: Case) -> Iterator[Row]:
    """All states of a knot. It is relaxed without friction; from there friction acts."""
    begin = time.process_time()
    points = overhand(case.turns, case.radius, TAIL * case.radius)
    if case.friction:
        relaxed = next(iter(Simulation(pulled_knot(replace(case, friction=0.0), points)).run()))
        points = relaxed.observables.position / DIAMETER
    model = pulled_knot(case, points)
    try:
        for record in Simulation(model).run():
            if case.friction and record.index == 0:
                continue  # neither tightened nor loosened
            way = "tighten" if record.stage_index == 0 else "loosen"
            row = row_of(model, record, case, way, time.process_time() - begin)
            print(
                f"{row.turns} turns, friction {row.friction:g}, {way} e {row.e:.3f}: F R2/B {row.force_radius:.4f}"
                f" by theory {row.theory / row.e**4:.4f}, {row.steps:,} steps, {row.cpu_s:.0f} s",
                flush=True,
            )
            yield row
    except Diverged as error:
        print(f"{case.turns} turns, friction {case.friction:g}, ended: {error}", flush=True)


def states_of(case: Case) -> list[Row]:
    return list(tightened(case))


def energy_terms(rows: list[Row]) -> np.ndarray:
    """(2,) k1, k2 of E = pi B/R (1 + k1 e + k2 e^2), by least squares over states without friction."""
    e = np.array([row.e for row in rows])
    excess = np.array([row.energy for row in rows]) / (np.pi * e**2) - 1.0
    return np.asarray(np.linalg.lstsq(np.stack([e, e**2], axis=1), excess, rcond=None)[0])


def with_energy_force(rows: list[Row]) -> list[Row]:
    """Rows with the force -dE/dS = B/(2 R^2) (1 + 3/2 k1 e + 2 k2 e^2) without friction, and the part of friction."""
    done = []
    for row in rows:
        free = [r for r in rows if (r.turns, r.friction, r.way) == (row.turns, 0.0, "tighten")]
        if free:
            k1, k2 = energy_terms(free)
            without = 0.5 * (1.0 + 1.5 * k1 * row.e + 2.0 * k2 * row.e**2)
            sign = 1.0 if row.way == "tighten" else -1.0
            added = sign * (row.force - without * row.e**4)
            share = added / (row.friction * row.contact_force) if row.friction else np.nan
            row = replace(row, energy_force=without, friction_share=share)
        done.append(row)
    return done


def study_knots(given: argparse.Namespace) -> None:
    path, cases = table_path(given, "knots.csv"), QUICK if given.quick else CASES
    order = [case.key for case in cases]
    rows = [row for row in read_rows(path, Row) if row.key in order]
    there = {row.key for row in rows}
    with ProcessPoolExecutor(given.jobs, get_context("spawn"), start_warp) as processes:
        for done in as_completed([processes.submit(states_of, case) for case in cases if case.key not in there]):
            rows = sorted([*rows, *done.result()], key=lambda row: order.index(row.key))
            write_rows(path, with_energy_force(rows))
    show_rows(with_energy_force(rows))
    draw_knots(picture_path(given, "knots.png"), with_energy_force(rows))


@dataclass(frozen=True)
class FrictionRow:
    """A knot of two turns with friction 0.2 and 0, after one level of 2.5 % strain. Forces are over B/h^2."""

    spacing_d: float
    load_steps: int  # in which an increment of load is applied
    e: float
    force: float
    force_without: float  # friction
    contact_force: float
    friction_share: float  # what friction adds to the force, over friction times contact force
    line_share: float  # of the contact force, at contacts along a line
    steps: int


def last_state(case: Case, points: np.ndarray) -> Row:
    """The last state of a knot drawn through points [d]."""
    model = pulled_knot(case, points)
    *_, record = Simulation(model).run()
    return row_of(model, record, case, "tighten", np.nan)


def friction_rows(spacings: Sequence[float], load_steps: Sequence[int], tolerance: float = 2e-2) -> Iterator[FrictionRow]:
    """A row for each node spacing and number of steps."""
    usual = mechanics.LOAD_STEPS
    for spacing in spacings:
        free = Case(2, 40.0, 0.025, spacing, 0.0, 1, tolerance=tolerance)
        drawn = overhand(free.turns, free.radius, TAIL * free.radius)
        relaxed = next(iter(Simulation(pulled_knot(free, drawn)).run())).observables.position / DIAMETER
        without = last_state(free, drawn)
        for steps in load_steps:
            mechanics.LOAD_STEPS = steps
            try:
                row = last_state(replace(free, friction=0.2), relaxed)
            finally:
                mechanics.LOAD_STEPS = usual
            share = (row.force - without.force) / (row.friction * row.contact_force)
            yield FrictionRow(
                spacing, steps, row.e, row.force, without.force, row.contact_force, share, row.line_share, row.steps
            )


def study_friction(given: argparse.Namespace) -> None:
    rows = list(friction_rows((2.0,) if given.quick else SPACINGS, LOAD_STEPS))
    write_rows(table_path(given, "knots_friction.csv"), rows)
    show_rows(rows)


def study_clasp(given: argparse.Namespace) -> None:
    found = clasp_rows(quick=given.quick)
    rows = [p.row for p in found]
    write_rows(table_path(given, "clasp.csv"), rows)
    show_rows(rows)
    draw_clasp(picture_path(given, "clasp.png"), found)


def study_trefoil(given: argparse.Namespace) -> None:
    rows = list(tightened_trefoil(LENGTHS[:2] if given.quick else LENGTHS, 96))
    write_rows(table_path(given, "trefoil.csv"), rows)
    show_rows(rows)
    draw_trefoil(picture_path(given, "trefoil.png"), *zip(*((r.length_d, r.contact_force, r.energy) for r in rows), strict=True))


def add_options(name: str, parser: argparse.ArgumentParser) -> None:
    add_directory(parser, "one case, three levels")
    if name == "knots":
        parser.add_argument("--jobs", type=int, default=1, metavar="N", help="knots computed at the same time, each in a process")


if __name__ == "__main__":
    studies = {"knots": study_knots, "friction": study_friction, "clasp": study_clasp, "trefoil": study_trefoil}
    sys.exit(run_one_of(__doc__, studies, add_options))
