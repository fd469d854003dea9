"""Meshes in equilibrium, stepped without a drive as by a relaxation or a ramp."""

from __future__ import annotations

from typing import Any

import numpy as np

from warpknit.planar.model import Model
from warpknit.planar.state import State, initial_state
from warpknit.planar.step import NeighbourSearch, Stepper
from warpknit.scene import make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

FOLLOWED = 20  # steps between two searches, at least


def at_rest(table: dict[str, Any], **solver: Any) -> tuple[Model, State]:
    """The mesh at rest under its load. Raises Diverged."""
    model = build_model(make_scene({**table, "solver": {**table["solver"], "drive": "relax", **solver}}))
    state = initial_state(model)
    for _ in Simulation(model, state).run():
        pass
    return model, state


def as_ramp(table: dict[str, Any], softening: float, scaling: dict[str, float]) -> tuple[Model, State]:
    """Equilibrium without multipliers, with softened stiffnesses and a ramp's masses."""
    _, rest = at_rest(table, axial_softening=softening, multipliers=False)
    solver = {**table["solver"], "drive": "ramp", "axial_softening": softening, "mass_scaling": scaling["mass_scaling"]}
    model = build_model(
        make_scene({**table, "solver": solver, "contact": {**table["contact"], "body_mass": scaling["body_mass"]}})
    )
    state = initial_state(model)
    kept = rest.arrays()
    del kept["control"]
    state.restore({**kept, "wire_mass": np.ones_like(kept["wire_mass"]), "control": state.arrays()["control"]})
    load = rest.steering.load
    state.steering.set(load=load, ramp_from=load, ramp_to=load)
    NeighbourSearch(model, state).search()
    Stepper(model, state).evaluate_contact()
    return model, state


def advance(stepper: Stepper, neighbours: NeighbourSearch, steps: int) -> bool:
    """Take steps without a drive, searching neighbours where the last search no longer holds; False where the mesh diverges or
    moves too fast to be followed."""
    state = stepper.state
    now = state.steering.step
    end, searched = now + steps, -FOLLOWED
    while now < end:
        stepper.step(int(min(50_000, end - now)))
        control = state.steering.read()
        status, now = control.status, control.step
        if status == 2.0 or (status == 1.0 and now < searched + FOLLOWED):
            return False
        if status == 1.0:
            neighbours.search()
            searched = now
    return True
