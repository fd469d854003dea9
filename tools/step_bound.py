"""How near the bound on the time step comes to the step at which a mesh really diverges.

    python tools/step_bound.py [--scenes N] [--seed S] [--out DIR] [--picture FILE]

Random scenes: pattern, proportions, wire, boundary, nodes, strain, shear, temperature, contact stiffness, body mass, softening and mass
scaling. Each is brought to rest, and stepped from there as `drive = "ramp"` does, undamped, with small random speeds and a step
that is longer from trial to trial. The true limit is the first step at which the kinetic energy grows GROWTH-fold within STEPS
steps, to RESOLUTION. For half of the scenes this is the ramp with its masses (warpknit/solve/timestep.py); for the others
the relaxation with its fictitious masses, whose bound is the step at which they are meant to be stable.
Prints the table's statistics, leaves step_bound.csv in DIR and draws the histogram.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from study import COLOURS, new_figure, tidy, write_rows

from warpknit import measure
from warpknit.errors import Diverged, WarpknitError
from warpknit.kernels import control as c
from warpknit.model.model import Model, build_model
from warpknit.model.numerics import MASS_MARGIN, STEP_MARGIN
from warpknit.scene import Scene, make_scene
from warpknit.solve.simulate import Simulation
from warpknit.model.state import LOOK_AHEAD, State, initial_state
from warpknit.solve.step import Stepper
from warpknit.solve.neighbours import NeighbourSearch
from warpknit.solve.frequency import frequency_square

RESULTS = Path(__file__).parent / "results"
PICTURE = Path(__file__).parents[1] / "docs" / "images" / "step_bound.png"
BARS = {
    "double atlas": (("1-0/1-2/2-3/2-1", "|.", 0), ("2-3/2-1/1-0/1-2", "|.", 1)),
    "pillar": (("0-1/1-0", "|", 0),),
    "closed tricot": (("1-0/1-2", "|", 0),),
    "open tricot": (("0-1/2-1", "|", 0),),
    "cord": (("1-0/2-3", "|", 0),),
    "atlas": (("1-0/1-2/2-3/2-1", "|", 0),),
    "reverse locknit": (("1-0/1-2", "|", 0), ("2-3/1-0", "|", 0)),
    "long double atlas": (("1-0/1-2/2-3/3-4/3-2/2-1", "|.", 0), ("3-4/3-2/2-1/1-0/1-2/2-3", "|.", 0)),
}
STEPS = 3000  # of a trial
GROWTH = 300.0  # of the kinetic energy: more is a divergence. A stable mode within 1e-3 of its limit grows 500-fold, but is one of many
RESOLUTION = 2e-3  # of the true limit
COARSE = 1.03  # from trial to trial until one diverges
SPEED = 1e-4  # wire diameters that the speeds carry in the shortest period, over 2 pi


@dataclass(frozen=True)
class Row:
    """A row of step_bound.csv."""

    scene: int
    drive: str
    pattern: str
    boundary: str
    nodes_per_loop: int
    diameter_over_course: float
    wale_over_course: float
    strain_weft: float
    strain_warp: float
    shear: float
    temperature_K: float
    softening: float
    contact_factor: float
    body_mass: float
    mass_scaling: float
    active_percent: float
    limited_by: str
    bound_s: float
    true_s: float
    ratio: float


def random_table(random: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """Pattern and scene of a mesh at rest."""
    pattern = str(random.choice(list(BARS)))
    course = 10 ** random.uniform(-3.5, -2.5)
    span = lambda low, high: float(random.uniform(low, high))  # noqa: E731
    loop = {
        "closed_radius": span(0.52, 0.66), "closed_head": span(0.48, 0.6), "open_head": span(0.42, 0.56),
        "open_half_width": span(0.22, 0.32),
    } if pattern == "double atlas" else {
        "foot_half_width": span(0.1, 0.14), "leg_half_width": span(0.2, 0.28), "head_height": span(0.18, 0.28)
    }  # fmt: skip
    return pattern, {
        "wire": {
            "youngs_modulus": 10 ** span(9, 12), "density": 10 ** span(3, 4.5), "poissons_ratio": 0.3, "expansion": 10 ** span(-6, -4.5),
            "yield_stress": 1e9, "tensile_strength": 2e9, "diameter": course * 10 ** span(-2.3, -1.6),
        },
        "knit": {
            "bars": [{"chain": chain, "threading": threading, "shift": shift} for chain, threading, shift in BARS[pattern]],
            "wale_spacing": course * (span(1.5, 1.9) if pattern == "double atlas" else span(0.9, 1.8)),
            "course_spacing": course,
            "loop": loop,
        },
        "model": {"boundary": str(random.choice(["periodic", "periodic", "gripped"])), "nodes_per_loop": int(random.integers(12, 61))},
        "load": {
            "strain_weft": span(-0.02, 0.2), "strain_warp": span(-0.02, 0.2), "shear": span(-0.05, 0.05), "temperature": span(4, 1000),
        },
        "contact": {},
        "solver": {"axial_softening": 10 ** span(0, 2.5), "precision": "double", "residual_tolerance": 1e-3, "multipliers": False,
                   "max_steps": 60000},
        "output": {"frames": 4},
    }  # fmt: skip


def at_rest(table: dict[str, Any]) -> tuple[Model, State]:
    """The mesh at rest under its load, without multipliers: its stiffnesses are those that it is stepped with."""
    model = build_model(make_scene(table))
    state = initial_state(model)
    for _ in Simulation(model, state).run():
        pass
    return model, state


def as_ramp(table: dict[str, Any], rest: State) -> tuple[Model, State]:
    """The same state with the masses of a ramp."""
    model = build_model(make_scene({**table, "solver": {**table["solver"], "drive": "ramp"}}))
    state = initial_state(model)
    control = rest.read_control()
    kept = rest.arrays()
    del kept["control"]
    state.restore({**kept, "wire_mass": np.ones_like(kept["wire_mass"]), "control": state.arrays()["control"]})
    where = range(int(c.GRADIENT), int(c.LENGTH_FACTOR) + 1)
    state.write_control({k: float(control[k]) for k in where})
    state.write_control({int(end) + k: float(control[int(c.GRADIENT) + k]) for end in (c.FROM, c.TO) for k in range(5)})
    NeighbourSearch(model, state).search()
    Stepper(model, state).evaluate_contact()
    return model, state


class Trials:
    """Steps a state from where it stands, by steps of any size."""

    def __init__(self, model: Model, state: State, random: np.random.Generator, shortest: float) -> None:
        """`shortest` [s]: a step near the limit."""
        self.model, self.state = model, state
        self.stepper = Stepper(model, state, threads=1)
        self.neighbours = NeighbourSearch(model, state)
        self.kept = state.arrays()
        speed = SPEED * model.scene.wire.diameter * 2.0 / shortest
        n, m = model.panel.node_count, model.panel.body_count
        for name, count in (("node_v", n), ("body_v", m)):
            for axis in "xy":
                self.kept[name + axis] = speed * random.standard_normal(count)

    def diverges(self, step: float) -> bool:
        """Whether the mesh, undamped, diverges at steps of so many seconds."""
        state = self.state
        state.restore(self.kept)
        state.write_control({
            c.TIME_STEP: step, c.DAMPING: 0.0, c.VELOCITY_FACTOR: 1.0, c.FORCE_FACTOR: step, c.STATUS: 0.0, c.DRIVE: 1.0,
            c.RAMP_STEP: 0.0, c.RAMP_STEPS: 0.0, c.SPEED_LIMIT: np.inf,
        })  # fmt: skip
        self.neighbours.search()
        self.stepper.step(2)
        start, taken = float(state.read_control()[int(c.KINETIC_TWICE)]), float(state.read_control()[int(c.STEP)])
        last = taken + STEPS
        while taken < last:
            self.stepper.step(int(min(250, last - taken)))
            control = state.read_control()
            if control[int(c.STATUS)] == 2.0 or not control[int(c.KINETIC_TWICE)] < GROWTH * start:
                return True
            if control[int(c.STATUS)] == 1.0:
                if control[int(c.STEP)] < taken + 20:
                    return True  # too fast to be followed
                self.neighbours.search()
            taken = float(control[int(c.STEP)])
        return False

    def limit(self, bound: float) -> float:
        """The step [s] at which it diverges."""
        low = 0.5 * bound
        while self.diverges(low):
            low *= 0.5
        high = low * COARSE
        while not self.diverges(high):
            low, high = high, high * COARSE
        while high > low * (1.0 + RESOLUTION):
            middle = math.sqrt(low * high)
            low, high = (low, middle) if self.diverges(middle) else (middle, high)
        return low


def measured(number: int, seed: int) -> list[Row]:
    """Rows of one scene, a ramp and a relaxation; other draws take the place of scenes that cannot be knitted or do not come to rest."""
    random = np.random.default_rng([seed, number])
    while True:
        pattern, table = random_table(random)
        factor, mass = 10 ** random.uniform(-1, 1), 10 ** random.uniform(-1.5, 1)
        scaling = 10 ** random.uniform(0, 8)
        try:
            scene = make_scene(table)
            model = build_model(scene)
            h = float(model.table.spacing.min())
            table["contact"] = {"stiffness": factor * 20.0 * scene.wire.bending_stiffness / h**3}
            table["solver"] = {**table["solver"], "drive": "relax"}
            relaxed, rest = at_rest(table)
        except (Diverged, WarpknitError) as error:
            print(f"scene {number}: drawn again: {str(error)[:140]}", flush=True)
            continue
        table["contact"]["body_mass"] = mass
        table["solver"]["mass_scaling"] = scaling
        ramp, moving = as_ramp(table, rest)
        break
    rows = []
    for drive, model, state in (("ramp", ramp, moving), ("relax", relaxed, rest)):
        reading = measure.read(model, state)
        if drive == "ramp":
            t0 = time.perf_counter()
            bound, limited = 2.0 / math.sqrt(frequency_square(reading)), "x"
            t1 = time.perf_counter() - t0
        else:
            bound, limited = math.sqrt(MASS_MARGIN / (1.0 + 2.0 * LOOK_AHEAD)), "unit step"
        true = Trials(model, state, random, bound).limit(bound)
        if drive == "ramp":
            body = 2 * float(reading.control[int(c.CONTACT_STIFFNESS)] * reading.control[int(c.BODY_INVERSE_MASS)])
            print(f"  {t1*1e3:.1f} ms  bouncing {2/math.sqrt(4*body)/true:.2f} plan {model.time_step/STEP_MARGIN/true:.2f} ", end="")
            global SPEED
            for SPEED in (1e-3, 1e-2):
                print(f"{Trials(model, state, random, bound).limit(bound)/true:.3f}", end=" ")
            SPEED = 1e-4
            print()
        load, knit = table["load"], table["knit"]
        rows.append(Row(
            number, drive, pattern, table["model"]["boundary"], table["model"]["nodes_per_loop"],
            table["wire"]["diameter"] / knit["course_spacing"], knit["wale_spacing"] / knit["course_spacing"],
            load["strain_weft"], load["strain_warp"], load["shear"], load["temperature"], table["solver"]["axial_softening"], factor,
            mass, scaling, measure.contacts(reading).active_percent, limited, bound, true, bound / true,
        ))  # fmt: skip
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--out", type=Path, default=RESULTS)
    given = parser.parse_args(arguments)
    rows: list[Row] = []
    for number in range(given.scenes):
        rows += measured(number, given.seed)
        for r in rows[-2:]:
            print(f"{r.scene:4d} {r.drive:5s} {r.pattern:18s} {r.boundary:9s} n {r.nodes_per_loop:3d} s {r.softening:6.1f} k {r.contact_factor:5.2f} m {r.body_mass:5.2f}"
                  f" active {r.active_percent:4.0f} {r.limited_by:9s} {r.ratio:.3f}", flush=True)
    for drive in ("ramp", "relax"):
        ratio = np.array([row.ratio for row in rows if row.drive == drive])
        print(f"{drive}: bound over true limit: median {np.median(ratio):.3f}, least {ratio.min():.3f}, largest {ratio.max():.3f}, above 1: {np.count_nonzero(ratio > 1)}")
    write_rows(given.out / "step_bound.csv", rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
