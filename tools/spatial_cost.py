"""Where the time of a step in space goes: with and without contact, kernel by kernel, and the search of pairs.

    python tools/spatial_cost.py [--nodes-per-loop 64] [--repeats 1] [--set KEY=VALUE]...

Runs the spatial cell to 10 % roughly, then times its steps in the state reached: best of seven, as other work slows a machine.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import warp as wp

from warpknit.scene import load_scene
from warpknit.spatial.mesh import build_mesh
from warpknit.spatial.relax import SpatialRelaxation

SCENE = Path(__file__).parent.parent / "scenes" / "atlas_cell_spatial.toml"
STEPS = 200
TRIES = 7


def best(work: Callable[[], object], count: int) -> float:
    """[s] of one of `count` things that `work` does."""
    taken = []
    for _ in range(TRIES):
        begin = time.perf_counter()
        work()
        taken.append(time.perf_counter() - begin)
    return min(taken) / count


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nodes-per-loop", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--set", dest="overrides", action="append", default=[])
    given = parser.parse_args(arguments)
    options = [
        "solver.preset=draft",
        "solver.residual_tolerance=0.05",
        "output.frames=3",
        f"model.nodes_per_loop={given.nodes_per_loop}",
        f"knit.repeats=[{given.repeats}, {given.repeats}]",
    ]
    relaxation = SpatialRelaxation(build_mesh(load_scene(SCENE, [*options, *given.overrides])))
    for _record in relaxation.run():
        pass
    stepper, contact, nodes = relaxation.stepper, relaxation.contact, relaxation.mesh.rods.node_count
    stepper.step(1)
    whole = best(lambda: stepper.step(STEPS), STEPS)
    print(f"nodes {nodes}, pairs {contact.pair_count}, contacts {len(contact.near().force)}")
    print(f"a step {1e6 * whole:.0f} us, {nodes / whole:.3g} node-steps/s")
    for kernel, dim, inputs in stepper.launches():
        with wp.ScopedCapture(device=stepper.device) as capture:
            for _ in range(STEPS):
                wp.launch(kernel, dim=dim, inputs=inputs, device=stepper.device)
        taken = best(lambda graph=capture.graph: wp.capture_launch(graph), STEPS)
        print(f"  {kernel.key:20s} {1e6 * taken:7.1f} us")
    search = best(contact.search, 1)
    share = contact.searches / max(relaxation.progress.steps, 1)
    steps = relaxation.progress.steps
    print(f"a search {1e6 * search:.0f} us, {contact.searches} in {steps} steps: {1e6 * search * share:.2f} us a step")
    stepper.contact = None
    stepper.step(1)
    free = best(lambda: stepper.step(STEPS), STEPS)
    print(f"a step without contact {1e6 * free:.0f} us, {nodes / free:.3g} node-steps/s")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
