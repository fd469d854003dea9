"""Knots and clasps of elastic rods in space, against theory and measurements that others published.

    python tools/studies/knots.py knots [DIR]     # 20 min, --quick 2: overhand knots of one to four turns, friction 0 to 0.3
    python tools/studies/knots.py clasp [DIR]     # 6 min: two hooked rods pulled apart: where they press
    python tools/studies/knots.py trefoil [DIR]   # 4 min: a closed trefoil that grows thicker

A knot is tied in a straight rod whose ends are clamped along x and moved apart. All lengths are over the radius h of the rod and
forces over B/h^2, so that material and diameter do not count, but for the stretch of the rod and the ratio of GJ to EI (Poisson's
ratio 0.3). The loop radius is R = S/(2 pi) with the end-to-end shortening S, the length of the rod less the distance of its ends,
and e^2 = h/R. Theory: knot_braid.py.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from clasps import clasp_rows, draw_clasp
from knot_braid import Braid, braid
from knot_curves import DIAMETER, overhand, pulled
from knot_pictures import draw_knots, draw_trefoil
from study import add_directory, picture_path, run_one_of, show_rows, table_path, write_rows
from trefoil import tightened_trefoil

from warpknit.errors import Diverged
from warpknit.model import build_model
from warpknit.solve.simulate import Record, Simulation
from warpknit.spatial.model import SpatialModel

RADIUS = 0.5 * DIAMETER
TAIL = 4.0  # loop radii; the deflection of a tail falls as exp(-s/(1.4 R)) or faster


@dataclass(frozen=True)
class Case:
    """A knot that is pulled tight: loop radius at the start [d], end strain, node spacing [d], friction coefficients."""

    turns: int
    radius: float
    strain: float
    spacing: float
    frictions: tuple[float, ...]
    levels: int = 6
    loosened: float | None = None  # strain to which it goes back
    tolerance: float = 5e-3


CASES = (
    Case(1, 400.0, 0.01, 4.0, (0.0,), 1),
    Case(1, 150.0, 0.01, 2.0, (0.0,), 1),
    Case(1, 40.0, 0.25, 1.0, (0.0,)),
    Case(1, 20.0, 0.58, 1.0, (0.0, 0.1, 0.2, 0.3), 8),
    Case(1, 12.0, 0.50, 0.5, (0.0,), 4, 0.38),
    Case(1, 12.0, 0.50, 1.0, (0.0, 0.1), 4, 0.38),
    Case(2, 400.0, 0.01, 4.0, (0.0,), 1, tolerance=1e-2),
    Case(2, 150.0, 0.01, 2.0, (0.0,), 1, tolerance=1e-2),
    Case(2, 40.0, 0.50, 1.0, (0.0,), 4, tolerance=1e-2),
    Case(3, 60.0, 0.45, 1.5, (0.0,), 3, tolerance=1e-2),
    Case(4, 80.0, 0.42, 2.0, (0.0,), 3, tolerance=1e-2),
    Case(2, 20.0, 0.30, 1.0, (0.0, 0.1), 6, tolerance=1e-2),
)
LENGTHS = (24.0, 21.0, 19.0, 18.0, 17.5, 17.0, 16.8, 16.6, 16.5, 16.4, 16.3)  # L/d of the closed trefoil
QUICK = (Case(1, 12.0, 0.4, 1.0, (0.0, 0.2), 3),)


@dataclass(frozen=True)
class Row:
    """One state of one knot. Forces are over B/h^2."""

    turns: int
    friction: float
    way: str  # tighten | loosen
    spacing_d: float
    e: float  # sqrt(h/R)
    loop_radius_h: float
    force: float
    force_radius: float  # F R^2/B
    theory: float  # F h^2/B to first order in e and friction
    contact_force: float  # of all contacts
    friction_share: float  # (F - F without friction at this e) over friction times contact force
    energy: float  # of bending and twist, h/B
    contacts: int
    overlap_d: float
    steps: int
    wall_s: float


def end_force(record: Record) -> float:
    """[N] pull along x, mean of both clamps."""
    pull = record.observables.edge_force[:, 0]
    return float(0.5 * (pull[-1] - pull[0]))


def row_of(model: SpatialModel, record: Record, case: Case, friction: float, way: str, wall: float) -> Row:
    o, b = record.observables, model.rods.section.bending_stiffness
    shortening = float(model.rods.wire_length[0] - np.linalg.norm(o.position[-1] - o.position[0]))
    e = float(np.sqrt(2.0 * np.pi * RADIUS / shortening))
    force, signed = end_force(record) * RADIUS**2 / b, friction if way == "tighten" else -friction
    return Row(
        case.turns, friction, way, case.spacing, e, e**-2, force, force / e**4, float(theory(case.turns).force(e, signed)),
        float(o.touching.force.sum()) * RADIUS**2 / b, np.nan, o.energies.stored * RADIUS / b, len(o.touching.force),
        o.penetration, record.steps, wall,
    )  # fmt: skip


def theory(turns: int) -> Braid:
    return braid(turns)


def tightened(case: Case) -> Iterator[Row]:
    """All states of a knot. It is relaxed without friction; from there friction acts."""
    start = overhand(case.turns, case.radius, TAIL * case.radius)
    for friction in sorted(case.frictions):
        begin = time.perf_counter()
        strains = [case.strain] + ([case.loosened] if case.loosened is not None else [])
        with tempfile.TemporaryDirectory() as folder:
            scene = pulled(
                Path(folder), [start], spacing=case.spacing, friction=friction, strains=strains, levels=case.levels,
                tolerance=case.tolerance,
            )  # fmt: skip
            model = build_model(scene)
        try:
            for record in Simulation(model).run():
                if friction == min(case.frictions) and record.index == 0:
                    start = record.observables.position / DIAMETER
                if friction and record.index == 0:
                    continue  # neither tightened nor loosened
                way = "tighten" if record.stage_index == 0 else "loosen"
                row = row_of(model, record, case, friction, way, time.perf_counter() - begin)
                print(
                    f"{row.turns} turns, friction {friction:g}, {way} e {row.e:.3f}: F R2/B {row.force_radius:.4f}"
                    f" by theory {row.theory / row.e**4:.4f}, {row.steps:,} steps, {row.wall_s:.0f} s",
                    flush=True,
                )
                yield row
        except Diverged as error:
            print(f"ended: {error}", flush=True)


def with_shares(rows: list[Row]) -> list[Row]:
    """The rows with what friction adds to the force, over friction times contact force."""
    done = []
    for row in rows:
        free = sorted(
            (r.e, r.force_radius) for r in rows if (r.turns, r.friction, r.spacing_d) == (row.turns, 0.0, row.spacing_d)
        )
        if row.friction and free:
            sign = 1.0 if row.way == "tighten" else -1.0
            without = float(np.interp(row.e, *zip(*free, strict=True))) * row.e**4
            row = replace(row, friction_share=sign * (row.force - without) / (row.friction * row.contact_force))
        done.append(row)
    return done


def study_knots(given: argparse.Namespace) -> None:
    rows: list[Row] = []
    for case in QUICK if given.quick else CASES:
        rows += tightened(case)
        write_rows(table_path(given, "knots.csv"), with_shares(rows))
    show_rows(with_shares(rows))
    draw_knots(picture_path(given, "knots.png"), with_shares(rows))


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


if __name__ == "__main__":
    sys.exit(run_one_of(__doc__, {"knots": study_knots, "clasp": study_clasp, "trefoil": study_trefoil}, add_options))
