"""What a scene may not say: each is one line of file, key, what is wrong and what to write instead."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warpknit.knit.lapping import KnitError
from warpknit.mesh.layout import knit_scene
from warpknit.scene import SceneError, load_scene, make_scene
from warpknit.scene.messages import known_keys
from warpknit.scene.values import STRAIN

SCENES = Path(__file__).parent.parent / "scenes"
CELL = SCENES / "atlas_cell.toml"


def parts_of(error: SceneError, file: object = CELL) -> tuple[str, str, str]:
    """Key, what is wrong and what to write instead: the parts of a message."""
    line = str(error)
    assert line.startswith(f"{file}: ") and line.isprintable()
    place, _, instead = line.removeprefix(f"{file}: ").partition("; ")
    key, _, wrong = place.partition(": ")
    assert wrong and instead and key == error.key
    return key, wrong, instead


REFUSED = [  # override, the key that is named, the value that was given, a value that is to be written
    # wrong unit, type or value
    ('wire.diameter="15 kg"', "wire.diameter", "'15 kg'", "'15 um'"),
    ("wire.diameter=-1.5e-5", "wire.diameter", "-1.5e-05", "'15 um'"),
    ("wire.diameter=0", "wire.diameter", "0", "'15 um'"),
    ("wire.diameter=30", "wire.diameter", "30", "'15 um'"),
    ("wire.diameter=nan", "wire.diameter", "nan", "'15 um'"),
    ("wire.diameter=inf", "wire.diameter", "inf", "'15 um'"),
    ("wire.diameter=true", "wire.diameter", "true", "'15 um'"),
    ("wire.diameter=[1]", "wire.diameter", "[1]", "'15 um'"),
    ("wire.diameter=2020-01-01", "wire.diameter", "datetime", "'15 um'"),
    ("wire.youngs_modulus=400 um", "wire.youngs_modulus", "'400 um'", "'400 GPa'"),
    ("wire.material=unobtainium", "wire.material", "'unobtainium'", "'molybdenum'"),
    ("wire.material=3", "wire.material", "3", "'tungsten'"),
    ("wire.poissons_ratio=0.6", "wire.poissons_ratio", "0.6", "0.5"),
    ("wire.ends=2.0", "wire.ends", "2.0", "1"),
    ("wire.ends=true", "wire.ends", "true", "1"),
    ("wire.ends=0", "wire.ends", "0", "1"),
    ("wire.set_fraction=1.5", "wire.set_fraction", "1.5", "0"),
    ("wire.plating.material=gold", "wire.plating.thickness", "", "'0.2 um'"),
    ("wire.tensile_strength=100 MPa", "wire.yield_stress", "2 GPa", "100 MPa"),
    ("wire.plating.thickness=1 mm", "wire.plating.thickness", "'1 mm'", "7.5 um"),
    ("wire.yield_stress=5 GPa", "wire.yield_stress", "'5 GPa'", "4.5 GPa"),
    ("wire.reference_temperature=-1", "wire.reference_temperature", "-1", "0 K"),
    ("wire=5", "wire", "5", ""),
    ("knit.bars=[]", "knit.bars", "[]", ""),
    ("knit.bars=[1]", "knit.bars[0]", "1", ""),
    ("knit.bars=[{}]", "knit.bars[0].chain", "", ""),
    ("knit.bars[1].chain=1-0//2-3", "knit.bars[1].chain", "'1-0//2-3'", ""),
    ("knit.bars[1].chain=1-0/1-", "knit.bars[1].chain", "'1-0/1-'", ""),
    ("knit.bars.1.chain=''", "knit.bars[1].chain", "''", ""),
    ("knit.bars[0].chain=10", "knit.bars[0].chain", "10", ""),
    ("knit.bars[0].threading=...", "knit.bars[0].threading", "'...'", "'|'"),
    ("knit.bars[0].threading=|x", "knit.bars[0].threading", "'|x'", "'|'"),
    ("knit.bars[0].shift=0.5", "knit.bars[0].shift", "0.5", ""),
    ("knit.wale_spacing=20 um", "knit.wale_spacing", "'20 um'", "30 um"),
    ("knit.course_spacing=29 um", "knit.course_spacing", "'29 um'", "30 um"),
    ("knit.wales=500 /cm", "knit.wales", "'500 /cm'", "30 um"),
    ("knit.wales=5.9 cm", "knit.wales", "'5.9 cm'", "'26 /inch'"),
    ("knit.repeats=7", "knit.repeats", "7", "1000000000"),
    ("knit.repeats=[7]", "knit.repeats", "[7]", ""),
    ("knit.repeats=[0, 1]", "knit.repeats", "[0, 1]", ""),
    ("knit.repeats=[1.0, 1]", "knit.repeats", "[1.0, 1]", ""),
    ("knit.repeats=[10000000000000000000000000000000000000000, 1]", "knit.repeats", "[1000", ""),
    ("knit.scatter=0.3", "knit.scatter", "0.3", "0.2"),
    ("variants.count=0", "variants.count", "0", "1"),
    ("variants={count=2, scatter=0.3}", "variants.scatter", "0.3", "0.2"),
    ("knit.seed=-1", "knit.seed", "-1", "0"),
    ("knit.loop.closed_radius=3", "knit.loop.closed_radius", "3", "0.78"),
    ("knit.loop.shape=square", "knit.loop.shape", "'square'", "'circular-oval'"),
    ("model.kind=solid", "model.kind", "'solid'", "'spatial'"),
    ("model.boundary=free", "model.boundary", "'free'", "'periodic'"),
    ("model.nodes_per_loop=7", "model.nodes_per_loop", "7", "8"),
    ("model.body_radius=1 mm", "model.body_radius", "'1 mm'", "15 um"),
    ("model.merge_lenses=1", "model.merge_lenses", "1", ""),
    ("load.strain_weft=15 kg", "load.strain_weft", "'15 kg'", "-0.5"),
    ("load.strain_warp=-2", "load.strain_warp", "-2", "-0.5"),
    ("load.tension_weft=2 N", "load.tension_weft", "'2 N'", "'2 N/m'"),
    ("load.displacement=24 mm", "load.displacement", "'24 mm'", "-0.5"),
    ("load.temperature=-300 degC", "load.temperature", "'-300 degC'", "4000 K"),
    ("path=3", "path", "3", ""),
    ("path={strain_warp=0.1}", "path", "{'strain_warp': 0.1}", ""),
    ("knit.bars=['1-0/1-2']", "knit.bars[0]", "'1-0/1-2'", "[[knit.bars]]"),
    ("knit.bars=1-0/1-2", "knit.bars", "'1-0/1-2'", "[[knit.bars]]"),
    ("knit.bars[2].shift=1", "knit.bars[2].chain", "missing", "links"),
    ("path[0].temperature=2 m", "path[0].temperature", "'2 m'", "'-190 degC'"),
    ("path[0].name=load", "path[0].name", "'load'", ""),
    ("path[3].temperature=2", "path[3]", "", "0"),
    ("contact.friction=6", "contact.friction", "6", "0"),
    ("contact.threshold=-1", "contact.threshold", "-1", "0"),
    ("contact.stiffness=0", "contact.stiffness", "0", "0"),
    ("solver.preset=fast", "solver.preset", "'fast'", "'reference'"),
    ("solver.drive=push", "solver.drive", "'push'", "'relax'"),
    ("solver.precision=half", "solver.precision", "'half'", "'single'"),
    ("solver.mass_scaling=4", "solver.mass_scaling", "4", ""),
    ("solver.loading_time=1 s", "solver.loading_time", "'1 s'", ""),
    ("solver.axial_softening=0.5", "solver.axial_softening", "0.5", "1"),
    ("solver.residual_tolerance=0", "solver.residual_tolerance", "0", "0.5"),
    ("solver.max_steps=0", "solver.max_steps", "0", "1"),
    ("solver.multipliers=yes", "solver.multipliers", "'yes'", ""),
    ("output.frames=0", "output.frames", "0", "1"),
    ("output.checkpoint_interval=60 m", "output.checkpoint_interval", "'60 m'", "'60 s'"),
    ("sweep.strain_weft=[0, 0.1]", "sweep.strain_warp", "", ""),
    ("sweep={strain_weft=[], strain_warp=[0]}", "sweep.strain_weft", "[]", ""),
    ("sweep={strain_weft=[0, nan], strain_warp=[0]}", "sweep.strain_weft[1]", "nan", "-0.5"),
    ("name=a/b", "name", "'a/b'", "100"),
    # overrides that cannot be set
    ("load.strain_warp", "override", "'load.strain_warp'", "KEY=VALUE"),
    ("=5", "override", "'=5'", "KEY=VALUE"),
    ("load..strain_warp=1", "override", "'load..strain_warp'", ""),
    ("wire.diameter.x=1", "wire.diameter.x", "1", ""),
    ("knit.bars.chain=1-0", "knit.bars.chain", "'1-0/1-2", ""),
]


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("wire.diameter=16", " m)"),
        ("wire.diameter='16'", " m)"),
        ("load.temperature=-100 K", "'-190 degC' ("),
        ("load.temperature=+80 K", "'-190 degC' ("),
        ("load.temperature=-80 C", "'-190 degC' ("),
        ("load.temperature=-190", " K)"),
        ("knit.wales=26", " 1/m)"),
        ("knit.wales=26", "'26 /inch'"),
        ("load.strain_weft=10", "'10 %'"),
        ("wire.yield_stress=2 m", "'800 MPa'"),
        ("wire.hardness=2 m", "'0.7 GPa'"),
        ("knit.wale_spacing=2 N", "'1.2 mm'"),
        ("load.pull=[{at=['1 N', 0]}]", "['1 mm', '1 mm']"),
    ],
)
def test_what_to_write_fits_the_key(override: str, said: str) -> None:
    """The example is of its size, and the unit of a bare number that is refused is named."""
    with pytest.raises(SceneError) as error:
        load_scene(CELL, [override])
    assert said in str(error.value)


def test_a_number_with_its_unit_is_not_taken_for_a_bare_one() -> None:
    with pytest.raises(SceneError) as error:
        load_scene(CELL, ["wire.diameter=16 m"])
    assert "bare" not in str(error.value)


@pytest.mark.parametrize(("override", "key", "given", "instead"), REFUSED, ids=[row[0] for row in REFUSED])
def test_a_bad_value_is_one_line_of_file_key_value_and_what_to_write(override: str, key: str, given: str, instead: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(CELL, [override])
    found = parts_of(caught.value)
    assert found[0] == key and given in found[1] and instead in found[2]
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    ("override", "bound"),
    [
        ("wire.diameter=0 um", "0 m"),
        ("wire.diameter=11 mm", "10 mm"),
        ("wire.ends=0", "1"),
        ("wire.ends=1001", "1000"),
        ("load.strain_weft=-0.6", f"{STRAIN.least:g}"),
        ("load.strain_weft=2.1", f"{STRAIN.most:g}"),
        ("knit.repeats=[0, 7]", " 1"),
    ],
)
def test_a_value_out_of_range_is_refused_by_the_end_that_it_passes(override: str, bound: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(CELL, [override])
    assert parts_of(caught.value)[1].endswith(bound)


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
        ("contact.mu=0.1", "contact.mu", "contact.friction"),
        ("mu=0.1", "mu", "contact.friction"),
        ("wire.cte=1", "wire.cte", "wire.expansion"),
    ],
)
def test_an_unknown_key_names_the_nearest_known_one(override, key, nearest):
    with pytest.raises(SceneError) as caught:
        load_scene(CELL, [override])
    found = parts_of(caught.value)
    assert found[0] == key and found[2].endswith(f" {nearest}")


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"wire.diameter": 1}, '{"wire": {"diameter": ...}}'),
        ({"wire": {"plating.material": 1}}, " wire.plating.material"),
        ({"knit.bars[1].chain": 1}, '{"knit": {"bars": [{"chain": ...}]}}, '),
    ],
)
def test_a_dotted_key_of_a_table_is_told_where_it_stands(table: dict, said: str) -> None:
    with pytest.raises(SceneError) as caught:
        make_scene(table)
    assert said in str(caught.value)


def test_wire_and_wires_are_told_apart() -> None:
    """The file that [wires] lacks is not told: it is another table that was meant."""
    with pytest.raises(SceneError, match=r"wire\.diameter$"):
        make_scene({"wires": {"diameter": "30 um"}})


def test_the_first_error_is_told_and_the_others_are_named():
    with pytest.raises(SceneError, match=r"wire\.diameter: -1 .*: load\.shear, output\.frames\)$"):
        make_scene({"wire": {"diameter": -1}, "load": {"shear": 7}, "output": {"frames": "x"}})


def test_a_list_is_not_wrong_beside_its_wrong_entries():
    """Of two bars both are refused; the list that is then empty is not told."""
    with pytest.raises(SceneError, match=r"knit\.bars\[0\]\.chain: 'hello' [^()]*$"):
        make_scene({"knit": {"bars": [{"chain": "hello"}]}})
    with pytest.raises(SceneError, match=r"knit\.bars\[0\]\.chain: .*: knit\.bars\[1\]\.threading\)$"):
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
    found = parts_of(caught.value, "scene.toml")
    assert found[0] == f"{stage}.{key}" and f" {next(iter(load))} = " in found[1] and key in found[2]


def test_two_ways_to_give_a_spacing_are_one_too_many():
    with pytest.raises(SceneError, match=r"knit\.wales: '5 /cm' .* wale_spacing = 0\.001; "):
        make_scene({"knit": {"wale_spacing": 1e-3, "wales": "5 /cm"}})


@pytest.mark.parametrize(
    ("content", "wrong"),
    [(b"[wire", "TOML"), (b"\xff\xfe", "UTF-8 (0xff)"), (b"a = 1\na = 2", "TOML"), (None, "")],
)
def test_an_unreadable_file_is_one_line(tmp_path, content, wrong):
    path = tmp_path / "bad.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    line = str(caught.value)
    assert line.startswith(f"{path}: ") and wrong in line and "; " in line and "\n" not in line


@pytest.mark.parametrize(
    ("text", "line", "quantity"),
    [
        ("[wire]\ndiameter = 30 um  # thin", 2, "30 um"),
        ("[wire]\nends = 2\ndiameter = 1.5e-5m", 3, "1.5e-5m"),
        ("load.strain_weft = 6 %\n", 1, "6 %"),
        ("[load]\ntension_warp = 2 N/m\n", 2, "2 N/m"),
        ("[load]\npull = [{at = [0.1, -1 mm]}]", 2, "-1 mm"),
        ("[wire]\nmaterial=tungsten\n", 2, "tungsten"),
        ("[wire]\nplating = {material = gold, thickness = '1 um'}", 2, "gold"),
        ("[knit]\nrepeats = [2 x 3]", 0, ""),
    ],
)
def test_a_quantity_without_quotes_is_told(text: str, line: int, quantity: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(text)
    said = str(caught.value)
    assert said.endswith(f'"{quantity}"') == bool(quantity)
    assert not quantity or f"line {line}: {quantity} " in said


@pytest.mark.parametrize("given", ["30 GHz", ["30 GHz"], "10 to 30 GHz, 2", [1e10, "30 GHz"]])
def test_frequencies_are_one_a_list_or_a_range(given) -> None:
    """One alone stands for a list of one; a range of two has its ends."""
    scene = load_scene({"model": {"boundary": "periodic"}, "reflection": {"frequencies": given}})
    assert scene.reflection is not None
    assert scene.reflection.frequencies == ((3e10,) if "30 GHz" in (given, *given[:1]) else (1e10, 3e10))


def test_a_directory_and_an_empty_text_are_no_scenes(tmp_path):
    with pytest.raises(SceneError, match="a directory"):
        load_scene(tmp_path)
    with pytest.raises(SceneError, match="^scene: '' "):
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
        parts_of(error, "scene.toml")
    else:
        assert len(scene.hash) == 64


@pytest.mark.parametrize(("wales", "courses", "key"), [("260", "25", "wales"), ("26", "300", "courses")])
def test_the_denser_of_wales_and_courses_is_named(wales, courses, key):
    knit = {"bars": [{"chain": "1-0/1-2"}], "wales": f"{wales} /inch", "courses": f"{courses} /inch"}
    with pytest.raises(SceneError, match=rf"knit\.{key}: .*; .* at most 10$"):
        load_scene({"wire": {"material": "gold", "diameter": "10 um"}, "knit": knit})


def test_a_wire_too_thick_for_its_wales_is_named():
    bars = [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}]
    knit = {"bars": bars, "wales": "26 /inch", "courses": "30 /inch"}
    scene = load_scene({"wire": {"material": "gold", "diameter": "300 um"}, "knit": knit, "model": {"kind": "spatial"}})
    with pytest.raises(KnitError) as refused:
        knit_scene(scene)
    assert refused.value.key == "wire.diameter" and "300 um" in refused.value.wrong and "at most" in refused.value.instead


@pytest.mark.parametrize(
    ("text", "remedy"), [("wire.diameter = \n", "correct this line"), ("name = 'a'\nname = 'b'\n", "each key once")]
)
def test_toml_that_is_invalid_says_what_to_do(text: str, remedy: str) -> None:
    with pytest.raises(SceneError, match=remedy):
        load_scene(text)
