"""The scene: units, defaults, what is refused and how, the resolved file and the hash."""

import math
import sys
from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic_core import PydanticCustomError

from warpknit.scene import SceneError, load_scene, make_scene, resolved_toml
from warpknit.scene.file import LoopTable
from warpknit.scene.materials import MATERIALS
from warpknit.scene.messages import known_keys
from warpknit.scene.presets import PRESETS
from warpknit.scene.units import QuantityError, si

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SCENES = Path(__file__).parent.parent / "scenes"


# --- units


@pytest.mark.parametrize(
    ("text", "dimension", "expected"),
    [
        ("15 um", "length", 15e-6),
        ("15um", "length", 15e-6),
        ("17 µm", "length", 17e-6),
        ("0.015 mm", "length", 15e-6),
        (1.5e-5, "length", 15e-6),
        ("1.5e-5", "length", 15e-6),
        ("400 GPa", "stress", 400e9),
        ("-190 degC", "temperature", 83.15),
        ("20 °C", "temperature", 293.15),
        ("293.15 K", "temperature", 293.15),
        ("68 degF", "temperature", 293.15),
        ("2 N/m", "tension", 2.0),
        ("12 /cm", "per_length", 1200.0),
        ("12 1/cm", "per_length", 1200.0),
        ("19.25 g/cm3", "density", 19250.0),
        ("19250 kg/m^3", "density", 19250.0),
        ("4.5e-6 /K", "expansion", 4.5e-6),
        ("4.5e-6 /degC", "expansion", 4.5e-6),
        ("10 %", "number", 0.1),
        ("1 min", "time", 60.0),
        (0, "force", 0.0),
    ],
)
def test_quantity_is_read_in_si(text, dimension, expected):
    assert si(text, dimension) == expected


@pytest.mark.parametrize(
    "value",
    ["15 kg", "15 bananas", "nan um", "inf m", "1e999 m", "um", "", "15 um um", "15 2 um", "5 m**(2", "15 um\nx = 1"]
    + [math.nan, math.inf, -math.inf, True, None, [1], {}, 10**400],
)
def test_what_is_no_length_is_refused_with_an_example(value):
    with pytest.raises(QuantityError, match=r"^given .*, expected a length such as '15 um'$"):
        si(value, "length")


@given(st.floats(min_value=1e-9, max_value=1e9))
def test_a_quantity_written_in_si_comes_back_to_the_same_bits(value):
    assert si(f"{value!r} m", "length") == value


# --- what is refused: override, key in the message, what was given, what is allowed

