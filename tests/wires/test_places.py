"""Places where wires from a file touch: every crossing of a weave, and wires that run side by side; and the forces there."""

from pathlib import Path

import numpy as np
import pytest

from warpknit import measure
from warpknit.runner.run import run_scene
from warpknit.scene import Scene, make_scene
from warpknit.solve.model import build_model, initial_state
from warpknit.solve.simulate import Simulation
from warpknit.wires.centre_lines import Wires
from warpknit.wires.hooks import LAYER, find_places

SPACING, DIAMETER = 2e-3, 20e-6  # [m]
LOOP_LENGTH = 3.3 * SPACING


def weave(columns: int, rows: int, points: int = 40) -> list[np.ndarray]:
    """Sine wires (point, 3) [m] of a plain weave that touch where they cross: `rows` along x, then `columns` along y."""
    wires = []
    for count, other, along in ((rows, columns, 0), (columns, rows, 1)):
        for number in range(count):
            arc = np.linspace(0.0, other * SPACING, points * other + 1)
            wire = np.zeros((len(arc), 3))
            wire[:, along], wire[:, 1 - along] = arc, (number + 0.5) * SPACING
            wire[:, 2] = 0.5 * DIAMETER * (-1.0) ** (number + along) * np.sin(np.pi * arc / SPACING)
            wires.append(wire)
    return wires


def as_open(wires: list[np.ndarray]) -> Wires:
    return Wires(tuple(wires), ("open",) * len(wires), np.zeros((len(wires), 2), dtype=int), None, None, None)


def as_tile(columns: int, rows: int) -> Wires:
    shifts = np.array([[1, 0]] * rows + [[0, 1]] * columns)
    points = tuple(wire[:-1] for wire in weave(columns, rows))
    return Wires(points, ("periodic",) * len(points), shifts, SPACING * np.array([columns, rows]), None, None)


def scene_of(folder: Path, drawn: list[np.ndarray], **tables: dict[str, object]) -> Scene:
    """A scene with these wires (point, 3) [m] in a file."""
    lines = [f"{number},{x:.12g},{y:.12g},{z:.12g}" for number, points in enumerate(drawn) for x, y, z in points]
    (folder / "wires.csv").write_text("\n".join(["wire,x [m],y [m],z [m]", *lines, ""]))
    table = {
        "wires": {"file": "wires.csv", "node_spacing": 50e-6, "loop_size": SPACING} | tables.pop("wires", {}),
        "wire": {"material": "molybdenum", "diameter": DIAMETER} | tables.pop("wire", {}),
        "output": {"frames": 2, "figures": False, "usd": False},
    }  # fmt: skip
    return make_scene(table | tables, path=folder / "wires.toml")


@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (2, 3), (5, 4)])
def test_every_crossing_of_a_weave_is_a_place(columns: int, rows: int) -> None:
    """n x m of them, at the crossings, also where nodes lie on each other; none hooks; wires drawn backwards cross as often."""
    wires = weave(columns, rows)
    for drawn in (wires, [wire[::-1] for wire in wires]):
        found = find_places(as_open(drawn), LOOP_LENGTH)
        assert (len(found), found.hooks) == (columns * rows, 0)
        expected = [((i + 0.5) * SPACING, (j + 0.5) * SPACING) for i in range(columns) for j in range(rows)]
        assert np.array(sorted(found.position.round(9).tolist())) == pytest.approx(np.array(expected))


@pytest.mark.parametrize(("columns", "rows"), [(2, 2), (4, 2)])
def test_every_crossing_of_a_woven_tile_is_a_place(columns: int, rows: int) -> None:
    assert len(find_places(as_tile(columns, rows), LOOP_LENGTH)) == columns * rows


def test_wires_in_different_layers_do_not_cross() -> None:
    """Two weaves above each other: their own crossings, and those between them up to half a loop apart."""
    lower = [wire * [1.0, 1.0, 0.0] for wire in weave(2, 2)]
    for gap, places in ((0.99, 16), (1.01, 8)):
        upper = [wire + [0.0, 0.0, gap * LAYER * LOOP_LENGTH] for wire in lower]
        found = find_places(as_open(lower + upper), LOOP_LENGTH)
        assert len(found) - found.hooks == places - 2 * found.hooks


