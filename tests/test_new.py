"""`warpknit new`: the scene that it writes is the one that was asked for, and nothing is overwritten."""

import re
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from reference.cases import slow
from reference.in_words import quantities
from warpknit.commands import new as new_module
from warpknit.commands.cli import main
from warpknit.commands.plan import overview_of
from warpknit.knit.lapping import KnitError, lapping_table
from warpknit.knit.named import NAMED_KNITS, named_knit
from warpknit.scene import load_scene
from warpknit.scene.new_scene import SceneRequest, scene_text
from warpknit.solve.model import build_model
from warpknit.solve.simulate import Simulation

INCH = 25.4e-3  # [m]
ROUND_OFF = 1e-12
OPTIONAL = re.compile(r"^# (?=\[|\w+ = )", re.MULTILINE)  # before a key that is commented out


@pytest.fixture(autouse=True)
def in_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(new_module, "on_terminal", lambda: True)


def new(*arguments: str, answers: str | None = None) -> Result:
    return CliRunner().invoke(main, ["new", *arguments], input=answers, prog_name="warpknit")


# --- knits by name


@pytest.mark.parametrize("name", NAMED_KNITS)
def test_a_named_knit_is_a_knit(name: str) -> None:
    """A loop of every bar on every needle that its threading serves, but for inlays."""
    knit = named_knit(name)
    lapping = lapping_table(knit.bars)
    loops = sum(stitch.kind != "inlay" for stitch in lapping.stitches)
    bars = sum(bar.threading.count("|") / len(bar.threading) for bar in knit.bars if bar.chain != "0-0/2-2")
    assert loops == bars * lapping.wales * lapping.courses


def test_the_double_atlas_is_the_default_of_a_scene() -> None:
    default = load_scene({}).knit.bars
    assert [(bar.chain, bar.threading, bar.shift) for bar in named_knit("double-atlas").bars] == [
        (bar.chain, bar.threading, bar.shift) for bar in default
    ]


@pytest.mark.parametrize("text", ["queens-cord", "Queen's Cord", " queens_cord "])
def test_a_name_may_be_spelled_in_several_ways(text: str) -> None:
    assert named_knit(text) is NAMED_KNITS["queens-cord"]


def test_an_unknown_name_gives_the_nearest() -> None:
    with pytest.raises(KnitError, match=r" reverse-locknit"):
        named_knit("revers locknit")


# --- the file


@pytest.mark.parametrize("name", NAMED_KNITS)
def test_every_named_knit_can_be_planned(name: str) -> None:
    done = new("--knit", name)
    assert done.exit_code == 0, done.stderr
    scene = load_scene(f"{name}.toml")
    assert [bar.chain for bar in scene.knit.bars] == [bar.chain for bar in NAMED_KNITS[name].bars]
    assert overview_of(scene, "cpu").bodies > 0


@pytest.mark.parametrize("name", ["double-atlas", "tricot", "reverse-locknit", *slow("atlas")])
def test_a_new_scene_converges(name: str) -> None:
    """At the draft preset, in ten levels of at most 1 %: a level that does not converge raises."""
    scene = load_scene(scene_text(SceneRequest(knit=name), "x.toml"), {"output.frames": 10}, preset="draft")
    records = list(Simulation(build_model(scene)).run())
    assert len(records) == 11 and records[-1].steady
    assert records[-1].observables.gradient[0, 0] == pytest.approx(1.0 + NAMED_KNITS[name].strain / 100, rel=1e-6)


def test_the_file_holds_what_was_asked_for() -> None:
    options = {
        "knit": "locknit", "material": "tungsten", "diameter": "17 um", "ends": "4", "wales": "10.24 /cm", "courses": "0.85 mm",
        "load": "6 %, 2 N/m", "model": "spatial",
    }  # fmt: skip
    done = new("mesh", *(part for name, value in options.items() for part in (f"--{name}", value)))
    assert done.exit_code == 0, done.stderr
    scene = load_scene("mesh.toml")
    assert scene.name == "mesh"
    assert (scene.wire.material, scene.wire.ends) == ("tungsten", 4)
    assert [bar.chain for bar in scene.knit.bars] == ["1-0/1-2", "2-3/1-0"]
    assert scene.wire.diameter == pytest.approx(17e-6, rel=ROUND_OFF, abs=0.0)
    assert scene.knit.wale_spacing == pytest.approx(1e-2 / 10.24, rel=ROUND_OFF)
    assert scene.knit.course_spacing == pytest.approx(0.85e-3, rel=ROUND_OFF)
    (stage,) = scene.stages
    assert (stage.strain_weft, stage.strain_warp, stage.tension_weft) == (pytest.approx(0.06), None, None)
    assert stage.tension_warp == pytest.approx(2.0)
    assert scene.model.kind == "spatial" and scene.model.boundary == "periodic"


