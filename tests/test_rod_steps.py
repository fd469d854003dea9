"""Steps of rods that are captured together are the same as steps one by one."""

from pathlib import Path

import numpy as np
import pytest

from reference.cases import slow
from warpknit.compute.host import fetch, store
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
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
    free = mechanics.model.rods.is_free
    store(state.velocity, 1e-4 * thickness * random.standard_normal((nodes, 3)) * free[:, None])
    store(state.spin, 1e-4 * random.standard_normal(nodes) * mechanics.model.rods.can_turn)
    for _ in range(2 * GRAPH_STEPS[0] // size):
        mechanics.step(size)
    mechanics.stepper.evaluate()
    return {name: fetch(getattr(state, name)).copy() for name in ("displacement", "director", "velocity", "angle", "force")}


@pytest.mark.parametrize("case", [*slow("single precision"), *(case for case in CASES if case != "single precision")])
def test_steps_of_a_graph_are_those_one_by_one(case: str) -> None:
    """Frames that a step leaves for the next one, and forces in memory that groups of wires share, change no bit; where neither
    is done, all frames are found anew."""
    together, alone = (stepped(*CASES[case], size) for size in (GRAPH_STEPS[0], 1))
    for name, values in together.items():
        assert np.array_equal(values, alone[name]), name


@pytest.mark.parametrize("boundary", ["periodic", "gripped"])
def test_what_blocks_have_travelled_bounds_the_ways_of_their_segments(boundary: str) -> None:
    """Nodes of each segment, the one before and the one behind it have moved by no more than its block has travelled, and by what
    steps are extrapolated; blocks that hardly move have travelled less than the fastest node of the mesh."""
    changes = [DRAFT, f"model.boundary={boundary}", "knit.repeats=[2, 3]"]
    mechanics = Simulation(build_model(load_scene(SCENES / "atlas_cell_spatial.toml", changes))).mechanics
    mechanics.search()
    state, rods, thickness = mechanics.state, mechanics.model.rods, mechanics.model.rods.section.thickness
    before = fetch(state.displacement).copy()
    push = np.zeros((rods.node_count, 3))
    some = np.flatnonzero(mechanics.model.rods.is_free)[10:20]
    push[some] = 1e-4 * thickness * np.random.default_rng(1).standard_normal((len(some), 3))
    store(state.velocity, push)
    mechanics.step(20)
    block, travel = fetch(mechanics.stepper.arrays.node_block), fetch(state.block_travel)
    control = state.steering.read()
    extrapolated = control.look_ahead * control.time_step * (np.abs(push).max() + control.speed_max)
    moved = np.linalg.norm(fetch(state.displacement) - before, axis=1)
    for node in rods.following, rods.previous, rods.following[rods.following], np.arange(rods.node_count):
        there = node >= 0
        assert np.all(moved[node[there]] <= travel[block[there]] * (1 + 1e-12) + 2 * extrapolated)
    assert 0.0 < moved.max() <= travel.max() * (1 + 1e-12) + 2 * extrapolated
    assert travel.max() <= control.step_travel * (1 + 1e-12)
    assert travel.min() < 0.1 * travel.max()
