"""Loads and membrane corrections go slower while wires overlap deeply (numerics.renewed_throttle)."""

from types import SimpleNamespace

import numpy as np
import pytest

from warpknit.mechanics.numerics import DEEP, LEAST_THROTTLE, MAX_OVERLAP, SHALLOW, renewed_throttle
from warpknit.mesh.rim import LoadPoint
from warpknit.planar.state import initial_state
from warpknit.planar.step import NeighbourSearch, Stepper
from warpknit.scene import make_scene
from warpknit.solve.membrane import Correction
from warpknit.solve.model import build_model
from warpknit.solve.multilevel import PART_STEPS, MultilevelRelaxation
from warpknit.solve.simulate import Simulation


def test_throttle_is_halved_by_deep_overlaps_and_recovers():
    throttles = [1.0]
    for overlap in (0.3, 0.3, 0.3, 0.3, 0.2, 0.1, 0.1, 0.1, 0.1):
        throttles.append(renewed_throttle(throttles[-1], overlap))
    assert throttles[1:] == [0.5, 0.25, 0.125, LEAST_THROTTLE, 0.125, 0.25, 0.5, 1.0, 1.0]
    assert SHALLOW < DEEP < MAX_OVERLAP


@pytest.mark.parametrize("lag", [0.0, 0.25, 0.5])
def test_a_load_that_lags_ends_at_its_target(lag: float):
    """A ramp of 30 steps takes 30/(1 - lag), and its last step does not go past the end."""
    model = build_model(make_scene({"model": {"kind": "planar", "boundary": "periodic", "nodes_per_loop": 16}}))
    state, taken = initial_state(model), int(np.ceil(30 / (1.0 - lag)))
    target = np.array([1.001, 0.0, 0.0, 1.002, 1.0])
    state.steering.set(ramp_step=0.0, ramp_steps=30.0, ramp_lag=lag, ramp_to=target)
    NeighbourSearch(model, state).search()
    stepper = Stepper(model, state)
    stepper.step(taken - 1)
    assert 0.0 < state.gradient[1, 1] - 1.0 < 0.002
    stepper.step(1)
    assert state.gradient.ravel() == pytest.approx(target[:4], rel=1e-15)
    assert state.steering.ramp_step == 30.0


def test_deep_overlaps_slow_the_load_in_space(monkeypatch: pytest.MonkeyPatch):
    simulation = Simulation(
        build_model(
            make_scene({"model": {"kind": "spatial", "boundary": "periodic", "nodes_per_loop": 16}, "contact": {"friction": 0.0}})
        )
    )
    mechanics = simulation.mechanics
    thickness = 2.0 * float(mechanics.model.rods.wire_radius.min())
    load = LoadPoint(np.diag([1.02, 1.02]), mechanics.model.scene.wire.reference_temperature)
    mechanics.set_load(load, 400)
    lags = []
    for overlap in (0.3, 0.3, 0.2, 0.1):
        monkeypatch.setattr(
            mechanics.contact, "pop_max_penetration", lambda rows, overlap=overlap: np.array([overlap * thickness])
        )
        assert mechanics.overlap() == pytest.approx(overlap)
        mechanics.group.check(np.array([0]), np.array([1]), np.array([True]))
        lags.append(mechanics.state.steering.ramp_lag)
    assert lags == [0.5, 0.75, 0.75, 0.5]
    mechanics.set_load(load, 400)
    assert mechanics.state.steering.ramp_lag == 0.0


def test_parts_of_a_correction_become_smaller_after_deep_overlaps():
    """All of it is applied, in parts of a quarter, and of an eighth after one that overlapped deeply."""
    relaxation, parts, steps = object.__new__(MultilevelRelaxation), [], []
    overlaps = iter((0.4, 0.2, 0.05, 0.0, 0.0, 0.0))
    relaxation.mechanics = SimpleNamespace(search=lambda: None, overlap=lambda: next(overlaps))
    relaxation._move = lambda _, correction: parts.append(float(correction.grid[0, 0]))
    relaxation.advance = steps.append
    relaxation._move_in_parts(None, Correction(np.ones((1, 2)), np.zeros((0, 2)), 0.25))
    assert parts == pytest.approx([0.25, 0.125, 0.125, 0.25, 0.25])
    assert steps == [PART_STEPS] * 4
