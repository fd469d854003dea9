"""The card of a tile of unequal loops is the mean of the cards of its meshes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from warpknit.base.errors import Diverged
from warpknit.results.row import Row
from warpknit.runner.run_directory import clear
from warpknit.scene import Scene, load_scene
from warpknit.studies.card import MaterialCard, find_cards
from warpknit.studies.load_path import (
    AS_KNITTED,
    DIFFERENCE_TOLERANCE,
    LoadPath,
    Meshes,
    meshes_of,
    under_tension,
)
from warpknit.studies.mean_card import ROUGH_TOLERANCE, find_mean, loads_of_card
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
def test_a_mean_card_is_the_mean_of_the_cards_of_its_meshes(friction):
    """With another friction each value changes by the mean of the changes of the same meshes."""
    scene = scene_of(friction)
    meshes = meshes_of(scene)
    path = LoadPath(meshes)
    list(path.load(under_tension(scene, TENSION), 2))
    mean = find_mean(meshes, path.states, TENSION)
    cards = {}
    for place, mesh in meshes.with_tolerance(DIFFERENCE_TOLERANCE).models.items():
        here, ahead, _ = loads_of_card(mesh.scene, path.states[place].gradient, TENSION)
        ((cards[place], _),) = find_cards(Meshes.of(mesh), {0: path.states[place]}, {0: here}, {0: ahead}).values()
    assert mean.meshes == 2 and len(cards) == (6 if friction else 2)
    assert mean.card.stiffness == pytest.approx(0.5 * (cards[0].stiffness + cards[1].stiffness), rel=1e-9)
    assert mean.card.strain_weft == pytest.approx(0.5 * (cards[0].strain_weft + cards[1].strain_weft), rel=1e-12)
    first, second = (cards[place].stiffness[0, 0] for place in (0, 1))
    assert mean.spread["C11"].std == pytest.approx(abs(first - second) / np.sqrt(2.0), rel=1e-6)
    ends = [float(np.trace(card.stiffness[:2, :2])) for card in (mean.softest, mean.stiffest)]
    assert ends == sorted(float(np.trace(cards[place].stiffness[:2, :2])) for place in (0, 1))
    median = float(mean.tensioned.gradient[0, 0]) - 1.0
    assert min(abs(median - cards[place].strain_weft) for place in (0, 1)) < 1e-12
    if friction:
        loading = 0.5 * (cards[0].history.loading + cards[1].history.loading)
        assert mean.card.history.loading == pytest.approx(loading, rel=1e-9)
        others = {"friction_half": (2, 3), "friction_double": (4, 5)}
        for name, places in others.items():
            expected = np.mean([cards[place].stiffness[0, 0] for place in places])
            assert mean.frictions["C11"][name] == pytest.approx(expected, rel=1e-9)
    else:
        assert mean.frictions["C11"] == {}


def test_a_rougher_tolerance_is_tried_where_the_fine_one_does_not_converge(monkeypatch):
    tried: list[float] = []

    def find(meshes, states, load, ahead, monitor):
        tried.append(meshes.scene.solver.residual_tolerance)
        if len(tried) == 1:
            raise Diverged("no progress")
        record = SimpleNamespace(observables=None)
        return {place: (replace(CARD, stress_max=float(place)), record) for place in meshes.own}

    row = Row(strain_weft=0.1, strain_warp=0.1, tension_weft_N_per_m=1.0, tension_warp_N_per_m=1.0, active_percent=1.0)
    monkeypatch.setattr("warpknit.studies.mean_card.find_cards", find)
    monkeypatch.setattr("warpknit.studies.mean_card.row_of", lambda _record: row.changed(stress_max_Pa=1e8))
    meshes = meshes_of(scene_of(0.0))
    mean = find_mean(meshes, dict.fromkeys(meshes.models, AS_KNITTED), TENSION)
    assert tried == [DIFFERENCE_TOLERANCE, ROUGH_TOLERANCE]
    assert (mean.meshes, mean.card.stress_max) == (2, 0.5)


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
