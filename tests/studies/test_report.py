"""`warpknit report` as a user makes it: the page, its files, what cannot be given, refusals."""

import csv
import html
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from reference.in_words import quantities
from reference.map_rows import row
from warpknit import __version__
from warpknit.base.errors import Diverged
from warpknit.base.text import duration
from warpknit.commands.cli import main
from warpknit.export import map_figure
from warpknit.results.row import Row
from warpknit.runner.progress_display import StageLines
from warpknit.scene import load_scene
from warpknit.studies import curves
from warpknit.studies.contact_map import LEAST_TOLD, map_row
from warpknit.studies.equal_tension import YIELDED, EqualTensionPath, load_equally, service_points
from warpknit.studies.fe_codes import CODES
from warpknit.studies.findings import DEFAULT_STRAINS, Findings, report_scene
from warpknit.studies.load_path import Meshes, ends_of, exact_model, knitted_worlds
from warpknit.studies.report import _card

SCENES = Path(__file__).parents[2] / "scenes"
MARKERS: list[object] = []  # of the last map that was drawn
PROGRESS: list[tuple[str, int, int]] = []  # stages that were shown: name, number, of how many
SMALL = ["output.frames=3", "sweep.strain_weft=[0.08, 0.12, 0.16]", "sweep.strain_warp=[0.08, 0.12, 0.16]"]


def make_report(out: Path, *arguments: str, scene: str = "contact_map.toml", shown: str = "--quiet"):
    settings = [part for setting in SMALL for part in ("--set", setting)]
    command = ["report", str(SCENES / scene), "--out", str(out), shown, "--preset", "draft", *settings, *arguments]
    return CliRunner().invoke(main, command, prog_name="warpknit")


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    """(page, card, map.csv) for the optimum and for a tension that the mesh carries, made one after the other."""
    out = tmp_path_factory.mktemp("report") / "r"
    found, said, drawn = {}, {}, map_figure.map_figure
    PROGRESS.clear()

    def kept(*arguments, **more):
        MARKERS[:] = more["marks"].places
        return drawn(*arguments, **more)

    stage = StageLines.stage

    def noted(self, name, number, of):
        PROGRESS.append((name, number, of))
        stage(self, name, number=number, of=of)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(curves, "POINTS", 2)
        patch.setattr(map_figure, "map_figure", kept)
        patch.setattr(StageLines, "stage", noted)
        given = {"": (), "0.06 N/m": ("--tension", "0.06 N/m", "--cards", "nastran, radioss")}
        for tension in given:
            done = make_report(
                out, *(["--tension", tension, "--cards", "nastran, radioss"] if tension else []), shown="--verbose"
            )
            assert done.exit_code == 0, done.output
            said[tension] = " ".join(done.output.split())
            page = (out / "report.html").read_text(encoding="utf-8")
            card = json.loads((out / "material_card.json").read_text(encoding="utf-8"))
            found[tension] = page, card, (out / "map.csv").stat().st_mtime_ns
    return out, found, said


def test_the_page_holds_all_it_shows(reports):
    """Every picture is inside, as are the words; nothing is looked for elsewhere."""
    out, found, _ = reports
    page, _, _ = found[""]
    sources = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert len(sources) == 7 and all(source.startswith("data:image/png;base64,") for source in sources)
    page = re.sub(r'"data:image/png;base64,[^"]*"', '""', page)  # which may spell any word
    assert "http" not in page and "@import" not in page and "<script" not in page and "url(" not in page
    for words in ("Active contacts", "Tension against strain", "Material card", "Openings", "resistance", "wire length per loop"):
        assert words in page
    scene = load_scene(out / "scene.toml")
    for words in (f"warpknit {__version__}, 20", scene.hash, "chain 1-0/1-2/2-3/2-1, threading |., shift 0", 'name="viewport"'):
        assert words in page
    assert page.count('<h2 class="new-page">') == 3 and "break-before: page" in page
    assert "nan" not in re.sub(r"data:[^\"]*", "", page).lower().split()
    assert len(list((out / "figures").glob("report_*.png"))) == 7


def test_only_stages_that_run_are_counted(reports):
    """A scene of one temperature has no stage of heat."""
    names = ("tension-strain curves", "equal tensions", "material card", "openings and page")
    assert PROGRESS[-4:] == [(name, number, 4) for number, name in enumerate(names, start=1)]


