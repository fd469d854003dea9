"""Scenes with [wires]: their keys, the scene written back, what `plan` says of them, and that nothing else runs them."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import wire_samples as samples
from click.testing import CliRunner

from reference.in_words import quantities
from warpknit.base.errors import SceneError
from warpknit.commands.cli import main
from warpknit.commands.plan import make_plan
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene
from warpknit.scene.scene import resolved_toml
from warpknit.scene.scene_loader import make_scene
from warpknit.solve.model import build_model
from warpknit.wires.read import rest_wires

SCENES = Path(__file__).parents[2] / "scenes" / "wires"
PATCH, CELL = SCENES / "plain_knit_patch.toml", SCENES / "plain_knit_cell.toml"


def refused(table, folder=SCENES) -> str:
    with pytest.raises(SceneError) as caught:
        make_scene(table, path=folder / "knit.toml")
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ({"file": "none.bcc"}, "wires.file: 'none.bcc'"),
        ({"file": "plain_knit_cell.toml"}, " .toml"),
        ({}, "wires.file: missing"),
        ({"file": "plain_knit.bcc"}, "wires.unit: missing"),
        ({"file": "plain_knit.bcc", "unit": "kg"}, "wires.unit: 'kg'"),
        ({"file": "plain_knit.usda", "unit": "mm"}, "wires.unit: 'mm'"),
        ({"file": "plain_knit.pyp", "closed": True}, "wires.closed: true"),
        ({"file": "plain_knit.pyp", "period": ["1 mm", "1 mm"]}, "['1 mm', '1 mm']"),
        ({"file": "plain_knit.csv", "period": ["1 mm", "0 mm"]}, "wires.period: ['1 mm', '0 mm']"),
        ({"file": "plain_knit.csv", "repeats": [2, 1]}, "wires.repeats: [2, 1]"),
        ({"file": "plain_knit.csv", "time": 3}, "wires.time: 3"),
        ({"file": "plain_knit.csv", "interpolation": "cubic"}, "wires.interpolation: 'cubic'"),
        ({"file": "plain_knit.csv", "node_spacing": 0}, "wires.node_spacing: 0"),
    ],
)
def test_keys(keys, line):
    assert line in refused({"wires": keys})


@pytest.mark.parametrize(
    ("other", "line"),
    [
        ({"knit": {}}, "wires: the table cannot be combined with [knit]"),
        ({"hook": {}}, "cannot be combined with [hook]; leave out one of knit, hook, wires"),
        ({"panel": {"outline": "disc", "size": "10 mm"}}, "panel: cannot be combined"),
        ({"sweep": {"strain_weft": [0.0], "strain_warp": [0.0]}}, "sweep: cannot be combined"),
        ({"solver": {"drive": "ramp"}}, "solver.drive: 'ramp'"),
        ({"load": {"displacement": "1 mm"}}, "load.displacement: '1 mm'"),
        ({"path": [{"temperature_gradient": [1.0, 0.0]}]}, "path[0].temperature_gradient: [1.0, 0.0]"),
    ],
)
def test_what_does_not_go_with_wires(other, line):
    assert line in refused({"wires": {"file": "plain_knit.csv"}} | other)


def test_a_scene_written_back_is_the_same_from_anywhere(tmp_path):
    scene = load_scene(PATCH, ["load.strain_weft=0.1", 'wires.period=["4.712388980 mm", "1 mm"]'])
    (tmp_path / "scene.toml").write_text(resolved_toml(scene), encoding="utf-8")
    again = load_scene(tmp_path / "scene.toml")
    assert again == scene and again.hash == scene.hash
    assert scene.wires is not None and scene.wires.unit == 1e-3 and scene.stages[0].strain_weft == 0.1


def test_a_scene_is_another_with_other_wires_in_its_file(tmp_path):
    for name in ("plain_knit.bcc", PATCH.name):
        shutil.copy(SCENES / name, tmp_path / name)
    before = load_scene(tmp_path / PATCH.name)
    assert before.hash == load_scene(PATCH).hash and before == load_scene(PATCH)
    samples.write_bcc(tmp_path / "plain_knit.bcc", samples.patch()[:1])
    after = load_scene(tmp_path / PATCH.name)
    assert after.hash != before.hash and after != before


def test_nodes_are_a_diameter_apart_unless_said():
    wires = rest_wires(make_scene({"wires": {"file": "plain_knit.csv"}, "wire": {"diameter": "0.1 mm"}}, path=PATCH))
    assert wires.lengths / wires.segment_counts == pytest.approx(1e-4, rel=0.01)
    wires = rest_wires(load_scene(PATCH))
    assert wires.lengths / wires.segment_counts == pytest.approx(50e-6, rel=0.01)


def test_what_a_file_says_wrong_is_said_with_the_scene(tmp_path):
    shutil.copy(PATCH, tmp_path / "knit.toml")
    data = (SCENES / "plain_knit.bcc").read_bytes()
    (tmp_path / "plain_knit.bcc").write_bytes(data[:-7])
    with pytest.raises(SceneError) as caught:
        rest_wires(load_scene(tmp_path / "knit.toml"))
    assert str(caught.value).startswith(f"{tmp_path / 'knit.toml'}: wires.file: 'plain_knit.bcc' ")
    assert f"({len(data) - 7:,} bytes" in str(caught.value)


@pytest.mark.parametrize(
    ("scene", "boundary", "line"),
    [(CELL, "gripped", "'periodic'"), (PATCH, "periodic", "'gripped'")],
)
def test_the_boundary_is_that_of_the_wires(scene, boundary, line):
    with pytest.raises(SceneError, match=f"model.boundary: '{boundary}' .*{line}"):
        rest_wires(load_scene(scene, [f"model.boundary={boundary}"]))


def test_the_samples_are_what_the_tool_writes(tmp_path):
    """The same numbers, whatever wrote the archive."""
    samples.main(tmp_path)
    for path in sorted(tmp_path.iterdir()):
        kept = SCENES / path.name
        if path.suffix == ".npz":
            with np.load(path) as one, np.load(kept) as other:
                assert all(np.array_equal(one[name], other[name]) for name in one.files)
        else:
            assert path.read_bytes() == kept.read_bytes(), path.name
        assert kept.stat().st_size < 10_000


# --- the command line


def call(*arguments):
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def test_plan_says_what_a_file_holds():
    result = call("plan", CELL, "--json")
    assert result.exit_code == 0
    found = json.loads(result.output)
    assert (found["wires"], found["open"], found["closed"], found["periodic"]) == (1, 0, 0, 1)
    assert found["nodes"] == 123 and found["overlaps"] == 0
    assert found["repeat_m"] == pytest.approx([1e-3 * samples.WALE, 1e-3 * samples.COURSE])
    thick = ("wire.diameter=0.5 mm", "wires.node_spacing=0.25 mm", "wires.repeats=[3, 3]")
    text = call("plan", CELL, "--verbose", *(part for each in thick for part in ("--set", each))).output
    assert {"3", "55.17 mm"} <= set(quantities(text))
    assert "36 overlaps; closest centre lines 0.7" in text
    assert {"0.1 mm", "0.5 mm"} <= set(quantities(text))


def test_wires_from_a_file_are_in_space():
    assert load_scene(CELL).model.kind == "spatial"


@pytest.mark.parametrize("command", ["run", "report", "plan"])
def test_only_the_spatial_model_takes_wires(command, tmp_path):
    where = () if command == "plan" else ("--out", tmp_path / "out", "--quiet")
    result = call(command, CELL, "--set", "model.kind=planar", "--device", "cpu", *where)
    assert result.exit_code == 2
    assert "model.kind: 'planar'" in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["map", "trade", "report"])
def test_wires_from_a_file_are_planned_and_run_only(command, tmp_path):
    result = call(command, CELL, "--device", "cpu", "--out", tmp_path / "out", "--quiet")
    assert result.exit_code == 2
    assert f"{CELL}: wires: cannot be combined" in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_weave_that_overlaps_is_told_when_planned_and_run(tmp_path):
    """A wire over another, 0.7 diameters apart: no hook, an overlap of 30 %, and tension at zero load."""
    along = np.linspace(-0.5, 0.5, 21)
    lines = [f"0,{x:.3f},0,{0.021 * np.exp(-((x / 0.2) ** 2)):.6f}" for x in along] + [f"1,0,{y:.3f},0" for y in along]
    (tmp_path / "weave.csv").write_text("\n".join(["wire,x [mm],y [mm],z [mm]", *lines, ""]))
    table = {
        "wires": {"file": "weave.csv", "node_spacing": "25 um"}, "wire": {"material": "molybdenum", "diameter": "30 um"},
        "load": {"strain_weft": 0.005}, "output": {"frames": 1, "figures": False, "usd": False}, "solver": {"preset": "draft"},
    }  # fmt: skip
    scene = make_scene(table, path=tmp_path / "weave.toml")
    planned = make_plan(scene)
    assert any(one.code == "W13" and "30 %" in quantities(one.text) for one in planned.warnings)
    assert any("no wires hook each other" in line.text for line in planned.table().lines())
    said = run_scene(scene, out=tmp_path / "run").summary.json()["warnings"]
    assert any(line.startswith("W13") for line in said), said


def test_round_off_without_load_is_no_prestress(tmp_path):
    """Open wires that do not touch, without a load: tensions of 1e-14 N/m are zero, not a compression or a prestress."""
    scene = load_scene("plain_knit_patch", {"output.usd": False, "output.figures": False}, preset="draft")
    codes = {line[:3] for line in run_scene(scene, out=tmp_path / "run").summary.json()["warnings"]}
    assert not codes & {"W07", "W13"}, codes


def crossing(folder, gap, spacing):
    """A straight wire of 30 um over another, `gap` diameters apart."""
    lines = ["0,-2,0,0", "0,2,0,0", f"1,0,-2,{0.03 * gap}", f"1,0,2,{0.03 * gap}"]
    (folder / "cross.csv").write_text("\n".join(["wire,x [mm],y [mm],z [mm]", *lines, ""]))
    wires = {"file": "cross.csv", "node_spacing": spacing, "interpolation": "linear"}
    table = {"wires": wires, "wire": {"diameter": "30 um"}, "load": {"strain_weft": 0.005}}
    return make_scene(table, path=folder / "cross.toml")


@pytest.mark.parametrize(("gap", "said"), [(0.997, "0.3 %"), (0.9995, ""), (1.0, "")])
def test_wires_that_only_touch_do_not_overlap(gap, said, tmp_path):
    warnings = [one.text for one in make_plan(crossing(tmp_path, gap, "0.1 mm")).warnings if one.code == "W13"]
    assert len(warnings) == bool(said) and all(said in line for line in warnings)


@pytest.mark.parametrize(("spacing", "few"), [("0.6 mm", "11"), ("0.5 mm", "")])
def test_nodes_are_few_where_wires_hook(spacing, few, tmp_path):
    """Loops of 3.3 x 2 mm of wire; straight wires have none, however far their nodes are apart."""
    hooked = load_scene(PATCH, [f"wires.node_spacing={spacing}"])
    for scene, expected in ((hooked, few), (crossing(tmp_path, 1.5, "0.3 mm"), "")):
        planned = [one for one in make_plan(scene).warnings if one.code == "W25"]
        built = [one for one in build_model(scene).panel.warnings if one.code == "W25"]
        assert planned == built and len(planned) == bool(expected) and all(expected in one.text for one in planned)