@pytest.mark.parametrize("plating", ["gold, 0.3 um", "gold 0.3um"])
def test_a_plating_stands_in_the_file(plating: str) -> None:
    done = new("mesh", "--plating", plating)
    assert done.exit_code == 0, done.stderr
    assert {"30 um", "300 nm"} <= set(quantities(done.stdout))
    coating = load_scene("mesh.toml").wire.plating
    assert coating is not None and coating.material == "gold"
    assert coating.thickness == pytest.approx(0.3e-6, rel=ROUND_OFF, abs=0.0)
    assert load_scene(scene_text(SceneRequest(), "x.toml")).wire.plating is None


@pytest.mark.parametrize("given", ["26", "26 /inch", "26 per inch", "0.9769230769230769 mm"])
def test_a_bare_gauge_counts_an_inch(given: str) -> None:
    scene = load_scene(scene_text(SceneRequest(knit="tricot", wales=given), "x.toml"))
    assert scene.knit.wale_spacing == pytest.approx(INCH / 26, rel=ROUND_OFF)


@pytest.mark.parametrize("load", ["5 %", "0.05", "50 mN/m", "6 %, 2 N/m"])
@pytest.mark.parametrize("knit", ["double-atlas", "atlas", "satin"])
@pytest.mark.parametrize("material", ["tungsten", "gold"])
def test_keys_that_are_commented_out_are_valid(knit: str, load: str, material: str) -> None:
    """All of them at once."""
    text = scene_text(SceneRequest(knit=knit, load=load, material=material), "x.toml")
    as_written, scene = load_scene(text), load_scene(OPTIONAL.sub("", text))
    assert (len(as_written.stages), len(scene.stages)) == (1, 3)
    assert scene.wire.plating is not None and scene.sweep is not None and scene.output.vtk
    assert scene.wire.youngs_modulus == as_written.wire.youngs_modulus


@pytest.mark.parametrize("knit", NAMED_KNITS)
def test_every_key_has_a_comment(knit: str) -> None:
    above = ""
    for line in scene_text(SceneRequest(knit=knit), "x.toml").splitlines():
        assert len(line) <= 130
        if re.match(r"\w+ = |    \{", line):
            assert "  # " in line or above.startswith("# "), line
        above = line


# --- the command


def test_the_list_has_every_knit_with_its_chains() -> None:
    done = new("--list")
    assert done.exit_code == 0 and not list(Path().iterdir())
    for knit in NAMED_KNITS.values():
        assert knit.name in done.stdout and knit.about in done.stdout
        assert all(bar.chain in done.stdout for bar in knit.bars)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--knit", "tricott"], "--knit: 'tricott'"),
        (["--material", "steel"], "--material: 'steel'"),
        (["--diameter", "15"], "--diameter: '15'"),
        (["--diameter", "15 kg"], "--diameter: '15 kg'"),
        (["--ends", "2.0"], "--ends: '2.0'"),
        (["--ends", "0"], "--ends: '0'"),
        (["--plating", "gold"], "--plating: 'gold'"),
        (["--plating", "tin, 1 um"], "--plating: 'tin, 1 um'"),
        (["--plating", "gold, 1"], "--plating: 'gold, 1'"),
        (["--plating", "gold, 1 mm"], "wire.plating.thickness: '1 mm'"),
        (["--wales", "-26"], "--wales: '-26'"),
        (["--courses", "26 N"], "--courses: '26 N'"),
        (["--load", "6"], "--load: '6'"),
        (["--load", "2 kg"], "--load: '2 kg'"),
        (["--load", "nan"], "--load: 'nan'"),
        (["--load", "1 %, 2 %, 3 %"], "--load: '1 %, 2 %, 3 %'"),
        (["--model", "plane"], "--model: 'plane'"),
        (["--wales", "900"], "knit.wales: '900 /inch'"),
        (["--wales", "26", "--courses", "28"], "knit.loop.closed_radius: "),
        (["a\nb"], "FILE: 'a\\nb.toml'"),
        (["folder"], "folder.toml: is a directory"),
    ],
)
def test_a_bad_value_is_status_2_and_one_line(arguments: list[str], said: str) -> None:
    Path("folder.toml").mkdir()
    done = new(*arguments)
    assert done.exit_code == 2 and said in done.stderr
    assert done.stderr.startswith("warpknit: ") and done.stderr.count("\n") == 1 and done.stdout == ""
    assert [path.name for path in Path().iterdir()] == ["folder.toml"]


