"""Kernels compiled before the tests share the cores, as processes that start together would each compile them."""

from warpknit.planar.state import initial_state
from warpknit.scene import make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation


def compile_kernels() -> None:
    """Load what relaxation in either model launches, in single and in double precision; what is in Warp's cache is read."""
    solver = {"preset": "draft"}
    for precision in ("single", "double"):
        model = build_model(make_scene({"model": {"kind": "planar"}, "solver": {**solver, "precision": precision}}), "cpu")
        Simulation(model, initial_state(model)).compile()
    in_space = {"model": {"kind": "spatial", "boundary": "periodic", "nodes_per_loop": 24}, "solver": solver}
    Simulation(build_model(make_scene(in_space))).compile()
