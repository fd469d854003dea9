"""The two forms of the wire step, a thread a node and a thread a block of nodes, are the same step.

Forces may differ by the rounding of a few edges and angles, `round_off` each; a node has four edges and three angles.
"""

import numpy as np
import pytest

from reference.meshes import MESHES, PRECISIONS, node_forces, round_off, settled, shaken
from reference.plane_wires import EPSILON, Rig, circle, panel_of_wires, table_of_wires
from warpknit.compute.steering import Steering
from warpknit.planar.observables import read
from warpknit.planar.step import Stepper

EDGES_AND_ANGLES = 7


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("precision", PRECISIONS)
def test_both_forms_give_the_same_forces(mesh: str, precision: str) -> None:
    """Cooled and sheared too, so that all of the load counts."""
    made = shaken(mesh, precision)
    made.state.steering.set(length_factor=0.995, gradient=((1.0, 0.02), (-0.01, 1.0)))
    by_pair, by_block = (node_forces(made, made.probe(by_pair)) for by_pair in (True, False))
    noise = EDGES_AND_ANGLES * round_off(made)
    assert np.count_nonzero(made.state.pair_force.numpy()) > 5
    assert np.abs(by_pair).max() > 100 * noise
    assert np.abs(by_pair - by_block).max() < noise


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("precision", PRECISIONS)
def test_both_forms_leave_the_same_sums(mesh: str, precision: str) -> None:
    """What a step leaves in `control`: squares, largest speed and force, and the power, of any sign.

    Squares differ by twice the noise of a force over the largest force, and the rounding of a sum over nodes; the
    power by that of its bound, the root of f^2/m times m v^2.
    """
    sums, forces = [], []
    for by_pair in (True, False):
        made = shaken(mesh, precision)
        for speed in (made.state.node_vx, made.state.node_vy, made.state.body_vx, made.state.body_vy):
            speed.zero_()
        made.state.steering.set(travel_limit=np.inf)
        forces.append(np.abs(node_forces(made, made.probe(by_pair))).max())
        Stepper(made.model, made.state, by_pair=by_pair).step(2)
        sums.append(made.state.steering.values.copy())
    epsilon = float(np.finfo(np.float32 if precision == "single" else np.float64).eps)
    share = 2 * EDGES_AND_ANGLES * round_off(made) / min(forces) + epsilon * made.model.panel.node_count
    squares = ("kinetic_twice", "speed_max", "force_max", "force_square")
    by_pair, by_block = (np.array([getattr(Steering(row), name) for name in squares]) for row in sums)
    assert share < 0.02
    assert by_pair == pytest.approx(by_block, rel=share, abs=0)


@pytest.mark.parametrize("mesh", MESHES)
def test_devices_give_the_same_forces(mesh: str, device: str) -> None:
    here = shaken(mesh, device=device)
    reference = shaken(mesh)
    found = node_forces(here, here.probe(by_pair=device != "cpu"))
    expected = node_forces(reference, reference.probe(by_pair=False))
    assert np.abs(found - expected).max() <= EDGES_AND_ANGLES * round_off(reference)


def long_wire(block_size: int, by_pair: bool = False) -> np.ndarray:
    """Forces (1000, 2) [N] on a wavy wire, laid out in blocks of `block_size`."""
    arc = 20e-6 * np.arange(1000)
    shape = np.stack([arc, 50e-6 * np.sin(arc / 150e-6)], axis=1)
    table = table_of_wires([shape])
    rig = Rig(table, panel_of_wires(table, held=[0, 1, 998, 999], block_size=block_size), by_pair=by_pair)
    return rig.forces(rig.rest + 1e-7 * np.random.default_rng(6).uniform(-1, 1, rig.rest.shape))


@pytest.mark.parametrize("block_size", [1, 2, 3, 7, 61, 64, 127])
def test_block_boundaries_do_not_matter(block_size: int) -> None:
    """Same rounding but for the remainder of a vectorised loop: EPSILON EA a segment."""
    whole, split = long_wire(128), long_wire(block_size)
    assert np.abs(whole).max() > 0.01
    assert np.abs(whole - split).max() < EDGES_AND_ANGLES * EPSILON * 71.0
    assert np.array_equal(long_wire(128, by_pair=True), long_wire(block_size, by_pair=True))


@pytest.mark.parametrize("nodes", [5, 40, 128, 129, 300])
def test_closed_wire_has_no_first_node(nodes: int) -> None:
    """Numbering the nodes of a ring from another one moves the forces along, to the rounding of its positions."""
    ring = circle(1e-3, nodes)
    random = np.random.default_rng(7)
    place = ring + 1e-3 / nodes * 0.05 * random.uniform(-1, 1, ring.shape)
    forces = []
    for turn in (0, 2, nodes // 2 + 1):
        table = table_of_wires([np.roll(ring, -turn, axis=0)], closed=True)
        rig = Rig(table, panel_of_wires(table, closed=True))
        forces.append(np.roll(rig.forces(np.roll(place, -turn, axis=0)), turn, axis=0))
    chord = 2e-3 * np.sin(np.pi / nodes)
    noise = 20 * EPSILON * 1e-3 * rig.model.axial_stiffness / chord
    assert np.abs(forces[0]).max() > 0.1
    assert np.abs(forces[1] - forces[0]).max() < noise
    assert np.abs(forces[2] - forces[0]).max() < noise


def test_two_runs_are_the_same_to_the_bit() -> None:
    """500 steps of the cell in single precision: every array of the state."""
    kept = []
    for _ in range(2):
        made = shaken("cell", "single")
        made.state.steering.set(travel_limit=np.inf)
        Stepper(made.model, made.state).step(500)
        kept.append(made.state.arrays())
    assert Steering(kept[0]["control"]).step == settled("cell", "single").state.steering.step + 500
    for name, array in kept[0].items():
        assert np.array_equal(array, kept[1][name]), name


@pytest.mark.parametrize("mesh", ["cell", "patch"])
def test_threads_share_a_step_to_the_same_bits(mesh: str) -> None:
    """Sums are taken in the same order however many threads there are, so nothing differs, not by a bit."""
    ends = []
    for threads in (1, 2, 3):
        moved = shaken(mesh)
        Stepper(moved.model, moved.state, threads=threads).step(107)
        ends.append(moved.state.arrays())
    for name, value in ends[0].items():
        np.testing.assert_array_equal(ends[1][name], value, err_msg=name)
        np.testing.assert_array_equal(ends[2][name], value, err_msg=name)


@pytest.mark.parametrize("length_factor", [1.0, 0.999])
@pytest.mark.parametrize("by_pair", [True, False])
@pytest.mark.parametrize("mesh", ["patch", "yielded"])
def test_kernel_forces_are_those_that_the_measures_see(mesh: str, by_pair: bool, length_factor: float) -> None:
    """Next to clamps too, where what is held rigid carries neither tension nor thermal strain."""
    made = shaken(mesh)
    made.state.steering.set(length_factor=length_factor)
    force = node_forces(made, made.probe(by_pair))
    reading = read(made.model, made.state)
    panel, segment = made.model.panel, reading.segment_force
    before = np.roll(segment, 1, axis=0)
    before[panel.wire_first] = 0.0
    expected = segment - before
    touching = np.nonzero(reading.pair_force > 0)[0]
    np.add.at(expected, reading.pair_node[touching][:, None] + np.arange(-1, 3), reading.pair_nodal[touching])
    expected[panel.held_node] = 0.0
    assert np.abs(force).max() > 1e-6
    np.testing.assert_allclose(force, expected, atol=EDGES_AND_ANGLES * round_off(made))