def test_loops_without_room_are_told_the_nearest_gauges_that_have_it() -> None:
    """Of wales 26 an inch, fewer, and of 28 courses more: the nearest that `new` takes, and their neighbours it does not."""
    said = new("--wales", "26", "--courses", "28").stderr
    found = re.search(r"use (\d+) wales an inch with these courses, (\d+) courses an inch with these wales", said)
    assert found is not None
    wales, courses = map(int, found.groups())
    assert new("--wales", f"{wales}", "--courses", "28", "a").exit_code == 0
    assert new("--wales", "26", "--courses", f"{courses}", "b").exit_code == 0
    assert new("--wales", f"{wales + 1}", "--courses", "28", "c").exit_code == 2
    assert new("--wales", "26", "--courses", f"{courses - 1}", "d").exit_code == 2


@pytest.mark.parametrize("diameter", ["300 um", "200 um"])
def test_the_thickness_that_is_named_has_room(diameter: str) -> None:
    """Beyond the room of the feet, and of the narrowest loop: both name (0.5 - leg_half_width) W/2 = 0.13 W of two layers of
    loops, rounded down, and one more digit has no room."""
    said = new("--knit", "tricot", "--wales", "26", "--courses", "30", "--diameter", diameter).stderr
    (thickness,) = re.findall(r"a thickness of at most (\S+) um", said)
    assert float(thickness) == pytest.approx(0.13 * 25.4e3 / 26.0, rel=1e-3)
    for factor, status in ((1.0, 0), (1.01, 2)):
        wire = ("--diameter", f"{factor * float(thickness)} um", f"factor{factor}")
        assert new("--knit", "tricot", "--wales", "26", "--courses", "30", *wire).exit_code == status


@pytest.mark.parametrize(("knit", "wales", "courses", "denser"), [("tricot", 26, 3, "courses"), ("satin", 6, 30, "wales")])
def test_spacings_at_which_centre_lines_intersect_are_refused(knit: str, wales: int, courses: int, denser: str) -> None:
    """`new` writes no file that `plan` would refuse, and names the spacing to change; denser by four there is room."""
    said = new("--knit", knit, "--wales", f"{wales}", "--courses", f"{courses}", "long")
    assert said.exit_code == 2 and f"use more {denser} per length" in said.stderr and not Path("long.toml").exists()
    changed = {"wales": wales, "courses": courses} | {denser: 4 * {"wales": wales, "courses": courses}[denser]}
    assert new("--knit", knit, "--wales", f"{changed['wales']}", "--courses", f"{changed['courses']}", "a").exit_code == 0


def test_wires_that_overlap_as_knitted_are_a_warning() -> None:
    """A run pushes them apart; loops that cannot be laid out are refused (docs/how-to/new_scene.md)."""
    knit = ("--knit", "reverse-locknit", "--diameter", "17 um", "--ends", "4")
    dense = new(*knit, "--wales", "60", "--courses", "60", "dense")
    assert dense.exit_code == 0 and "89 %" in quantities(dense.output)
    denser = new(*knit, "--wales", "120", "--courses", "120", "denser")
    assert denser.exit_code == 2 and denser.stderr.count("\n") == 1 and not Path("denser.toml").exists()


def test_a_new_scene_tells_that_the_elastic_limit_is_assumed() -> None:
    """The line has the value of the material, and is taken without its #."""
    assert new("--material", "molybdenum").exit_code == 0
    (line,) = [one for one in Path("double-atlas.toml").read_text().splitlines() if "yield_stress =" in one]
    assert line.startswith("# yield_stress = ") and "assumed" in line
    Path("given.toml").write_text(Path("double-atlas.toml").read_text().replace(line, line.removeprefix("# ")))
    scene, given = load_scene("double-atlas.toml"), load_scene("given.toml")
    assert scene.wire == given.wire
    assert set(scene.assumed) - set(given.assumed) == {"wire.yield_stress"}


