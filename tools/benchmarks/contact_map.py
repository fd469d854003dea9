"""Cost of a contact map as one batch, beside single cells.

A round gives cell-steps per second of the batch on one and on all threads and of `Simulation` cell by cell (the time loop alone,
without building and files), measured in turn, and the seconds that all cells take or would take: of wall time, and of all cores
together, which says more on a machine that others use too.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from warpknit.mechanics.numerics import CORES
from warpknit.planar.model import Model
from warpknit.planar.state import initial_state
from warpknit.scene import Scene, Stage, load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.studies.load_path import ends_of, knitted_worlds

SCENE = Path(__file__).parents[2] / "scenes/contact_map.toml"


def cases(options: argparse.Namespace) -> Iterator[dict[str, str | float]]:
    """A dictionary a round."""
    scene = load_scene(options.scene or SCENE)
    if scene.sweep is None:
        raise SystemExit(f"{scene.path} has no [sweep]")
    stages = [
        replace(scene.stages[0], strain_weft=x, strain_warp=y, tension_weft=None, tension_warp=None)
        for y in scene.sweep.strain_warp
        for x in scene.sweep.strain_weft
    ]
    model = build_model(scene)
    levels = scene.output.levels
    list(ends_of(knitted_worlds([model], [stages[:1]], [levels])))  # compiles the kernels
    one_by_one(scene, model, stages[:1])
    for _ in range(options.rounds):
        row: dict[str, float | int] = {"cells": len(stages), "nodes": model.panel.node_count}
        for threads in (1, len(CORES)):
            os.environ["WARPKNIT_THREADS"] = str(threads)
            begin, begin_cpu = time.perf_counter(), time.process_time()
            batch = knitted_worlds([model] * len(stages), [[stage] for stage in stages], [levels] * len(stages))
            list(ends_of(batch))
            wall, cpu = time.perf_counter() - begin, time.process_time() - begin_cpu
            row |= {f"batch_{threads}_threads_s": wall, f"batch_{threads}_threads_cpu_s": cpu}
            row[f"batch_{threads}_threads_cell_steps_per_s"] = batch.steps / wall
        begin_cpu = time.process_time()
        steps, wall = one_by_one(scene, model, stages[:: options.sample])
        share = batch.steps / steps
        row["one_by_one_cell_steps_per_s"] = steps / wall
        row |= {"one_by_one_s": wall * share, "one_by_one_cpu_s": (time.process_time() - begin_cpu) * share}
        yield {"case": "map"} | {key: float(f"{value:.4g}") for key, value in row.items()}


def one_by_one(scene: Scene, model: Model, stages: Sequence[Stage]) -> tuple[int, float]:
    """Steps and seconds of single runs."""
    steps, begin = 0, time.perf_counter()
    for stage in stages:
        simulation = Simulation(replace(model, scene=replace(scene, stages=(stage,))), initial_state(model))
        for _ in simulation.run():
            pass
        steps += simulation.progress.steps
    return steps, time.perf_counter() - begin
