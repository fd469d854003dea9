"""Cost of finding contacts: neighbour search, walk along the arc, sleeping pairs.

Runs a scene, then times, on the state it has then: one neighbour search, one step's contact kernel with the
pairs that sleep, the same with every pair awake (each walks along the arc from its last contact point), and the whole step.
`search_share` is the share of all searches of the run in its steps.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from warpknit import measure
from warpknit.compute.device import start_warp
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

from .turns import best

SCENE = Path(__file__).parents[2] / "scenes/atlas_patch.toml"


def cases(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """One dictionary."""
    start_warp()
    model = build_model(load_scene(options.scene or SCENE, ["output.frames=4", *options.overrides]), options.device)
    simulation = Simulation(model)
    simulation.compile()
    for record in simulation.run():
        last = record
    state, steps, neighbours = simulation.state, simulation.progress.steps, simulation.mechanics.neighbours
    stepper, searches = simulation.mechanics.stepper, neighbours.searches

    def seconds(work: Callable[[], object], times: int) -> float:
        return best({"": work}, options.rounds, times, options.device)[""]

    search = seconds(neighbours.search, 20)
    asleep = int(np.sum(state.pair_wake.numpy() > 0.0))
    contact = seconds(stepper.evaluate_contact, 200)
    state.pair_wake.zero_()
    awake = seconds(stepper.evaluate_contact, 200)
    neighbours.search()
    step = seconds(lambda: stepper.step(2), 100) / 2
    yield {
        "case": "search",
        "nodes": model.panel.node_count,
        "pairs": model.pair_count,
        "pairs_asleep": asleep,
        "pairs_active": measure.contacts(last.observables).active,
        "searches": searches,
        "steps": steps,
        "search_us": 1e6 * search,
        "contact_us": 1e6 * contact,
        "contact_all_awake_us": 1e6 * awake,
        "step_us": 1e6 * step,
        "search_share": search * searches / (step * steps),
    }
