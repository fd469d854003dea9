"""Correction of soft motion: least energy in the space of motions, and the same equilibrium of a swatch in fewer steps."""

from pathlib import Path

import numpy as np
import pytest
from swatches import DIAMETER, swatch

from warpknit.compute.host import fetch
from warpknit.compute.kept import Owner, restore, save
from warpknit.scene import make_scene
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.spatial.convergence import MOTIONS, SoftMotion, least_energy

UNKNOWNS = 6
ROUND_OFF = 1e-9  # of a solution of equations with rates from 1e-4 to 1


def spring(rates: np.ndarray) -> tuple[np.ndarray, np.random.Generator]:
    """A stiffness with these rates along random directions."""
    random = np.random.default_rng(3)
    directions, _ = np.linalg.qr(random.standard_normal((len(rates), len(rates))))
    return directions @ np.diag(rates) @ directions.T, random


def test_motions_in_all_directions_give_the_equilibrium() -> None:
    """f = K (x - u): the least energy is at x, however soft the softest direction is; motions of any size count."""
    stiffness, random = spring(np.geomspace(1e-4, 1.0, UNKNOWNS))
    equilibrium = random.standard_normal(UNKNOWNS)
    motions = random.standard_normal((UNKNOWNS, UNKNOWNS)) * np.geomspace(1e-6, 1.0, UNKNOWNS)[:, None]
    move = least_energy(motions, -motions @ stiffness, stiffness @ equilibrium)
    assert move == pytest.approx(equilibrium, abs=ROUND_OFF)


def test_no_force_is_left_along_the_motions() -> None:
    """d (f - K u) = 0, also where motions repeat each other or are zero."""
    stiffness, random = spring(np.geomspace(1e-4, 1.0, UNKNOWNS))
    force, (first, second) = random.standard_normal(UNKNOWNS), random.standard_normal((2, UNKNOWNS))
    motions = np.stack([first, second, first, 0.0 * first])
    move = least_energy(motions, -motions @ stiffness, force)
    assert motions @ (force - stiffness @ move) == pytest.approx(np.zeros(4), abs=ROUND_OFF)
    assert np.linalg.matrix_rank(np.stack([first, second, move])) == 2


def test_a_direction_without_a_least_energy_is_left_out() -> None:
    rates, force = np.array([2.0, 1.0, -1.0]), np.ones(3)
    assert least_energy(np.eye(3), -np.diag(rates), force) == pytest.approx([0.5, 1.0, 0.0], abs=ROUND_OFF)


def test_nothing_moves_without_motion() -> None:
    assert np.array_equal(least_energy(np.zeros((2, 3)), np.zeros((2, 3)), np.ones(3)), np.zeros(3))


def strained(tmp_path: Path) -> Simulation:
    np.savez(tmp_path / "swatch.npz", wire=swatch("plain", 8, 8, 0.9))
    tables = {
        "wires": {"file": "swatch.npz", "unit": "m", "loop_size": "5.5 mm", "overlaps": "at rest"},
        "wire": {"diameter": DIAMETER, "youngs_modulus": "1 MPa", "poissons_ratio": 0.3, "density": "1300 kg/m3"},
        "contact": {"friction": 0.0},
        "load": {"strain_warp": 0.02},
        "output": {"frames": 2},
    }
    return Simulation(build_model(make_scene(tables, path=tmp_path / "swatch.toml")))


def test_a_swatch_reaches_the_same_equilibrium_in_fewer_steps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The energy changes by less than the tolerance of the residual, as an error of that size changes it by its square."""
    simulation = strained(tmp_path)
    *_, corrected = simulation.run()
    monkeypatch.setattr(SoftMotion, "correct", lambda self: None)
    *_, without = strained(tmp_path).run()
    assert corrected.steady and without.steady
    assert corrected.steps < without.steps
    tolerance = simulation.model.scene.solver.residual_tolerance
    assert corrected.observables.energies.stored == pytest.approx(without.observables.energies.stored, rel=tolerance)


def test_a_checkpoint_keeps_the_motions(tmp_path: Path) -> None:
    group = strained(tmp_path).mechanics.group
    kept, restored = group.soft_motion, SoftMotion(group.relaxation, group.contact)
    kept._motions, kept._changes = ([np.full(3, value), np.arange(3.0)] for value in (1.0, 2.0))
    restore(save(Owner(kept)), Owner(restored))
    for name in SoftMotion.KEPT:
        assert np.array_equal(getattr(restored, name), getattr(kept, name))


def test_sections_turn_with_the_motion(tmp_path: Path) -> None:
    """Motions of turns alone, each against its torque: all sections turn by torque over stiffness, at most by LARGEST."""
    group = strained(tmp_path).mechanics.group
    stepper, soft = group.relaxation.stepper, group.soft_motion
    group.contact.search()
    stepper.evaluate()
    nodes, thickness = stepper.rods.node_count, stepper.rods.section.thickness
    before, torque = fetch(stepper.state.director).copy(), fetch(stepper.state.torque).copy()
    turns = 1e-6 * np.random.default_rng(0).standard_normal((MOTIONS, nodes)) * stepper.rods.can_turn
    stiffness = 1e3 * np.abs(torque).max()
    soft._motions = [np.concatenate([np.zeros(3 * nodes), turn * thickness]) for turn in turns]
    soft._changes = [np.concatenate([np.zeros(3 * nodes), -stiffness * turn / thickness]) for turn in turns]
    expected = turns.T @ np.linalg.solve(turns @ turns.T, turns @ torque) / stiffness
    soft.correct()
    stepper.evaluate()
    turned = np.einsum("ij,ij->i", np.cross(before, fetch(stepper.state.director)), fetch(stepper.state.tangent))
    assert np.abs(expected).max() > 0.0
    assert turned == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())