def test_a_file_is_replaced_only_by_force() -> None:
    Path("tricot.toml").write_text("# mine\n")
    done = new("--knit", "tricot")
    assert done.exit_code == 2
    assert done.stderr.startswith("warpknit: tricot.toml: ") and "--force" in done.stderr
    assert Path("tricot.toml").read_text() == "# mine\n"
    assert new("--knit", "tricot", "--force").exit_code == 0
    assert load_scene("tricot.toml").name == "tricot"


def test_without_a_terminal_nothing_is_asked() -> None:
    done = new(answers="tricot\n")
    assert done.exit_code == 0 and "Knit [" not in done.stdout
    assert [path.name for path in Path().iterdir()] == ["double-atlas.toml"]


# --- the questions


def test_with_a_knit_nothing_is_asked(terminal: None) -> None:
    done = new("--knit", "tricot", answers="")
    assert done.exit_code == 0 and "[" not in done.stdout


def test_return_takes_what_is_in_brackets(terminal: None) -> None:
    done = new(answers="\n" * 10)
    assert done.exit_code == 0, done.stderr
    as_asked = Path("double-atlas.toml").read_text()
    assert as_asked == scene_text(SceneRequest(), "double-atlas.toml")


def test_answers_are_those_of_the_options(terminal: None) -> None:
    done = new(answers="tricot\ntungsten\ngold, 0.2 um\n17 um\n4\n24\n28 /inch\n1 N/m\nspatial\nmine\n")
    assert done.exit_code == 0, done.stderr
    options = ("--knit", "tricot", "--material", "tungsten", "--plating", "gold, 0.2 um", "--diameter", "17 um", "--ends", "4")
    assert (
        new(*options, "--wales", "24", "--courses", "28 /inch", "--load", "1 N/m", "--model", "spatial", "other").exit_code == 0
    )
    assert Path("mine.toml").read_text() == Path("other.toml").read_text().replace("other.toml", "mine.toml")


def test_what_options_give_is_not_asked(terminal: None) -> None:
    done = new("--diameter", "25 um", "--load", "1 %", "mesh", answers="tricot\n" + "\n" * 6)
    assert done.exit_code == 0, done.stderr
    assert "diameter" not in done.stdout and "Load" not in done.stdout and "File" not in done.stdout
    assert load_scene("mesh.toml").wire.diameter == pytest.approx(25e-6, rel=ROUND_OFF, abs=0.0)


def test_a_bad_answer_is_asked_for_again(terminal: None) -> None:
    Path("tricot.toml").write_text("# mine\n")
    done = new(answers="tricott\ntricot\n\ngold\nnone\n25\n25 um\n\n\n\n6\n6 %\n\ntricot\nmesh\n")
    assert done.exit_code == 0, done.stderr
    for refused in ("'tricott'", "'gold'", "'25'", "'6'", "tricot.toml: "):
        assert refused in done.stdout
    assert Path("tricot.toml").read_text() == "# mine\n" and load_scene("mesh.toml").name == "mesh"


def test_loops_without_room_are_asked_for_again(terminal: None) -> None:
    """Wire and spacings, with the last answers in brackets."""
    done = new(answers="tricot\n\n\n0.1 mm\n3\n\n\n" + "30 um\n1\n\n\n" + "\n\n\n")
    assert done.exit_code == 0, done.stderr
    assert "[3]: 1" in done.stdout
    assert load_scene("tricot.toml").wire.ends == 1


@pytest.mark.parametrize("answers", ["", "tricot\n", "tricot\n\n\n\n\n"])
def test_the_end_of_input_writes_nothing(terminal: None, answers: str) -> None:
    done = new(answers=answers)
    assert done.exit_code == 130 and done.stderr == "warpknit: interrupted\n"
    assert not list(Path().iterdir())


@pytest.mark.parametrize("file", ["/proc/mesh.toml", "nowhere/mesh.toml"])
def test_a_place_that_takes_no_file_is_refused(file: str) -> None:
    done = new(file)
    assert done.exit_code == 2 and done.stderr.count("\n") == 1 and file in done.stderr
    assert not Path("nowhere").exists()


def test_the_table_has_quantities_not_the_text_as_typed() -> None:
    done = new("--knit", "tricot", "--diameter", "30um", "--plating", "gold,0.2um")
    assert {"30 um", "200 nm"} <= set(quantities(done.stdout))
