"""What a scene may not say: each is one line of file, key, given and allowed."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warpknit.knit import KnitError
from warpknit.mesh.layout import knit_scene
from warpknit.scene import SceneError, load_scene, make_scene
from warpknit.scene.messages import known_keys

SCENES = Path(__file__).parent.parent / "scenes"


LENGTH = "a length above 0 m and at most 10 mm, such as '15 um'"
REFUSED = [
    # wrong unit, type or value
    ('wire.diameter="15 kg"', "wire.diameter", "'15 kg'", LENGTH),
    ("wire.diameter=-1.5e-5", "wire.diameter", "-1.5e-05", LENGTH),
    ("wire.diameter=0", "wire.diameter", "0", LENGTH),
    ("wire.diameter=30", "wire.diameter", "30", LENGTH),  # meant as um
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
    ("wire.plating.material=gold", "wire.plating.thickness", "nothing", "a length above 0 m, such as '0.2 um'"),
    ("wire.tensile_strength=100 MPa", "wire.yield_stress", "2 GPa", "at most the tensile strength, 100 MPa"),
    ("wire.plating.thickness=1 mm", "wire.plating.thickness", "'1 mm'", "at most the radius of the wire, 7.5 um"),
    ("wire.yield_stress=5 GPa", "wire.yield_stress", "'5 GPa'", "at most the tensile strength, 4.5 GPa"),
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
        "at least 30 um, two diameters of the wire between loops",
    ),
    ("knit.course_spacing=29 um", "knit.course_spacing", "'29 um'", "at least 30 um, two diameters of the wire"),
    ("knit.wales=500 /cm", "knit.wales", "'500 /cm'", "at least 30 um, two diameters of the wire"),
    ("knit.wales=5.9 cm", "knit.wales", "'5.9 cm'", "a count per length above 0 1/m, such as '26 /inch'"),
    ("knit.repeats=7", "knit.repeats", "7", "two whole numbers from 1 to 1000000000, such as [7, 6]"),
    ("knit.repeats=[7]", "knit.repeats", "[7]", "two whole numbers"),
    ("knit.repeats=[0, 1]", "knit.repeats", "[0, 1]", "two whole numbers"),
    ("knit.repeats=[1.0, 1]", "knit.repeats", "[1.0, 1]", "two whole numbers"),
    (f"knit.repeats=[{10**40}, 1]", "knit.repeats", "[1000", "two whole numbers"),
    ("knit.scatter=0.3", "knit.scatter", "0.3", "a number from 0 to 0.2"),
    ("sweep={strain_weft=[0], strain_warp=[0], seeds=2}", "sweep.seeds", "2", "1 without knit.scatter, as all seeds"),
    ("knit.seed=-1", "knit.seed", "-1", "a whole number from 0"),
    ("knit.loop.closed_radius=3", "knit.loop.closed_radius", "3", "a number from 0.4 to 0.78"),
    ("knit.loop.shape=square", "knit.loop.shape", "'square'", "'auto', 'circular-oval', 'general'"),
    ("model.kind=solid", "model.kind", "'solid'", "'planar', 'spatial'"),
    ("model.boundary=free", "model.boundary", "'free'", "'gripped', 'periodic'"),
    ("model.nodes_per_loop=7", "model.nodes_per_loop", "7", "a whole number from 8"),
    ("model.body_radius=1 mm", "model.body_radius", "'1 mm'", "at most the diameter of the wire, 15 um"),
    ("model.merge_lenses=1", "model.merge_lenses", "1", "true, false"),
    ("load.strain_weft=15 kg", "load.strain_weft", "'15 kg'", "a number from -0.5 to 2"),
    ("load.strain_warp=-2", "load.strain_warp", "-2", "a number from -0.5 to 2"),
    ("load.tension_weft=2 N", "load.tension_weft", "'2 N'", "a force per length at least 0 N/m, such as '2 N/m'"),
    ("load.displacement=24 mm", "load.displacement", "'24 mm'", "a displacement with a strain from -0.5 to 2"),
    ("load.temperature=-300 degC", "load.temperature", "'-300 degC'", "a temperature above 0 K and at most 4000 K"),
    ("path=3", "path", "3", "a list of tables"),
    ("path={strain_warp=0.1}", "path", "{'strain_warp': 0.1}", "a list of tables: write [[path]] in place of [path]"),
    ("knit.bars=['1-0/1-2']", "knit.bars[0]", "'1-0/1-2'", 'a table, as in a list of tables, [{chain = "1-0/1-2"}]'),
    ("knit.bars=1-0/1-2", "knit.bars", "'1-0/1-2'", 'a list of tables, [{chain = "1-0/1-2"}]'),
    ("knit.bars[2].shift=1", "knit.bars[2].shift", "1", "an entry that is there (there are 2 bars, 0 and 1), or a new one with"),
    ("path[0].temperature=2 m", "path[0].temperature", "'2 m'", "such as '-190 degC'"),
    ("path[0].name=load", "path[0].name", "'load'", "a name that differs from those of other stages"),
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
    ("load.strain_warp", "an override", "'load.strain_warp'", "KEY=VALUE"),
    ("=5", "an override", "'=5'", "KEY=VALUE"),
    ("load..strain_warp=1", "an override", "'load..strain_warp'", "a dotted key"),
    ("wire.diameter.x=1", "wire.diameter.x", "1", "no key below wire.diameter, which is '15 um'"),
    ("knit.bars.chain=1-0", "knit.bars.chain", "'1-0'", "no key below knit.bars"),
]


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("wire.diameter=16", f"wire.diameter: given 16, allowed: {LENGTH} (a bare number is in m)"),
        ("wire.diameter='16'", f"wire.diameter: given '16', allowed: {LENGTH} (a bare number is in m)"),
        ("wire.diameter=16 m", f"wire.diameter: given '16 m', allowed: {LENGTH}"),
        ("load.temperature=-100 K", "such as '-190 degC' (absolute, not a change; degrees Celsius are degC)"),
        ("load.temperature=+80 K", "such as '-190 degC' (absolute, not a change; degrees Celsius are degC)"),
        ("load.temperature=-80 C", "such as '-190 degC' (absolute, not a change; degrees Celsius are degC)"),
        ("load.temperature=-190", "such as '-190 degC' (a bare number is in K)"),
        ("knit.wales=26", "such as '26 /inch' (a bare number is in 1/m; write its unit)"),
        ("load.strain_weft=10", "a number from -0.5 to 2 (a share: 0.1 is '10 %')"),
        ("wire.set_fraction=2", "allowed: a number from 0 to 1"),
        ("wire.yield_stress=2 m", "a stress above 0 Pa, such as '800 MPa'"),
        ("wire.hardness=2 m", "a stress above 0 Pa, such as '0.7 GPa'"),
        ("knit.wale_spacing=2 N", "a length above 0 m, such as '1.2 mm'"),
        ("load.pull=[{at=['1 N', 0]}]", "a pair, each a length, such as ['1 mm', '1 mm']"),
    ],
)
def test_what_is_allowed_fits_the_key(override: str, said: str) -> None:
    """The example is of its size, and a bare number that is refused is told its unit."""
    with pytest.raises(SceneError) as error:
        load_scene(SCENES / "atlas_cell.toml", [override])
    assert said in str(error.value).partition(" (also wrong")[0]
    assert str(error.value).partition(" (also wrong")[0].endswith(said)


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
        ("knit.bar[1].shift=1", "knit.bar[1].shift", "knit.bars[1].shift"),
    ],
)
def test_an_unknown_key_names_the_nearest_known_one(override, key, nearest):
    with pytest.raises(SceneError) as caught:
        load_scene(SCENES / "atlas_cell.toml", [override])
    assert f"atlas_cell.toml: {key}: unknown key, the nearest is {nearest}: given " in str(caught.value)
    assert ", allowed: " in str(caught.value)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"wire.diameter": 1}, '\'wire.diameter\': given 1, allowed: tables in each other, {"wire": {"diameter": ...}}'),
        ({"wire": {"plating.material": 1}}, "or an override of wire.plating.material"),
        ({"knit.bars[1].chain": 1}, '{"knit": {"bars": [{"chain": ...}]}}, or an override of knit.bars[1].chain'),
    ],
)
def test_a_dotted_key_of_a_table_is_told_where_it_stands(table: dict, said: str) -> None:
    with pytest.raises(SceneError) as caught:
        make_scene(table)
    assert said in str(caught.value)


def test_wire_and_wires_are_told_apart() -> None:
    """The file that [wires] lacks is not told: it is another table that was meant."""
    with pytest.raises(
        SceneError, match=r"the nearest is wire\.diameter \(\[wire\] is one wire, \[wires\] a file of wires\): "
    ) as error:
        make_scene({"wires": {"diameter": "30 um"}})
    assert "also wrong" not in str(error.value)


def test_the_first_error_is_told_and_the_others_are_named():
    with pytest.raises(SceneError, match=r"wire\.diameter: given -1.*\(also wrong: load\.shear, output\.frames\)$"):
        make_scene({"wire": {"diameter": -1}, "load": {"shear": 7}, "output": {"frames": "x"}})


def test_a_list_is_not_wrong_beside_its_wrong_entries():
    """Of two bars both are refused; the list that is then empty is not told."""
    with pytest.raises(SceneError, match=r"knit\.bars\[0\]\.chain: given 'hello', [^()]*$"):
        make_scene({"knit": {"bars": [{"chain": "hello"}]}})
    with pytest.raises(SceneError, match=r"knit\.bars\[0\]\.chain: .*\(also wrong: knit\.bars\[1\]\.threading\)$"):
        make_scene({"knit": {"bars": [{"chain": "hello"}, {"chain": "1-0/1-2", "threading": "x"}]}})


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
        (b"\xff\xfe", "a byte that is not UTF-8 (0xff)"),
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
    assert ", allowed: a scene file in TOML" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "line", "quantity"),
    [
        ("[wire]\ndiameter = 30 um  # thin", 2, "30 um"),
        ("[wire]\nends = 2\ndiameter = 1.5e-5m", 3, "1.5e-5m"),
        ("load.strain_weft = 6 %\n", 1, "6 %"),
        ("[load]\ntension_warp = 2 N/m\n", 2, "2 N/m"),
        ("[load]\npull = [{at = [0.1, -1 mm]}]", 2, "-1 mm"),
        ("[knit]\nrepeats = [2 x 3]", 0, ""),
    ],
)
def test_a_quantity_without_quotes_is_told(text: str, line: int, quantity: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(text)
    said = f'(line {line}: {quantity} without quotes), allowed: a quantity with its unit as text, "{quantity}"'
    assert str(caught.value).endswith(said if quantity else ", allowed: a scene in TOML")


def test_a_directory_and_an_empty_text_are_no_scenes(tmp_path):
    with pytest.raises(SceneError, match="given a directory, allowed"):
        load_scene(tmp_path)
    with pytest.raises(SceneError, match="^scene: the source: given '', allowed: a path, TOML text, a dict or a scene$"):
        load_scene("")


@settings(deadline=None)
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


@pytest.mark.parametrize(("wales", "courses", "key"), [("260", "25", "wales"), ("26", "300", "courses")])
def test_the_denser_of_wales_and_courses_is_named(wales, courses, key):
    knit = {"bars": [{"chain": "1-0/1-2"}], "wales": f"{wales} /inch", "courses": f"{courses} /inch"}
    with pytest.raises(SceneError, match=rf"knit\.{key}: given .*differ by a factor of at most 10; here wales are") as refused:
        load_scene({"wire": {"material": "gold", "diameter": "10 um"}, "knit": knit})
    assert "bare" not in str(refused.value)


def test_a_wire_too_thick_for_its_wales_is_named():
    bars = [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}]
    knit = {"bars": bars, "wales": "26 /inch", "courses": "30 /inch"}
    scene = load_scene({"wire": {"material": "gold", "diameter": "300 um"}, "knit": knit, "model": {"kind": "spatial"}})
    with pytest.raises(KnitError) as refused:
        knit_scene(scene)
    assert refused.value.key == "wire.diameter" and "a thickness of at most" in refused.value.allowed
