"""What a designer takes from a mesh in space: its network of resistors, its openings, its card."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from warpknit import measure
from warpknit.commands.cli import main
from warpknit.measure.network import contact_resistances, sheet_conductance, sheet_resistance, wire_resistance
from warpknit.scene import load_scene
from warpknit.scene.materials import MATERIALS
from warpknit.solve.model import build_model
from warpknit.spatial.observables import SpatialObservables
from warpknit.studies import curves
from warpknit.studies.card import HEATED, find_cards, tension_slope_of
from warpknit.studies.load_path import LoadPath, Meshes, exact_model, states_at, under_strain, under_tension
from warpknit.studies.opening_size import openings

SCENES = Path(__file__).parents[2] / "scenes"
STRAINS = (0.1, 0.1)


def scene_of(kind: str, *settings: str):
    return load_scene(SCENES / "contact_map.toml", [f"model.kind={kind}", "output.frames=1", *settings], "draft")


@pytest.fixture(scope="module")
def state() -> SpatialObservables:
    """The cell at 10 %, where contacts carry."""
    (found,) = states_at(build_model(scene_of("spatial")), [np.diag(1.0 + np.array(STRAINS))])
    assert isinstance(found, SpatialObservables)
    return found


def every_segment(r: SpatialObservables):
    """The network from where everything stands: each segment between two nodes a resistor, cut where contacts touch it, and each
    contact one between the two places on it. Ends, reach, conductance, number of points, area."""
    rods, wire, touching = r.model.rods, r.model.scene.wire, r.touching
    periods = r.gradient @ np.diag(r.model.panel.size)
    place = [*r.position[:, :2]]
    per_length = 4.0 * MATERIALS[wire.material].resistivity / (np.pi * wire.diameter**2)
    ohms_along = per_length * rods.natural_arc * r.length_factor
    ends, reach, ohms, at = [], [], [], {}
    for node, following in enumerate(rods.following):
        last = rods.wire_first[rods.wire_of[node]] + rods.wire_count[rods.wire_of[node]] - 1
        beyond = r.gradient @ rods.wire_period[rods.wire_of[node]][:2] if node == last else 0.0
        way = place[following] + beyond - place[node]
        stops = [
            (touching.place[k, side], k, side)
            for side, nodes in enumerate((touching.first, touching.second))
            for k in np.flatnonzero((nodes == node) & (touching.force > measure.active_threshold(r.model)))
        ]
        here, before = node, 0.0
        for share, contact, side in sorted(stops):
            at[contact, side] = len(place)
            place.append(place[node] + share * way)
            ends.append((here, at[contact, side]))
            reach.append((share - before) * way)
            ohms.append((share - before) * ohms_along[node])
            here, before = at[contact, side], share
        ends.append((here, following))
        reach.append((1.0 - before) * way)
        ohms.append((1.0 - before) * ohms_along[node])
    for contact in sorted({contact for contact, _ in at}):
        one, other = at[contact, 0], at[contact, 1]
        across = np.linalg.solve(periods, place[other] - place[one])
        ends.append((one, other))
        reach.append(periods @ (across - np.rint(across)))
        ohms.append(0.5 * MATERIALS[wire.material].resistivity * np.sqrt(np.pi * wire.hardness / touching.force[contact]))
    return np.array(ends), np.array(reach), 1.0 / np.array(ohms), len(place), abs(np.linalg.det(periods))


def test_a_mesh_in_space_is_the_network_of_its_segments(state):
    """Wires between contacts are their segments in series, each contact is Holm's constriction under its own force, and where
    in a repeat a point stands does not matter."""
    weft, warp = sheet_resistance(state)
    assert len(contact_resistances(state)) > 8
    assert (1.0 / weft, 1.0 / warp) == pytest.approx(np.diag(sheet_conductance(*every_segment(state))), rel=1e-9)


def test_arcs_of_contacts_add_up_to_the_wire(state):
    """Each wire is as long as its segments, all round, and contacts stand on it."""
    t = state.contact_places
    assert t.wire_length == pytest.approx(state.model.rods.wire_length, rel=1e-9, abs=0)
    assert np.all((t.arc >= 0.0) & (t.arc < t.wire_length[t.wire]))
    assert wire_resistance(state.model.scene.wire) > 0.0


def test_openings_are_those_of_the_planar_mesh_of_equal_strain(state):
    """In plan view both models have the same wires, but for what contacts push them apart by, 0.1 d on either side, and two steps
    of the grid of d/5."""
    (planar,) = states_at(build_model(scene_of("planar")), [np.diag(1.0 + np.array(STRAINS))])
    mine, other = (max(opening.circle for opening in openings(one)) for one in (state, planar))
    assert mine == pytest.approx(other, abs=0.6 * state.model.scene.wire.thickness)


TRICOT = {
    "wire": {"material": "molybdenum", "diameter": "30 um"},
    "knit": {"bars": [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}], "wales": "26 /inch", "courses": "30 /inch", "repeats": [1, 1]},
    "model": {"kind": "spatial", "boundary": "periodic"},
    "contact": {"friction": 0.2},
    "load": {"strain_weft": 0.0},
    "solver": {"preset": "draft"},
    "output": {"frames": 3},
}


@pytest.mark.slow
def test_a_card_with_friction_has_a_stiffness_of_small_cycles_and_one_of_loading():
    """Contacts that stick are springs, so C of small cycles is that of an energy: symmetric to what residuals of 2e-5 leave of a
    tension of 1 N/m over strains of 1e-4, 0.1 N/m of 240. Slip yields: loading, no strain finds more resistance than a cycle. A
    wire that expands freely takes the mesh with it but for its contacts, which hold back by less than the tension over C. Heated
    and cooled back it has strained by what slipped."""
    model = exact_model(load_scene(TRICOT), 1e-4)
    path, tension = LoadPath(model), 1.0
    list(path.load(under_tension(model.scene, tension), 3))
    load = under_strain(model.scene, path.states[0].gradient)
    ahead = under_tension(model.scene, 1.01 * tension)
    card, _ = find_cards(Meshes.of(exact_model(model.scene)), path.states, {0: load}, {0: ahead})[0]
    assert card.asymmetry < 1e-3 and card.is_stable
    loading, cycles = card.history.loading, card.stiffness
    assert np.linalg.eigvalsh(cycles - 0.5 * (loading + loading.T)).min() > -0.01 * cycles.max()
    assert loading[1, 1] < 0.5 * cycles[1, 1]
    held_back = tension / cycles[0, 0] / HEATED
    for expansion in (card.expansion[:2], card.history.cooling[:2]):
        assert expansion == pytest.approx(2 * [model.scene.wire.expansion], abs=held_back)
    assert card.expansion[:2] != pytest.approx(card.history.cooling[:2], rel=1e-3)
    assert tension_slope_of(card.history.loading, card.tension)[0, 1] == loading[0, 1] - card.tension_weft


@pytest.mark.slow
def test_the_card_in_space_is_symmetric_and_near_that_of_the_plane():
    """S = dw/dE makes C symmetric: residuals of 2e-5 of the tension (0.13 N/m) over strains of 1e-3 are 1.6e-3 of 1.7 N/m.
    Tensions of the planar model are 6 % too high at 12 % and 4 % at 16 % (studies/condensation.md); C, their slope, is no farther
    off, nor is shear, where heights count."""
    cards = {}
    for kind in ("planar", "spatial"):
        model = exact_model(scene_of(kind))
        path, load = LoadPath(model), under_strain(model.scene, np.diag([1.16, 1.12]))
        path.to(load)
        cards[kind], _ = find_cards(path.meshes, path.states, {0: load}, {})[0]
    mine, other = cards["spatial"], cards["planar"]
    assert mine.asymmetry < 1.6e-3 and mine.step_difference < 5e-3 and mine.is_stable
    assert mine.stiffness == pytest.approx(other.stiffness, abs=0.06 * other.stiffness.max())
    assert mine.areal_mass == pytest.approx(other.areal_mass, rel=5e-3)


@pytest.mark.slow
def test_a_report_in_space_is_a_page_with_a_card(tmp_path, monkeypatch):
    monkeypatch.setattr(curves, "POINTS", 2)
    settings = ["model.kind=spatial", "output.frames=1", "sweep.strain_weft=[0.12, 0.16]", "sweep.strain_warp=[0.12, 0.16]"]
    options = ["--quiet", "--preset", "draft", *(part for setting in settings for part in ("--set", setting))]
    command = ["report", str(SCENES / "contact_map.toml"), *options, "--out", str(tmp_path / "r")]
    done = CliRunner().invoke(main, command, prog_name="warpknit")
    assert done.exit_code == 0, done.output
    assert "Model: spatial (chosen in the scene)" in (tmp_path / "r" / "report.html").read_text(encoding="utf-8")
    card = json.loads((tmp_path / "r" / "material_card.json").read_text(encoding="utf-8"))
    assert card["quality"]["positive_definite"]
