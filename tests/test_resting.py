"""Blocks of nodes at rest: what steps leave out does not change the equilibrium (spatial/rod_relaxation.py)."""

from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pytest

from warpknit import measure
from warpknit.compute.host import fetch
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Progress, Simulation
from warpknit.spatial import rod_relaxation

TOLERANCE = 1e-2  # of the draft preset: what a tension may still drift
PATCH = {
    "wire.material": "molybdenum",
    "wire.diameter": "30 um",
    "knit.bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}],
    "knit.wales": "26 /inch",
    "knit.courses": "30 /inch",
    "knit.repeats": [8, 8],
    "model.kind": "spatial",
    "model.boundary": "gripped",
    "load.strain_weft": 0.03,
    "load.strain_warp": 0.03,
    "output.frames": 1,
}


@pytest.fixture(autouse=True)
def rests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of a mesh without membrane corrections rest, too."""

    def begin(blocks: rod_relaxation.RestingBlocks) -> None:
        blocks.wake()
        blocks._is_allowed[:] = True

    monkeypatch.setattr(rod_relaxation.RestingBlocks, "begin", begin)


class Stop(Exception):
    pass


def run(look: Callable[[Simulation], None], friction: float = 0.0, kept: dict | None = None) -> Simulation:
    """A gripped tricot, with a look at every check."""
    model = build_model(load_scene({}, PATCH | {"contact.friction": friction}, "draft"))
    simulation = Simulation(model, progress=Progress.from_dict(kept["progress"]) if kept else None)
    if kept:
        simulation.drive.load_state_dict(kept["memory"])
    simulation.monitor = lambda _: look(simulation)
    with suppress(Stop):
        list(simulation.run())
    return simulation


def blocks(simulation: Simulation) -> np.ndarray:
    """[block] see kernels/rod_blocks.py."""
    return fetch(simulation.mechanics.state.block_rest).copy()


@pytest.mark.parametrize("friction", [0.0, pytest.param(0.2, marks=pytest.mark.slow)])
def test_the_equilibrium_is_that_of_all_nodes(friction: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the blocks rest on the way, at the end none; tensions are equal within what they may still drift."""
    shares: list[float] = []
    simulation = run(lambda simulation: shares.append(float((blocks(simulation) > 0).mean())), friction)
    assert max(shares) > 0.2
    assert not blocks(simulation).any()
    tension = np.array(measure.mesh_tension(simulation.mechanics.observe()))
    monkeypatch.setattr(rod_relaxation, "CALM", 0.0)
    shares.clear()
    alone = run(lambda simulation: shares.append(float((blocks(simulation) > 0).mean())), friction)
    assert max(shares) == 0.0
    assert tension == pytest.approx(np.array(measure.mesh_tension(alone.mechanics.observe())), rel=TOLERANCE)


def test_nodes_at_rest_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between two checks without a correction or a test of stability, nodes at rest keep their places, and others move."""
    monkeypatch.setattr("warpknit.spatial.convergence.Stability.begin", lambda self, world: None)
    kept: dict[str, np.ndarray] = {}
    moved: list[tuple[float, float]] = []

    def look(simulation: Simulation) -> None:
        simulation.drive.membrane = None
        stepper, place = simulation.mechanics.stepper, fetch(simulation.mechanics.state.displacement).copy()
        now = np.repeat(blocks(simulation), fetch(stepper.arrays.block_count)) > 0
        if kept and kept["rests"].any():
            motion = np.linalg.norm(place - kept["place"], axis=1)
            moved.append((float(motion[kept["rests"]].max()), float(motion[~kept["rests"]].max())))
        kept.update(place=place, rests=now)

    run(look)
    assert len(moved) > 5
    at_rest, others = np.array(moved).T
    assert not at_rest.any() and others.all()


def test_a_run_stopped_with_nodes_at_rest_goes_on_to_the_same_bits() -> None:
    """Which nodes rest, and that corrections have moved them, is part of the state."""
    whole = fetch(run(lambda _: None).mechanics.state.displacement).copy()
    kept: dict = {}
    looks = 0

    def stop(simulation: Simulation) -> None:
        nonlocal looks
        looks += blocks(simulation).any()
        if looks == 3:
            kept.update(memory=simulation.drive.state_dict(), progress=simulation.progress.as_dict())
            raise Stop

    run(stop)
    assert kept
    resumed = run(lambda _: None, kept=kept)
    assert np.array_equal(fetch(resumed.mechanics.state.displacement), whole)
