"""Scenes of two hooked wires: what is read, what is refused, and what a run leaves."""

from __future__ import annotations

import csv
import json
import math
import sys
from pathlib import Path

import pytest

from warpknit.commands.plan import overview_of
from warpknit.runner.run import run_scene
from warpknit.scene import SceneError, load_scene, make_scene, resolved_toml

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SCENES = Path(__file__).parents[1] / "scenes"
HOOKS = sorted(path.name for path in SCENES.glob("hook_*.toml"))
QUICK = ["model.nodes_per_loop=16", "solver.residual_tolerance=1e-2", "output.frames=4"]


@pytest.mark.parametrize("name", HOOKS)
def test_hook_scenes_are_written_back_as_they_are(name: str) -> None:
    scene = load_scene(SCENES / name)
    assert make_scene(tomllib.loads(resolved_toml(scene)), path=scene.path) == scene
    assert scene.stages[0].shear * scene.hook.height == pytest.approx(scene.stages[0].displacement, rel=1e-14)


def test_defaults_of_a_hook() -> None:
    """A third of a circle, reaching through each other by a fifth of the radius; double precision."""
    scene = make_scene({"hook": {"radius": "2 mm"}})
    assert scene.hook.length == pytest.approx(2e-3 * 2 * math.pi / 3)
    assert scene.hook.overlap == pytest.approx(0.4e-3)
    assert scene.hook.height == pytest.approx(2 * 2e-3 * math.sin(math.pi / 3))
    assert scene.solver.precision == "double"
    assert scene.contact.treatment == "free-body"
    assert scene.contact.spring_stiffness is None
    assert make_scene({"hook": {}, "contact": {"treatment": "ring"}}).contact.spring_stiffness == 1e-3


@pytest.mark.parametrize(
    ("table", "key", "said"),
    [
        ({"hook": {}, "knit": {}}, "hook", "knit"),
        ({"hook": {"wales": 1}}, "hook.wales", "knit.wales"),
        ({"hook": {"overlap": "2 mm"}}, "hook.overlap", "'2 mm'"),
        ({"hook": {"length": "7 mm"}}, "hook.length", "'7 mm'"),
        ({"hook": {"radius": "20 um"}}, "hook.radius", "at least 60 um"),
        ({"hook": {}, "load": {"strain_weft": 0.1}}, "load.strain_weft", "displacement and temperature"),
        ({"hook": {}, "path": [{"shear": 0.1}]}, "path[0].shear", "displacement and temperature"),
        ({"hook": {}, "load": {"displacement": "3 mm"}}, "load.displacement", "'3 mm'"),
        ({"hook": {}, "model": {"boundary": "periodic"}}, "model.boundary", "'gripped'"),
        ({"hook": {}, "solver": {"precision": "single"}}, "solver.precision", "'double'"),
        ({"hook": {}, "sweep": {"strain_weft": [0], "strain_warp": [0]}}, "sweep", "leave it out"),
        ({"contact": {"treatment": "ring"}}, "contact.treatment", "'free-body'"),
        ({"hook": {}, "contact": {"treatment": "rang"}}, "contact.treatment", "'spring-cylinder'"),
        ({"hook": {}, "contact": {"plane_load": 1}}, "contact.plane_load", "contact.treatment = 'friction-plane'"),
        ({"hook": {}, "contact": {"treatment": "ring", "ring_radius": "5 um"}}, "contact.ring_radius", "at least 7.5 um"),
        ({"hook": {}, "contact": {"treatment": "ring", "friction": 0.1}}, "contact.friction", "'free-body'"),
        ({"hook": {}, "contact": {"body_mass": 0.1}}, "contact.body_mass", "leave it out"),
    ],
)
def test_what_a_hook_cannot_be_is_refused(table: dict, key: str, said: str) -> None:
    with pytest.raises(SceneError) as caught:
        make_scene(table)
    line = str(caught.value)
    assert line.startswith(f"scene.toml: {key}:")
    assert said in line and "\n" not in line


def test_a_run_of_a_hook_leaves_what_was_asked_for(tmp_path: Path) -> None:
    """Displacement, forces, places and ways of the contact, in history.csv and summary.json, and the figure."""
    run = run_scene(load_scene(SCENES / "hook_spring_cylinder.toml", QUICK), out=tmp_path / "r", device="cpu")
    assert run.exit_code == 0
    assert (tmp_path / "r" / "figures" / "hook.png").exists()
    with open(tmp_path / "r" / "history.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["displacement_m"]) for row in rows] == pytest.approx([0.0, 2e-4, 4e-4, 6e-4, 8e-4])
    last, before = rows[-1], rows[-2]
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())["hook"]
    assert summary == {key: pytest.approx(float(last[key])) for key in summary}
    assert float(last["force_left_N"]) == pytest.approx(2.7e-3, rel=0.05)
    slid = abs(float(last["arc_right_m"]) - float(before["arc_right_m"]))
    assert float(last["slide_right_m"]) - float(before["slide_right_m"]) == pytest.approx(slid)
    assert 0.0 < float(last["ground_force_N"]) < 1e-6
    # what is there for a mesh is read by the same programs
    from warpknit.export import export_run

    assert [path.name for path in export_run(tmp_path / "r", "png")] == ["hook.png"]
    assert len(export_run(tmp_path / "r", "csv")) == 2 * len(rows)


def test_the_plan_of_a_hook() -> None:
    plan = overview_of(load_scene(SCENES / "hook_ring.toml"), "cpu")
    assert (plan.wires, plan.bodies, plan.nodes) == (2, 1, 2 * 51)
    assert any("'ring'" in sentence for sentence in plan.physics)
    assert plan.mesh[0][0] == "hook"


def test_a_spring_stiffer_than_the_contact_is_refused() -> None:
    from warpknit.base.errors import ModelError
    from warpknit.planar.model import build_model

    table = {"hook": {}, "contact": {"treatment": "ring", "spring_stiffness": 1e4}}
    with pytest.raises(ModelError, match=r"contact\.spring_stiffness: 10 kN/m .* 99\.\d+ N/m"):
        build_model(make_scene(table))
