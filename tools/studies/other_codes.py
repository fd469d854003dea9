"""PyElastica and Yade on the same wires: spatial hook and knot, error and processor time.

    python tools/studies/other_codes.py [DIR] [--case hook|knot] [--code CODE]     # 15 min, --quick 1

Each code solves each case (other_cases.py) at several discretizations and, the explicit codes, at several rates. An error is the
largest force error over the last two of four levels, over the reference's: warpknit's two finest runs, extrapolated by the square
of the spacing for the hook, and the mean of both for the knot. Times are processor times of one core from the assembled model to
the last level; compilation and assembly stand apart. Each code runs in turn, the others in processes of their own. PyElastica
comes with the extra `other-codes`, Yade with the package `yade` of Debian; a code that is absent is left out, and says so. With
--case or --code the other rows of the table stay.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from other_cases import HOOK_MOVE, LEVELS, Numerics, Solved, by_warpknit, knot_shortening, problem_of
from rod_problem import RADIUS, Problem
from study import COLOURS, add_directory, new_figure, new_parser, picture_path, read_rows, show_rows, table_path, tidy, write_rows

from warpknit.base.errors import Diverged
from warpknit.compute.device import start_warp

HERE = Path(__file__).parent
LONGEST = 300.0  # [s] of a run
CASES = ("hook", "knot")
CODES = ("warpknit", "PyElastica", "Yade")
BOUNDS = (0.10, 0.05, 0.02, 0.01)  # errors of the table of times
COMPARED = 2  # last levels whose errors count
FINEST = {"hook": (48, 96), "knot": (180, 250)}  # segments of warpknit's reference

# PyElastica: the shear mode of a round rod limits the step to about 0.15 d^2 sqrt(rho A/B), whatever the segments
LADDER = {
    ("warpknit", "hook"): [Numerics(n, tolerance=1e-3, softening=64.0) for n in (8, 12, 16, 24, 48, 96)],
    ("PyElastica", "hook"): [
        Numerics(n, periods=q, step=h, damping=z, stiffness=1.0)
        for n, h, runs in (
            (12, 0.05, ((0.1, 2.0), (0.25, 2.0))),
            (24, 0.1, ((0.1, 2.0), (0.25, 2.0), (0.5, 2.0), (0.5, 4.0))),
            (48, 0.2, ((0.1, 2.0), (0.25, 2.0), (0.5, 2.0), (0.5, 4.0))),
            (96, 0.25, ((0.25, 2.0), (0.5, 2.0))),
        )
        for q, z in runs
    ],
    ("Yade", "hook"): [
        Numerics(n, periods=q, step=0.5, damping=0.2, stiffness=1.0)
        for n, q in ((12, 0.5), (24, 0.25), (24, 0.5), (24, 2.0), (48, 0.25), (48, 0.5), (48, 1.0), (48, 2.0),
                     (96, 0.5), (96, 1.0))
    ],
    ("warpknit", "knot"): [Numerics(n, tolerance=5e-3) for n in (64, 90, 120, 134, 180, 250)],
    ("PyElastica", "knot"): [
        Numerics(n, periods=q, step=0.25, damping=10.0, stiffness=30.0)
        for n, q in ((64, 0.1), (64, 0.2), (90, 0.1), (90, 0.2), (90, 0.5), (134, 0.1), (134, 0.2), (134, 0.5), (180, 0.2))
    ],
    ("Yade", "knot"): [
        Numerics(n, periods=q, step=0.3, damping=0.2, stiffness=30.0)
        for n, q in ((64, 0.5), (64, 2.0), (90, 0.5), (90, 2.0), (110, 0.5), (110, 2.0), (128, 0.25), (128, 0.5), (128, 2.0))
    ],
}  # fmt: skip
QUICK = {"warpknit": 2, "PyElastica": 1, "Yade": 1}


@dataclass(frozen=True)
class Row:
    """One run. Forces over B/d^2, lengths over d, times of the model over d^2 sqrt(rho A/B)."""

    case: str  # hook | knot
    code: str
    segments: int
    nodes: int
    periods: float  # of a level, of the lowest mode; 0: not in time
    time_step: float
    damping: float
    stiffness: float
    tolerance: float
    force_1: float  # at the end of each level
    force_2: float
    force_3: float
    force_4: float
    error: float  # largest of the last two levels
    steps: int
    cpu_s: float
    setup_s: float


def is_here(code: str) -> bool:
    """Whether a code is installed."""
    if code == "PyElastica":
        return importlib.util.find_spec("elastica") is not None
    return code == "warpknit" or shutil.which("yade") is not None


def result_of(code: str, problem: Problem) -> dict[str, Any]:
    """Result of PyElastica or Yade for a problem, in a process of its own. Raises `RuntimeError` without one."""
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder) / "problem.npz", Path(folder) / "result.json"
        problem.save(given)
        environment = os.environ | {"OMP_NUM_THREADS": "1"}
        if code == "PyElastica":
            command = [sys.executable, str(HERE / "elastica_rods.py"), str(given), str(found)]
        else:
            command = ["yade", "-n", "-x", "-j1", str(HERE / "yade_rods.py")]
            environment |= {"PROBLEM": str(given), "RESULT": str(found), "PYTHONPATH": str(HERE)}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=2.0 * LONGEST, check=False)
        if not found.exists():
            raise RuntimeError(f"{code}: {(done.stdout + done.stderr).strip()[-300:]}")
        return json.loads(found.read_text(encoding="utf-8"))


def by_other(code: str, case: str, numerics: Numerics) -> Solved:
    """The case by PyElastica or Yade."""
    return solved_of(case, result_of(code, problem_of(code, case, numerics)))


def solved_of(case: str, result: dict[str, Any]) -> Solved:
    """Forces of levels behind the first relaxation: of the contact on one wire (hook), of the pull (knot)."""
    ends = np.array(result["force"])
    is_hook = case == "hook"
    force = np.linalg.norm(ends[:, 0].sum(axis=1), axis=1) if is_hook else 0.5 * (ends[:, 0, 1, 0] - ends[:, 0, 0, 0])
    if len(force) < LEVELS or not np.isfinite(force).all():
        raise RuntimeError("diverged")
    return Solved(force[-LEVELS:], np.array(result["cpu_s"]), result["setup_s"], result["steps"], sum(result["nodes"]))


def solved(code: str, case: str, numerics: Numerics) -> Solved:
    if code == "warpknit":
        found = by_warpknit(case, numerics)
        return Solved(found.force[-LEVELS:], found.cpu, found.setup, found.steps, found.nodes)
    return by_other(code, case, numerics)


def reference(case: str) -> np.ndarray:
    """[level] force by warpknit's two finest runs at a residual tolerance of 1e-4 (hook) or 3e-3 (knot)."""
    tolerance = {"hook": 1e-4, "knot": 3e-3}[case]
    coarse, fine = (solved("warpknit", case, Numerics(n, tolerance=tolerance, softening=64.0)).force for n in FINEST[case])
    return fine + (fine - coarse) / 3.0 if case == "hook" else 0.5 * (coarse + fine)


