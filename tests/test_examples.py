"""Examples in README.md, the documents and the docstrings at the door run as they stand."""

import doctest
import inspect
import os
import re
import subprocess
import sys
import textwrap
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import warpknit
from warpknit.measure.table import Record
from warpknit.results.run import Run
from warpknit.scene import Scene, load_scene, resolved_toml

ROOT = Path(__file__).parents[1]
QUICK = {"solver.preset": "draft", "output.frames": 2, "output.usd": False}
EXTRAS = {"docs/how-to/browser.md": "viser"}  # pages whose examples need a package of an extra
BLOCK = re.compile(r"(<!-- script -->\n)?```python\n(.*?)```", re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the scenes that examples name, at a small size."""
    folder = tmp_path_factory.mktemp("examples")
    (folder / "scenes").mkdir()
    sweep = {"sweep.strain_weft": [0.04, 0.08, 0.12], "sweep.strain_warp": [0.04, 0.08, 0.12]}
    for name, more in (("atlas_cell", {}), ("contact_map", sweep), ("hook_spatial", {})):
        scene = load_scene(ROOT / "scenes" / f"{name}.toml", QUICK | more if name != "hook_spatial" else more)
        (folder / "scenes" / f"{name}.toml").write_text(resolved_toml(scene))
    warpknit.run(folder / "scenes" / "atlas_cell.toml", folder / "finished", quiet=True)
    return folder


@pytest.fixture
def fresh(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A working directory with these scenes, and with one finished run."""
    (tmp_path / "scenes").symlink_to(folder / "scenes")
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "atlas_cell").symlink_to(folder / "finished")
    monkeypatch.chdir(tmp_path)


def blocks(name: str, *, scripts: bool) -> list[str]:
    text = (ROOT / name).read_text(encoding="utf-8")
    return [code for script, code in BLOCK.findall(text) if bool(script) == scripts]


def documents_with_examples() -> list[str]:
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    names = [path.relative_to(ROOT).as_posix() for path in pages if "_build" not in path.parts]
    return [name for name in names if blocks(name, scripts=False)]


@pytest.mark.usefixtures("fresh")
@pytest.mark.parametrize("name", documents_with_examples())
def test_blocks_of_a_document_run_in_their_order(name: str) -> None:
    if name in EXTRAS:
        pytest.importorskip(EXTRAS[name], reason="an extra is not installed")
    names: dict = {}
    found = blocks(name, scripts=False)
    assert found
    for code in found:
        exec(compile(code, name, "exec"), names)


def test_the_study_uses_several_processes(folder: Path) -> None:
    """The script of docs/python.md, in ten lines of its own."""
    (code,) = blocks("docs/python.md", scripts=True)
    assert len([line for line in code.splitlines() if line.strip() and "import" not in line]) <= 10
    (folder / "study.py").write_text(code)
    done = subprocess.run(
        [sys.executable, "study.py"], cwd=folder, capture_output=True, text=True, timeout=300,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    diameters, tensions = np.array([line.split() for line in done.stdout.splitlines()], dtype=float).T
    assert diameters.tolist() == [12, 15, 20, 27] and np.all(np.diff(tensions) > 0.0)


DOCTESTS = [path for path in sorted((ROOT / "warpknit").rglob("*.py")) if ">>> " in path.read_text(encoding="utf-8")]


@pytest.mark.parametrize("path", DOCTESTS, ids=lambda path: path.stem)
def test_doctests_of_a_module_give_what_they_say(path: Path) -> None:
    module = import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
    done = doctest.testmod(module)
    assert done.attempted > 0 and done.failed == 0


def examples(item: object) -> list[str]:
    """The indented paragraphs of a docstring."""
    paragraphs = re.split(r"\n\s*\n", inspect.getdoc(item) or "")
    return [textwrap.dedent(text) for text in paragraphs if all(line.startswith("    ") for line in text.splitlines())]


DOCUMENTED = {name: getattr(warpknit, name) for name in (*dir(warpknit), "scene", "errors") if name != "__version__"}


@pytest.mark.usefixtures("fresh")
@pytest.mark.parametrize("name", ["warpknit", *DOCUMENTED])
def test_an_example_of_a_docstring_runs(name: str) -> None:
    found = examples(warpknit if name == "warpknit" else DOCUMENTED[name])
    assert found, "no example"
    run_examples(found, name)


RETURNED = [Scene, Scene.changed, Run, Record]


@pytest.mark.usefixtures("fresh")
@pytest.mark.parametrize("item", RETURNED, ids=lambda item: item.__qualname__)
def test_examples_of_what_they_return_run(item: object) -> None:
    found = examples(item)
    assert found, "no example"
    run_examples(found, str(item))


def run_examples(found: list[str], name: str) -> None:
    """Run examples with the names that they take for granted."""
    scene = load_scene("scenes/atlas_cell.toml")
    names = vars(warpknit) | DOCUMENTED | {"warpknit": warpknit, "np": np, "scene": scene}
    for code in found:
        exec(compile(code, name, "exec"), names)
