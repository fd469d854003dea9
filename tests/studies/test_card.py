"""The material card against conservation and scaling laws."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from warpknit import measure
from warpknit.scene import load_scene
from warpknit.studies import card as card_module
from warpknit.studies.card import STEP, find_cards, stretch
from warpknit.studies.load_path import AS_KNITTED, Followed, LoadPath, Meshes, exact_model, states_at, under_strain, under_tension

SCENE = Path(__file__).parents[2] / "scenes" / "contact_map.toml"
STRAINS = 0.16, 0.16


@pytest.fixture(scope="module")
def model():
    return exact_model(load_scene(SCENE, ["output.frames=4"], "draft"))


def card_at(model, load):
    """The card under a load, and its mesh."""
    path = LoadPath(model)
    list(path.load(load, model.scene.output.frames))
    card, record = find_cards(path.meshes, path.states, {0: load}, {})[0]
    return card, record.observables


def card_at_strains(model):
    return card_at(model, under_strain(model.scene, np.diag(1.0 + np.array(STRAINS))))


@pytest.fixture(scope="module")
def found(model):
    return card_at_strains(model)


def test_stretch_has_the_strain_that_is_asked():
    """E = (f^T f - 1)/2, f upper triangular."""
    strain = np.array([0.03, -0.02, 0.05])
    f = stretch(strain)
    green = 0.5 * (f.T @ f - np.eye(2))
    assert f[1, 0] == 0.0
    assert [green[0, 0], green[1, 1], 2 * green[0, 1]] == pytest.approx(strain, abs=1e-15)


def test_the_stiffness_is_that_of_an_energy(found):
    """C = d2w/dE2 is symmetric and, where the mesh is stable, positive definite; the mesh is its own mirror image after half a
    repeat, so that stretch brings no shear. Tolerance: residual 2e-5 of the tension (0.2 N/m) over a strain of 1e-3, against
    2 N/m, is 0.2 %; the second difference step must agree as well."""
    card, _ = found
    assert card.is_stable
    assert card.asymmetry < 0.002 and card.step_difference < 0.002
    assert np.abs(card.stiffness[:2, 2]).max() < 0.002 * card.stiffness.max()
    nu12, nu21 = card.poissons_ratios
    assert nu12 * card.moduli[1] == pytest.approx(nu21 * card.moduli[0], rel=1e-12)  # Maxwell and Betti


@pytest.mark.parametrize(("kink", "step"), [(7e-4, 0.25 * STEP), (1.0, STEP)])
def test_the_step_is_halved_where_a_contact_closes_nearby(kink, step, monkeypatch):
    """Stiffness 140 N/m in weft up to a strain, and 60 N/m beyond: differences within the kink find the first."""

    def stress(_state, f, _tensioned):
        strain = 0.5 * (f.T @ f - np.eye(2))
        within = np.clip(strain[0, 0], -kink, kink)
        return 140.0 * within + 60.0 * (strain[0, 0] - within), 100.0 * strain[1, 1], 50.0 * strain[0, 1]

    mesh = SimpleNamespace(panel=SimpleNamespace(area=1.0), scene=load_scene(SCENE))
    observed = SimpleNamespace(gradient=np.eye(2), thermal_force=0.0, model=mesh)
    record = SimpleNamespace(observables=observed)
    path = SimpleNamespace(to=lambda load: {0: record}, states={0: None})
    monkeypatch.setattr(card_module, "LoadPath", lambda *_: path)
    monkeypatch.setattr(card_module, "follow", lambda loads, _levels: [Followed([record], AS_KNITTED) for _ in loads])
    monkeypatch.setattr(card_module, "under_strain", lambda *_: None)
    monkeypatch.setattr(card_module, "_stress", stress)
    for name, value in {
        "mesh_tension": (1.0, 1.0),
        "areal_mass": 1.0,
        "largest_stress": 1.0,
    }.items():
        monkeypatch.setattr(measure, name, lambda _, value=value: value)
    monkeypatch.setattr(measure, "contacts", lambda _: SimpleNamespace(active_percent=50.0))
    shares = []
    ((card, _),) = find_cards(Meshes.of(mesh), {}, {}, {}, shares.append).values()
    assert np.diag(card.stiffness) == pytest.approx([140.0, 100.0, 25.0])
    assert card.difference_step == step and card.difference < 1e-6
    assert shares[-1] == pytest.approx(1.0)


def test_the_card_foretells_a_further_strain(model, found):
    """S = S0 + C E for a strain in all directions at once that no difference was taken along, to second order in E."""
    card, _ = found
    strain = STEP * np.array([1.0, -1.5, 2.0])
    f, tensioned = stretch(strain), np.diag(1.0 + np.array(STRAINS))
    (state,) = states_at(model, [f @ tensioned])
    s = np.linalg.solve(f, state.nominal_stress) @ tensioned.T / np.linalg.det(tensioned)
    change = np.array([s[0, 0] - card.tension_weft, s[1, 1] - card.tension_warp, s[0, 1]])
    expected = card.stiffness @ strain
    assert change == pytest.approx(expected, abs=0.03 * np.abs(expected).max())


def test_the_free_mesh_expands_as_its_wires_and_slackens(model, found):
    """Bending alone makes the energy of a mesh of size L scale as u(F/L)/L, thin wire being inextensible and the contact's reach
    small: at constant tension s the mesh expands by (1 + 3 C^-1 s) of the wires' expansion. What does not scale is the reach,
    1.25 d against loops of C: a share of d/C = 0.015."""
    card, _ = found
    tension = np.array([card.tension_weft, card.tension_warp, 0.0])
    expected = np.array([1.0, 1.0, 0.0]) + 3.0 * np.linalg.solve(card.stiffness, tension)
    wire = model.scene.wire
    assert card.expansion / wire.expansion == pytest.approx(expected, abs=wire.diameter / 1e-3)
    assert abs(expected[0] - 1.0) > 2 * 0.015  # what a mesh without tension would do is told apart


def test_the_strains_of_a_tension_are_found(model):
    """Both tensions meet what is asked within half a percent."""
    card, state = card_at(model, under_tension(model.scene, 0.18))
    assert (card.tension_weft, card.tension_warp) == pytest.approx((0.18, 0.18), rel=5e-3)
    assert np.diag(state.gradient) - 1.0 == pytest.approx((card.strain_weft, card.strain_warp))


def test_the_card_does_not_depend_on_the_tile(model, found):
    """Endless cloth is the same in tiles of two repeats. Residuals of 2e-5 over a strain of 1e-3 leave 2e-3 of the largest
    stiffness at most; C is nearly singular, and its inverse, six times as large, has 1 %."""
    scene = model.scene
    twice, _ = card_at_strains(exact_model(replace(scene, knit=replace(scene.knit, repeats=(1, 2)))))
    card, _ = found
    assert twice.stiffness == pytest.approx(card.stiffness, abs=2e-3 * card.stiffness.max())
    assert twice.moduli == pytest.approx(card.moduli, rel=0.01)
    assert twice.expansion == pytest.approx(card.expansion, abs=0.01 * card.expansion.max())


def test_heat_changes_the_stress_by_the_stiffness_times_the_expansion(model, found):
    """dS = -C alpha dT, from meshes that are hotter and colder, not from derivatives of the energy; the slope of their energy is
    `thermal_force`. Thermal strain of 1e-3 on either side, as the differences of the card: of stress, residuals of 2e-5 over that
    are 0.2 % at most; the energy changes by their square. Chords in place of arcs would leave 0.3 and 0.2 %."""
    card, base = found
    by, stress, stored = 1e-3 / model.scene.wire.expansion, [], []
    tensioned = np.diag(1.0 + np.array(STRAINS))
    for sign in (1.0, -1.0):
        stage = model.scene.stages[0]
        warm = replace(stage, temperature=stage.temperature + sign * by)
        (state,) = states_at(replace(model, scene=replace(model.scene, stages=(warm,))), [tensioned])
        stress.append(np.diag(state.nominal_stress @ tensioned.T / np.linalg.det(tensioned)))
        energies = state.energies
        stored.append(energies.stretch + energies.bend + energies.contact)
    assert base.thermal_force == pytest.approx((stored[0] - stored[1]) / 2e-3, rel=1e-4)
    change = (stress[0] - stress[1]) / (2.0 * by)
    expected = -(card.stiffness @ card.expansion)[:2]
    assert change == pytest.approx(expected, rel=2e-3)
    assert np.all(expected < 0.0)  # a warmer mesh is slacker


def test_tension_changes_by_the_slope_that_the_card_gives(model, found):
    """D = d(tension)/d(strain), by differences of the tensions that `tension_strain.csv` has, not of S; 1 % as for C."""
    card, _ = found
    slopes = np.zeros((2, 2))
    changes = [sign * STEP * np.eye(2)[k] for k in (0, 1) for sign in (1.0, -1.0)]
    gradients = [np.diag((1.0 + change) * (1.0 + np.array(STRAINS))) for change in changes]
    tension = np.array([measure.mesh_tension(state) for state in states_at(model, gradients)])
    slopes[:, 0], slopes[:, 1] = (tension[0] - tension[1]) / (2 * STEP), (tension[2] - tension[3]) / (2 * STEP)
    assert slopes == pytest.approx(card.tension_slope, abs=0.01 * card.stiffness.max())
    assert abs(slopes[0, 1] - card.stiffness[0, 1]) > 0.05 * card.stiffness.max()  # C is told apart


def test_a_sheared_mesh_balances_its_moments_and_is_its_own_mirror_image(model):
    """Forces that sum up to no moment make the true stress symmetric, within the residuals of 2e-5. Mirrored at the warp, the
    double atlas is itself, moved by half a repeat: shear the other way turns the sign of the shear stress alone."""
    tensioned = np.diag(1.0 + np.array(STRAINS))
    states = states_at(model, [tensioned + [[0.0, shear], [0.0, 0.0]] for shear in (0.1, -0.1)])
    right, left = (measure.true_stress(state.nominal_stress, state.gradient) for state in states)
    tolerance = 5e-5 * right.max()
    assert right[0, 1] > 0.2 * right.max()
    assert right[0, 1] == pytest.approx(right[1, 0], abs=tolerance)
    assert left * [[1.0, -1.0], [-1.0, 1.0]] == pytest.approx(right, abs=tolerance)
    assert measure.contacts(states[0]) == measure.contacts(states[1])