def row_of(code: str, case: str, n: Numerics, found: Solved, wanted: np.ndarray) -> Row:
    error = float(np.abs(found.force / wanted - 1.0)[-COMPARED:].max())
    step = 0.0 if code == "warpknit" else problem_of(code, case, n).time_step
    return Row(
        case, code, n.segments, found.nodes, n.periods, step, n.damping, n.stiffness, n.tolerance, *map(float, found.force),
        error, found.steps, float(found.cpu[-1]), found.setup,
    )  # fmt: skip


def reference_row(case: str, wanted: np.ndarray) -> Row:
    return Row(case, "reference", 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, *map(float, wanted), 0.0, 0, 0.0, 0.0)


def time_to(rows: list[Row], case: str, code: str, bound: float) -> Row | None:
    """Cheapest run of a code within a stable error; None without one. The runs with smaller steps and rates keep it."""
    own = [r for r in rows if (r.case, r.code) == (case, code)]

    def keeps(r: Row) -> bool:
        return all(o.error <= bound for o in own if o.segments >= r.segments and o.periods >= r.periods)

    return min((r for r in own if keeps(r)), key=lambda r: r.cpu_s, default=None)


def show_times(rows: list[Row]) -> None:
    """Processor time to each error."""
    for case in dict.fromkeys(r.case for r in rows):
        for code in CODES:
            for bound in BOUNDS:
                r = time_to(rows, case, code, bound)
                what = "not reached" if r is None else f"{r.cpu_s:.2f} s, {r.segments} segments, {r.steps:,} steps"
                print(f"{case} {code:10s} {bound:4.0%}: {what}")


