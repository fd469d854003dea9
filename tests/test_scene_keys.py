"""A key of a scene is declared once: everything else that knows it follows, the documents too."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import get_args

from scene_reference import with_key_tables

from warpknit.scene import make_scene
from warpknit.scene.keys import keys_below
from warpknit.scene.messages import known_keys
from warpknit.scene.scene import SceneFile

ROOT = Path(__file__).parent.parent

DECLARED = '    probe_spacing: values.Length = key("Distance of the probes.", 2e-3)\n'
FOLLOWS = """
import sys
tomllib = __import__("tomllib" if sys.version_info >= (3, 11) else "tomli")
from pathlib import Path
import warpknit
from warpknit.scene import SceneError, make_scene, resolved_toml
from scene_reference import with_key_tables

assert Path(warpknit.__file__).is_relative_to(sys.argv[1])
scene = make_scene({})
assert scene.output.probe_spacing == 2e-3
given = make_scene({"output": {"probe_spacing": "5 um"}})
assert given.output.probe_spacing == 5e-6 and given.hash != scene.hash
written = tomllib.loads(resolved_toml(given))
assert written["output"]["probe_spacing"] == "5e-06 m" and make_scene(written) == given
for table, said in (
    ({"output": {"probe_spacin": 1}}, "output.probe_spacin: unknown key; the nearest is output.probe_spacing"),
    ({"output": {"probe_spacing": "5 kg"}}, "output.probe_spacing: '5 kg'"),
):
    try:
        make_scene(table)
    except SceneError as error:
        assert said in str(error), error
    else:
        raise AssertionError(table)
text = with_key_tables(Path(sys.argv[2]).read_text())
assert "| `output.probe_spacing` | 2 mm | a length above 0 m, such as `15 um` | Distance of the probes. |" in text
"""


def test_a_key_is_one_line(tmp_path):
    """A copy of the program with one more line in [output] reads, checks, writes back, suggests and documents the key."""
    shutil.copytree(ROOT / "warpknit", tmp_path / "warpknit", ignore=shutil.ignore_patterns("__pycache__"))
    path = tmp_path / "warpknit" / "scene" / "options.py"
    text = path.read_text(encoding="utf-8")
    place = "    vtk: values.Flag = key("
    assert text.count(place) == 1
    path.write_text(text.replace(place, DECLARED + place), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", FOLLOWS, str(tmp_path), str(ROOT / "docs" / "scenes.md")],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT / "docs")])},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_the_tables_of_keys_are_those_of_the_code():
    text = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
    assert text == with_key_tables(text), "python docs/scene_reference.py"


def test_every_key_says_what_it_means_in_one_line():
    keys = dict(keys_below(SceneFile))
    assert list(keys) == known_keys()
    for name, entry in keys.items():
        assert entry.about.endswith(".") and "\n" not in entry.about, name
        assert entry.table is not None or entry.allowed, name


def test_a_scene_of_defaults_has_a_value_wherever_one_is_needed():
    """What the tables of a file may leave out is filled in: None is left only where the annotation allows it."""
    scene = make_scene({"panel": {"grip_pitch": 0.01, "cord": {"tension": 1.0, "stiffness": 100.0}}})
    tables = [scene.wire, scene.knit, scene.knit.loop, scene.model, scene.panel, scene.contact, scene.solver, scene.output]
    for table in [*tables, *scene.stages, *scene.knit.bars, scene.panel.cord]:
        for name, entry in keys_below(type(table)):
            if "." not in name and type(None) not in get_args(entry.annotation):
                assert getattr(table, name) is not None, name
