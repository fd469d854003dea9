"""Commands, scenes, links and keys in the documents are valid, studies have dates, and the site builds without warnings."""

import inspect
import json
import os
import re
import shlex
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from inspect import get_annotations
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import pytest

from warpknit.base.text import exact
from warpknit.commands.cli import main
from warpknit.measure import table
from warpknit.reflection.table import LeastTension, LossRow
from warpknit.results.finding import KINDS
from warpknit.results.row import Row, Values
from warpknit.runner.answers import Answers
from warpknit.runner.other_model import FIGURES
from warpknit.runner.run import run_scene
from warpknit.runner.summary import ERRORS, panel_of
from warpknit.runner.variants import Means, Spread
from warpknit.scene import load_scene
from warpknit.scene.keys import keys_below
from warpknit.scene.materials import MATERIALS
from warpknit.scene.scene import SceneFile

ROOT = Path(__file__).parents[1]
PAGES = [path for path in sorted((ROOT / "docs").rglob("*.md")) if "_build" not in path.parts]
GUIDES = [path for path in PAGES if path.parent.name in ("tutorials", "how-to") or path.name in ("start.md", "index.md")]
HELP = main.context_settings  # click keeps the help option that a context is first asked for
LARGEST = 150_000  # [bytes] of a picture of a tutorial or the gallery


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def blocks(path: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", path.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("path", [ROOT / "README.md", *GUIDES], ids=name_of)
def test_commands_have_the_options_that_a_page_gives(path: Path) -> None:
    """And the scenes that they name exist, in the repository or on the page."""
    text = path.read_text(encoding="utf-8")
    for block in blocks(path, "bash"):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            if "warpknit" not in words[:4]:
                continue
            words = words[words.index("warpknit") + 1 :]
            if words[:1] == ["--version"]:
                continue
            command = main.commands[words[0]]
            command.make_parser(command.make_context(words[0], [], resilient_parsing=True, **HELP)).parse_args(list(words[1:]))
            for scene in re.findall(r"\S+\.toml", " ".join(words)):
                assert (ROOT / scene).exists() or f"`{scene}`" in text, f"{scene} is nowhere"


@pytest.mark.parametrize("path", [path for path in GUIDES if blocks(path, "toml")], ids=name_of)
def test_scenes_of_a_page_are_valid(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    for text in blocks(path, "toml"):
        load_scene(text)


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_links_of_a_page_lead_somewhere(path: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)", path.read_text(encoding="utf-8")):
        assert target.startswith("https://") or (path.parent / target).exists(), target


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_no_line_of_a_page_is_a_comment_by_chance(path: Path) -> None:
    """The site leaves out a line that begins with %."""
    assert not re.search(r"^\s*%", path.read_text(encoding="utf-8"), re.MULTILINE)


def test_pictures_of_guides_are_small() -> None:
    named = {
        picture
        for path in GUIDES
        for picture in re.findall(r"images/((?:tutorial|gallery)[\w/-]+\.png)", path.read_text("utf-8"))
    }
    for picture in named:
        assert (ROOT / "docs" / "images" / picture).stat().st_size < LARGEST, picture


def test_every_scene_is_in_the_gallery_with_picture_and_time() -> None:
    text = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    for path in [*(ROOT / "scenes").glob("*.toml"), *(ROOT / "scenes" / "wires").glob("*.toml")]:
        (section,) = re.findall(rf"^## {path.stem}\n(.*?)(?=^## |\Z)", text, re.DOTALL | re.MULTILINE)
        assert f"images/gallery/{path.stem}.png" in section, path.stem
        assert re.search(r"^Time: [\d.]+ (s|min)$", section, re.MULTILINE), path.stem


def test_studies_have_a_date() -> None:
    for path in (ROOT / "docs" / "studies").glob("*.md"):
        if path.name != "index.md":
            third = path.read_text(encoding="utf-8").split("\n")[2]
            assert re.match(r"\*Record of \d+ \w+ \d{4}: warpknit [\d.]+, ", third), path


# --- keys


def test_every_key_of_a_scene_stands_once() -> None:
    """A `[[path]]` has the keys of `[load]`, which stand without the name of their table."""
    text = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
    tables = re.findall(r"^<!-- keys of .*?-->\n(.*?)^<!-- end of keys -->", text, re.DOTALL | re.MULTILINE)
    found = Counter(name for rows in tables for name in re.findall(r"^\| `([\w.\[\]]+)` \|", rows, re.MULTILINE))
    keys = [name.replace("[0]", "[]") for name, entry in keys_below(SceneFile) if entry.table is None]
    assert found == Counter(name.removeprefix("load.") for name in keys if not name.startswith("path[]."))


def reference_of(section: str) -> list[str]:
    """Names with a meaning in the tables of a section of docs/reference/summary.md, sorted."""
    text = (ROOT / "docs/reference/summary.md").read_text(encoding="utf-8")
    part = text.partition(f"\n## {section}\n")[2].partition("\n## ")[0]
    return sorted(re.findall(r"^\| `([^`]+)` \| \S", part, re.MULTILINE))


def keys_of(kind: type, before: str = "") -> Iterator[str]:
    """Keys of a section of results, from the fields of its type and of the types in it."""
    for part in reversed(kind.__mro__[: kind.__mro__.index(Row if issubclass(kind, Row) else Values)]):
        types = get_type_hints(part)
        for name in get_annotations(part):
            yield f"{before}{name}"
            for inner, place in types_in(types[name]):
                if name != "first_yield_interior" and inner.__module__ != Row.__module__:
                    yield from keys_of(inner, f"{before}{name}{place}.")


def types_in(hint: Any) -> Iterator[tuple[type, str]]:
    """The types of values in a type: in a sequence at the place `[]`, else at ``."""
    if isinstance(hint, type) and issubclass(hint, Values):
        yield hint, ""
    for inner in get_args(hint):
        yield from ((one, "[]" if get_origin(hint) is Sequence else place) for one, place in types_in(inner))


def test_every_key_of_a_result_stands_once_with_a_meaning() -> None:
    """None is missing, none is left of a key that is gone."""
    assert reference_of("answers") == sorted([*keys_of(Answers), *keys_of(LeastTension, "reflection[].")])
    assert reference_of("variants") == sorted([*keys_of(Spread), *keys_of(Means)])
    assert reference_of("spatial_model") == sorted(["meshes", *FIGURES])
    assert reference_of("reflection.csv") == sorted(get_annotations(LossRow))
    columns = {line.name for line in table.MEASURES if line.history or line.map}
    of_first_class = (name for name in columns if not re.search(r"_[B-Z]_(percent|N)$", name))
    assert reference_of("history.csv and map.csv") == sorted(of_first_class)
    summary = reference_of("summary.json")
    measures = {f"{line.summary}.{line.name}" for line in table.MEASURES if line.summary}
    groups = {name.partition(".")[0] for name in measures}
    errors = ["quality.estimated_error", *(f"quality.estimated_errors.{name}" for name in ERRORS)]
    assert [name for name in summary if name.partition(".")[0] in groups] == sorted([*measures, *errors])
    of_panel = re.findall(r'^ {8,12}"(\w+)":', inspect.getsource(panel_of), re.MULTILINE)
    assert sorted(of_panel) == sorted(name.rpartition(".")[2] for name in summary if name.startswith("panel."))
    assert max(Counter(summary).values()) == 1


def test_every_warning_has_its_meaning_and_its_advice() -> None:
    """In docs/reference/warnings.md, where contents list the codes by rank."""
    text = (ROOT / "docs/reference/warnings.md").read_text(encoding="utf-8")
    sections = re.findall(r"^### (W\d\d): (.+)\n\n\S[^#]*?\n\n\*\*Advice\.\*\* (.+)$", text, re.MULTILINE)
    assert {code: advice for code, _, advice in sections} == {code: advice for code, (_, advice) in KINDS.items()}
    titles = {code: title for code, title, _ in sections}
    for rank, part in enumerate(text.partition("## General limits")[0].split("\n**")[1:]):
        codes = [code for code, (other, _) in KINDS.items() if other == rank]
        assert re.findall(r"^- \[(.*?)\]\(#(.*?)\) (.*)$", part, re.MULTILINE) == [
            (code, code.lower(), titles[code]) for code in codes
        ]


def paths_of(part: dict[str, Any], before: str = "") -> Iterator[str]:
    """Keys of a nested dict, joined by points."""
    for name, value in part.items():
        yield from paths_of(value, f"{before}{name}.") if isinstance(value, dict) else [f"{before}{name}"]


@pytest.mark.parametrize(
    ("scene", "overrides"),
    [
        ("atlas_cell", ("solver.preset=draft", "load.strain_weft=0.01", "load.strain_warp=0.01", "wire.plastic=true")),
        ("hook_free_body", ("solver.preset=draft", "load.displacement=0.1 mm")),
    ],
)
def test_every_key_of_a_summary_is_in_its_reference(scene: str, overrides: tuple[str, ...], tmp_path: Path) -> None:
    quick = ("output.frames=1", "output.figures=false", "output.usd=false")
    run_scene(load_scene(ROOT / "scenes" / f"{scene}.toml", [*overrides, *quick]), out=tmp_path / "run", device="cpu")
    found = json.loads((tmp_path / "run" / "summary.json").read_text(encoding="utf-8"))
    known = set(reference_of("summary.json"))
    keys = {name for name in paths_of(found) if not name.startswith(("answers.", "contacts.central_rhombus.", "spatial_model."))}
    assert keys - known == set()
    if found["answers"] is not None:
        assert set(found["answers"]) == set(get_annotations(Answers))


@pytest.mark.slow
def test_the_site_builds_without_warnings(tmp_path: Path) -> None:
    for package in ("sphinx", "myst_nb", "furo", "sphinx_click", "sphinx_copybutton"):
        pytest.importorskip(package, reason=f"{package} is not installed: pip install -e '.[docs]'")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-d", str(tmp_path / "trees")]
    done = subprocess.run(
        [*command, "docs", str(tmp_path / "site")],
        cwd=ROOT, check=False, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "index.html").exists()


def test_the_assumed_limits_of_the_materials_are_those_of_the_code() -> None:
    page = (ROOT / "docs/scenes.md").read_text(encoding="utf-8")
    for name, material in MATERIALS.items():
        assert f"| {name} | {exact(material.yield_stress, 'Pa')} | {exact(material.tensile_strength, 'Pa')} |" in page