LENGTH = "a length above 0 m, such as '15 um'"
REFUSED = [
    # wrong unit, type or value
    ('wire.diameter="15 kg"', "wire.diameter", "'15 kg'", LENGTH),
    ("wire.diameter=-1.5e-5", "wire.diameter", "-1.5e-05", LENGTH),
    ("wire.diameter=0", "wire.diameter", "0", LENGTH),
    ("wire.diameter=nan", "wire.diameter", "nan", LENGTH),
    ("wire.diameter=inf", "wire.diameter", "inf", LENGTH),
    ("wire.diameter=true", "wire.diameter", "true", LENGTH),
    ("wire.diameter=[1]", "wire.diameter", "[1]", LENGTH),
    ("wire.diameter=2020-01-01", "wire.diameter", "datetime", LENGTH),
    ("wire.youngs_modulus=400 um", "wire.youngs_modulus", "'400 um'", "a stress above 0 Pa, such as '400 GPa'"),
    ("wire.material=unobtainium", "wire.material", "'unobtainium'", "'tungsten', 'molybdenum'"),
    ("wire.material=3", "wire.material", "3", "'tungsten'"),
    ("wire.poissons_ratio=0.6", "wire.poissons_ratio", "0.6", "a number above -1 and at most 0.5"),
    ("wire.ends=2.0", "wire.ends", "2.0", "a whole number from 1"),
    ("wire.ends=true", "wire.ends", "true", "a whole number from 1"),
    ("wire.ends=0", "wire.ends", "0", "a whole number from 1"),
    ("wire.set_fraction=1.5", "wire.set_fraction", "1.5", "a number from 0 to 1"),
    ("wire.plating.material=gold", "wire.plating.thickness", "nothing", LENGTH),
    ("wire.plating.thickness=1 mm", "wire.plating.thickness", "'1 mm'", "at most the radius of the wire, 7.5e-06 m"),
    ("wire.yield_stress=5 GPa", "wire.yield_stress", "'5 GPa'", "at most the tensile strength, 4.5e+09 Pa"),
    ("wire.reference_temperature=-1", "wire.reference_temperature", "-1", "a temperature above 0 K"),
    ("wire=5", "wire", "5", "a table"),
    ("knit.bars=[]", "knit.bars", "[]", "a list with at least one entry"),
    ("knit.bars=1-0/1-2", "knit.bars", "'1-0/1-2'", "a list"),
    ("knit.bars=[1]", "knit.bars[0]", "1", "a table"),
    ("knit.bars=[{}]", "knit.bars[0].chain", "nothing", "links a-b"),
    ("knit.bars[1].chain=1-0//2-3", "knit.bars[1].chain", "'1-0//2-3'", "links a-b"),
    ("knit.bars[1].chain=1-0/1-", "knit.bars[1].chain", "'1-0/1-'", "links a-b"),
    ("knit.bars.1.chain=''", "knit.bars[1].chain", "''", "links a-b"),
    ("knit.bars[0].chain=10", "knit.bars[0].chain", "10", "links a-b"),
    ("knit.bars[0].threading=...", "knit.bars[0].threading", "'...'", "at least one '|'"),
    ("knit.bars[0].threading=|x", "knit.bars[0].threading", "'|x'", "'|' for a threaded"),
    ("knit.bars[0].shift=0.5", "knit.bars[0].shift", "0.5", "a whole number"),
    (
        "knit.wale_spacing=20 um",
        "knit.wale_spacing",
        "'20 um'",
        "two diameters of the wire or more between loops, 3e-05 m",
    ),
    ("knit.course_spacing=29 um", "knit.course_spacing", "'29 um'", "two diameters of the wire or more"),
    ("knit.wales=500 /cm", "knit.wales", "'500 /cm'", "two diameters of the wire or more"),
    ("knit.wales=5.9 cm", "knit.wales", "'5.9 cm'", "a count per length above 0 1/m, such as '12 /cm'"),
    ("knit.repeats=7", "knit.repeats", "7", "two whole numbers from 1 to 1000000000, such as [7, 6]"),
    ("knit.repeats=[7]", "knit.repeats", "[7]", "two whole numbers"),
    ("knit.repeats=[0, 1]", "knit.repeats", "[0, 1]", "two whole numbers"),
    ("knit.repeats=[1.0, 1]", "knit.repeats", "[1.0, 1]", "two whole numbers"),
    (f"knit.repeats=[{10**40}, 1]", "knit.repeats", "[1000", "two whole numbers"),
    ("knit.scatter=0.3", "knit.scatter", "0.3", "a number from 0 to 0.2"),
    ("sweep={strain_weft=[0], strain_warp=[0], seeds=2}", "sweep.seeds", "2", "1, as without knit.scatter all seeds"),
    ("knit.seed=-1", "knit.seed", "-1", "a whole number from 0"),
    ("knit.loop.closed_radius=3", "knit.loop.closed_radius", "3", "a number from 0.4 to 0.78"),
    ("knit.loop.shape=square", "knit.loop.shape", "'square'", "'auto', 'circular-oval', 'general'"),
    ("model.kind=solid", "model.kind", "'solid'", "'planar', 'spatial'"),
    ("model.boundary=free", "model.boundary", "'free'", "'gripped', 'periodic'"),
    ("model.nodes_per_loop=7", "model.nodes_per_loop", "7", "a whole number from 8"),
    ("model.body_radius=1 mm", "model.body_radius", "'1 mm'", "at most the diameter of the wire, 1.5e-05 m"),
    ("model.merge_lenses=1", "model.merge_lenses", "1", "true, false"),
    ("load.strain_weft=15 kg", "load.strain_weft", "'15 kg'", "a number from -0.5 to 2"),
    ("load.strain_warp=-2", "load.strain_warp", "-2", "a number from -0.5 to 2"),
    ("load.tension_weft=2 N", "load.tension_weft", "'2 N'", "a force per length at least 0 N/m, such as '2 N/m'"),
    ("load.displacement=24 mm", "load.displacement", "'24 mm'", "what makes a strain from -0.5 to 2"),
    ("load.temperature=-300 degC", "load.temperature", "'-300 degC'", "a temperature above 0 K and at most 4000 K"),
    ("path=3", "path", "3", "a list"),
    ("path[0].temperature=2 m", "path[0].temperature", "'2 m'", "such as '-190 degC'"),
    ("path[0].name=load", "path[0].name", "'load'", "a name that no other stage has"),
    ("path[3].temperature=2", "path[3]", "2", "an entry 0 to 0 of a list"),
    ("contact.friction=6", "contact.friction", "6", "a number from 0 to 5"),
    ("contact.threshold=-1", "contact.threshold", "-1", "a force at least 0 N"),
    ("contact.stiffness=0", "contact.stiffness", "0", "a force per length above 0 N/m"),
    ("solver.preset=fast", "solver.preset", "'fast'", "'draft', 'standard', 'reference'"),
    ("solver.drive=push", "solver.drive", "'push'", "'relax', 'ramp'"),
    ("solver.precision=half", "solver.precision", "'half'", "'single', 'double'"),
    ("solver.mass_scaling=4", "solver.mass_scaling", "4", "1 with drive = 'relax'"),
    ("solver.loading_time=1 s", "solver.loading_time", "'1 s'", "only with drive = 'ramp'"),
    ("solver.axial_softening=0.5", "solver.axial_softening", "0.5", "a number from 1"),
    ("solver.residual_tolerance=0", "solver.residual_tolerance", "0", "a number above 0 and at most 0.5"),
    ("solver.max_steps=0", "solver.max_steps", "0", "a whole number from 1"),
    ("solver.multipliers=yes", "solver.multipliers", "'yes'", "true, false"),
    ("output.frames=0", "output.frames", "0", "a whole number from 1"),
    ("output.checkpoint_interval=60 m", "output.checkpoint_interval", "'60 m'", "a time above 0 s, such as '60 s'"),
    ("sweep.strain_weft=[0, 0.1]", "sweep.strain_warp", "nothing", "a list with at least one entry"),
    ("sweep={strain_weft=[], strain_warp=[0]}", "sweep.strain_weft", "[]", "a list with at least one entry"),
    ("sweep={strain_weft=[0, nan], strain_warp=[0]}", "sweep.strain_weft[1]", "nan", "a number from -0.5 to 2"),
    ("name=a/b", "name", "'a/b'", "a name of 1 to 100 characters"),
    # overrides that cannot be set
    ("load.strain_warp", "--set", "'load.strain_warp'", "KEY=VALUE"),
    ("=5", "--set", "'=5'", "KEY=VALUE"),
    ("load..strain_warp=1", "--set", "'load..strain_warp'", "a dotted key"),
    ("wire.diameter.x=1", "wire.diameter.x", "1", "no key below wire.diameter, which is '15 um'"),
    ("knit.bars.chain=1-0", "knit.bars.chain", "'1-0'", "no key below knit.bars"),
]


