"""What a material card says of itself: limits, stability, temperature."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from reference.in_words import codes, in_words, quantities
from warpknit.scene import load_scene
from warpknit.studies.card import History, MaterialCard
from warpknit.studies.card_files import card_values, card_warnings, strength_values
from warpknit.studies.findings import Findings

SCENES = Path(__file__).parents[2] / "scenes"
CARD = MaterialCard(
    strain_weft=0.1, strain_warp=0.1, tension_weft=1.0, tension_warp=1.0, stiffness=np.eye(3), asymmetry=0.0, step_difference=0.0,
    expansion=np.zeros(3), areal_mass=0.01, stress_max=1e8, active_percent=50.0, temperature=293.15,
)  # fmt: skip


def test_a_card_of_a_wire_that_would_break_says_so_where_it_is_named():
    scene = load_scene(SCENES / "contact_map.toml")
    state = Findings.card_state.fget(SimpleNamespace(card=replace(CARD, stress_max=5e9), scene=scene, where="2 N/m"))
    assert quantities(state) == ["2 N/m", "20 degC", "5 GPa", "4.5 GPa"]
    elastic = Findings.card_state.fget(SimpleNamespace(card=CARD, scene=scene, where="2 N/m"))
    assert quantities(elastic) == ["2 N/m", "20 degC"]


def test_a_card_says_how_near_the_wire_is_to_its_limits():
    """3 GPa over 2 GPa and 4.5 GPa, the limits of tungsten, which are assumed until the scene gives them."""
    card, file = replace(CARD, stress_max=3e9), SCENES / "contact_map.toml"
    rows = {name: (value, meaning) for name, value, _, meaning in strength_values(card, load_scene(file))}
    assert rows["stress_over_yield"][0] == pytest.approx(1.5) and rows["stress_over_strength"][0] == pytest.approx(2.0 / 3.0)
    assert rows["yield_stress"][0] == 2e9 and "wire.yield_stress" in rows["yield_stress"][1]
    given = load_scene(file, ["wire.yield_stress=2 GPa"])
    assert not any("wire.yield_stress" in meaning for _, _, _, meaning in strength_values(card, given))
    (said,) = card_warnings(replace(card, stress_max=5e9), given)
    assert said.code == "W56" and {"5 GPa", "4.5 GPa"} <= set(quantities(said.text))


def test_a_card_that_cannot_be_used_says_so():
    """Moduli and Poisson's ratios come from the inverse, which has no meaning where the mesh is not stable."""
    scene = load_scene(SCENES / "contact_map.toml")
    card = replace(CARD, stiffness=np.diag([3.0, 2.0, -1.0]), step_difference=0.4, stress_max=3e9)
    names = {name: value for name, value, _, _ in card_values(card)}
    assert names["stable"] == 0.0 and names["difference"] == 0.4 and not {"E1", "nu12", "alpha1"} & set(names)
    warnings = list(card_warnings(card, scene))
    said = " ".join(map(str, warnings))
    assert codes(warnings) == ["W50", "W52", "W56"] and "by 40 %" in said and "3 GPa" in said
    assert "unstable in shear" in said and "C33 = -1 N/m" in said and "a larger --tension" in said


def test_prestress_may_hold_what_the_stiffness_does_not():
    """Waves along weft or warp shear the mesh against C33 and the tension along them: C33 + S, the least of all directions."""
    card = replace(CARD, stiffness=np.diag([3.0, 2.0, -0.75]))
    assert not card.is_stable and card.softest == 2
    assert card.least_wave_stiffness == pytest.approx(0.25, rel=1e-12)
    said = " ".join(in_words(card_warnings)(card, load_scene(SCENES / "contact_map.toml")))
    assert "250 mN/m" in quantities(said)
    slack = replace(card, tension_warp=0.5)
    assert slack.least_wave_stiffness == pytest.approx(-0.25, rel=1e-12)
    assert "also with its prestress" in " ".join(in_words(card_warnings)(slack, load_scene(SCENES / "contact_map.toml")))


def test_a_card_says_which_temperature_it_holds_for():
    assert ("temperature", 293.15, "K") in [values[:3] for values in card_values(CARD)]


def test_the_card_of_further_loading_has_its_tangent():
    """Its stiffness is the symmetric part, its error the largest asymmetry over the largest entry."""
    tangent = np.array([[4.0, 1.0, 0.0], [2.0, 3.0, 0.0], [0.0, 0.0, 1.0]])
    card = replace(CARD, history=History(tangent, 0.01, np.zeros(3)))
    loading = card.of_loading
    assert loading is not None and loading.history is None and CARD.of_loading is None
    assert np.array_equal(loading.stiffness, [[4.0, 1.5, 0.0], [1.5, 3.0, 0.0], [0.0, 0.0, 1.0]])
    assert loading.difference == pytest.approx(0.25) and loading.tension_weft == card.tension_weft
