"""Tight spatial knits: which levels converge, in how many steps, and failures.

    python tools/studies/tight_knits.py [DIR] [--only WORD] [--yarn WORD] [--load WORD] [--levels N] [--preset NAME]
    python tools/studies/tight_knits.py DIR --against OTHER

One repeat of each knit, periodic, at 26 wales and 30 courses an inch, of 30 um molybdenum wire and of a yarn of four 17 um wires;
by 2, 6 and 12 % both ways, and by 6 % one way with the other one free of tension. Every level is a row: steps and processor time,
the criteria of convergence, tension, contacts and stress, and the steps and time that `warpknit plan` expects of a level. The
last bar of a knit is the front guide bar, whose underlaps lie outermost. Prints the table and renews its rows in
tight_knits_levels.csv; options choose a part of them. --against compares the table in DIR with another one in OTHER, such as of
preset `reference`.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from study import add_directory, new_parser, read_rows, table_path, write_rows

from warpknit import measure
from warpknit.base.errors import WarpknitError
from warpknit.commands.plan import make_plan
from warpknit.compute.device import start_warp
from warpknit.knit.lapping import KnitError
from warpknit.knit.named import named_knit
from warpknit.runner.history import row_of
from warpknit.runner.warnings_of import warnings_of
from warpknit.scene import Scene, make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Record, Simulation

INCH = 25.4e-3  # [m]
WALES, COURSES = 26, 30  # an inch
STUDIED = ("tricot", "open-tricot", "locknit", "reverse-locknit", "satin", "sharkskin", "queens-cord", "inlaid-pillar", "atlas")
KNITS = {knit.title: knit for knit in map(named_knit, (*STUDIED, "full-double-atlas"))}
YARNS = {"30um": {"diameter": 30e-6}, "4x17um": {"diameter": 17e-6, "ends": 4}}
LOADS: dict[str, dict[str, float]] = {
    "2": {"strain_weft": 0.02, "strain_warp": 0.02},
    "6": {"strain_weft": 0.06, "strain_warp": 0.06},
    "12": {"strain_weft": 0.12, "strain_warp": 0.12},
    "6 weft": {"strain_weft": 0.06, "tension_warp": 0.0},
    "6 warp": {"tension_weft": 0.0, "strain_warp": 0.06},
}
LEVELS = 3
MAX_STEPS = 40_000  # of a level
JUMP = 0.3  # of the larger tension: a larger decrease with strain is reported
QUANTILES = (0.5, 0.75, 0.9, 0.95)
SLACK = 1e-3  # [N/m] tension below which a knit counts as slack


@dataclass(frozen=True)
class Row:
    """A row of tight_knits_levels.csv, SI."""

    knit: str
    yarn: str
    load: str
    level: int
    levels: int
    ending: str  # converged | the class of the error
    strain_weft: float
    strain_warp: float
    nodes: int
    pairs: int  # of segments in the list of the search
    steps: int
    seconds: float  # of the processor
    balance: float  # unbalanced forces or motion, compared with solver.residual_tolerance
    overlap: float  # [d] largest overlap or gap of a contact, compared with OVERLAP_ERROR of spatial/multipliers.py
    tension_weft: float
    tension_warp: float
    active_percent: float
    elsewhere_percent: float  # of the contact forces, at no site
    force_sum: float
    stress_max: float
    planned_steps: int
    planned_seconds: float
    said: str


def scene_of(knit: str, yarn: str, load: str, levels: int, preset: str) -> Scene:
    """One repeat of a knit."""
    return make_scene(
        {
            "wire": {"material": "molybdenum", **YARNS[yarn]},
            "knit": {
                "bars": [asdict(bar) for bar in KNITS[knit].bars],
                "wale_spacing": INCH / WALES,
                "course_spacing": INCH / COURSES,
            },
            "model": {"kind": "spatial", "boundary": "periodic"},
            "contact": {"friction": 0.0},
            "variants": {"count": 1},
            "load": LOADS[load],
            "solver": {"preset": preset, "max_steps": MAX_STEPS},
            "output": {"frames": levels, "usd": False, "figures": False},
        }
    )


def rows_of(knit: str, yarn: str, load: str, levels: int, preset: str) -> Iterator[Row]:
    """Levels of a run, with the failed one at its end."""
    nothing = dict.fromkeys(Row.__dataclass_fields__, math.nan) | {"nodes": 0, "pairs": 0, "steps": 0, "planned_steps": 0}
    common = nothing | {"knit": knit, "yarn": yarn, "load": load, "levels": levels}
    begin, simulation = time.process_time(), None
    records: list[Record] = []
    try:
        scene = scene_of(knit, yarn, load, levels, preset)
        planned = make_plan(scene, "cpu")
        common |= {"planned_steps": planned.steps // levels, "planned_seconds": (planned.wall_s or math.nan) / levels}
        simulation = Simulation(build_model(scene))
        simulation.compile()
        common |= {"nodes": simulation.model.node_count}
        begin = time.process_time()
        for record in simulation.run():
            records.append(record)
            level = len(records) - 1
            steps = record.steps - (records[-2].steps if level else 0)  # level 0: as knitted
            seconds = time.process_time() - begin
            pairs = simulation.mechanics.contact.pair_count
            values = {"level": level, "steps": steps, "seconds": seconds, "pairs": pairs, **_criteria(simulation)}
            if level:
                yield Row(**common | values | _state(record) | {"ending": "converged", "said": _said(simulation, records)})
            begin = time.process_time()
    except (WarpknitError, KnitError) as error:
        found = {
            "ending": type(error).__name__,
            "said": str(error),
            "level": len(records),
            "seconds": time.process_time() - begin,
        }
        if simulation is not None:
            done = records[-1].steps if records else 0
            strains = simulation.state.gradient.diagonal() - 1.0
            found |= {"steps": simulation.progress.steps - done, **_criteria(simulation)}
            found |= {"strain_weft": float(strains[0]), "strain_warp": float(strains[1])}
        yield Row(**common | found)


def _criteria(simulation: Simulation) -> dict[str, float]:
    """Values of the last convergence check, for the tolerances."""
    mechanics = simulation.mechanics
    mechanics.stepper.evaluate()
    contacts = mechanics.contact.sums()
    sums = mechanics.relaxation.sums(of_mean=False)
    balance = float(mechanics.group.residual(sums, contacts, mechanics.rows)[0])
    return {"balance": balance, "overlap": float(contacts.overlap_max[0]) / mechanics.model.rods.section.thickness}


def _state(record: Record) -> dict[str, float]:
    r = record.observables
    weft, warp = measure.mesh_tension(r)
    site, elsewhere = float(r.site_force.sum()), float(r.contact_elsewhere.sum())
    return {
        "strain_weft": float(r.gradient[0, 0] - 1.0),
        "strain_warp": float(r.gradient[1, 1] - 1.0),
        "tension_weft": float(weft),
        "tension_warp": float(warp),
        "active_percent": float(measure.contacts(r).active_percent),
        "elsewhere_percent": 100.0 * elsewhere / max(site + elsewhere, 1e-300),
        "force_sum": site,
        "stress_max": float(measure.stress_extremes(r)[0]),
    }


def _said(simulation: Simulation, records: list[Record]) -> str:
    """Warnings of a run, and tensions that fall from level to level."""
    said = [str(warning) for warning in warnings_of(simulation.model, [row_of(record) for record in records])]
    if len(records) > 2:
        before, now = (np.array(measure.mesh_tension(record.observables)) for record in records[-2:])
        if np.any(now < before - JUMP * max(before.max(), SLACK)):
            said.insert(0, f"the tension falls from {_mn(before)} to {_mn(now)} mN/m")
    return "; ".join([*simulation.notes, *said])


def _mn(tension: np.ndarray) -> str:
    return " / ".join(f"{1e3 * value:.3g}" for value in tension)


def line(row: Row) -> str:
    """One row as text."""
    load = f"{row.knit:22s} {row.yarn:7s} {row.load:7s} {row.level}/{row.levels} {row.ending:10s}"
    cost = f"{row.steps:7d} ({row.planned_steps:5d}) steps {row.seconds:6.1f} ({row.planned_seconds:5.1f}) s"
    cost += f", balance {row.balance:7.1g}, overlap {row.overlap:7.1g} d"
    tension = f"{1e3 * row.tension_weft:9.4g} {1e3 * row.tension_warp:9.4g} mN/m"
    return f"{load} {cost}  {tension} {row.active_percent:5.1f} % {1e-6 * row.stress_max:6.0f} MPa  {row.said[:100]}"


def in_order(rows: list[Row], path: Path) -> list[Row]:
    """The rows and earlier ones, in the order of knits, yarns, loads and levels."""
    renewed = {(row.knit, row.yarn, row.load) for row in rows}
    kept = [row for row in read_rows(path, Row) if (row.knit, row.yarn, row.load) not in renewed]
    names = list(KNITS), list(YARNS), list(LOADS)
    return sorted(
        [*kept, *rows],
        key=lambda row: (*(n.index(v) for n, v in zip(names, (row.knit, row.yarn, row.load), strict=True)), row.level),
    )


def compare(rows: list[Row], finer: list[Row]) -> Iterator[str]:
    """Quantiles of differences of converged levels from `finer`, where tension is carried."""
    by_level = {(row.knit, row.yarn, row.load, row.level): row for row in rows if row.ending == "converged"}
    pairs = [(by_level.get((row.knit, row.yarn, row.load, row.level)), row) for row in finer if row.ending == "converged"]
    differ: dict[str, list[float]] = {"tension": [], "stress": [], "active": []}
    for here, there in pairs:
        most = max(abs(there.tension_weft), abs(there.tension_warp))
        if here is not None and most > SLACK:
            apart = (abs(getattr(here, name) - getattr(there, name)) for name in ("tension_weft", "tension_warp"))
            differ["tension"].append(max(apart) / most)
            differ["stress"].append(abs(here.stress_max / there.stress_max - 1.0))
            differ["active"].append(0.01 * abs(here.active_percent - there.active_percent))
    for name, values in differ.items():
        quantiles = ", ".join(f"{100.0 * np.quantile(values, share):.2f} % at {share:.0%}" for share in QUANTILES)
        yield f"{name}: {quantiles} of {len(values)} levels"


def main() -> int:
    parser = new_parser(__doc__)
    add_directory(parser)
    parser.add_argument("--only", default="", help="knits whose name has this in it")
    parser.add_argument("--yarn", choices=YARNS, help="of this wire or yarn")
    parser.add_argument("--load", choices=LOADS, action="append", help="of this load; may be given several times")
    parser.add_argument("--levels", type=int, default=LEVELS, help="load levels of a run  [default: %(default)s]")
    parser.add_argument("--preset", default="draft", help="solver.preset  [default: %(default)s]")
    parser.add_argument(
        "--against", type=Path, metavar="OTHER", help="compare with the table of this folder, such as of another preset"
    )
    given = parser.parse_args()
    path = table_path(given, "tight_knits_levels.csv")
    if given.against is not None:
        print("\n".join(compare(read_rows(path, Row), read_rows(given.against / path.name, Row))))
        return 0
    start_warp()
    for knit in (name for name in KNITS if given.only in name):
        for yarn in (name for name in YARNS if given.yarn in (None, name)):
            for load in given.load or LOADS:
                rows = []
                for row in rows_of(knit, yarn, load, given.levels, given.preset):
                    rows.append(row)
                    print(line(row), flush=True)
                write_rows(path, in_order(rows, path))
    return 0


if __name__ == "__main__":
    sys.exit(main())
