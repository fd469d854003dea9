"""The matrix of extremes: scenes far from the usual, and how each ends.

    python tools/studies/extremes.py [DIR] [--only WORD] [--quick]

Each ends in one of three ways: in a right answer, which is checked against another run (a mesh that is similar, the same mesh
refined, mirrored, or by another load path); in such an answer with a warning of what is out of range; or with exit status 2 or 3
and a line that says why. A case with a warning and no comparison has wires far beyond their strength, where a mesh has several
states or depends on every node. Tensions are T C^3/EI. Prints the table and writes it to extremes.csv; ends with status 1 where a
case did not end as expected. --quick leaves out cases of minutes.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from study import add_directory, new_parser, read_rows, show_rows, table_path, write_rows

from warpknit import measure
from warpknit.base.errors import WarpknitError
from warpknit.knit.lapping import KnitError
from warpknit.planar.observables import read
from warpknit.runner.run import run_scene
from warpknit.scene import Scene, make_scene
from warpknit.solve.model import build_model
from warpknit.solve.relax import Relaxation
from warpknit.solve.simulate import Simulation

BASE: dict[str, dict[str, Any]] = {
    "wire": {"material": "tungsten", "diameter": 15e-6},
    "knit": {"wale_spacing": 1.7e-3, "course_spacing": 1e-3},
    "model": {"kind": "planar", "boundary": "periodic"},
    "load": {"strain_weft": 0.14, "strain_warp": 0.14},
    "solver": {"preset": "standard"},
    "output": {"frames": 4, "usd": False, "figures": False},
}
LEAST = 5e-3  # T C^3/EI that differences are compared with where the mesh carries less
STRESS = "above the strength"
WRINKLE = "wrinkle out of its plane"
METAL = "is outside the range of metals"
ROOM = "strength at 20 degC, which differ"

Table = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Outcome:
    """Ending of a run."""

    exit: int
    seconds: float
    steps: int
    tension: tuple[float, float]  # T C^3/EI in weft and warp; nan without a result
    warnings: tuple[str, ...]
    message: str


@dataclass(frozen=True)
class Case:
    """A scene and how it has to end."""

    group: str
    name: str
    table: Table
    against: Table | None = None  # another scene whose answer it must have
    scale: float = 1.0  # times the answer of `against`
    allowed: float = 0.02  # difference of the tensions over the larger one
    warned: tuple[str, ...] = ()  # what the warnings have to say
    refused: tuple[str, ...] = ()  # what the line of exit status 2 or 3 has to say, one of them; empty: it may not end so
    slow: bool = False
    run: Callable[[], tuple[Outcome, Outcome]] | None = field(default=None, compare=False)  # another way to find both


@dataclass(frozen=True)
class Row:
    """A row of extremes.csv."""

    group: str
    case: str
    exit: int
    seconds: float
    steps: int
    tension_weft: float
    tension_warp: float
    difference_percent: float
    allowed_percent: float
    ending: str  # right | right, warned | refused | WRONG
    said: str


def scene(**tables: dict[str, Any]) -> Table:
    """The base scene with other values; those that are None fall away."""
    merged = {name: {**BASE.get(name, {}), **tables.get(name, {})} for name in {*BASE, *tables}}
    return {name: {key: value for key, value in table.items() if value is not None} for name, table in merged.items()}


def run(table: Table) -> Outcome:
    """Run a scene as the command line would."""
    start = time.perf_counter()
    nothing = (math.nan, math.nan)
    try:
        made = make_scene(table)
        with tempfile.TemporaryDirectory() as folder:
            result = run_scene(made, out=Path(folder) / "run")
    except (WarpknitError, KnitError) as error:
        return Outcome(getattr(error, "exit_code", 2), time.perf_counter() - start, 0, nothing, (), str(error))
    summary, steps = result.summary.json(), int(result.summary.json()["solver"]["steps"])
    seconds, warnings = time.perf_counter() - start, tuple(summary["warnings"])
    if result.exit_code or "mesh" not in summary:
        return Outcome(result.exit_code, seconds, steps, nothing, warnings, result.message)
    tension = [summary["mesh"][f"tension_{name}_N_per_m"] for name in ("weft", "warp")]
    return Outcome(0, seconds, steps, scaled(made, tension), warnings, "")


def scaled(made: Scene, tension: Sequence[float]) -> tuple[float, float]:
    """Tensions [N/m] as T C^3/EI."""
    unit = made.wire.bending_stiffness / made.knit.course_spacing**3
    return tension[0] / unit, tension[1] / unit


def rotated(angle: float) -> tuple[Outcome, Outcome]:
    """A strained tile turned as a whole by an angle [rad], and unturned."""
    made = make_scene(scene())
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    found = []
    for rotation in (turn, np.eye(2)):
        start = time.perf_counter()
        model = build_model(made)
        simulation = Simulation(model)
        for _ in simulation.run():
            pass
        assert isinstance(simulation.drive, Relaxation)
        gradient = np.diag([1.14, 1.14])
        for share in np.linspace(0.0, 1.0, 9)[1:]:
            part = share * angle if rotation is turn else 0.0
            step = np.array([[math.cos(part), -math.sin(part)], [math.sin(part), math.cos(part)]])
            simulation.drive.equilibrium_at(step @ gradient, made.wire.reference_temperature)
        reading = read(model, simulation.state)
        stress = rotation.T @ measure.true_stress(reading.nominal_stress, reading.gradient) @ rotation
        steps = simulation.progress.steps
        found.append(Outcome(0, time.perf_counter() - start, steps, scaled(made, np.diag(stress).tolist()), (), ""))
    return found[0], found[1]


def warmer(temperature: float) -> tuple[Table, float]:
    """Equivalent mesh at the reference temperature, and the factor of its tensions.

    All lengths grow by f = 1 + alpha (T - T0), so the held edges strain it by (1 + strain)/f - 1, and T = EI/L^3 g.
    """
    factor = 1.0 + 4.5e-6 * (temperature - 293.15)
    strain = 1.14 / factor - 1.0
    return scene(load={"strain_weft": strain, "strain_warp": strain}), factor**-3


def matrix() -> list[Case]:
    """All cases."""
    base = scene()
    cases = [Case("wire", "15 um, the base", base, scene(model={"nodes_per_loop": 48}), allowed=0.02)]
    add = cases.append
    for diameter in (1e-6, 1e-4, 1e-3):
        knit = {"wale_spacing": 1.7e-3 * diameter / 15e-6, "course_spacing": 1e-3 * diameter / 15e-6}
        similar = scene(wire={"diameter": diameter}, knit=knit)
        add(Case("wire", f"{diameter * 1e6:g} um, mesh to scale", similar, base, allowed=0.01))
    for diameter in (1e-6, 4e-6, 50e-6, 120e-6):
        wire = {"diameter": diameter}
        finer = scene(wire=wire, model={"nodes_per_loop": 40})
        add(Case("wire", f"{diameter * 1e6:g} um, courses of 1 mm", scene(wire=wire), finer, allowed=0.04))
    jammed = scene(wire={"diameter": 300e-6}, solver={"max_steps": 50_000})
    add(Case("wire", "300 um, courses of 1 mm", jammed, refused=("too thick for the loops",)))
    add(Case("wire", "1 mm, courses of 1 mm", scene(wire={"diameter": 1e-3}), refused=("two diameters of the wire",)))
    for modulus, said in ((1e6, (METAL,)), (1e9, (METAL,)), (1e12, (METAL,))):
        add(Case("stiffness", f"E = {modulus:g} Pa", scene(wire={"youngs_modulus": modulus}), base, allowed=0.01, warned=said))
    ramp = {"drive": "ramp", "preset": "draft"}
    ramped = scene(solver=ramp)
    for density in (10.0, 1e5):
        wire = {"density": density}
        add(Case("density", f"{density:g} kg/m3", scene(wire=wire), base, allowed=0.01, warned=(METAL,)))
        add(Case("density", f"{density:g} kg/m3, ramp", scene(wire=wire, solver=ramp), ramped, allowed=0.01, warned=(METAL,)))
    for repeats in ([1, 16], [8, 8], [1, 10000], [100, 100]):
        draft = {"preset": "draft"}
        tile = scene(knit={"repeats": repeats}, solver=draft)
        name = f"{repeats[0]} x {repeats[1]}, periodic"
        add(Case("repeats", name, tile, scene(solver=draft), allowed=0.02, slow=repeats[1] > 99))
    held = {"model": {"boundary": "gripped"}}
    fine = {"model": {"boundary": "gripped", "nodes_per_loop": 80}}
    tenth = {"load": {"strain_weft": 0.1, "strain_warp": 0.1}}
    for repeats, allowed in (([1, 1], 0.1), ([1, 12], 0.03), ([12, 1], 0.03)):
        knit = {"repeats": repeats}
        one, other = scene(knit=knit, **held, **tenth), scene(knit=knit, **fine, **tenth)
        add(Case("repeats", f"{repeats[0]} x {repeats[1]}, gripped, 10 %", one, other, allowed=allowed))
    add(Case("nodes", "4 a loop", scene(model={"nodes_per_loop": 4}), refused=("from 8 to 100000",)))
    reference = scene(model={"nodes_per_loop": 80})
    for nodes, allowed, said in ((8, 0.2, ("nodes a loop are few",)), (16, 0.03, ()), (48, 0.01, ()), (200, 0.01, ())):
        model = {"nodes_per_loop": nodes}
        refused = ("raise solver.max_steps",) if nodes > 99 else ()
        many = Case("nodes", f"{nodes} a loop", scene(model=model), reference, 1.0, allowed, said, refused, nodes > 99)
        add(many)
    once = {"frames": 1, "usd": False, "figures": False}
    many = scene(model={"nodes_per_loop": 2000}, output=once, solver={"max_steps": 20_000})
    add(Case("nodes", "2000 a loop, 20,000 steps", many, reference, allowed=0.02, refused=("raise solver.max_steps",), slow=True))
    for weft, warp in ((-0.2, -0.2), (-0.2, 0.0), (0.0, -0.2), (-0.2, 0.14), (0.14, -0.2)):
        load = {"strain_weft": weft, "strain_warp": warp}
        finer = scene(load=load, model={"nodes_per_loop": 40})
        add(Case("strain", f"{weft:+.0%} weft, {warp:+.0%} warp", scene(load=load), finer, allowed=0.06, warned=(WRINKLE,)))
    tough = ("exceeds the strength",)
    wide = (1.0, 0.0, math.nan), (0.0, 1.0, math.nan), (0.5, 0.5, 0.08), (1.0, 1.0, 0.08), (1.0, -0.2, math.nan)
    for weft, warp, allowed in wide:
        load, output = {"strain_weft": weft, "strain_warp": warp}, {"frames": 10, "usd": False, "figures": False}
        finer = scene(load=load, model={"nodes_per_loop": 40}, output=output)
        against = None if math.isnan(allowed) else finer
        name = f"{weft:+.0%} weft, {warp:+.0%} warp"
        add(Case("strain", name, scene(load=load, output=output), against, allowed=allowed, warned=(STRESS,), refused=tough))
    for temperature in (4.0, 1500.0):
        like, factor = warmer(temperature)
        add(Case("temperature", f"{temperature:g} K", scene(load={"temperature": temperature}), like, factor, warned=(ROOM,)))
    melted = scene(wire={"material": "gold"}, load={"temperature": 1500.0})
    finer = scene(wire={"material": "gold"}, load={"temperature": 1500.0}, model={"nodes_per_loop": 40})
    add(Case("temperature", "1500 K, gold", melted, finer, allowed=0.05, warned=(ROOM, "melts at")))
    for scaling in (1e4, 1e10):
        add(Case("mass scaling", f"{scaling:g}", scene(solver={**ramp, "mass_scaling": scaling}), ramped, allowed=0.01))
    add(Case("mass scaling", "1e13", scene(solver={**ramp, "mass_scaling": 1e13}), refused=("from 1 to 1e+12",)))
    quick = {**ramp, "axial_softening": 300.0}
    coarse = {"boundary": "periodic", "nodes_per_loop": 12}
    time_of_load = build_model(make_scene(scene(solver=quick, model=coarse))).loading_time
    for factor, said in ((0.01, ("too fast for a quasi-static result", "did not reach equilibrium")), (100.0, ())):
        solver = {**quick, "loading_time": factor * time_of_load}
        against = scene(solver=quick, model=coarse) if factor > 1.0 else None
        loaded = scene(solver=solver, model=coarse)
        add(Case("loading", f"{factor:g} x the time", loaded, against, warned=said, slow=factor > 1.0))
    strip = {"repeats": [1, 2500]}
    single, double = ({"preset": "draft", "precision": name} for name in ("single", "double"))
    one, other = (scene(knit=strip, solver=solver, **held) for solver in (single, double))
    add(Case("precision", "single, a strip of 10 m", one, other, allowed=0.01, slow=True))
    add(Case("precision", "single", scene(solver={"precision": "single"}), scene(solver={"precision": "double"}), allowed=0.01))
    lost = scene(wire={"diameter": 1e-6}, solver={"precision": "single"})
    add(Case("precision", "single, 1 um wire", lost, refused=("round-off in single precision",)))
    for radius in (0.0625, 1.0):
        body = {"boundary": "periodic", "body_radius": radius * 100e-6}
        thick = {"diameter": 100e-6}
        finer = scene(wire=thick, model={**body, "nodes_per_loop": 40})
        large = scene(wire=thick, model=body)
        add(Case("touching", f"100 um, bodies of {radius:g} d", large, finer, allowed=0.05, refused=("too thick for the loops",)))
    thick = {"diameter": 180e-6}
    finer = scene(wire=thick, model={"nodes_per_loop": 40})
    add(Case("touching", "180 um, bodies outside their lenses", scene(wire=thick), finer, allowed=0.05, warned=("press already",),
             refused=("too thick for the loops",)))  # fmt: skip
    for friction in (0.0, 0.3, 1.0, 5.0):
        contact, output = {"friction": friction}, {"frames": 60, "usd": False, "figures": False}
        finer = scene(contact=contact, output=output)
        add(Case("friction", f"{friction:g}", scene(contact=contact), finer, allowed=0.06))
    knit, fine = {"repeats": [2, 2]}, {"model": {"boundary": "gripped", "nodes_per_loop": 40}}
    add(Case("held ends", "apart by 10 %", scene(knit=knit, **held, **tenth), scene(knit=knit, **fine, **tenth), allowed=0.1))
    add(Case("held ends", "apart by 20 %, a wire taut", scene(knit=knit, **held, load={"strain_weft": 0.2}), warned=(STRESS,)))
    together = {"load": {"strain_weft": -0.1, "strain_warp": -0.1}}
    add(Case("held ends", "together", scene(knit=knit, **held, **together), scene(knit=knit, **fine, **together), allowed=0.08,
             warned=(WRINKLE,)))  # fmt: skip
    for boundary in ("periodic", "gripped"):
        model = {"boundary": boundary}
        one, other = (scene(model=model, knit=knit, load={"shear": shear}) for shear in (0.2, -0.2))
        said = (STRESS,) if boundary == "gripped" else ()
        add(Case("held ends", f"shear of 0.2, {boundary}", one, other, allowed=0.05, warned=said))
    load = {**tenth["load"], "clamp_rotation": math.radians(10.0)}
    one, other = scene(knit=knit, **held, load=load), scene(knit=knit, **fine, load=load)
    add(Case("held ends", "each turned by 10 degrees, at 10 %", one, other, allowed=0.1, warned=(STRESS,)))
    one, other = (scene(knit=knit, **held, load={**load, "clamp_rotation": math.radians(turn)}) for turn in (60.0, -60.0))
    add(Case("held ends", "each turned by 60 degrees, at 10 %", one, other, allowed=0.02, warned=(STRESS,)))
    add(Case("held ends", "a tile turned by 30 degrees", {}, allowed=0.01, run=lambda: rotated(math.radians(30.0))))
    return cases


def judged(case: Case) -> Row:
    """Run a case and what it is compared with."""
    if case.run is not None:
        outcome, other = case.run()
    else:
        outcome = run(case.table)
        other = run(case.against) if case.against is not None and outcome.exit == 0 else None
    difference = math.nan
    if other is not None:
        one, wanted = np.array(outcome.tension), case.scale * np.array(other.tension)
        difference = float(np.max(np.abs(one - wanted)) / max(np.max(np.abs(wanted)), LEAST))
    said = "; ".join(outcome.warnings) if outcome.exit == 0 else outcome.message
    return Row(
        case.group, case.name, outcome.exit, outcome.seconds, outcome.steps, *outcome.tension, 100 * difference,
        100 * case.allowed if other is not None else math.nan, ending(case, outcome, other, difference), said,
    )  # fmt: skip


def ending(case: Case, outcome: Outcome, other: Outcome | None, difference: float) -> str:
    """Ending of a case, or WRONG."""
    if outcome.exit:
        line = outcome.message
        known = outcome.exit in (2, 3) and "\n" not in line and any(part in line for part in case.refused)
        return "refused" if known else "WRONG"
    told = all(any(part in warning for warning in outcome.warnings) for part in case.warned)
    right = other is not None and difference <= case.allowed
    if case.against is None and case.run is None:
        right = bool(case.warned) and bool(np.all(np.isfinite(outcome.tension)))
    if not right or not told:
        return "WRONG"
    return "right, warned" if case.warned else "right"


def in_order(rows: list[Row], path: Path, names: list[tuple[str, str]]) -> list[Row]:
    """The rows and earlier ones, in the order of the cases."""
    known = {(row.group, row.case): row for row in read_rows(path, Row)}
    known |= {(row.group, row.case): row for row in rows}
    return [known[name] for name in names if name in known]


def main() -> int:
    parser = new_parser(__doc__)
    add_directory(parser, quick="leave out what takes minutes")
    parser.add_argument("--only", default="", help="cases whose group or name has this in it")
    given = parser.parse_args()
    path = table_path(given, "extremes.csv")
    rows, cases = [], matrix()
    for case in cases:
        if given.only not in f"{case.group}: {case.name}" or (case.slow and given.quick):
            continue
        rows.append(judged(case))
        row = rows[-1]
        print(
            f"{row.group:12s} {row.case:38s} exit {row.exit} {row.seconds:6.1f} s  {row.tension_weft:9.4g}"
            f" {row.tension_warp:9.4g}  differs {row.difference_percent:6.2f} % of {row.allowed_percent:3.0f}"
            f"  {row.ending:13s} {row.said[:90]}",
            flush=True,
        )
        write_rows(path, in_order(rows, path, [(c.group, c.name) for c in cases]))
    wrong = [row for row in rows if row.ending == "WRONG"]
    print(f"{len(rows)} cases: {len(rows) - len(wrong)} end as they have to, {len(wrong)} do not")
    show_rows(wrong) if wrong else None
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
