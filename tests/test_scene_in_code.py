"""Scenes built and changed in code: the same checks and messages as those of a file."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from warpknit.base.errors import SceneError
from warpknit.scene import load_scene, resolved_toml

CELL = Path(__file__).parents[1] / "scenes" / "atlas_cell.toml"
TEXT = '[wire]\ndiameter = "17 um"\n[load]\nstrain_warp = 0.1\n'
TABLE = {"wire": {"diameter": "17 um"}, "load": {"strain_warp": 0.1}}


def test_path_string_text_and_dict_give_equal_scenes(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(TEXT)
    scenes = [load_scene(source) for source in (path, str(path), TEXT, TABLE)]
    assert all(scene == scenes[0] for scene in scenes)
    assert {scene.hash for scene in scenes} == {scenes[0].hash}


def test_values_of_numpy_and_paths_are_taken() -> None:
    given = {"load": {"strain_warp": np.float32(0.25)}, "knit": {"repeats": np.array([2, 3])}}
    scene = load_scene(given, {"knit.repeats": (np.int64(3), 3)})
    assert scene.stages[0].strain_warp == 0.25 and scene.knit.repeats == (3, 3)
    with pytest.raises(SceneError, match="wires.file: 'none.bcc'"):
        load_scene({"wires": {"file": Path("none.bcc")}})


@pytest.mark.parametrize(
    ("source", "line"),
    [
        ({"wire": {"diameter": "15 kg"}}, "scene: wire.diameter: '15 kg'"),
        ({"wire": {"diamter": 1}}, "scene: wire.diamter: ... wire.diameter"),
        ({"knit": {"name": "x"}}, "scene: knit.name: ... knit."),  # not the `name` of the scene
        ({"wire": {"friction": 0.2}}, "scene: wire.friction: ... contact.friction"),
        ({"wire": {"frictoin": 0.2}}, "scene: wire.frictoin: ... wire."),
        ({"diameter": "15 um"}, "scene: diameter: ... wire.diameter"),
        ({"load": 3}, "scene: load: 3"),
        ({1: {"diameter": "17 um"}}, "scene: the key 1 "),
        ({"wire": {1: "17 um"}}, "scene: wire: the key 1"),
        ({"knit": {"bars": [{"chain": "1-0/1-2"}, {1: 2}]}}, "scene: knit.bars[1]: the key 1"),
        ({"wire": {...: 1}}, "scene: wire: the key Ellipsis"),
        ("[load]\nstrain_warp = ", "scene: "),
        ("none.toml", "none.toml: "),
        (3, "scene: 3 "),
    ],
)
def test_a_wrong_source_is_refused_in_one_line(source: object, line: str) -> None:
    with pytest.raises(SceneError) as error:
        load_scene(source)
    begin, _, end = line.partition("...")
    assert str(error.value).startswith(begin)
    assert end in str(error.value).removeprefix(begin) and "\n" not in str(error.value)


def test_a_path_with_an_equals_sign_is_a_path(tmp_path: Path) -> None:
    path = tmp_path / "strain=0.1.toml"
    path.write_text(TEXT)
    assert load_scene(str(path)).wire == load_scene(TEXT).wire
    assert load_scene("load.strain_warp = 0.1").stages[0].strain_warp == 0.1


def test_changed_is_what_overrides_give_and_defaults_follow() -> None:
    """A preset chooses nodes, a tension takes the place of a strain, and the scene itself stays."""
    scene = load_scene(CELL)
    kept = scene.hash
    overrides = {"load.tension_warp": "1 mN/m", "wire.diameter": "17 um"}
    changed = scene.changed(overrides, preset="draft")
    assert changed == load_scene(CELL, overrides, "draft") == load_scene(scene, overrides, "draft")
    assert changed.model.nodes_per_loop < scene.model.nodes_per_loop and changed.stages[0].strain_warp is None
    assert changed.changed({"wire.diameter": "20 um"}).stages[0].tension_warp == 1e-3
    assert scene.hash == kept
    assert scene.changed("load.shear=0.1") == scene.changed([("load.shear", 0.1)])
    with pytest.raises(SceneError, match=r"atlas_cell.toml: wire.diameter: '-1 um' "):
        scene.changed({"wire.diameter": "-1 um"})


def test_an_entry_of_a_list_that_the_scene_leaves_out_is_that_of_the_default() -> None:
    scene = load_scene({})
    first, second = scene.changed(["knit.bars[1].shift=2"]).knit.bars
    assert (first, second.chain, second.shift) == (scene.knit.bars[0], scene.knit.bars[1].chain, 2)
    assert scene.changed({"knit.bars[2].chain": "1-0/1-2"}).knit.bars[:2] == scene.knit.bars
    both = scene.changed(["knit.bars[2].shift=1", "knit.bars[2].chain=1-0/1-2"])  # a new one, in any order
    assert (both.knit.bars[2].shift, both.knit.bars[2].chain) == (1, "1-0/1-2")
    assert scene.changed({"knit.repeats[1]": 3}).knit.repeats == (1, 3)
    with pytest.raises(SceneError, match=r"knit\.bars\[3\]: .* 2 entries"):
        scene.changed({"knit.bars[3].shift": 1})


@pytest.mark.parametrize("given", [{1: 2}, {"": 1}, {None: 1}, [3], [("a",)], 3])
def test_an_override_that_is_none_is_refused_in_one_line(given: object) -> None:
    with pytest.raises(SceneError, match="^scene: override: .*; "):
        load_scene({}).changed(given)


def test_a_scene_survives_another_process() -> None:
    scene = load_scene(CELL)
    there = pickle.loads(pickle.dumps(scene))
    assert there == scene and there.changed({"load.shear": 0.1}) == scene.changed({"load.shear": 0.1})


def test_a_scene_put_together_from_parts_keeps_its_values() -> None:
    """Its values are taken as they stand; `changed` does not bring back those that were replaced."""
    scene = replace(load_scene(CELL), name="mine")
    with pytest.raises(SceneError, match="load_scene"):
        scene.changed({"load.shear": 0.1})
    again = load_scene(scene, {"load.shear": 0.1})
    assert again.name == "mine" and again.stages[0].shear == 0.1
    assert load_scene(scene) is scene


def test_a_scene_is_one_line(tmp_path: Path) -> None:
    assert repr(load_scene(CELL)) == "<Scene 'atlas_cell': tungsten 15 um, 1 x 1 repeats, planar, periodic, 1 stage>"
    hook = load_scene(CELL.parent / "hook_spatial.toml")
    assert "spatial" in repr(hook)
    (tmp_path / "again.toml").write_text(resolved_toml(hook))
    assert load_scene(tmp_path / "again.toml") == hook


@pytest.mark.parametrize(
    ("table", "line"),
    [
        ("wire", "diameter [m], default 15 um: Diameter of one wire, without plating."),
        ("wire", "youngs_modulus [Pa], default the material's: Young's modulus."),
        ("wire", 'material, default "tungsten": Default of Young\'s modulus,'),
        ("wire", "plastic, default false: The wire yields in bending"),
        ("knit", "repeats, default [1, 1]: Pattern repeats along weft and warp."),
        ("contact", "threshold [N], default 0: A pair is active"),
        ("solver", "loading_time [s], default "),
    ],
)
def test_help_of_a_table_has_its_keys_with_unit_and_default(table: str, line: str) -> None:
    assert f"    {line}" in (getattr(load_scene(CELL), table).__doc__ or "")