@pytest.mark.parametrize(("override", "key", "shown", "allowed"), REFUSED, ids=[row[0] for row in REFUSED])
def test_a_bad_value_is_one_line_of_file_key_given_and_allowed(override, key, shown, allowed):
    path = SCENES / "atlas_cell.toml"
    with pytest.raises(SceneError) as caught:
        load_scene(path, [override])
    line = str(caught.value)
    assert line.startswith(f"{path}: {key}: given {shown}")
    assert f", allowed: {allowed}" in line or (", allowed: " in line and allowed in line.split(", allowed: ")[1])
    assert "\n" not in line
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    ("override", "key", "nearest"),
    [
        ("wire.diamter=1", "wire.diamter", "wire.diameter"),
        ("wired.diameter=1", "wired", "wire"),
        ("diameter=1", "diameter", "wire.diameter"),
        ("strain_warp=1", "strain_warp", "load.strain_warp"),
        ("load.strain_wrap=1", "load.strain_wrap", "load.strain_warp"),
        ("knit.bars[1].chian=1-0", "knit.bars[1].chian", "knit.bars[1].chain"),
        ("knit.closed_radius=1", "knit.closed_radius", "knit.loop.closed_radius"),
        ("solver.boundary=periodic", "solver.boundary", "model.boundary"),
        ("path[0].temprature=1", "path[0].temprature", "path[0].temperature"),
    ],
)
def test_an_unknown_key_names_the_nearest_known_one(override, key, nearest):
    with pytest.raises(SceneError) as caught:
        load_scene(SCENES / "atlas_cell.toml", [override])
    assert f"atlas_cell.toml: {key}: unknown key, the nearest is {nearest}: given " in str(caught.value)
    assert ", allowed: " in str(caught.value)


