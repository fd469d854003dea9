"""Time of a step of ranks that share a mesh, and its communication.

    python tools/bench.py --ranks --threads 1 2                     one rank
    mpirun -n 2 python tools/bench.py --ranks --nodes 1e5 1e6       two ranks

The mesh is the periodic tile of scenes/atlas_cell.toml at rest under 12 % both ways, with similar numbers of columns and rows of
repeats, or `--rows` of them. `step_us` is the best of `--rounds` turns. `swap_us` is the swap of forces at the borders and
`rows_us` the swap of partial sums, both alone. `work_us` is the processor time of a step of one rank that waits for nobody, which
other programs on the machine hardly change. `border_bytes` is the most that a rank sends to its neighbours in a step. To compare
numbers of ranks, take turns.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from warpknit.compute.device import find_device
from warpknit.compute.ranks import Ranks, join_ranks
from warpknit.planar.state import initial_state
from warpknit.planar.world_step import StripStepper
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

CELL = Path(__file__).parents[2] / "scenes/atlas_cell.toml"
LOAD = ("load.strain_weft=0.12", "load.strain_warp=0.12", "output.frames=1")
SWAPS = 5000

Clock: TypeAlias = Callable[[], float]


def best(work: Callable[[], object], times: int, rounds: int, ranks: Ranks, clock: Clock = time.perf_counter) -> float:
    """[us] of one call, the slowest rank's, in the best of the rounds."""
    found = math.inf
    for _ in range(rounds):
        ranks.everyone(None)
        begin = clock()
        for _ in range(times):
            work()
        found = min(found, max(ranks.everyone(clock() - begin)))
    return 1e6 * found / times


def measure(options: argparse.Namespace, nodes: int, threads: int, ranks: Ranks) -> dict[str, Any]:
    one = build_model(load_scene(CELL)).panel.node_count
    rows = options.rows or max(1, round(math.sqrt(nodes / one)))
    columns = max(1, round(nodes / one / rows))
    os.environ["WARPKNIT_THREADS"] = str(threads)
    model = build_model(load_scene(CELL, [*LOAD, f"knit.repeats=[{columns}, {rows}]"]), options.device, ranks)
    state = initial_state(model)
    simulation = Simulation(model, state)
    for _record in simulation.run():
        pass
    state.steering.set(travel_limit=np.inf)
    stepper = simulation.mechanics.stepper
    steps = max(1, round(options.seconds * 1e8 * ranks.count / nodes / 50)) * 50
    found = {
        "case": "ranks",
        "nodes": model.global_model.panel.node_count,
        "repeats": [columns, rows],
        "ranks": ranks.count,
        "threads": stepper.threads,
        "step_us": round(best(lambda: stepper.step(steps), 1, options.rounds, ranks) / steps, 2),
        "border_bytes": 0,
        "swap_us": 0.0,
        "rows_us": 0.0,
    }
    if isinstance(stepper, StripStepper):
        found["border_bytes"] = max(ranks.everyone(stepper.border_bytes))
        found["swap_us"] = round(best(stepper._exchange_forces, SWAPS, options.rounds, ranks), 2)
        found["rows_us"] = round(best(stepper._collect_rows, SWAPS, options.rounds, ranks), 2)
        stepper._exchange_forces = stepper._collect_rows = lambda: None
    found["work_us"] = round(best(lambda: stepper.step(steps), 1, options.rounds, ranks, time.process_time) / steps, 2)
    return found


def cases(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A dictionary a size and number of threads, on the first rank."""
    ranks = join_ranks()
    options.device = find_device(options.device, ranks.place)
    for nodes in options.nodes:
        for threads in options.threads:
            found = measure(options, int(nodes), threads, ranks)
            if ranks.is_first:
                yield found