@pytest.mark.parametrize(("apart", "places"), [(1.5, 1), (2.5, 0)])
def test_wires_side_by_side_are_one_place_within_two_diameters(tmp_path: Path, apart: float, places: int) -> None:
    """Two straight wires that do not cross, and a straight wire beside its own copy in the next tile."""
    along = np.linspace(0.0, SPACING, 41)
    one = np.stack([along, 0.0 * along, 0.0 * along], axis=1)
    other = one + [0.0, apart * DIAMETER, 0.0]
    pair = build_model(scene_of(tmp_path, [one, other]))
    assert pair.panel.body_count == places
    assert pair.panel.pair_wire.reshape(-1, 2).tolist() == [[0, 1]] * places
    period = [SPACING, apart * DIAMETER]
    tile = build_model(scene_of(tmp_path, [one], wires={"period": period}, model={"boundary": "periodic"}))
    assert tile.panel.pair_wire.reshape(-1, 2).tolist() == [[0, 0]] * places


def test_a_bulge_towards_a_wire_is_a_place_at_its_top(tmp_path: Path) -> None:
    """A wire that comes within 1.2 diameters of another and goes away again: the closest points are the place."""
    along = np.linspace(0.0, SPACING, 81)
    straight = np.stack([along, 0.0 * along, 0.0 * along], axis=1)
    height = 1.2 * DIAMETER + 100.0 * (along - 0.3 * SPACING) ** 2
    model = build_model(scene_of(tmp_path, [straight, np.stack([along, height, 0.0 * along], axis=1)]))
    assert model.panel.body_count == 1
    first = straight[0, 0] + model.wires.site_seed[0, 0] * model.rods.rest_edge[0, 0]
    assert first == pytest.approx(0.3 * SPACING, abs=50e-6)


def test_contact_forces_of_a_weave_balance_its_wires(tmp_path: Path) -> None:
    """A wire of tension T that leaves a crossing at the slope t on both sides presses on it with F = 2 T sin t.

    The wires are naturally straight. Half way between two crossings a wire has no moment. Beyond the length sqrt(EI/T) from a
    crossing, 0.12 mm here, it carries no shear force, and its direction is that of T: the share of shear is
    1/cosh(L/2 sqrt(T/EI)), 4e-4, with L between crossings.
    """
    table = {"load": {"strain_weft": 0.002, "strain_warp": 0.002}, "model": {"boundary": "periodic"}}
    scene = scene_of(tmp_path, weave(2, 2), wires={"period": [2.0 * SPACING, 2.0 * SPACING]}, wire={"set_fraction": 0.0}, **table)
    model = build_model(scene)
    record = list(Simulation(model, initial_state(model)).run())[-1]
    r = record.observables
    assert model.panel.body_count == 4
    middle = np.flatnonzero(np.isclose(r.position[:, :2] / r.stretch[0, 0] % SPACING, 0.0, atol=0.02 * SPACING).any(axis=1))
    tension = np.linalg.norm(r.segment_force[middle], axis=1)
    slope = np.abs(r.segment_tangent[middle, 2])
    closed_form = 2.0 * float(np.mean(tension * slope))
    shear = 1.0 / np.cosh(0.5 * SPACING * np.sqrt(tension.mean() / model.bending_stiffness))
    assert shear < 1e-3
    assert r.pair_force == pytest.approx(np.full(8, closed_form), rel=2e-3)
    # by statics of the half wave between two such places, the forces across the mesh balance to the tolerance of the equilibrium
    assert r.pair_force == pytest.approx(np.full(8, 2.0 * np.abs(r.segment_force[middle, 2]).mean()), rel=1e-3)
    contacts = measure.contacts(r)
    assert (contacts.pairs, contacts.active, contacts.active_percent) == (8, 8, 100.0)
    assert len(r.elsewhere_force) == 0


def test_the_answers_of_a_weave_count_its_crossings(tmp_path: Path) -> None:
    """All 4 crossings close, at a tension, carry the same force, and give a best tension."""
    load, boundary = {"tension_weft": "100 N/m", "tension_warp": "100 N/m"}, {"boundary": "periodic"}
    scene = scene_of(tmp_path, weave(2, 2), wires={"period": [2.0 * SPACING, 2.0 * SPACING]}, load=load, model=boundary)
    summary = run_scene(scene, out=tmp_path / "run").summary.json()
    contacts, answers = summary["contacts"], summary["answers"]
    assert (contacts["bodies"], contacts["active_percent"], contacts["elsewhere"]) == (4, 100.0, 0)
    assert contacts["force_max_N"] == pytest.approx(contacts["force_mean_N"], rel=1e-3)
    # a wire carries the tension of its spacing; its slope between crossings is at most that of a straight line
    straight = 2.0 * 100.0 * SPACING * DIAMETER / SPACING
    assert 0.5 * straight < contacts["force_max_N"] < 1.3 * straight
    (only,) = answers["contacts"]
    assert only["pairs"] == 8 and only["closes"] is not None
    assert answers["best"]["active_percent"] == 100.0 and summary["model"]["source"] == "wires"
