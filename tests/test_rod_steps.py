"""Steps of rods that are captured together are the same as steps one by one."""

from pathlib import Path

import numpy as np
import pytest

from warpknit.host import fetch, store
from warpknit.model import build_model
from warpknit.scene import load_scene
from warpknit.solve.simulate import Simulation
from warpknit.spatial.rod_step import GRAPH_STEPS

SCENES = Path(__file__).parent.parent / "scenes"
DRAFT = "solver.preset=draft"
CASES = {
    "a tile": ("atlas_cell_spatial.toml", []),
    "single precision": ("atlas_cell_spatial.toml", ["solver.precision=single", "knit.repeats=[4, 4]"]),
    "clamps that follow the load": ("atlas_cell_spatial.toml", ["model.boundary=gripped", "knit.repeats=[2, 2]"]),
    "clamps that slide": ("hook_spatial.toml", []),
}


def stepped(scene: str, overrides: list[str], size: int) -> dict[str, np.ndarray]:
    """A mesh at rest whose nodes and sections have got a push, after two graphs of steps, taken `size` at a time."""
    mechanics = Simulation(build_model(load_scene(SCENES / scene, [DRAFT, *overrides]))).mechanics
    mechanics.search()
    random, state = np.random.default_rng(1), mechanics.state
    thickness, nodes = mechanics.model.rods.section.thickness, mechanics.model.node_count
    free = mechanics.relaxation.free
    store(state.velocity, 1e-4 * thickness * random.standard_normal((nodes, 3)) * free[:, None])
    store(state.spin, 1e-4 * random.standard_normal(nodes) * mechanics.relaxation.free_sections)
    for _ in range(2 * GRAPH_STEPS[0] // size):
        mechanics.step(size)
    mechanics.stepper.evaluate()
    return {name: fetch(getattr(state, name)).copy() for name in ("displacement", "director", "velocity", "angle", "force")}


@pytest.mark.parametrize("case", CASES)
def test_steps_of_a_graph_are_those_one_by_one(case: str) -> None:
    """Frames that a step leaves for the next one, and forces in memory that groups of wires share, change no bit; where neither
    is done, all frames are found anew."""
    together, alone = (stepped(*CASES[case], size) for size in (GRAPH_STEPS[0], 1))
    for name, values in together.items():
        assert np.array_equal(values, alone[name]), name
