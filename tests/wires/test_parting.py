"""Wires pushed apart before they are rods: a thickness apart, on the sides on which they were drawn, free of stress."""

from pathlib import Path

import numpy as np
import pytest
from swatches import DIAMETER, swatch

from reference.cases import slow
from warpknit.base.errors import Diverged
from warpknit.scene import make_scene
from warpknit.solve import equilibrium
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation
from warpknit.wires.centre_lines import Wires
from warpknit.wires.hooks import find_places
from warpknit.wires.parting import APART, FOUND, pushed_apart
from warpknit.wires.read import drawn_wires, rest_wires

LENGTH, NODES = 20e-3, 21  # [m] of straight wires, a diameter between two nodes
LEAST = APART - FOUND  # of the thickness, apart


def crossed(height: float) -> list[np.ndarray]:
    """Two straight wires that cross at right angles in their middles, the second so many thicknesses above the first."""
    along = np.linspace(-0.5, 0.5, NODES) * LENGTH
    none = np.zeros(NODES)
    return [np.stack([along, none, none], axis=1), np.stack([none, along, none + height * DIAMETER], axis=1)]


@pytest.mark.parametrize("height", [0.8, 0.1, -0.1, 2e-3])
def test_crossed_wires_part_evenly_to_a_thickness(height: float) -> None:
    """By symmetry either wire moves by half of what is missing, the upper one up; the other way round where it lies below. The
    ends stay, which clamps hold. Lengths free of stress keep their ratio to the segments, here 1."""
    drawn = crossed(height)
    rest = tuple(np.linalg.norm(np.diff(points, axis=0), axis=1) for points in drawn)
    wires = Wires(tuple(drawn), ("open", "open"), np.zeros((2, 2), dtype=int), None, None, rest)
    apart = pushed_apart(wires, np.full(2, DIAMETER))
    first, second = (
        points[NODES // 2] - points_drawn[NODES // 2] for points, points_drawn in zip(apart.points, drawn, strict=True)
    )
    assert first == pytest.approx(-second, abs=1e-9 * DIAMETER)
    gap = abs(apart.points[1][NODES // 2, 2] - apart.points[0][NODES // 2, 2])
    assert LEAST * DIAMETER <= gap <= (APART + FOUND) * DIAMETER
    assert np.sign(second[2]) == np.sign(height)
    for points, points_drawn, length in zip(apart.points, drawn, apart.rest_lengths, strict=True):
        assert points[[0, 1, -2, -1]] == pytest.approx(points_drawn[[0, 1, -2, -1]], abs=1e-5 * DIAMETER)
        assert length == pytest.approx(np.linalg.norm(np.diff(points, axis=0), axis=1), rel=1e-12)


@pytest.mark.parametrize("height", [1.2, 5.0])
def test_wires_without_overlaps_stay(height: float) -> None:
    """Near each other, and so far apart that no pair is listed."""
    wires = Wires(tuple(crossed(height)), ("open", "open"), np.zeros((2, 2), dtype=int), None, None, None)
    assert pushed_apart(wires, np.full(2, DIAMETER)) is wires


def test_wires_that_go_on_part_through_the_border_of_a_repeat() -> None:
    """Straight wires that cross in the corner of a repeat, wherever that is cut: the same moves, turned round with the nodes."""
    period, count = np.array([LENGTH, LENGTH]), 20
    along, none = np.arange(count) * LENGTH / count, np.zeros(count)
    moved = []
    for start in (0, 10):
        drawn = [np.stack([along + start * 1e-3, none, none], axis=1), np.stack([none, along, none + 0.5e-3], axis=1)]
        wires = Wires(tuple(drawn), ("periodic",) * 2, np.eye(2, dtype=int), period, None, None)
        apart = pushed_apart(wires, np.full(2, DIAMETER))
        moved.append(np.roll(apart.points[0][:, 2] - drawn[0][:, 2], start))
        assert np.ptp(apart.points[1][[0, 0], 2] - apart.points[1][[0, 0], 2]) == 0.0
        assert apart.points[1][0, 2] - np.roll(apart.points[0], start, axis=0)[0, 2] >= LEAST * DIAMETER
    assert moved[0] == pytest.approx(moved[1], abs=1e-6 * DIAMETER)


@pytest.mark.parametrize(("kind", "overlap"), [("plain", 0.9), *slow(("rib", 0.5), ("cable", 0.7))])
def test_a_swatch_is_in_equilibrium_where_it_is_apart(kind: str, overlap: float, tmp_path: Path) -> None:
    """It takes no step to the mesh without load, which has no force and hooks as it did; from there it strains."""
    np.savez(tmp_path / "swatch.npz", wire=swatch(kind, 6, 5, overlap))
    tables = {
        "wires": {"file": "swatch.npz", "unit": "m", "loop_size": "5.5 mm", "overlaps": "at rest"},
        "wire": {"diameter": DIAMETER, "youngs_modulus": "1 MPa", "poissons_ratio": 0.3, "density": "1300 kg/m3"},
        "contact": {"friction": 0.0},
        "load": {"strain_weft": 0.02},
        "output": {"frames": 2},
    }
    scene = make_scene(tables, path=tmp_path / "swatch.toml")
    model = build_model(scene)
    moved, drawn = (find_places(wires, scene.wires.loop_length).hooks for wires in (rest_wires(scene), drawn_wires(scene)))
    assert moved == drawn
    first, *_, last = Simulation(model).run()
    assert first.steps == 0 and first.load_factor == 0.0
    assert not len(first.observables.touching.force)
    assert last.load_factor == 1.0 and last.steady


def test_a_level_that_stalls_by_overlaps_names_the_way_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without patience, a swatch as drawn stalls at once."""
    monkeypatch.setattr(equilibrium, "PATIENCE", 0)
    np.savez(tmp_path / "swatch.npz", wire=swatch("plain", 6, 4, 0.5))
    wires = {"file": "swatch.npz", "unit": "m", "loop_size": "5.5 mm"}
    scene = make_scene(
        {"wires": wires, "wire": {"diameter": DIAMETER}, "contact": {"friction": 0.0}}, path=tmp_path / "scene.toml"
    )
    with pytest.raises(Diverged, match="wires.overlaps = 'at rest'"):
        list(Simulation(build_model(scene)).run())
