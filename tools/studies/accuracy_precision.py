"""Single against double precision, for accuracy.py."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from study import scene_of, show_rows, table_path, write_rows

from warpknit import measure
from warpknit.planar.model import Model
from warpknit.planar.state import State, initial_state
from warpknit.planar.step import NeighbourSearch, Stepper
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

MESHES: dict[str, dict[str, dict[str, Any]]] = {
    "patch of 24 mm": {},
    "strip of 1 m": {"knit": {"repeats": [1, 250]}},
}
ROUNDS = 7  # of the speed
STEPS = 200  # of a round


@dataclass(frozen=True)
class PrecisionRow:
    """A row of precision.csv; errors in percent of the reference."""

    scene: str
    precision: str
    nodes: int
    steps: int
    node_steps_per_s: float
    tension_weft_N_per_m: float
    tension_warp_N_per_m: float
    active_percent: float
    error_tension_percent: float
    error_active_points: float
    error_contact_force_percent: float
    error_stress_percent: float


@dataclass(frozen=True)
class Equilibrium:
    """A mesh at rest under its load, and what is measured on it."""

    model: Model
    state: State
    steps: int
    tension: np.ndarray  # (2,) [N/m]
    active_percent: float
    contact_force: float  # [N]
    stress: float  # [Pa]


def find(name: str, precision: str, tolerance: float) -> Equilibrium:
    """Run a scene."""
    tables = {
        **MESHES[name], "solver": {"precision": precision, "residual_tolerance": tolerance}, "output": {"frames": 2},
    }  # fmt: skip
    model = build_model(scene_of("atlas_patch.toml", **tables))
    state = initial_state(model)
    simulation = Simulation(model, state)
    *_, last = simulation.run()
    r = last.observables
    return Equilibrium(
        model, state, simulation.progress.steps, np.array(measure.mesh_tension(r)), measure.contacts(r).active_percent,
        float(r.pair_force.max(initial=0.0)), measure.stress_extremes(r)[0],
    )  # fmt: skip


def speeds(meshes: Sequence[Equilibrium]) -> list[float]:
    """Node-steps a second of each, which take turns."""
    steppers = [Stepper(mesh.model, mesh.state, threads=1) for mesh in meshes]
    searches = [NeighbourSearch(mesh.model, mesh.state) for mesh in meshes]
    best = [np.inf] * len(meshes)
    for turn in range(ROUNDS + 1):
        for k, (stepper, neighbours) in enumerate(zip(steppers, searches, strict=True)):
            neighbours.search()
            start = time.perf_counter()
            stepper.step(STEPS)
            seconds = time.perf_counter() - start
            if meshes[k].state.steering.status:
                raise SystemExit("a mesh at rest moved too far to be followed")  # steps then do nothing
            if turn:  # the first launch of all compiles
                best[k] = min(best[k], seconds)
    return [mesh.model.panel.node_count * STEPS / seconds for mesh, seconds in zip(meshes, best, strict=True)]


def row_of(name: str, precision: str, found: Equilibrium, reference: Equilibrium, speed: float) -> PrecisionRow:
    """A run against the reference."""
    error = lambda value, wanted: 100.0 * float(np.max(np.abs(value - wanted)) / np.max(np.abs(wanted)))  # noqa: E731
    return PrecisionRow(
        name, precision, found.model.panel.node_count, found.steps, speed, *found.tension.tolist(), found.active_percent,
        error(found.tension, reference.tension), abs(found.active_percent - reference.active_percent),
        error(found.contact_force, reference.contact_force), error(found.stress, reference.stress),
    )  # fmt: skip


def study_precision(given: argparse.Namespace) -> None:
    rows: list[PrecisionRow] = []
    for name in list(MESHES)[: 1 if given.quick else None]:
        found = {precision: find(name, precision, 3e-3) for precision in ("single", "double")}
        rates = speeds(list(found.values()))
        reference = find(name, "double", 3e-4)
        rows += [row_of(name, *item, reference, speed) for item, speed in zip(found.items(), rates, strict=True)]
        show_rows(rows)
    write_rows(table_path(given, "precision.csv"), rows)
