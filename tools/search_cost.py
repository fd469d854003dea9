"""What finding contacts costs: the hash search, the walk along the arc, and what sleeping pairs save.

    python tools/search_cost.py [SCENE] [KEY=VALUE ...]

Loads the scene's mesh, then times, on the state it has then: one neighbour search through the hash, one step's contact
kernel with the pairs that sleep, the same with every pair awake (each walks along the arc from its last contact point),
and the whole step. Prints one line each and the amortised share of the search in the run.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from warpknit import measure
from warpknit.device import start_warp
from warpknit.planar.model import (build_model)
from warpknit.planar.state import initial_state
from warpknit.scene import load_scene
from warpknit.solve.simulate import Simulation


def seconds(work: Callable[[], object], count: int) -> float:
    """Time of one call, the least of three rounds of `count`."""
    best = np.inf
    for _ in range(3):
        begin = time.perf_counter()
        for _ in range(count):
            work()
        best = min(best, (time.perf_counter() - begin) / count)
    return float(best)


def main() -> None:
    scene, *overrides = sys.argv[1:] or ["scenes/atlas_patch.toml"]
    start_warp()
    model = build_model(load_scene(scene, ["output.frames=4", *overrides]))
    simulation = Simulation(model, initial_state(model))
    simulation.warm_up()
    for record in simulation.run():
        last = record
    state, steps, searches = simulation.state, simulation.progress.steps, simulation.drive.neighbours.searches
    search = seconds(simulation.drive.neighbours.search, 20)
    asleep = int(np.sum(state.pair_wake.numpy() > 0.0))
    contact = seconds(simulation.drive.stepper.evaluate_contact, 200)
    state.pair_wake.zero_()
    awake = seconds(simulation.drive.stepper.evaluate_contact, 200)
    simulation.drive.neighbours.search()
    step = seconds(lambda: simulation.drive.stepper.step(2), 100) / 2
    active = measure.contacts(last.observables).active
    print(f"{model.panel.node_count} nodes, {model.pair_count} pairs, {asleep} asleep, {active} active")
    print(f"neighbour search (hash)           {search * 1e6:9.1f} us, {searches} in {steps} steps")
    print(f"contact kernel, sleepers skipped  {contact * 1e6:9.1f} us")
    print(f"contact kernel, every pair walks  {awake * 1e6:9.1f} us")
    print(f"whole step                        {step * 1e6:9.1f} us")
    print(f"search, a share of the steps      {search * searches / (step * steps):9.2%}")


if __name__ == "__main__":
    main()
