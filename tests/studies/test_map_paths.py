"""Paths of maps: pairs of loads in the same proportion are load steps of one path."""

from pathlib import Path

import pytest

from warpknit.measure import mesh_tension
from warpknit.scene import load_scene
from warpknit.solve.model import build_model
from warpknit.studies.load_path import ends_of, knitted_worlds
from warpknit.studies.map_paths import MapPath, map_paths, path_to

SCENE = Path(__file__).parents[2] / "scenes/contact_map.toml"
GRID = ["sweep.strain_weft=[0, 0.02, 0.06]", "sweep.strain_warp=[0, 0.02, 0.06]", "output.frames=6"]


def test_pairs_in_the_same_proportion_share_a_path():
    """Increments of 0.06/6: from 0.02 to 0.06 there are four, so each pair of the path has four levels."""
    scene = load_scene(SCENE, GRID)
    paths = map_paths(scene)
    assert sorted(paths, key=lambda path: path.pairs) == [
        MapPath(((0.0, 0.0),), 1),
        MapPath(((0.0, 0.02), (0.0, 0.06)), 4),
        MapPath(((0.02, 0.0), (0.06, 0.0)), 4),
        MapPath(((0.02, 0.02), (0.06, 0.06)), 4),
        MapPath(((0.02, 0.06),), 6),
        MapPath(((0.06, 0.02),), 6),
    ]
    assert path_to(scene, (0.02, 0.0)) == MapPath(((0.02, 0.0),), 4)


@pytest.mark.parametrize("setting", ["load.shear=0.01", "load.temperature=100 degC"])
def test_pairs_with_a_shear_or_a_temperature_have_their_own_paths(setting):
    assert [path.pairs for path in map_paths(load_scene(SCENE, [*GRID, setting]))].count(((0.06, 0.06),)) == 1


def test_a_pair_behind_another_on_its_path_has_its_own_equilibrium():
    """In space: tensions at 10 %, a load step behind 5 %, agree with those of 10 % in two levels, to the tolerance."""
    scene = load_scene(SCENE, ["model.kind=spatial", "solver.preset=draft"])
    model = build_model(scene)
    near, far = (scene.sweep.stage(scene.stages[0], (strain, strain)) for strain in (0.05, 0.1))
    simulation = knitted_worlds([model, model], [[near, far], [far]], [1, 2])
    tensions = {(world, end.stage_index): mesh_tension(end.observables) for world, end in ends_of(simulation)}
    assert set(tensions) == {(0, 0), (0, 1), (1, 0)}
    assert tensions[0, 1] == pytest.approx(tensions[1, 0], rel=scene.solver.residual_tolerance)
    assert min(tensions[0, 1]) > 2.0 * max(tensions[0, 0])
