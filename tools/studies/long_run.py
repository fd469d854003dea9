"""Long runs stay right: the cell at rest and at load over ten million steps.

    python tools/studies/long_run.py [DIR] [--steps N] [--only DRIVE]

One repeat of the double atlas mesh, periodic, as knitted and at 14 % both ways. Three ways to step it on:

    shaken  real masses, double precision, no damping, small random speeds to begin with: the mesh is shaken for good, and what it
            has in energy has to stay
    ramp    the same with the damping of a ramp: it reaches equilibrium, and has to stay there
    relax   fictitious masses, as a relaxation steps it: it rests, and has to stay where it is

The shaken mesh has to keep its energy, to BOUNDS of what the shaking put in; one at rest may move by what the residual tolerance
of 1e-3 lets through: 1e-3 of its tension and of its largest strain. No more than one contact may open or close. Ends with
status 1 where one of them went further.

Prints how far energy, the largest axial strain, tension and active contacts, averaged over fiftieths of the steps, move from the
first fiftieth, and writes long_run.csv, and those averages to long_run_course.csv. --only runs one drive and keeps the rows of
the others.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

import numpy as np
from stepping import advance, as_ramp
from study import add_directory, new_parser, read_rows, scene_of, table_path, write_rows

from warpknit import measure
from warpknit.planar.model import Model
from warpknit.planar.observables import PlanarObservables, read
from warpknit.planar.state import State, initial_state
from warpknit.planar.step import NeighbourSearch, Stepper
from warpknit.planar.time_step import stable_step
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

RUNS = (("shaken", "double"), ("ramp", "double"), ("relax", "single"), ("relax", "double"))
STRAINS = (0.0, 0.14)
LOOKS = 50  # parts of a run
AVERAGE = 200  # readings of a part, spread over it
PENALTY = 1e3  # [N/m] of the contacts of a ramp
BOUNDS = {  # changes of energy, largest axial strain and tension, as in a row
    "shaken": (1e-2, 2e-8, 1e-4),
    "ramp": (1e-6, 4e-9, 1e-4),
    "relax": (1e-6, 4e-9, 1e-4),
}
SPEED = 1e-4  # wire diameters a step, of the shaken mesh


@dataclass(frozen=True)
class Row:
    """A row of long_run.csv: the largest changes since the first fiftieth of the steps."""

    drive: str
    precision: str
    strain: float
    steps: int
    time_step_s: float
    us_a_step: float
    energy_change: float  # of the shaken mesh over what the shaking put in, else over EI/W a loop
    strain_change: float  # of the largest axial strain
    tension_change: float  # over EI/C^3
    active_first: int
    active_least: int
    active_most: int

    @property
    def is_within_bounds(self) -> bool:
        changes = (self.energy_change, self.strain_change, self.tension_change)
        contacts = max(self.active_most - self.active_first, self.active_first - self.active_least)
        return contacts <= 1 and all(change <= bound for change, bound in zip(changes, BOUNDS[self.drive], strict=True))


@dataclass(frozen=True)
class Part:
    """A row of long_run_course.csv: averages over a fiftieth of the steps."""

    drive: str
    precision: str
    strain: float
    steps: int  # at its end
    energy: float  # over EI/W a loop, or over what the shaking put in and from what the mesh has at rest
    axial_strain: float  # the largest
    tension_weft: float  # T C^3/EI
    tension_warp: float
    active: float


def mesh(drive: str, precision: str, strain: float) -> tuple[Model, State]:
    """The cell at rest under its load, ready to be stepped on."""
    solver = {"precision": precision, "residual_tolerance": 1e-3, "axial_softening": 100.0}
    load = {"strain_weft": strain, "strain_warp": strain}
    if drive != "relax":
        table = {
            "model": {"boundary": "periodic", "nodes_per_loop": 24}, "output": {"frames": 4}, "solver": solver,
            "contact": {"stiffness": PENALTY}, "load": load,
        }  # fmt: skip
        return as_ramp(table, 100.0, {"mass_scaling": 1.0, "body_mass": 0.5})
    model = build_model(scene_of("atlas_cell.toml", load=load, solver=solver, output={"frames": 4}))
    state = initial_state(model)
    for _ in Simulation(model, state).run():
        pass
    return model, state


def shake(model: Model, state: State, step: float) -> None:
    """Give everything small random speeds."""
    random = np.random.default_rng(1)
    speed = SPEED * model.scene.wire.diameter / step
    for array in (state.node_vx, state.node_vy, state.body_vx, state.body_vy):
        array.assign(speed * random.standard_normal(array.shape[0]))


def measured(drive: str, precision: str, strain: float, steps: int) -> tuple[Row, list[Part]]:
    """Step one mesh on and on."""
    model, state = mesh(drive, precision, strain)
    neighbours, stepper = NeighbourSearch(model, state), Stepper(model, state, threads=1)
    neighbours.search()
    step = state.steering.time_step
    at_rest = stored(read(model, state))
    scale = measure.energy_scale(model)
    if drive != "relax":
        step = stable_step(model, state, 0)
        shake(model, state, step)
        damping = 0.0 if drive == "shaken" else model.damping
        state.steering.set(time_step=step, damping=damping, velocity_factor=1.0, force_factor=step)
    if drive == "shaken":
        scale = kinetic(model, state, read(model, state), speeds_of(state))
    looks, started = [], time.perf_counter()
    parts = int(LOOKS * AVERAGE)
    for look in range(parts):
        if not advance(stepper, neighbours, steps // parts - 1):
            raise SystemExit(f"{drive}, {precision}, {strain:g}: diverged at look {look}")
        reading, speeds = read(model, state), speeds_of(state)
        advance(stepper, neighbours, 1)
        stretch = float(np.max(np.abs(reading.axial_strain)))
        energy = stored(reading) + kinetic(model, state, reading, speeds) - at_rest * (drive == "shaken")
        looks.append([energy, stretch, *measure.mesh_tension(reading), measure.contacts(reading).active])
    seconds = time.perf_counter() - started
    values = np.array(looks)
    means = values.reshape(LOOKS, AVERAGE, -1).mean(axis=1)
    changes = np.max(np.abs(means - means[0]), axis=0)
    unit = measure.tension_scale(model)
    row = Row(
        drive, precision, strain, steps, step, 1e6 * seconds / steps, float(changes[0] / scale),
        float(changes[1]), float(changes[2:4].max() / unit),
        int(values[0, 4]), int(values[:, 4].min()), int(values[:, 4].max()),
    )  # fmt: skip
    over = np.array([scale, 1.0, unit, unit, 1.0])
    return row, [Part(drive, precision, strain, steps * (k + 1) // LOOKS, *(mean / over)) for k, mean in enumerate(means)]


def stored(reading: PlanarObservables) -> float:
    """[J]"""
    energies = reading.energies
    return energies.stretch + energies.bend + energies.contact


def speeds_of(state: State) -> np.ndarray:
    """(node + body, 2) [m/s] half a step before the displacements."""
    parts = [(state.node_vx, state.node_vy), (state.body_vx, state.body_vy)]
    return np.concatenate([np.stack([x.numpy(), y.numpy()], axis=1).astype(float) for x, y in parts])


def kinetic(model: Model, state: State, reading: PlanarObservables, before: np.ndarray) -> float:
    """[J] m v(n - 1/2) v(n + 1/2)/2, the state being one step further than the reading.

    With the stored energy this is what central differences keep of a linear mesh.
    """
    mass = np.repeat(state.wire_mass.numpy(), model.panel.wire_count) / model.rest.inverse_mass.numpy()[reading.entry]
    mass = np.concatenate([mass, np.full(model.panel.body_count, 1.0 / reading.control.body_inverse_mass)])
    return 0.5 * float(mass @ np.einsum("na,na->n", before, speeds_of(state)))


def main() -> int:
    parser = new_parser(__doc__)
    add_directory(parser)
    parser.add_argument("--steps", type=int, default=10_000_000)
    parser.add_argument("--only", choices=sorted({drive for drive, _ in RUNS}), help="rows of the other drives are kept")
    given = parser.parse_args()
    table, course = table_path(given, "long_run.csv"), table_path(given, "long_run_course.csv")
    rows = [row for row in read_rows(table, Row) if given.only and row.drive != given.only]
    parts = [part for part in read_rows(course, Part) if given.only and part.drive != given.only]
    for drive, precision in RUNS:
        for strain in STRAINS:
            if given.only in (None, drive):
                row, of_row = measured(drive, precision, strain, given.steps)
                rows, parts = [*rows, row], [*parts, *of_row]
                print(row, flush=True)
                write_rows(table, rows)
                write_rows(course, parts)
    beyond = [row for row in rows if not row.is_within_bounds]
    print(f"{len(rows)} runs, {len(beyond)} beyond the bounds", *beyond, sep="\n")
    return 1 if beyond else 0


if __name__ == "__main__":
    sys.exit(main())
