"""Where the time of a step in space goes: with and without contact, kernel by kernel, and the search of pairs.

Runs the spatial cell to 10 % roughly, then times its steps in the state reached. Kernels alone are timed with a time step of
zero, which leaves the state where it is. Times are in us, that of the search spread over all steps.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warpknit.kernels import control as c
from warpknit.model import build_model
from warpknit.scene import load_scene
from warpknit.solve.simulate import Simulation

from .turns import best

SCENE = Path(__file__).parents[2] / "scenes" / "atlas_cell_spatial.toml"
STEPS = 200
NODES_PER_LOOP = 64
PARTS = {
    "update_frames": "rods",
    "bend_rods": "rods",
    "step_rods": "rods",
    "find_closest_places": "narrow_phase",
    "add_contact_forces": "contact_forces",
}


def at_load(repeats: int, overrides: list[str]) -> Simulation:
    """The cell at rest, roughly."""
    options = [
        "solver.preset=draft",
        "solver.residual_tolerance=0.05",
        "output.frames=3",
        f"model.nodes_per_loop={NODES_PER_LOOP}",
        f"knit.repeats=[{repeats}, {repeats}]",
    ]
    relaxation = Simulation(build_model(load_scene(SCENE, [*options, *overrides])))
    for _record in relaxation.run():
        pass
    return relaxation


def repeated(relaxation: Simulation, kernel: wp.Kernel, dim: int, inputs: list) -> Callable[[], None]:
    """One kernel alone, STEPS times."""
    device = relaxation.mechanics.stepper.device
    with wp.ScopedCapture(device=device) as capture:
        for _ in range(STEPS):
            wp.launch(kernel, dim=dim, inputs=inputs, device=device)
    return lambda: wp.capture_launch(capture.graph)


def kernels_alone(relaxation: Simulation, rounds: int) -> dict[str, float]:
    """[s] of each kernel of a step."""
    stepper = relaxation.mechanics.stepper
    kept = {c.TIME_STEP: float(stepper.state.read_control()[int(c.TIME_STEP)])}
    stepper.state.write_control({c.TIME_STEP: 0.0})
    works = {kernel.key: repeated(relaxation, kernel, dim, inputs) for kernel, dim, inputs in stepper.launches()}
    taken = best(works, rounds)
    stepper.state.write_control(kept)
    return {name: seconds / STEPS for name, seconds in taken.items()}


def measure(repeats: int, overrides: list[str], rounds: int) -> dict[str, Any]:
    """What a step takes, and its parts."""
    relaxation = at_load(repeats, overrides)
    stepper, contact, steps = relaxation.mechanics.stepper, relaxation.mechanics.contact, relaxation.progress.steps
    nodes, searches = relaxation.model.rods.node_count, contact.searches
    contact.search()
    stepper.state.write_control({c.TRAVEL_LIMIT: np.inf})
    stepper.step(STEPS)
    whole = best({"step": lambda: stepper.step(STEPS)}, rounds)["step"] / STEPS
    parts = kernels_alone(relaxation, rounds)
    near, pairs = contact.read_contacts(), contact.pair_count
    search = best({"search": contact.search}, rounds)["search"] * searches / max(steps, 1)
    stepper.contact = None
    stepper.step(STEPS)
    free = best({"step": lambda: stepper.step(STEPS)}, rounds)["step"] / STEPS
    share = dict.fromkeys(("broad_phase", *dict.fromkeys(PARTS.values())), 0.0) | {"broad_phase": search}
    for name, seconds in parts.items():
        share[PARTS[name]] += seconds
    return {
        "case": "space",
        "nodes": nodes,
        "precision": "double",
        "threads": 1,
        "device": str(stepper.device),
        "node_steps_per_s": nodes / whole,
        "compile_s": None,
        "c_loop_node_steps_per_s": None,
        "bandwidth_floor_node_steps_per_s": None,
        "node_steps_per_s_without_contact": nodes / free,
        "pairs": pairs,
        "contacts": int((near.force > 0.0).sum()),
        "searches": searches,
        "steps": steps,
        "step_us": 1e6 * whole,
        **{f"{name}_us": 1e6 * seconds for name, seconds in share.items()},
        "kernels_us": {name: 1e6 * seconds for name, seconds in parts.items()},
    }


def cases(options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A dictionary a size, of as many columns as rows of repeats."""
    one = build_model(load_scene(SCENE, [f"model.nodes_per_loop={NODES_PER_LOOP}"])).rods.node_count
    for nodes in options.nodes:
        yield measure(max(1, round(math.sqrt(nodes / one))), options.overrides, options.rounds)