def test_the_answers_come_first(reports):
    """Where contacts close and wires yield under equal tensions, before anything else; the same in answers.json."""
    out, found, _ = reports
    page, _, _ = found["0.06 N/m"]
    assert page.index("<h2>In short</h2>") < page.index("<h2>The mesh</h2>")
    answers = json.loads((out / "answers.json").read_text(encoding="utf-8"))
    closes = {one["name"]: one["closes"] for one in answers["contacts"]}
    assert closes["A"]["tension_weft_N_per_m"] < closes["B"]["tension_weft_N_per_m"] < 0.06
    assert closes["B"]["tension_weft_N_per_m"] == pytest.approx(closes["B"]["tension_warp_N_per_m"], rel=0.05)
    low, high = (answers["best"][end]["tension_weft_N_per_m"] for end in ("low", "high"))
    assert low < answers["best"]["tension_weft_N_per_m"] < high
    assert f"stress at {100.0 * answers['best']['stress_over_limit']:.0f} % of yield" in page
    served = {point["tension_N_per_m"]: point["active_percent"] for point in answers["service"]}
    assert served[0.06] == pytest.approx(200.0 / 3.0) and served[4.9] is None
    assert "first yield" in page and "class B" in page


def test_the_wall_time_is_that_of_the_whole_report(reports):
    """Map, card and page, each with its part. The second report uses the map and the curves of the first, which take hardly any
    time; the line shows the parts that take some."""
    out, _, said = reports
    report = json.loads((out / "map.json").read_text(encoding="utf-8"))["report"]
    names = ["map", "tension-strain curves", "equal tensions", "material card", "openings and page"]
    assert list(report["stages_s"]) == names and min(report["stages_s"].values()) > 0.0
    assert 0.9 * report["wall_s"] < sum(report["stages_s"].values()) <= report["wall_s"]
    shown = ", ".join(f"{name} {duration(took)}" for name, took in report["stages_s"].items() if took >= LEAST_TOLD)
    assert f"wall time {duration(report['wall_s'], 3)}: {shown} " in said["0.06 N/m"]
    assert re.search(r"wall time [0-9.]+ s: map [0-9.]+ s, tension-strain curves ", said[""])


def test_without_a_tension_the_card_is_for_the_optimum(reports):
    _, found, _ = reports
    page, card, _ = found[""]
    assert page.count(f"<td>{YIELDED}</td>") == 6  # in short, and beside the map
    assert "optimum" in card["state"]


def test_a_tension_that_is_not_found_is_said_and_is_no_success(tmp_path, monkeypatch):
    """A card that was asked for and is missing: exit status 3, one line that says what to change, and the page is there."""
    monkeypatch.setattr(curves, "POINTS", 2)
    done = make_report(tmp_path / "r", "--tension", "1 MN/m", "--set", "solver.max_steps=2000")
    assert done.exit_code == 3 and quantities(done.stderr)[0] == "1 MN/m" and len(done.stderr.splitlines()) == 1
    page = (tmp_path / "r" / "report.html").read_text(encoding="utf-8")
    assert "1 MN/m" in quantities(page) and not (tmp_path / "r" / "material_card.json").exists()


def test_an_optimum_that_is_not_found_again_is_marked_so(tmp_path, monkeypatch):
    """Page, table and picture say it, and what to ask for."""
    monkeypatch.setattr(curves, "POINTS", 2)

    def no_card(*_, **__):
        raise Diverged("a wire is lost")

    monkeypatch.setattr("warpknit.studies.report.find_mean", no_card)
    done = make_report(tmp_path / "r", shown="--verbose")
    assert done.exit_code == 0
    page = html.unescape((tmp_path / "r" / "report.html").read_text(encoding="utf-8"))
    for text in (done.stdout, page):
        assert "a wire is lost" in text
    assert re.search(r"<th>optimum strain, weft / warp</th><td>[^<]*, not found again</td>", page)
    (line,) = re.findall(r"^map +(9 .*)$", done.stdout, re.MULTILINE)
    assert quantities(line) == ["9", "8 %", "16 %", "8 %", "16 %"]


def test_the_loads_of_the_default_map_are_said_to_be_so():
    rows = [row(x, y, (1.0, 1.0)) for x in DEFAULT_STRAINS for y in DEFAULT_STRAINS]
    scene = report_scene(load_scene(SCENES / "atlas_cell.toml"))
    text = Findings.sweep_text.fget(SimpleNamespace(rows=rows, by_tension=False, scene=scene))
    assert quantities(text) == ["121", "0 %", "20 %", "0 %", "20 %"]


