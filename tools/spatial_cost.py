"""Where the time of a step in space goes: with and without contact, kernel by kernel, and the search of pairs.

    python tools/spatial_cost.py [--nodes-per-loop 64] [--repeats 1] [--json] [--set KEY=VALUE]...

Runs the spatial cell to 10 % roughly, then times its steps in the state reached. Each round times everything once, one after the
other, and the best round of each counts, as other work slows a machine. Kernels alone are timed with a time step of zero, which
leaves the state where it is. `tools/bench.py --space` prints the same as its JSON lines.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warpknit.kernels import control as c
from warpknit.scene import load_scene
from warpknit.spatial.mesh import build_mesh
from warpknit.spatial.relax import SpatialRelaxation

SCENE = Path(__file__).parent.parent / "scenes" / "atlas_cell_spatial.toml"
STEPS = 200
ROUNDS = 7
PARTS = {
    "follow_rods": "rods",
    "bend_rods": "rods",
    "step_rods": "rods",
    "find_closest_places": "narrow_phase",
    "push_wires_apart": "contact_forces",
}


def at_load(nodes_per_loop: int, repeats: int, overrides: list[str]) -> SpatialRelaxation:
    """The cell at rest, roughly."""
    options = [
        "solver.preset=draft",
        "solver.residual_tolerance=0.05",
        "output.frames=3",
        f"model.nodes_per_loop={nodes_per_loop}",
        f"knit.repeats=[{repeats}, {repeats}]",
    ]
    relaxation = SpatialRelaxation(build_mesh(load_scene(SCENE, [*options, *overrides])))
    for _record in relaxation.run():
        pass
    return relaxation


def repeated(relaxation: SpatialRelaxation, kernel: wp.Kernel, dim: int, inputs: list) -> Callable[[], None]:
    """One kernel alone, STEPS times."""
    device = relaxation.stepper.device
    with wp.ScopedCapture(device=device) as capture:
        for _ in range(STEPS):
            wp.launch(kernel, dim=dim, inputs=inputs, device=device)
    return lambda: wp.capture_launch(capture.graph)


def kernels_alone(relaxation: SpatialRelaxation, rounds: int) -> dict[str, float]:
    """[s] of each kernel of a step."""
    stepper = relaxation.stepper
    kept = {c.TIME_STEP: float(stepper.state.read_control()[int(c.TIME_STEP)])}
    stepper.state.write_control({c.TIME_STEP: 0.0})
    works = {kernel.key: repeated(relaxation, kernel, dim, inputs) for kernel, dim, inputs in stepper.launches()}
    taken = best(works, rounds)
    stepper.state.write_control(kept)
    return {name: seconds / STEPS for name, seconds in taken.items()}


def best(works: dict[str, Callable[[], Any]], rounds: int) -> dict[str, float]:
    """[s] of the best round of each, taken in turn."""
    found = dict.fromkeys(works, math.inf)
    for _ in range(rounds):
        for name, work in works.items():
            begin = time.perf_counter()
            work()
            wp.synchronize()
            found[name] = min(found[name], time.perf_counter() - begin)
    return found


def measure(
    nodes_per_loop: int = 64, repeats: int = 1, overrides: list[str] | None = None, rounds: int = ROUNDS
) -> dict[str, Any]:
    """What a step takes, and which share of it its parts take; times in us, those of the search spread over all steps."""
    relaxation = at_load(nodes_per_loop, repeats, overrides or [])
    stepper, contact, steps = relaxation.stepper, relaxation.contact, relaxation.progress.steps
    nodes, searches = relaxation.mesh.rods.node_count, contact.searches
    contact.search()
    stepper.state.write_control({c.TRAVEL_LIMIT: np.inf})
    stepper.step(STEPS)
    whole = best({"step": lambda: stepper.step(STEPS)}, rounds)["step"] / STEPS
    parts = kernels_alone(relaxation, rounds)
    near, pairs = contact.near(), contact.pair_count
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


def print_table(found: dict[str, Any]) -> None:
    total = sum(found[f"{name}_us"] for name in ("broad_phase", *dict.fromkeys(PARTS.values())))
    print(f"nodes {found['nodes']}, pairs {found['pairs']}, contacts {found['contacts']}")
    print(f"a step {found['step_us']:.0f} us, {found['node_steps_per_s']:.3g} node-steps/s")
    print(f"without contact {found['node_steps_per_s_without_contact']:.3g} node-steps/s")
    for part in ("rods", "contact_forces", "narrow_phase", "broad_phase"):
        taken = found[f"{part}_us"]
        print(f"{part:20s} {taken:7.1f} us {100 * taken / total:5.1f} %")
        for name, seconds in found["kernels_us"].items():
            if PARTS[name] == part:
                print(f"  {name:18s} {seconds:7.1f} us")
    print(f"{found['searches']} searches in {found['steps']} steps")


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes-per-loop", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--json", action="store_true", help="one JSON object in place of a table")
    parser.add_argument("--set", dest="overrides", action="append", default=[])
    given = parser.parse_args(arguments)
    found = measure(given.nodes_per_loop, given.repeats, given.overrides, given.rounds)
    if given.json:
        print(json.dumps(found))
    else:
        print_table(found)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
