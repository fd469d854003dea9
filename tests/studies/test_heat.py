"""What heat does to a mesh under tension (studies/heat.py)."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from reference.in_words import ChangingRow as Row
from reference.in_words import quantities
from warpknit.base.errors import Diverged
from warpknit.scene import Scene, load_scene
from warpknit.solve.model import build_model
from warpknit.studies.equal_tension import EqualTensionPath
from warpknit.studies.heat import heat, tension_held
from warpknit.studies.load_path import LoadPath, meshes_of

SCENES = Path(__file__).parents[2] / "scenes"


@pytest.fixture(scope="module")
def scene() -> Scene:
    hot = ['path=[{temperature="120 degC"}]', "output.frames=4"]
    return load_scene(SCENES / "contact_map.toml", hot, "draft")


def rows_of(scene: Scene) -> list[Row]:
    return list(LoadPath(build_model(scene)).rows(scene.stages[0], levels=1))


def test_a_temperature_that_is_not_reached_is_told(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """The answers are those of the records before, and the mesh says where it stopped; the other case goes on."""

    class Failing(LoadPath):
        def load(self, stage, levels, monitor=lambda _: None):
            for number, record in enumerate(super().load(stage, levels, monitor)):
                if number == 1 and isinstance(stage, Mapping) and "tension held" in stage[0].name:
                    raise Diverged("no progress")
                yield record

    monkeypatch.setattr("warpknit.studies.heat.LoadPath", Failing)
    (held, framed), _ = heat(scene, meshes_of(scene), EqualTensionPath(rows=rows_of(scene)), 0.2)
    assert quantities(held.ended)[-1] == "70 degC"
    assert len(held.rows) == 2
    assert [one["temperature_K"][1] for one in held.answers] == [pytest.approx(343.15)]
    assert framed.ended == "" and framed.rows[-1].temperature_K == pytest.approx(393.15)


def test_heat_that_is_not_shown_has_its_reason(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """No other temperature, no tension that the mesh carries, and a load that does not converge, each in words."""
    path, meshes = EqualTensionPath(rows=rows_of(scene)), meshes_of(scene)
    cold = load_scene(SCENES / "contact_map.toml")
    assert heat(cold, meshes, path, 0.2) == ([], "the scene has no [[path]] with another temperature")
    assert heat(scene, meshes, path, None)[0] == [] and "no tension was found" in heat(scene, meshes, path, None)[1]

    class Failing(LoadPath):
        def load(self, stage, levels, monitor=lambda _: None):
            raise Diverged("no progress")

    monkeypatch.setattr("warpknit.studies.heat.LoadPath", Failing)
    assert heat(scene, meshes, path, 0.2) == ([], "the mesh did not converge under 200 mN/m at 20 degC: no progress")


def test_heat_is_applied_at_a_tension_that_the_mesh_reaches() -> None:
    """A requested tension beyond the path gives way to the best one."""
    path = EqualTensionPath(states={2.0: None})
    assert [tension_held(path, *pair) for pair in ((2.0, 1.0), (200.0, 1.0), (None, 1.0), (200.0, None))] == [2.0, 1.0, 1.0, None]
