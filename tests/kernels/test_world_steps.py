"""Worlds step as a mesh by itself does: kernels/world_steps.py against the kernels that it stands for."""

import numpy as np
import pytest

from warpknit.planar.state import State, initial_state
from warpknit.planar.step import NeighbourSearch, Stepper
from warpknit.planar.world_step import WorldStepper
from warpknit.scene import make_scene
from warpknit.solve.model import build_model

STEPS = 37  # odd: it ends in the other buffer of displacements
STRAINS = (0.02, 0.12, 0.2)


def load(state: State, strain: float, steps: int) -> None:
    """Aim at an equibiaxial strain by a ramp of so many steps."""
    state.steering.set(ramp_step=0.0, ramp_steps=float(steps), ramp_to=(1 + strain, 0.0, 0.0, 1 + strain, 1.0))


@pytest.mark.parametrize(
    ("boundary", "repeats", "precision"),
    [("periodic", [1, 1], "single"), ("gripped", [2, 2], "single"), ("periodic", [1, 1], "double")],
)
def test_worlds_step_to_the_bits_of_a_single_mesh(boundary, repeats, precision):
    """Same numbers, same order of sums: states of three loads are equal to the bit, whichever thread took them."""
    model = build_model(
        make_scene({
            "knit": {"repeats": repeats},
            "model": {"kind": "planar", "boundary": boundary, "nodes_per_loop": 16},
            "solver": {"precision": precision},
        })
    )  # fmt: skip
    worlds = WorldStepper(model, len(STRAINS), threads=2)
    assert worlds.is_by_world
    rows = np.arange(len(STRAINS))
    for state, strain in zip(worlds.states, STRAINS, strict=True):
        load(state, strain, 30)
        NeighbourSearch(model, state).search()
    worlds.step(rows, np.full(len(rows), float(STEPS)))
    for row, strain in zip(rows, STRAINS, strict=True):
        single = initial_state(model)
        load(single, strain, 30)
        NeighbourSearch(model, single).search()
        Stepper(model, single).step(STEPS)
        kept, wanted = worlds.states[row].arrays(), single.arrays()
        assert worlds.states[row].steering.step == single.steering.step > 0
        for name, value in wanted.items():
            assert np.array_equal(kept[name], value), name


def test_a_frozen_world_stays_as_it_is():
    """One that is stale stops where it is while the others go on."""
    model = build_model(make_scene({"model": {"kind": "planar", "boundary": "periodic", "nodes_per_loop": 16}}))
    worlds = WorldStepper(model, 2)
    for state in worlds.states:
        load(state, 0.001, 30)
        NeighbourSearch(model, state).search()
    worlds.states[0].steering.travel_limit = 0.0
    worlds.step(np.arange(2), np.full(2, 20.0))
    assert worlds.state.steering.step.tolist() == [1.0, 20.0]
    assert worlds.state.steering.status.tolist() == [1.0, 0.0]