def test_curves_with_missing_states_are_told_on_the_terminal():
    point = Row(tension_weft_N_per_m=0.01)
    curves, bare = [point, point.changed(tension_weft_N_per_m=None)], {"card": None, "branch_notes": [], "limit_of_curves": []}
    (warning,) = Findings.warnings.fget(SimpleNamespace(**bare, curves=curves))
    assert warning.code == "W58" and warning.text.startswith("1 of 2 states")
    assert Findings.warnings.fget(SimpleNamespace(**bare, curves=curves[:1])) == []


@pytest.mark.slow
def test_a_report_without_its_card_keeps_an_earlier_one(tmp_path, monkeypatch):
    """All files of the report with the card at 30 mN/m are the same, byte for byte, after one that finds no card; the reason is
    told once."""
    monkeypatch.setattr(curves, "POINTS", 2)
    out = tmp_path / "r"
    assert make_report(out, "--tension", "0.03 N/m").exit_code == 0
    kept = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}

    def no_card(*_, **__):
        raise Diverged("a wire is lost")

    monkeypatch.setattr("warpknit.studies.report.find_mean", no_card)
    done = make_report(out, "--tension", "0.06 N/m", "--areal-mass", "10 g/m^2")
    assert done.exit_code == 3 and done.stderr.count("a wire is lost") == 1
    assert "a wire is lost" not in done.stdout and len(done.stderr.splitlines()) == 1
    assert {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()} == kept


def test_a_tension_within_reach_is_the_prestress_of_the_card(reports):
    out, found, _ = reports
    _, card, _ = found["0.06 N/m"]
    assert card["values"]["prestress1"] == pytest.approx(0.06, rel=5e-3)
    assert card["values"]["prestress2"] == pytest.approx(0.06, rel=5e-3)
    with open(out / "material_card.csv", newline="", encoding="utf-8") as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    assert {name: float(row["value"]) for name, row in rows.items()} == card["values"]
    assert rows["stress_over_yield"]["value"] == str(card["values"]["stress_max"] / card["values"]["yield_stress"])
    assert card["quality"]["positive_definite"] and rows["C33"]["unit"] == "N/m"


def test_the_fe_codes_that_were_asked_for_get_a_card(reports):
    """All of them for the optimum; of those only that of the second report is left, with its prestress. Radioss has curves alone,
    and the weft contracts while its tension rises to 60 mN/m, as the page says."""
    out, found, said = reports
    files = {name: code.file for name, code in CODES.items()}
    assert found[""][1]["fe_cards"] == files
    page, card, _ = found["0.06 N/m"]
    none, _, why = card["fe_cards"].pop("radioss").partition(": ")
    assert card["fe_cards"] == {"nastran": files["nastran"]} and none == "none" and "weft" in why
    assert why in page and why in said["0.06 N/m"] and why not in said[""] and "(FABRIC)" not in found[""][0] + said[""]
    assert {path.name for path in out.iterdir()} & set(files.values()) == {files["nastran"]}
    assert "--out" in said["0.06 N/m"] and "--out" not in said[""]  # the earlier card was replaced
    bulk = (out / files["nastran"]).read_text(encoding="ascii").replace("\n$ ", " ")
    assert f"Prestress: {1e-3 * card['values']['prestress1']:.9g} MPa in weft" in bulk


def test_card_service_table_and_marker_have_one_source(reports):
    """The strains and the share of the card, rounded alike, in its text, its table, the service table and the legend."""
    _, found, _ = reports
    page, card, _ = found["0.06 N/m"]
    values = card["values"]
    weft, warp, share = (f"{100 * values[name]:.1f} %" for name in ("prestrain1", "prestrain2", "active"))
    strains, in_words = f"{weft} / {warp}", f"{weft} weft, {warp} warp"
    assert f"<th>60 mN/m</th><td>{strains}</td><td>{share}</td>" in page
    assert page.count(strains) + page.count(in_words) >= 3 and page.count(share) >= 3
    assert f"<th>prestrain1</th><td>{100 * values['prestrain1']:.1f}</td>" in page
    assert f"<th>active</th><td>{100 * values['active']:.1f}</td>" in page
    assert [
        (f"60 mN/m: {in_words}, {share} active", (values["prestrain1"], values["prestrain2"]), 100 * values["active"])
    ] == MARKERS


