"""The card of a tile of unequal loops is the mean of the cards of its meshes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from warpknit.base.errors import Diverged
from warpknit.runner.history import row_of
from warpknit.runner.run_directory import clear
from warpknit.scene import Scene, load_scene
from warpknit.solve.variant_models import VariantModels
from warpknit.studies.card import MaterialCard, find_card
from warpknit.studies.load_path import DIFFERENCE_TOLERANCE, LoadPath, exact, under_tension
from warpknit.studies.mean_card import BEYOND, find_mean, loads_of_card
from warpknit.studies.report_files import write_other_cards

TENSION = 1.0  # [N/m]
CARD = MaterialCard(
    strain_weft=0.1, strain_warp=0.1, tension_weft=1.0, tension_warp=1.0, stiffness=np.eye(3), asymmetry=0.0, step_difference=0.0,
    expansion=np.zeros(3), areal_mass=0.01, stress_max=1e8, active_percent=50.0, temperature=293.15,
)  # fmt: skip


def scene_of(friction: float) -> Scene:
    return load_scene(
        {
            "wire": {"material": "molybdenum", "diameter": "30 um"},
            "knit": {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch"},
            "model": {"kind": "spatial", "boundary": "periodic"},
            "contact": {"friction": friction},
            "load": {"tension_weft": TENSION, "tension_warp": TENSION},
            "solver": {"preset": "draft"},
            "output": {"frames": 2},
            "variants": {"count": 2, "standard_error": 0.0},
        }
    )


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_a_mean_card_is_the_mean_of_the_cards_of_its_meshes(friction, monkeypatch):
    monkeypatch.setattr("warpknit.studies.mean_card.MESHES_A_PROCESS", 1)
    scene = scene_of(friction)
    load, fine = under_tension(scene, TENSION), exact(scene, DIFFERENCE_TOLERANCE)
    cards = []
    variants = VariantModels(replace(fine, stages=(load,)))
    for number in (0, 1):
        way = LoadPath(variants.model(number))
        *_, record = way.load(load, 2)
        here, ahead, _ = loads_of_card(fine, row_of(record), TENSION)
        cards.append(find_card(way.model, way.state, here, ahead=ahead)[0])
    mean = find_mean(scene, load, TENSION, replace(cards[0], jumps="it jumped"))
    assert mean is not None and mean.meshes == 2 and mean.card.jumps == ""
    assert mean.card.stiffness == pytest.approx(0.5 * (cards[0].stiffness + cards[1].stiffness), rel=1e-3, abs=1e-3)
    assert mean.card.strain_weft == pytest.approx(0.5 * (cards[0].strain_weft + cards[1].strain_weft), rel=1e-4)
    first, second = (card.stiffness[0, 0] for card in cards)
    assert mean.spread["C11"].std == pytest.approx(abs(first - second) / np.sqrt(2.0), rel=0.05)
    ends = [float(np.trace(card.stiffness[:2, :2])) for card in (mean.softest, mean.stiffest)]
    assert ends == pytest.approx(sorted(float(np.trace(card.stiffness[:2, :2])) for card in cards), rel=1e-3)
    if friction:
        assert mean.card.history is not None and cards[0].history is not None and cards[1].history is not None
        loading = 0.5 * (cards[0].history.loading + cards[1].history.loading)
        assert mean.card.history.loading == pytest.approx(loading, rel=1e-3, abs=0.05)


def test_a_rougher_tolerance_is_tried_where_the_fine_one_does_not_converge(monkeypatch):
    """Meshes have their cards at the second tolerance; their path is that of the card, in levels of a run."""
    fine, rough = 1e-3, 2e-3  # enough for the path; no card is computed
    monkeypatch.setattr("warpknit.studies.load_path.DIFFERENCE_TOLERANCE", fine)
    monkeypatch.setattr("warpknit.studies.load_path.ROUGH_TOLERANCE", rough)
    tried: list[float] = []

    def find(model, state, load, monitor, *, ahead):
        tried.append(model.scene.solver.residual_tolerance)
        if tried[-1] < rough:
            raise Diverged("no progress")
        return replace(CARD, stress_max=float(len(tried))), None

    monkeypatch.setattr("warpknit.studies.mean_card.find_card", find)
    scene = scene_of(0.0)
    mean = find_mean(scene, under_tension(scene, TENSION), TENSION, CARD)
    assert tried == 2 * [fine] + 2 * [rough]
    assert mean is not None and (mean.meshes, mean.card.stress_max) == (2, 3.5)
    tensions = [row.tension_weft_N_per_m for row in mean.loading]
    expected = [0.0, 0.5 * TENSION, TENSION, BEYOND * TENSION]
    assert tensions == pytest.approx(expected, rel=0.01, abs=0.01 * TENSION)


def test_other_cards_of_an_earlier_report_are_removed(tmp_path):
    for name in ("softest", "stiffest", "loading"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "material_card.csv").touch()
    write_other_cards(SimpleNamespace(mean=None, card=None), tmp_path)
    assert not any(tmp_path.iterdir())


def test_ends_of_a_card_are_results_that_a_new_run_replaces(tmp_path):
    (tmp_path / "softest").mkdir()
    (tmp_path / "map.json").write_text('{"stop_reason": "finished"}')
    clear(tmp_path)
    assert not any(tmp_path.iterdir())
