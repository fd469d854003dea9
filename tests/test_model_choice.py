"""`model.kind = "auto"`: which model is taken, why, and that plan, run, map and report say so."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from reference.interrupted import assert_parts_are_the_whole
from warpknit.cli import main
from warpknit.design import curves
from warpknit.knit.chain import KnitError
from warpknit.knit.named import NAMED_KNITS
from warpknit.plan import make_plan
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene, make_scene
from warpknit.scene.model_choice import LARGE, PLANE_IS_GOOD, first_touch
from warpknit.scene.presets import PRESETS
from warpknit.trade.error_estimate import settings_for_error
from warpknit.trade.probe_run import ProbeRun

SCENES = Path(__file__).parent.parent / "scenes"
ATLAS = SCENES / "atlas_cell.toml"
BARS = [{"chain": "1-0/1-2"}, {"chain": "1-2/1-0"}]
KNIT = {"bars": BARS, "wale_spacing": "1 mm", "course_spacing": "0.8 mm", "repeats": [3, 2]}
TIGHT = {"knit": KNIT, "model": {"boundary": "periodic"}}  # a closed tricot of two bars
SWEEP = {"strain_weft": [0.0], "strain_warp": [0.0, 0.02]}
PLANE_WARNING = "tight loops: wires in space touch after 70 % of the planar approach"
TRICOT_FILE = """
knit = {bars = [{chain = "1-0/1-2"}, {chain = "1-2/1-0"}], wale_spacing = "1 mm", course_spacing = "0.8 mm", repeats = [3, 2]}
model = {boundary = "periodic"}
load = {strain_warp = 0.02}
output = {frames = 1, usd = false}
solver = {preset = "draft"}
sweep = {strain_weft = [0.0], strain_warp = [0.0, 0.02]}
"""


@pytest.fixture
def tricot(tmp_path: Path) -> Path:
    path = tmp_path / "tricot.toml"
    path.write_text(TRICOT_FILE, encoding="utf-8")
    return path


def command(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(main, [str(part) for part in arguments], prog_name="warpknit")
    return done.exit_code, done.stdout + done.stderr


def test_an_open_knit_is_in_the_plane() -> None:
    """The double atlas cell: wires touch in space after 88 % of the planar approach (docs/studies/condensation.md)."""
    scene = load_scene(ATLAS)
    assert first_touch(scene) == pytest.approx(0.88, abs=0.005)
    assert first_touch(scene) > PLANE_IS_GOOD
    assert scene.model.kind == "planar"
    assert scene.kind_reason == (
        "taken by auto: wires in space first touch after 88 % of the planar approach, and the plane is good from 80 % on"
    )
    assert scene.model.nodes_per_loop == PRESETS["standard"].nodes_per_loop and scene.solver.precision == "single"


def test_a_tight_knit_is_in_space_with_the_presets_of_space() -> None:
    """The tricot of docs/studies/condensation.md: 70 %."""
    scene = make_scene(TIGHT)
    assert first_touch(scene) == pytest.approx(0.70, abs=0.005)
    assert scene.model.kind == "spatial"
    assert scene.kind_reason == (
        "taken by auto: wires in space first touch after 70 % of the planar approach; the plane is good from 80 % on"
    )
    for name, preset in PRESETS.items():
        by_auto = make_scene(TIGHT, preset=name)
        given = make_scene(TIGHT, ["model.kind=spatial"], preset=name)
        assert by_auto == given and by_auto.hash == given.hash
        assert by_auto.model.nodes_per_loop == preset.spatial_nodes_per_loop and by_auto.solver.precision == "double"
        assert by_auto.preset_in_force == name


@pytest.mark.parametrize("kind", ["planar", "spatial"])
def test_a_kind_that_is_given_stays(kind: str) -> None:
    for table in (TIGHT, {}):
        scene = make_scene(table, [f"model.kind={kind}"])
        assert (scene.model.kind, scene.kind_reason) == (kind, "as given")


@pytest.mark.parametrize(
    ("tables", "options", "words"),
    [
        ({"solver": {"multipliers": False}}, {}, "no multipliers"),
        ({"solver": {"drive": "ramp"}}, {"ranks": 2}, '`solver.drive = "ramp"` and `mpirun`'),
        ({"model": {"boundary": "gripped"}, "panel": {"focal_length": "1 m"}}, {}, "held on a paraboloid"),
    ],
)
def test_a_tight_knit_is_in_the_plane_where_space_lacks_something(tables: dict, options: dict, words: str) -> None:
    """It says so, and the warning of the plane is raised."""
    scene = make_scene({**TIGHT, **tables}, **options)
    assert scene.model.kind == "planar"
    assert scene.kind_reason.startswith(f"taken by auto: not available in space: {words}; wires in space first touch after 70 %")
    assert any(sentence.startswith(PLANE_WARNING) for sentence in make_plan(scene, "cpu").physics)


@pytest.mark.parametrize(
    ("tables", "command", "kind", "reason"),
    [
        ({"hook": {}}, "", "planar", "two hooked wires, driven in their plane"),
        ({"hook": {}}, "error", "planar", "two hooked wires, driven in their plane"),
        (
            {"hook": {"crossing_distance": "20 um"}},
            "",
            "spatial",
            "not available in the plane: crossing distance of hooked wires",
        ),
        ({"wires": {"file": "plain_knit.csv"}}, "", "spatial", "not available in the plane: wires from a file"),
        ({"wires": {"file": "plain_knit.csv"}}, "trade", "spatial", "not available in the plane: wires from a file"),
        (
            {"contact": {"friction": 0.1}, "sweep": SWEEP},
            "map",
            "spatial",
            "not available in the plane: friction and `warpknit map`; wires in space first touch after 88 %",
        ),
    ],
)
def test_other_meshes_and_what_the_plane_lacks(tables: dict, command: str, kind: str, reason: str) -> None:
    scene = make_scene(tables, path=SCENES / "wires" / "scene.toml", command=command)
    assert scene.model.kind == kind and scene.kind_reason.startswith(f"taken by auto: {reason}")


def test_scattered_loops_are_judged_by_their_mean() -> None:
    """All seeds of a map have one model, although single loops of some touch early."""
    scenes = [make_scene({"knit": {"scatter": 0.1, "seed": seed}}) for seed in range(3)]
    assert {scene.kind_reason for scene in scenes} == {load_scene(ATLAS).kind_reason}


def test_a_large_mesh_is_still_in_space_and_the_reason_says_what_that_takes() -> None:
    """12 loops a tile of 3 x 2 repeats, of 64 nodes each."""
    scene = make_scene(TIGHT, ["knit.repeats=[100, 100]"])
    assert scene.model.kind == "spatial" and 2 * 2 * 100 * 100 * 64 > LARGE
    assert "take hours (`warpknit plan`), model.kind = 'planar' is faster" in scene.kind_reason


def test_a_plan_says_which_model_and_why(tricot: Path) -> None:
    for path, kind in ((tricot, "spatial"), (ATLAS, "planar")):
        scene = load_scene(path)
        planned = make_plan(scene, "cpu")
        (line,) = [line for line in planned.lines() if line.startswith("model ")]
        assert line == f"model      {kind}, {scene.kind_reason}"
        assert planned.as_dict()["model"] == {"kind": kind, "kind_reason": scene.kind_reason}
    code, said = command("plan", tricot, "--set", "model.kind=planar")
    assert code == 0 and "model      planar, as given" in said and PLANE_WARNING in said


def test_a_run_says_which_model_and_resumes_in_it(tricot: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    code, said = command("run", tricot, "--out", out, "--quiet", "--device", "cpu")
    scene = load_scene(tricot)
    assert code == 0 and said.splitlines()[0].split(maxsplit=1) == ["model", f"spatial, {scene.kind_reason}"]
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["model"]["kind"], summary["model"]["kind_reason"]) == ("spatial", scene.kind_reason)
    assert not any("tight loops" in warning for warning in summary["warnings"])
    kept = load_scene(out / "scene.toml", ["name=tricot"])
    assert kept.model.kind == "spatial" and kept.hash == scene.hash == summary["scene"]["hash"]
    code, said = command("run", tricot, "--out", out, "--quiet", "--device", "cpu", "--resume")
    assert code == 0 and scene.kind_reason in said
    code, said = command("run", tricot, "--out", out, "--quiet", "--device", "cpu", "--resume", "--set", "model.kind=planar")
    assert code == 2 and "another scene" in said


def test_an_interrupted_run_goes_on_in_its_model(tricot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = load_scene(tricot, ["output.frames=2", "output.figures=false"])
    parts = assert_parts_are_the_whole(scene, tmp_path, monkeypatch, every=9)
    assert json.loads((parts / "summary.json").read_text())["model"]["kind"] == "spatial"


def test_a_map_in_the_plane_of_a_tight_knit_begins_with_its_warning(tricot: Path, tmp_path: Path) -> None:
    code, said = command("map", tricot, "--out", tmp_path / "map", "--quiet", "--set", "model.kind=planar")
    first, second, *_ = said.splitlines()
    assert code == 0 and first.startswith("warning ") and PLANE_WARNING in first
    assert second.split(maxsplit=1) == ["model", "planar, as given"]
    written = json.loads((tmp_path / "map" / "map.json").read_text())
    assert written["warnings"][0].startswith(PLANE_WARNING)
    assert (written["model"]["kind"], written["model"]["kind_reason"]) == ("planar", "as given")


def test_a_map_of_a_tight_knit_is_in_space(tricot: Path, tmp_path: Path) -> None:
    code, said = command("map", tricot, "--out", tmp_path / "map", "--quiet")
    assert code == 0 and said.splitlines()[0].split(maxsplit=1) == ["model", f"spatial, {load_scene(tricot).kind_reason}"]
    assert json.loads((tmp_path / "map" / "map.json").read_text())["warnings"] == []


def test_a_report_and_its_card_in_the_plane_of_a_tight_knit_begin_with_its_warning(
    tricot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(curves, "POINTS", 2)
    out = tmp_path / "report"
    strains = "[0.08, 0.1]"
    settings = [f"sweep.strain_weft={strains}", f"sweep.strain_warp={strains}", "model.kind=planar", "output.figures=false"]
    code, said = command("report", tricot, "--out", out, "--quiet", *(part for s in settings for part in ("--set", s)))
    assert code == 0 and PLANE_WARNING in said.splitlines()[0]
    page = (out / "report.html").read_text(encoding="utf-8")
    top = page.split("<h1>")[1].split("<p", maxsplit=2)[1]
    assert 'class="warning"' in top and PLANE_WARNING.capitalize() in top
    assert "Model: planar, as given; " in page
    card = json.loads((out / "material_card.json").read_text())
    assert card["warnings"][0].startswith(PLANE_WARNING) and card["model"]["kind"] == "planar"
    header, first, *_ = (out / "material_card.csv").read_text().splitlines()
    assert header == "name,value,unit,meaning" and first.startswith("model_valid,0") and PLANE_WARNING in first


def test_an_error_bound_is_met_in_the_model_that_auto_takes(tmp_path: Path) -> None:
    """On a tight knit that hardly touches: settings of space are found, on a single repeat, and used."""
    table = {**TIGHT, "load": {"strain_warp": 0.01}, "output": {"frames": 1, "usd": False, "figures": False}}
    scene = make_scene(table, command="error")
    assert ProbeRun(scene).small.knit.repeats == (1, 1)
    bound = settings_for_error(scene, 20.0)
    chosen = make_scene(table, bound.overrides, command="error")
    assert chosen.model.kind == "spatial" and chosen.model.nodes_per_loop == bound.setting.nodes_per_loop
    summary = run_scene(chosen, out=tmp_path / "run", device="cpu", error_estimator=bound.error_estimator(scene)).summary
    assert 0.0 <= summary["quality"]["estimated_error"] <= 0.2


def test_how_bodies_are_placed_does_not_change_the_choice() -> None:
    """Nested lenses count as one, whether each has a body or not."""
    assert load_scene(ATLAS, ["model.merge_lenses=false"]).kind_reason == load_scene(ATLAS).kind_reason


@pytest.mark.parametrize("name", NAMED_KNITS)
def test_loops_narrower_than_their_wire_are_refused_of_every_knit(name: str) -> None:
    """At 260 wales an inch the feet of a loop, 0.24 of 98 um apart, are closer than a wire of 30 um."""
    knit = {"bars": [vars(bar) for bar in NAMED_KNITS[name].bars], "wales": "260 /inch", "courses": "60 /inch"}
    scene = load_scene({"wire": {"diameter": "30 um"}, "knit": knit, "model": {"boundary": "periodic"}})
    with pytest.raises(KnitError):
        make_plan(scene)


def test_wires_that_overlap_as_knitted_are_for_space() -> None:
    """At 200 wales an inch all contacts of a single atlas overlap in plan view, so that none has a way to go."""
    knit = {"bars": [{"chain": "1-0/1-2/2-3/3-4/3-2/2-1"}], "wales": "200 /inch", "courses": "30 /inch"}
    scene = load_scene({"wire": {"diameter": "30 um"}, "knit": knit, "model": {"boundary": "periodic"}})
    assert scene.model.kind == "spatial" and "after 0 % of the planar approach" in scene.kind_reason