def test_service_points_are_equilibria_and_not_interpolated(reports):
    """The service tension of the scene, 0.06 N/m, is where the card of that tension is, within the tolerance of the run; the
    bilinear map of three strains a side is a quarter of a percent of strain away."""
    out, found, _ = reports
    values = found["0.06 N/m"][1]["values"]
    scene = load_scene(out / "scene.toml")
    scene = replace(scene, output=replace(scene.output, service_tension=0.06))
    path = load_equally(exact_model(scene, scene.solver.residual_tolerance), 0.06)
    point = service_points(scene, path, (), None, None)[0]
    assert point.strains == pytest.approx((values["prestrain1"], values["prestrain2"]), abs=5e-4)
    assert 0.01 * point.row.active_percent == pytest.approx(values["active"])


def test_the_map_that_is_there_is_used_again(reports):
    _, found, _ = reports
    assert found[""][2] == found["0.06 N/m"][2]


def test_a_further_tension_uses_the_states_that_are_there(reports, tmp_path, monkeypatch):
    """Neither the curves nor the path under equal tensions are computed again; the card is that of a report of this tension
    alone, whose path is the same."""
    out, found, _ = reports

    def again(*_, **__):
        raise AssertionError("computed again")

    kept = tmp_path / "r"
    shutil.copytree(out, kept)
    for name in ("report.tension_strain", "equal_tension.load_equally"):
        monkeypatch.setattr(f"warpknit.studies.{name}", again)
    done = make_report(kept, "--tension", "0.06 N/m", "--cards", "nastran")
    assert done.exit_code == 0, done.output
    values = json.loads((kept / "material_card.json").read_text(encoding="utf-8"))["values"]
    assert values == found["0.06 N/m"][1]["values"]
    assert (kept / "tension_strain.csv").read_bytes() == (out / "tension_strain.csv").read_bytes()


def test_a_card_at_a_tension_that_only_the_map_has_is_of_its_state():
    """The path under equal tensions ended at once; the map has 60 mN/m in weft and warp."""
    sweep = ['sweep={tension_weft=["60 mN/m"], tension_warp=["60 mN/m"]}', "output.frames=3"]
    scene = load_scene(SCENES / "contact_map.toml", sweep, "draft")
    model = exact_model(scene, scene.solver.residual_tolerance)
    pair = scene.sweep.pairs[0]
    ((_, end),) = ends_of(knitted_worlds([model], [[scene.sweep.stage(scene.stages[0], pair)]], [scene.output.levels]))
    cell = map_row(pair, end, steps=1, by_tension=True)
    path = EqualTensionPath(ended="level 1 did not converge")
    found, text, loading = _card(scene, Meshes.of(model), [cell], None, path, [], 0.06, lambda _: None)
    card = found.card
    assert quantities(text) == ["60 mN/m"] and card.branch == ""
    assert (card.strain_weft, card.strain_warp) == pytest.approx((cell.strain_weft, cell.strain_warp), abs=1e-12)
    assert (card.tension_weft, card.tension_warp) == pytest.approx((0.06, 0.06), rel=scene.solver.residual_tolerance)
    assert loading[-2].strain_weft == cell.strain_weft
    assert _card(scene, Meshes.of(model), [], None, path, [], 0.06, lambda _: None)[0] is None


def test_the_curves_are_a_table(reports):
    out, *_ = reports
    with open(out / "tension_strain.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["load"] for row in rows] == ["both"] * 3 + ["weft_alone"] * 3 + ["warp_alone"] * 3
    assert float(rows[2]["tension_weft_N_per_m"]) > float(rows[5]["tension_weft_N_per_m"]) > 0.0
    assert rows[0]["sheet_resistance_weft_ohm"] == ""  # no contact, no current across


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--tension", "2 kg"), "--tension"),
        (("--tension", "-1 N/m"), "--tension"),
        (("--cards", "nastran,marc"), "--cards"),
        (("--set", "model.boundary=gripped"), "model.boundary"),
        (("--set", "solver.drive=ramp"), "solver.drive"),
    ],
)
def test_what_cannot_be_reported_is_refused(tmp_path, arguments, said):
    done = make_report(tmp_path / "r", *arguments)
    assert done.exit_code == 2 and said in done.stderr and len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "r").exists()


def test_another_mesh_in_the_directory_is_refused(reports):
    out, *_ = reports
    done = make_report(out, "--set", "wire.diameter=20 um")
    assert done.exit_code == 2 and "--force" in done.stderr and len(done.stderr.splitlines()) == 1
