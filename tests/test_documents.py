"""Commands and scenes in the documents are valid, pictures are small, and the site builds without warnings."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from warpknit.cli import main
from warpknit.scene import load_scene

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


def test_pictures_of_guides_are_small() -> None:
    named = {
        picture
        for path in GUIDES
        for picture in re.findall(r"images/((?:tutorial|gallery)[\w/-]+\.png)", path.read_text("utf-8"))
    }
    for picture in named:
        assert (ROOT / "docs" / "images" / picture).stat().st_size < LARGEST, picture


@pytest.mark.slow
def test_the_site_builds_without_warnings(tmp_path: Path) -> None:
    for package in ("sphinx", "myst_parser", "furo", "sphinx_click", "sphinx_copybutton"):
        pytest.importorskip(package, reason=f"{package} is not installed: pip install -e '.[docs]'")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-d", str(tmp_path / "trees")]
    done = subprocess.run(
        [*command, "docs", str(tmp_path / "site")],
        cwd=ROOT, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "index.html").exists()
