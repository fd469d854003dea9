"""The neighbour search finds what a search through all nodes finds, and what it puts to sleep touches nothing."""

import math
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from reference.meshes import MESHES, Mesh, settled, shaken
from reference.plane_wires import CLOSEST_POINT_TOLERANCE, Rig, panel_of_wires, straight, table_of_wires
from warpknit.compute.steering import Steering
from warpknit.planar.observables import read
from warpknit.planar.state import initial_state
from warpknit.planar.step import NeighbourSearch, Stepper
from warpknit.solve.simulate import Simulation


def distances(mesh: Mesh, pair: int) -> tuple[np.ndarray, np.ndarray]:
    """Places along the wire counted from the seed (m,), and the distances of their nodes from the pair's body (m,)
    [m]."""
    model, panel, table = mesh.model, mesh.model.panel, mesh.model.table
    r = read(model, mesh.state)
    place = np.arange(panel.pair_low[pair], panel.pair_high[pair] + 2)
    wire = panel.pair_wire[pair]
    first, count = panel.wire_first[wire], panel.wire_count[wire]
    node = first + np.mod(panel.pair_seed[pair] + place - first, count)
    entry = panel.pair_table[pair] + place
    body = panel.body_rest[pair // 2] - panel.pair_shift[pair]
    offset = (body - np.stack([table.x[entry], table.y[entry]], axis=1)) @ r.gradient.T + r.body_u[pair // 2] - r.u[node]
    return place, np.hypot(offset[:, 0], offset[:, 1])


def narrowed(made: Mesh) -> Mesh:
    """The same mesh with pairs that reach no farther than two nodes along the wire, so that the ends of the reach
    matter."""
    model, panel = made.model, made.model.panel
    low, high = np.maximum(panel.pair_low, 0), np.minimum(panel.pair_high, 0)
    mesh = replace(
        model.mesh,
        pair_low=wp.array(low, dtype=wp.int32, device=model.device),
        pair_high=wp.array(high, dtype=wp.int32, device=model.device),
    )
    return Mesh(replace(model, mesh=mesh, panel=replace(panel, pair_low=low, pair_high=high)), made.state)


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("case", ["settled", "rest", "narrow"])
def test_search_finds_the_nearest_node(mesh: str, case: str, device: str) -> None:
    """For every open pair: the nearest node within the search radius, or none where brute force finds none."""
    made = shaken(mesh, "single", device, size=0.2)
    if case == "rest":
        made = Mesh(made.model, initial_state(made.model))
    elif case == "narrow":
        made = narrowed(made)
    state = made.state
    state.pair_force.zero_()
    state.pair_gap.fill_(1.0)
    state.pair_slide.fill_(-1000)
    search = NeighbourSearch(made.model, state)
    search.search()
    slide, u, wake = (a.numpy() for a in (state.pair_slide, state.pair_u, state.pair_wake))
    found = 0
    for pair in range(made.model.pair_count):
        place, distance = distances(made, pair)
        nearest = int(np.argmin(distance))
        if distance[nearest] > search.radius * (1 + 1e-5):
            assert wake[pair] == 1.0
        elif distance[nearest] < search.radius * (1 - 1e-5):
            assert slide[pair] + u[pair] == place[nearest] or np.sort(distance)[1] < distance[nearest] * (1 + 1e-5)
            found += 1
    assert found > made.model.pair_count // (10 if case == "narrow" else 2)


@pytest.mark.parametrize("mesh", MESHES)
def test_sleeping_pairs_touch_nothing(mesh: str) -> None:
    """From rest to 10 % strain: whenever one looks, waking all pairs up finds no force that was not there."""
    made = settled(mesh)
    model, state = made.model, initial_state(made.model)
    simulation = Simulation(model, state)
    stepper = Stepper(model, state)
    looks, slept = 0, 0

    def look(_progress: object) -> None:
        nonlocal looks, slept
        kept = state.arrays()
        if Steering(kept["control"]).status != 0.0:
            return
        stepper.state.parity = state.parity
        simulation.mechanics.stepper.evaluate_contact()
        sleeping = state.pair_wake.numpy() > state.steering.travel
        before = state.pair_force.numpy().copy()
        state.pair_wake.zero_()
        for _ in range(10):  # an open pair's point moves once a step; give it time to arrive
            simulation.mechanics.stepper.evaluate_contact()
        after = state.pair_force.numpy()
        assert not np.any(after[sleeping] > 0.0)
        assert np.array_equal(before[sleeping], after[sleeping])
        looks, slept = looks + 1, slept + int(sleeping.sum())
        state.restore(kept)

    simulation.monitor = look
    for _record in simulation.run():
        pass
    assert looks > 10
    assert slept > looks * model.pair_count // 10


STEP = 2e-8  # [s] of the collision; a third of what is stable


def collide(phase: float, *, asleep: bool, device: str = "cpu") -> tuple[np.ndarray, int]:
    """Positions after a body and a wire have met, from 80 um apart, and the first step that felt it.

    Both fly at the speed that the travel counts, the body towards `phase` of a segment, so nothing is left to spare.
    """
    table = table_of_wires([straight(21, 50e-6), straight(21, 50e-6, 2e-3)])
    body = np.array([[(10 + phase) * 50e-6, 80e-6]])
    rig = Rig(table, panel_of_wires(table, bodies=body, pairs=[(0, 10, 1), (1, 10, -1)]), device, axial_softening=40.0)
    speed = np.zeros_like(rig.rest)
    speed[:21, 1], speed[-1, 1] = 1.0, -1.0
    rig.set_velocity(speed)
    search = NeighbourSearch(rig.model, rig.state)
    rig.set_time_step(STEP)
    touch = -1
    for step in range(2000):
        if step == 0 or rig.state.steering.status == 1.0:
            search.search()
            if not asleep:
                rig.state.pair_wake.zero_()
        rig.step(1)
        if touch < 0 and rig.state.pair_force.numpy()[0] > 0:
            touch = step
    return rig.position(), touch


@pytest.mark.parametrize("phase", [0.0, 0.5, 0.9])
def test_pair_wakes_up_before_it_touches(phase: float, device: str) -> None:
    """A head-on collision is the same, to the tolerance of the contact point, whether the pair slept or not.

    The first step that feels it starts when both have flown half the way that was open: (80 um - reach)/(2 v dt) steps.
    """
    slept, woken = (collide(phase, asleep=asleep, device=device) for asleep in (True, False))
    assert slept[1] == woken[1] == math.ceil((80e-6 - 0.625 * 15e-6) / (2 * STEP))
    assert np.abs(slept[0] - woken[0]).max() < CLOSEST_POINT_TOLERANCE * 50e-6