def test_the_first_error_is_told_and_the_others_are_counted():
    with pytest.raises(SceneError, match=r"wire\.diameter: given -1.*\(and 2 more\)$"):
        make_scene({"wire": {"diameter": -1}, "load": {"shear": 7}, "output": {"frames": "x"}})


@pytest.mark.parametrize(
    ("load", "key"),
    [
        ({"strain_weft": 0.1, "tension_weft": "2 N/m"}, "tension_weft"),
        ({"strain_warp": 0.1, "tension_warp": "2 N/m"}, "tension_warp"),
        ({"strain_warp": 0.1, "displacement": "1 mm"}, "displacement"),
        ({"tension_weft": 1, "displacement": "1 mm"}, "displacement"),
    ],
)
@pytest.mark.parametrize("stage", ["load", "path[0]"])
def test_one_direction_is_driven_in_one_way(load, key, stage):
    table = {"load": load} if stage == "load" else {"path": [load]}
    with pytest.raises(SceneError) as caught:
        make_scene(table)
    assert str(caught.value).startswith(f"scene.toml: {stage}.{key}: given ")
    assert " beside " in str(caught.value)
    assert ", allowed: one of strain_w" in str(caught.value)


def test_two_ways_to_give_a_spacing_are_one_too_many():
    with pytest.raises(SceneError, match=r"knit\.wales: given '5 /cm' beside wale_spacing = 0\.001, allowed: one of"):
        make_scene({"knit": {"wale_spacing": 1e-3, "wales": "5 /cm"}})


@pytest.mark.parametrize(
    ("content", "given"),
    [
        (b"[wire", "invalid TOML"),
        (b"\xff\xfe", "invalid TOML"),
        (b"a = 1\na = 2", "invalid TOML"),
        (None, "no such file"),
    ],
)
def test_an_unreadable_file_is_one_line(tmp_path, content, given):
    path = tmp_path / "bad.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert str(caught.value).startswith(f"{path}: the file: given {given}")
    assert str(caught.value).endswith(", allowed: a scene file in TOML")
    assert "\n" not in str(caught.value)


def test_a_directory_is_no_scene(tmp_path):
    with pytest.raises(SceneError, match="is a directory"):
        load_scene(tmp_path)


@given(
    st.sampled_from([key.replace("path[0]", "load") for key in known_keys()]),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
        max_leaves=5,
    ),
)
def test_any_value_of_any_key_is_taken_or_refused_in_one_line(key, value):
    try:
        scene = make_scene({}, [(key, value)])
    except SceneError as error:
        assert ": given " in str(error) and ", allowed: " in str(error)
        assert str(error).isprintable()
    else:
        assert len(scene.hash) == 64


# --- defaults and derived values


def test_the_patch_is_the_papers_mesh():
    scene = load_scene(SCENES / "atlas_patch.toml")
    assert scene.name == "atlas_patch"
    assert scene.wire.diameter == 15e-6
    assert scene.wire.youngs_modulus == 400e9
    assert scene.knit.size == pytest.approx((23.8e-3, 24e-3), rel=1e-12)
    assert scene.model.boundary == "gripped"
    assert scene.model.body_radius == 15e-6 / 8
    assert [(stage.strain_weft, stage.strain_warp, stage.temperature) for stage in scene.stages] == [(0.1, 0.1, 293.15)]


def test_the_cell_is_one_periodic_repeat_of_the_patch():
    cell, patch = load_scene(SCENES / "atlas_cell.toml"), load_scene(SCENES / "atlas_patch.toml")
    assert cell.model.boundary == "periodic"
    assert cell.knit.repeats == (1, 1)
    assert cell.wire == patch.wire
    assert make_scene({}, ["model.boundary=periodic"]).knit == cell.knit


