"""Kernels compiled before the tests share the cores, as processes that start together would each compile them.

They stay in Warp's cache for the next run: in WARP_CACHE_PATH, or in the folder of the user's caches.
"""

import subprocess
import sys
from pathlib import Path

from warpknit.planar.state import initial_state
from warpknit.scene import make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

MODELS = ("planar", "spatial")


def compile_kernels(*kinds: str) -> None:
    """Load what relaxation launches, the planar one in single and in double precision; what is in Warp's cache is read."""
    solver = {"preset": "draft"}
    if "planar" in kinds:
        for precision in ("single", "double"):
            model = build_model(make_scene({"model": {"kind": "planar"}, "solver": {**solver, "precision": precision}}), "cpu")
            Simulation(model, initial_state(model)).compile()
    if "spatial" in kinds:
        in_space = {"model": {"kind": "spatial", "boundary": "periodic", "nodes_per_loop": 24}, "solver": solver}
        Simulation(build_model(make_scene(in_space), "cpu")).compile()


def compile_in_processes() -> None:
    """`compile_kernels` of each model in a process of its own, at the same time."""
    folder = Path(__file__).parents[1]
    command = [sys.executable, "-c", "import sys; from reference.kernel_cache import *; compile_kernels(sys.argv[1])"]
    started = [subprocess.Popen([*command, kind], cwd=folder) for kind in MODELS]
    for process in started:
        if process.wait() != 0:
            raise RuntimeError("the kernels did not compile")