def draw(path: Path, rows: list[Row]) -> None:
    """Draw error against processor time, and the force of each code's finest run."""
    figure, panels = new_figure(11.0, 8.0, 2, 2)
    _, first, last = knot_shortening()
    shares = np.arange(1, LEVELS + 1) / LEVELS
    loop = (first + (last - first) * shares) / (2.0 * np.pi) / RADIUS  # R/h
    for (speed, force), case in zip(panels, ("hook", "knot"), strict=True):
        x = 1e3 * HOOK_MOVE * shares if case == "hook" else loop
        scale = 1e3 if case == "hook" else RADIUS**2 * loop**2
        (wanted,) = [r for r in rows if (r.case, r.code) == (case, "reference")]
        force.plot(x, scale * forces_of(wanted), color="black", marker="x", markersize=9, label="reference")
        for code, colour, marker in zip(CODES, COLOURS, "osD", strict=False):
            own = [r for r in rows if (r.case, r.code) == (case, code)]
            if not own:
                continue
            speed.scatter([r.cpu_s for r in own], [100.0 * r.error for r in own], color=colour, marker=marker, label=code)
            best = min(own, key=lambda r: r.error)
            label = f"{code}, {best.segments} segments"
            force.plot(x, scale * forces_of(best), color=colour, marker=marker, linestyle="", alpha=0.8, label=label)
        for bound in (1.0, 2.0, 5.0):
            speed.axhline(bound, color="#999999", linewidth=0.8, linestyle=":")
        speed.set(xscale="log", yscale="log", xlabel="processor time [s]", ylabel="error of the force [%]", xlim=(0.1, 300.0))
        speed.set(xticks=(0.1, 1.0, 10.0, 100.0), yticks=(0.1, 1.0, 10.0), ylim=(0.02, 50.0), title=f"{case}: each run")
        for axis in (speed.xaxis, speed.yaxis):
            axis.set_major_formatter("{x:g}")
    panels[0, 1].set(xlabel="displacement [mm]", ylabel="contact force [0.001 B/d²]", title="hook: least error of each code")
    panels[1, 1].set(ylabel="pull F R²/B [-]", title="knot: least error of each code")
    panels[1, 1].set(xlabel="radius of the loop over wire radius [-]")
    tidy(panels)
    panels[1, 0].get_legend().remove()
    figure.savefig(path)


def forces_of(row: Row) -> np.ndarray:
    return np.array([row.force_1, row.force_2, row.force_3, row.force_4])


def study(given: argparse.Namespace) -> None:
    table = table_path(given, "other_codes.csv")
    chosen = [
        (case, code)
        for case in CASES
        for code in ("reference", *CODES)
        if given.case in (None, case) and given.code in (None, code)
    ]
    rows = [row for row in read_rows(table, Row) if (row.case, row.code) not in chosen] if given.case or given.code else []
    for case, code in chosen:
        if code == "reference":
            rows.append(reference_row(case, reference(case)))
        elif not is_here(code):
            print(f"{code} is not installed: left out")
        else:
            ladder = LADDER[code, case]
            wanted = forces_of(next(r for r in rows if (r.case, r.code) == (case, "reference")))
            rows += runs(code, case, ladder[: QUICK[code]] if given.quick else ladder, wanted)
        rows.sort(key=lambda r: (CASES.index(r.case), ("reference", *CODES).index(r.code)))
        write_rows(table, rows)
    show_rows(rows)
    show_times(rows)
    if {r.case for r in rows} == set(CASES):
        draw(picture_path(given, "other_codes.png"), rows)


def runs(code: str, case: str, ladder: list[Numerics], wanted: np.ndarray) -> Iterator[Row]:
    """Rows of the runs that end with a result."""
    for numerics in ladder:
        try:
            row = row_of(code, case, numerics, solved(code, case, numerics), wanted)
        except (Diverged, RuntimeError, subprocess.TimeoutExpired) as error:
            print(f"{code}, {case}, {numerics}: {error}", flush=True)
            continue
        print(f"{case} {code} {row.segments} segments, {row.periods:g} periods: {row.error:.2%}, {row.cpu_s:.2f} s", flush=True)
        yield row


if __name__ == "__main__":
    parser = new_parser(__doc__)
    add_directory(parser, "two runs of warpknit, one of each other code")
    parser.add_argument("--case", choices=CASES, help="renew the rows of this case only")
    parser.add_argument("--code", choices=CODES, help="renew the rows of this code only")
    arguments = parser.parse_args()
    start_warp()
    study(arguments)