def test_a_million_repeats_are_a_valid_scene():
    """Whether they fit in memory is for the model to say."""
    assert make_scene({}, ["knit.repeats=[1000000000, 1000000000]"]).knit.repeats == (10**9, 10**9)


def test_counts_per_length_stand_for_spacings():
    knit = make_scene({"knit": {"wales": "5 /cm", "courses": "10 /cm"}}).knit
    assert (knit.wale_spacing, knit.course_spacing) == (2e-3, 1e-3)


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_fills_in_what_the_scene_leaves_out(name):
    scene, preset = make_scene({}, preset=name), PRESETS[name]
    assert scene.solver.preset == name
    assert scene.model.nodes_per_loop == preset.nodes_per_loop
    assert scene.solver.axial_softening == preset.axial_softening
    assert scene.solver.precision == preset.precision
    assert scene.solver.residual_tolerance == preset.residual_tolerance


def test_keys_of_the_scene_stand_before_the_preset():
    scene = make_scene({"model": {"nodes_per_loop": 50}, "solver": {"preset": "draft", "precision": "double"}})
    assert scene.model.nodes_per_loop == 50
    assert scene.solver.precision == "double"
    assert scene.solver.axial_softening == PRESETS["draft"].axial_softening


def test_the_preset_of_the_command_line_stands_before_the_files():
    assert make_scene({"solver": {"preset": "draft"}}, preset="reference").solver.preset == "reference"


def test_wire_stiffness_and_mass_of_a_round_section():
    """EA = E pi d^2/4, EI = E pi d^4/64, mass per length = rho pi d^2/4."""
    wire = make_scene({}).wire
    area = math.pi * wire.diameter**2 / 4
    assert wire.axial_stiffness == pytest.approx(400e9 * area, rel=1e-12)
    assert wire.bending_stiffness == pytest.approx(400e9 * math.pi * wire.diameter**4 / 64, rel=1e-12)
    assert wire.linear_density == pytest.approx(19250 * area, rel=1e-12)


@pytest.mark.parametrize(("material", "stiffer", "heavier"), [("tungsten", 0.022, 0.054), ("molybdenum", 0.027, 0.102)])
def test_plating_of_gold_adds_stiffness_and_mass(material, stiffer, heavier):
    """An annulus of thickness t: EI grows by E_Au/E ((1 + 2t/d)^4 - 1), mass by rho_Au/rho ((1 + 2t/d)^2 - 1)."""
    bare = make_scene({"wire": {"material": material}}).wire
    plated = make_scene({"wire": {"material": material, "plating": {"thickness": "0.2 um"}}}).wire
    assert plated.bending_stiffness / bare.bending_stiffness - 1 == pytest.approx(stiffer, abs=5e-4)
    assert plated.linear_density / bare.linear_density - 1 == pytest.approx(heavier, abs=5e-4)


def test_parallel_ends_add_up():
    one, three = make_scene({}).wire, make_scene({}, ["wire.ends=3"]).wire
    assert three.axial_stiffness == 3 * one.axial_stiffness
    assert three.bending_stiffness == 3 * one.bending_stiffness
    assert three.linear_density == 3 * one.linear_density


def test_a_key_of_the_wire_stands_before_its_material():
    wire = make_scene({"wire": {"material": "molybdenum", "expansion": "5.1e-6 /K"}}).wire
    assert wire.expansion == 5.1e-6
    assert wire.density == MATERIALS["molybdenum"].density


def test_displacement_of_every_side_stretches_by_twice_itself():
    stage = load_scene(SCENES / "atlas_patch.toml", ["load.displacement=1.2 mm"]).stages[0]
    assert (stage.strain_weft, stage.strain_warp) == pytest.approx((2.4 / 23.8, 2.4 / 24.0), rel=1e-12)


def test_a_stage_takes_over_what_it_leaves_out():
    stages = make_scene(
        {
            "load": {"strain_weft": 0.1, "tension_warp": "2 N/m"},
            "path": [
                {"name": "cold", "temperature": "-190 degC"},
                {"tension_weft": 1},
                {"strain_warp": 0, "shear": 0.05},
            ],
        }
    ).stages
    told = [
        (s.name, s.strain_weft, s.tension_weft, s.strain_warp, s.tension_warp, s.shear, s.temperature) for s in stages
    ]
    assert told == [
        ("load", 0.1, None, None, 2.0, 0.0, 293.15),
        ("cold", 0.1, None, None, 2.0, 0.0, 83.15),
        ("stage-3", None, 1.0, None, 2.0, 0.0, 83.15),
        ("stage-4", None, 1.0, 0.0, None, 0.05, 83.15),
    ]


