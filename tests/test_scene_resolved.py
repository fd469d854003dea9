"""The resolved scene and its hash."""

import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from warpknit.scene import load_scene, make_scene, resolved_toml
from warpknit.scene.messages import known_keys
from warpknit.scene.presets import PRESETS

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SCENES = Path(__file__).parent.parent / "scenes"


VARIED = [
    {},
    {"load": {"displacement": "1.2 mm"}, "knit": {"repeats": [7, 6], "wales": "5.9 /cm"}, "name": "the patch"},
    {
        "wire": {"plating": {"thickness": "0.2 um"}, "ends": 3},
        "path": [{"temperature": "-190 degC"}, {"tension_warp": 1}],
    },
    {"solver": {"drive": "ramp", "mass_scaling": 1e4, "loading_time": "10 ms", "damping": "100 /s", "max_steps": 10}},
    {
        "sweep": {"strain_weft": [0, 0.02], "strain_warp": [0.0]},
        "knit": {"scatter": 0.1},
        "contact": {"stiffness": "10 N/m", "threshold": "1 uN"},
    },
]


@pytest.mark.parametrize("table", VARIED)
@pytest.mark.parametrize("preset", PRESETS)
def test_the_resolved_file_loads_to_an_equal_scene(tmp_path, table, preset):
    scene = make_scene(table, preset=preset)
    path = tmp_path / "resolved.toml"
    path.write_text(resolved_toml(scene))
    again = load_scene(path)
    assert again == scene
    assert again.hash == scene.hash


@given(st.floats(1e-6, 1e-4), st.floats(0.1, 5.0), st.floats(-0.4, 1.0))
def test_the_resolved_file_keeps_every_bit(diameter, courses, strain):
    scene = make_scene(
        {
            "wire": {"diameter": f"{diameter * 1e6!r} um"},
            "knit": {"wales": f"{courses!r} /mm", "course_spacing": "1 mm"},
            "load": {"strain_weft": strain},
            "model": {"kind": "planar"},  # nothing is laid out
        }
    )
    assert make_scene(tomllib.loads(resolved_toml(scene))) == scene


def test_the_resolved_file_writes_every_key_or_names_it_as_left_out():
    panel = {"grip_pitch": 0.01, "cord": {"tension": 1.0, "stiffness": 100.0}}
    pull = [{"at": [1.7e-3, 0.0], "by": [0.0, 0.0]}]
    table = {"path": [{}], "wire": {"plating": {"thickness": 1e-7}}, "panel": panel, "load": {"pull": pull}}
    text = resolved_toml(make_scene(table))
    written = tomllib.loads(text)
    comment = text.splitlines()[0]
    other_ways = {"wales", "courses", "displacement", "tension_weft", "tension_warp", "file", "width"}
    for key in known_keys():
        if key.split(".")[-1] in other_ways or key.startswith(("sweep", "reflection", "hook", "wires")):
            continue
        place = written
        for part in key.replace("[0]", ".0").split("."):
            place = place[int(part)] if isinstance(place, list) and part.isdecimal() else place.get(part)
            if place is None:
                assert key in comment
                break


def test_the_hash_does_not_depend_on_how_the_file_is_written(tmp_path):
    one, other = tmp_path / "one.toml", tmp_path / "other.toml"
    one.write_text('[wire]\ndiameter = "15 um"\n[load]\nstrain_weft = 0.1\ntemperature = "20 degC"\n')
    other.write_text('# a comment\nload = {temperature = 293.15, strain_weft = "10 %"}\nwire.diameter = "0.015 mm"\n')
    assert load_scene(one).hash == load_scene(other).hash
    assert load_scene(one).hash == make_scene({"load": {"strain_weft": 0.1, "strain_warp": 0}}).hash


@pytest.mark.parametrize(
    "override",
    ["wire.diameter=15.001 um", "knit.repeats=[1, 2]", "knit.bars[0].shift=1", "load.shear=0.01", "path[0].shear=0"]
    + ["contact.threshold=1e-9", "solver.precision=double", "output.frames=21", "knit.loop.tilt=0.11"],
)
def test_the_hash_depends_on_every_value(override):
    path = SCENES / "atlas_cell.toml"
    assert load_scene(path, [override]).hash != load_scene(path).hash
