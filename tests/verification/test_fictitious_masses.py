"""Masses banded along the wire: their inverse, and the bound on the stiffness of bent and twisted rods."""

import numpy as np
import pytest
from scipy.linalg import eigh

from reference.rods import SECTION, Pose, helix
from warpknit.compute.host import fetch
from warpknit.compute.launch import bind
from warpknit.kernels.banded_mass import NEXT, PIVOT, SECOND, factor_masses
from warpknit.mechanics.numerics import LOOK_AHEAD, MASS_MARGIN
from warpknit.spatial.rod_arrays import StepForces, motion_launch
from warpknit.spatial.rod_relaxation import RodRelaxation
from warpknit.spatial.rod_step import RodStepper
from warpknit.spatial.rods import Rods, rods_of


def dense(rods: Rods, masses: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """(3, node, node) masses along x, y, z and (node, node) spin inertias."""
    nodes, after = rods.node_count, rods.following
    coupled, spin = np.zeros((nodes, nodes)), np.diag(masses["spin_inertia"])
    for i, j in enumerate(after):
        if j < 0:
            continue
        for matrix, k, value in (
            (coupled, j, masses["next_mass"][i]),
            (coupled, after[j], masses["second_mass"][i]),
            (spin, j, masses["next_inertia"][i]),
        ):
            if k >= 0:
                matrix[i, k] += value
                matrix[k, i] += value
    return np.stack([np.diag(masses["node_mass"][:, k]) + coupled for k in range(3)]), spin


def test_accelerations_are_those_of_the_dense_matrices() -> None:
    """Open wires, a ring and a wire that goes on into the next tile, with random couplings below half the diagonal."""
    rods = rods_of(
        SECTION,
        [helix(5, 4, 9, 0.6), helix(2, 0, 7) + [0, 0, 5], helix(3, 1, 12)],
        [None, np.zeros(3), np.array([0.0, 0.0, 1.0])],
    )
    stepper, rng, nodes = RodStepper(rods), np.random.default_rng(0), rods.node_count
    relaxation = RodRelaxation(stepper)
    after = rods.following
    inner = (after >= 0) & (after[after] >= 0)
    masses = {
        "node_mass": rng.uniform(5, 6, (nodes, 3)),
        "next_mass": np.where(after >= 0, rng.uniform(-1, 1, nodes), 0.0),
        "second_mass": np.where(inner, rng.uniform(-1, 1, nodes), 0.0),
        "spin_inertia": rng.uniform(3, 4, nodes),
        "next_inertia": np.where(inner, rng.uniform(-1, 1, nodes), 0.0),
    }
    force, torque = rng.normal(size=(nodes, 3)), np.where(after >= 0, rng.normal(size=nodes), 0.0)
    stepper.set_masses(**masses)
    stepper.state.force.assign(force)
    stepper.state.torque.assign(torque)
    stepper.state.steering.set(velocity_factor=0.0, force_factor=1.0)
    motion_launch(stepper.arrays, stepper.state, range(len(stepper.rods.wire_first)), StepForces.of(stepper.state)).run("cpu")
    mass, spin = dense(rods, masses)
    found = stepper.state.velocity.numpy()
    for k in range(3):
        assert found[:, k] == pytest.approx(np.linalg.solve(mass[k], force[:, k]), rel=0, abs=1e-13)
    assert stepper.state.spin.numpy() == pytest.approx(np.linalg.solve(spin, torque), rel=0, abs=1e-13)
    twice = sum(float(force[:, k] @ mass[k] @ force[:, k]) for k in range(3)) + float(torque @ spin @ torque)
    found = relaxation.masses.twice_energy(stepper.state.force, stepper.state.torque, "forces", stepper.rows)
    assert found == pytest.approx(twice, rel=1e-13, abs=0)


@pytest.mark.parametrize(("uniform", "low", "high"), [(1e-2, 1.0 - 1e-9, 1.0 + 1e-9), (1e-6, 1.2 / MASS_MARGIN, 3.0)])
def test_masses_factored_in_parts_stay_heavy_enough(uniform: float, low: float, high: float) -> None:
    """Fourth differences and a uniform mass: a node answers to another one as exp(-n (uniform/4)^(1/4)), n nodes away, and D
    as its square. Over the 128 nodes by which parts overlap that is 1e-25, and 3e-3 with the smaller mass, about as in a
    tricot: masses may then differ, and steps are stable down to 1/MASS_MARGIN of them."""
    nodes, parts = 900, 6
    stepper = RodStepper(rods_of(SECTION, [np.arange(nodes)[:, None] * [1e-4, 0.0, 0.0]], [None]))
    fourth = np.diff(np.eye(nodes), 2, axis=0)
    mass = fourth.T @ fourth + uniform * np.eye(nodes)
    beside = [np.append(np.diag(mass, k), np.zeros(k)) for k in (1, 2)]
    every = np.repeat(np.diag(mass)[:, None], 3, axis=1)
    stepper.set_masses(node_mass=every, next_mass=beside[0], second_mass=beside[1], spin_inertia=np.ones(nodes))
    arrays, state, inside = stepper.arrays, stepper.state, nodes - 2  # the last two nodes come behind
    bind(factor_masses, parts, arrays, state, first_wire=0, parts=parts).run("cpu")
    factor, pivot = fetch(state.mass_factor)[:inside, :, 0], fetch(state.sweep)[:inside, 0]
    assert factor[:, int(PIVOT)] == pytest.approx(1.0 / pivot, rel=1e-15)
    lower = np.eye(inside) + np.diag(factor[1:, int(NEXT)], -1) + np.diag(factor[2:, int(SECOND)], -2)
    found = eigh(lower @ np.diag(pivot) @ lower.T, mass[:inside, :inside], eigvals_only=True)
    assert low < found[0] <= found[-1] < high


@pytest.mark.parametrize("turn", [0.05, 0.4, 1.2])
@pytest.mark.parametrize("stretch", [0.01, 1.0])
def test_masses_bound_the_stiffness_of_a_coil(turn: float, stretch: float) -> None:
    """The largest w^2 of M^-1 K of an open coil at rest, by differences, is below 4/(1 + 2 g), the limit of a step of 1 s with
    look-ahead g; stiff and soft in stretch."""
    nodes = 18
    radius, angle = 1.0 / (2 * np.sin(turn / 2)), turn * np.arange(nodes)
    rods = rods_of(SECTION, [np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.1 * angle], axis=1)])
    pose = Pose(rods)
    pose.stepper.state.stretch_stiffness.fill_(stretch * SECTION.axial_stiffness)
    pose.stepper.evaluate()
    RodRelaxation(pose.stepper, softening=1.0 / stretch, wave_length=100.0, multipliers=False)
    state = pose.stepper.state
    names = ("node_mass", "next_mass", "second_mass", "spin_inertia", "next_inertia")
    masses = {name: fetch(getattr(state, name)) for name in names}
    mass, spin = dense(rods, masses)
    unknowns, sections = pose.unknowns(), np.flatnonzero(pose.has_segment)
    whole = np.zeros((unknowns, unknowns))
    for k in range(3):
        whole[k : 3 * nodes : 3, k : 3 * nodes : 3] = mass[k]
    whole[3 * nodes :, 3 * nodes :] = spin[np.ix_(sections, sections)]
    root = np.linalg.inv(np.linalg.cholesky(whole))
    stiffness = pose.stiffness(1e-5)
    largest = np.linalg.eigvalsh(root @ (0.5 * (stiffness + stiffness.T)) @ root.T)[-1]
    assert 0.1 < largest < 4.0 / (1.0 + 2.0 * LOOK_AHEAD)