def test_without_a_temperature_the_wire_stays_where_it_is_free_of_thermal_strain():
    assert make_scene({"wire": {"reference_temperature": "300 K"}}).stages[0].temperature == 300.0


# --- overrides


@pytest.mark.parametrize("text", ["17 um", '"17 um"', "17e-6", " 17e-6 "])
def test_an_override_is_toml_or_a_plain_string(text):
    assert make_scene({}, [f"wire.diameter={text}"]).wire.diameter == 17e-6


def test_an_override_takes_the_place_of_the_other_way_to_say_it():
    table = {"load": {"strain_weft": 0.1, "strain_warp": 0.1}, "knit": {"wale_spacing": "1.7 mm"}}
    scene = make_scene(table, ["load.tension_weft=2 N/m", "knit.wales=5 /cm"])
    assert (scene.stages[0].strain_weft, scene.stages[0].tension_weft) == (None, 2.0)
    assert scene.stages[0].strain_warp == 0.1
    assert scene.knit.wale_spacing == 2e-3
    assert table == {"load": {"strain_weft": 0.1, "strain_warp": 0.1}, "knit": {"wale_spacing": "1.7 mm"}}


def test_two_overrides_that_say_it_twice_are_refused():
    with pytest.raises(SceneError, match="beside"):
        make_scene({}, ["load.strain_weft=0.1", "load.tension_weft=2"])


def test_an_override_makes_the_stage_it_names():
    assert [stage.name for stage in make_scene({}, ["path[0].name=hot"]).stages] == ["load", "hot"]


# --- the resolved scene and the hash

VARIED = [
    {},
    {"load": {"displacement": "1.2 mm"}, "knit": {"repeats": [7, 6], "wales": "5.9 /cm"}, "name": "the patch"},
    {
        "wire": {"plating": {"thickness": "0.2 um"}, "ends": 3},
        "path": [{"temperature": "-190 degC"}, {"tension_warp": 1}],
    },
    {"solver": {"drive": "ramp", "mass_scaling": 1e4, "loading_time": "10 ms", "damping": "100 /s", "max_steps": 10}},
    {
        "sweep": {"strain_weft": [0, 0.02], "strain_warp": [0.0], "seeds": 3},
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
        if key.split(".")[-1] in other_ways or key.startswith(("sweep", "hook", "wires")):
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


# --- agreement with the knit


def test_loop_defaults_and_ranges_are_those_of_the_knit():
    loops = pytest.importorskip("warpknit.knit.loops")
    defaults = make_scene({}).knit.loop
    assert {f.name for f in fields(loops.LoopProportions)} == set(LoopTable.model_fields)
    for proportion in fields(loops.LoopProportions):
        assert getattr(defaults, proportion.name) == proportion.default
    for name, (low, high) in loops.RANGES.items():
        check = LoopTable.model_fields[name].metadata[0].func
        for value in (low, high):
            assert check(value) == value
        for value in (low - 1e-6, high + 1e-6):
            with pytest.raises(PydanticCustomError):
                check(value)


def test_the_size_of_the_panel_is_that_of_the_knit():
    knit_cloth = getattr(pytest.importorskip("warpknit.knit"), "knit_cloth", None)
    if knit_cloth is None:
        pytest.skip("no knit yet")
    scene = load_scene(SCENES / "atlas_cell.toml")
    assert scene.knit.size == pytest.approx(tuple(knit_cloth(scene.knit, scene.wire.diameter).size), rel=1e-12)


def test_fine_nodes_are_double_unless_said():
    """Round-off of single precision grows as EI/h^2: many nodes a loop default to double."""
    assert make_scene({"model": {"nodes_per_loop": 60}}).solver.precision == "double"
    assert make_scene({"model": {"nodes_per_loop": 60}, "solver": {"precision": "single"}}).solver.precision == "single"
