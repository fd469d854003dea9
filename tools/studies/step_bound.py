"""Ratio of the used step to the step at which a mesh diverges.

    python tools/studies/step_bound.py [DIR] [--scenes N] [--first N] [--seed S]

Random scenes: pattern, proportions, wire, boundary, nodes, strain, shear, temperature, contact stiffness, body mass, softening,
mass scaling. Each is relaxed twice, and stepped from there with small random speeds and no damping, by a step that grows from
trial to trial:

    ramp    with the masses of a ramp and the softening it keeps, by the step of warpknit/planar/time_step.py
    relax   with fictitious masses, multipliers as in equilibrium, by the step of 1 s that they are made for

The true limit is the shortest step tried, to RESOLUTION, at which the kinetic energy grows to GROWTH times what it reaches with
steps a third as long. `ratio` is the step that is taken, margin included, over the limit; `bound_ratio` leaves the margin out.
Prints what the ratios are, and leaves step_bound.csv and their histogram, step_bound.png.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from stepping import advance, as_ramp, at_rest
from study import COLOURS, add_directory, new_figure, new_parser, picture_path, read_rows, table_path, tidy, write_rows

from warpknit import measure
from warpknit.base.errors import Diverged, WarpknitError
from warpknit.mechanics.numerics import LOOK_AHEAD, MASS_MARGIN, STEP_MARGIN
from warpknit.planar.model import Model
from warpknit.planar.observables import read
from warpknit.planar.state import State
from warpknit.planar.step import NeighbourSearch, Stepper
from warpknit.planar.time_step import largest_step
from warpknit.scene import make_scene
from warpknit.solve.model import build_model

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
LOOK = 250  # steps between looks at its energy
GROWTH = 100.0  # of the kinetic energy
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
    contact_over_bend: float  # penalty over EI/h^3
    body_mass: float
    mass_scaling: float
    active_percent: float
    step_s: float
    limit_s: float
    ratio: float
    bound_ratio: float


@dataclass(frozen=True)
class Drawn:
    """A random scene in equilibrium, for a relaxation and a ramp."""

    pattern: str
    table: dict[str, Any]
    scaling: dict[str, float]  # body_mass and mass_scaling of the ramp
    relaxed: tuple[Model, State]
    moving: tuple[Model, State]


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
            "youngs_modulus": 10 ** span(9, 12), "density": 10 ** span(3, 4.5), "expansion": 10 ** span(-6, -4.5),
            "yield_stress": 1e9, "tensile_strength": 2e9, "diameter": course * 10 ** span(-2.3, -1.6),
        },
        "knit": {
            "bars": [{"chain": chain, "threading": threading, "shift": shift} for chain, threading, shift in BARS[pattern]],
            "wale_spacing": course * (span(1.5, 1.9) if pattern == "double atlas" else span(0.9, 1.8)),
            "course_spacing": course,
            "loop": loop,
        },
        "model": {
            "kind": "planar",
            "boundary": str(random.choice(["periodic", "periodic", "gripped"])), "nodes_per_loop": int(random.integers(12, 49)),
        },
        "load": {
            "strain_weft": span(-0.02, 0.2), "strain_warp": span(-0.02, 0.2), "shear": span(-0.05, 0.05),
            "temperature": span(4, 1000),
        },
        "contact": {},
        "solver": {"axial_softening": 10 ** span(1, 3), "precision": "double", "residual_tolerance": 3e-3, "max_steps": 15000},
        "output": {"frames": 2},
    }  # fmt: skip


class Trials:
    """Steps a state from where it stands, by steps of any size."""

    def __init__(self, model: Model, state: State, random: np.random.Generator, shortest: float) -> None:
        """`shortest` [s]: a step near the limit."""
        self.model, self.state = model, state
        self.stepper = Stepper(model, state, threads=1)
        self.neighbours = NeighbourSearch(model, state)
        self.kept = state.arrays()
        self.most = math.inf  # of the kinetic energy, twice [J]
        speed = SPEED * model.scene.wire.diameter * 2.0 / shortest
        n, m = model.panel.node_count, model.panel.body_count
        for name, count in (("node_v", n), ("body_v", m)):
            for axis in "xy":
                self.kept[name + axis] = speed * random.standard_normal(count)

    def diverges(self, step: float) -> bool:
        """Whether the undamped mesh diverges at steps of `step` seconds."""
        state = self.state
        state.restore(self.kept)
        state.steering.set(
            time_step=step,
            damping=0.0,
            velocity_factor=1.0,
            force_factor=step,
            status=0.0,
            drive=1.0,
            ramp_step=0.0,
            ramp_steps=0.0,
            speed_limit=np.inf,
        )
        self.neighbours.search()
        reached = 0.0
        for _ in range(STEPS // LOOK):
            if not advance(self.stepper, self.neighbours, LOOK):
                return True
            reached = max(reached, state.steering.kinetic_twice)
            if not reached < self.most:
                return True
        self.reached = reached
        return False

    def limit(self, step: float) -> float:
        """The step [s] at which it diverges; `step` is one that should not."""
        low = step / 3.0
        if self.diverges(low):
            return low
        self.most = GROWTH * self.reached
        high = low * COARSE
        while not self.diverges(high):
            low, high = high, high * COARSE
        while high > low * (1.0 + RESOLUTION):
            middle = math.sqrt(low * high)
            low, high = (low, middle) if self.diverges(middle) else (middle, high)
        return high


def drawn(number: int, random: np.random.Generator) -> Drawn:
    """A knittable scene that reaches equilibrium; others are drawn again."""
    while True:
        pattern, table = random_table(random)
        factor, given = float(10 ** random.uniform(-1, 1)), bool(random.integers(2))
        scaling = {"body_mass": 10 ** random.uniform(-1.5, 1), "mass_scaling": 10 ** random.uniform(0, 8)}
        try:
            model = build_model(make_scene(table))
            if given:
                bend = model.bending_stiffness / float(model.table.spacing.min()) ** 3
                table["contact"] = {"stiffness": factor * 20.0 * bend}
            relaxed = at_rest(table)
            softening = min(relaxed[0].softening, 10 ** random.uniform(0, 2.5))
            penalty = {**table, "contact": {"stiffness": table["contact"].get("stiffness", model.contact_stiffness)}}
            moving = as_ramp(penalty, softening, scaling)
        except (Diverged, WarpknitError) as error:
            print(f"scene {number}: drawn again: {str(error)[:150]}", flush=True)
            continue
        return Drawn(pattern, table, scaling, relaxed, moving)


def measured(number: int, seed: int) -> list[Row]:
    """Rows of one scene, as a ramp and as a relaxation."""
    random = np.random.default_rng([seed, number])
    scene = drawn(number, random)
    rows = []
    for drive, (model, state) in (("ramp", scene.moving), ("relax", scene.relaxed)):
        reading = read(model, state)
        control = reading.control
        if drive == "ramp":
            bound, margin = largest_step(reading, 0), STEP_MARGIN
        else:
            bound = math.sqrt(MASS_MARGIN / (1.0 + 2.0 * LOOK_AHEAD))
            margin = 1.0 / bound
        limit = Trials(model, state, random, bound).limit(bound)
        table, bend = scene.table, model.bending_stiffness / float(model.table.spacing.min()) ** 3
        load, knit = table["load"], table["knit"]
        rows.append(Row(
            scene=number, drive=drive, pattern=scene.pattern, boundary=table["model"]["boundary"],
            nodes_per_loop=table["model"]["nodes_per_loop"],
            diameter_over_course=table["wire"]["diameter"] / knit["course_spacing"],
            wale_over_course=knit["wale_spacing"] / knit["course_spacing"],
            strain_weft=load["strain_weft"], strain_warp=load["strain_warp"], shear=load["shear"],
            temperature_K=load["temperature"],
            softening=model.softening, contact_over_bend=control.contact_stiffness / bend,
            body_mass=scene.scaling["body_mass"], mass_scaling=scene.scaling["mass_scaling"] if drive == "ramp" else 1.0,
            active_percent=measure.contacts(reading).active_percent, step_s=margin * bound,
            limit_s=limit, ratio=margin * bound / limit, bound_ratio=bound / limit,
        ))  # fmt: skip
    return rows


def draw(rows: Sequence[Row], path: Path) -> None:
    """The histogram."""
    figure, panels = new_figure(9.0, 3.4, 1, 2)
    edges = np.linspace(0.2, 1.05, 52)
    titles = {"ramp": "ramp", "relax": "relaxation"}
    for axes, (drive, title), colour in zip(panels[0], titles.items(), COLOURS, strict=False):
        ratio = np.array([row.ratio for row in rows if row.drive == drive])
        axes.hist(np.clip(ratio, edges[0], None), edges, color=colour)
        axes.axvline(1.0, color="black", linewidth=1.0)
        axes.axvline(float(np.median(ratio)), color="black", linewidth=1.0, linestyle="--")
        axes.set(title=title, xlabel="step taken over the step that really diverges", ylabel=f"scenes, of {len(ratio)}")
        axes.text(0.03, 0.93, f"median {np.median(ratio):.3f}\nleast {ratio.min():.2f}", transform=axes.transAxes, va="top")
    tidy(panels, legend=False)
    figure.savefig(path)


def main() -> int:
    parser = new_parser(__doc__)
    add_directory(parser)
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first scene; rows of others are kept")
    parser.add_argument("--seed", type=int, default=5)
    given = parser.parse_args()
    path = table_path(given, "step_bound.csv")
    rows = read_rows(path, Row) if given.first else []
    for number in range(given.first, given.first + given.scenes):
        rows += measured(number, given.seed)
        write_rows(path, rows)
        for row in rows[-2:]:
            print(
                f"{row.scene:4d} {row.drive:5s} {row.pattern:18s} {row.boundary:9s} {row.nodes_per_loop:3d} nodes, softened"
                f" {row.softening:6.1f}, contact/bend {row.contact_over_bend:6.1f}, bodies {row.body_mass:5.2f},"
                f" {row.active_percent:3.0f} % active: {row.ratio:.3f}",
                flush=True,
            )
    for drive in ("ramp", "relax"):
        ratio = np.array([row.ratio for row in rows if row.drive == drive])
        count, edges = np.histogram(ratio, np.arange(0.3, 1.1, 0.05))
        bound = np.median([row.bound_ratio for row in rows if row.drive == drive])
        print(f"{drive}: median {np.median(ratio):.3f}, least {ratio.min():.3f}, largest {ratio.max():.3f},"
              f" above 1: {np.count_nonzero(ratio > 1)} of {len(ratio)}; median without margin {bound:.3f}")  # fmt: skip
        for begin, number in zip(edges, count, strict=False):
            print(f"  {begin:.2f} {'#' * int(number)} {number}")
    draw(rows, picture_path(given, "step_bound.png"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
