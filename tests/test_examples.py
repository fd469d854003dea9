"""Examples in README.md, the documents and the public docstrings run as they stand."""

import doctest
import inspect
import os
import re
import runpy
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
from warpknit.scene import Scene, load_scene, resolved_toml, scene_loader
from warpknit.scene.presets import PRESETS

ROOT = Path(__file__).parents[1]
QUICK = {"solver.preset": "draft", "output.frames": 2, "output.usd": False}
SMALLEST = '"output.frames": 1, "output.figures": False, "output.usd": False, "variants.sensitivity": False'
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
    """A working directory with these scenes, and with one finished run. What they leave to the defaults is quick."""
    (tmp_path / "scenes").symlink_to(folder / "scenes")
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "atlas_cell").symlink_to(folder / "finished")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(PRESETS, "standard", PRESETS["draft"])
    monkeypatch.setattr(scene_loader, "VARIANTS", 1)


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


@pytest.mark.slow
def test_the_study_uses_several_processes(folder: Path) -> None:
    """The script of docs/python.md, in ten lines of its own."""
    (code,) = blocks("docs/python.md", scripts=True)
    assert len([line for line in code.splitlines() if line.strip() and "import" not in line]) <= 10
    (folder / "study.py").write_text(code.replace('"output.frames": 4', SMALLEST))
    done = subprocess.run(
        [sys.executable, "study.py"], cwd=folder, check=False, capture_output=True, text=True, timeout=300,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    diameters, tensions = np.array([line.split() for line in done.stdout.splitlines()], dtype=float).T
    assert diameters.tolist() == [12, 15, 20, 27] and np.all(np.diff(tensions) > 0.0)


SCRIPTS = ROOT / "docs" / "examples"
MOLYBDENUM = 320e9  # [Pa]


@pytest.fixture
def rows(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> list:
    """The lines of numbers that a script prints, as lists of floats."""
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(SCRIPTS / f"{request.param}.py"))
    lines = [re.findall(r"(?<![\w.])-?\d+\.?\d*", line) for line in capsys.readouterr().out.splitlines()]
    return [[float(number) for number in line] for line in lines if line]


@pytest.mark.parametrize("path", sorted(SCRIPTS.glob("*.py")), ids=lambda path: path.stem)
def test_a_script_is_short(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) < 40


@pytest.mark.parametrize("rows", ["tile_under_tension"], indirect=True)
def test_a_tile_is_given_its_tension(rows: list) -> None:
    tension, weft, warp, active, stress = np.array(rows).T
    assert tension[[0, -1]].tolist() == [0.0, 2.0]
    assert all(np.all(np.diff(column) > 0.0) for column in (tension, weft, warp, stress)) and np.all(np.diff(active) >= 0.0)


@pytest.mark.parametrize("rows", ["map_as_array"], indirect=True)
def test_a_map_is_an_array(rows: list) -> None:
    """(warp, weft) in %: most contacts close at the largest strain in weft."""
    active = np.array([row for row in rows if len(row) == 3][1:4])
    assert active.shape == (3, 3) and active[0, 0] == 0.0
    assert np.all(np.diff(active, axis=1) >= 0.0) and rows[-1][:2] == [active.max(), 12.0]


@pytest.mark.slow
@pytest.mark.parametrize("rows", ["study_over_diameter"], indirect=True)
def test_thinner_wire_bears_more_stress(rows: list) -> None:
    """At equal tensions; more tension gives more stress."""
    diameter, tension, _, stress = (column.reshape(3, 3) for column in np.array(rows).T)
    assert diameter[:, 0].tolist() == [20.0, 25.0, 30.0] and tension[0].tolist() == [0.5, 1.0, 2.0]
    assert np.all(np.diff(stress, axis=0) < 0.0) and np.all(np.diff(stress, axis=1) > 0.0)


@pytest.mark.parametrize("rows", ["wires_from_arrays"], indirect=True)
def test_a_weave_is_softer_than_straight_wires(rows: list) -> None:
    """Three by three wires touch at nine crossings; straight ones would carry EA times the strain, over their pitch."""
    *_, (load, tension, crossings, force) = rows[1:]
    straight = MOLYBDENUM * np.pi / 4 * (100e-6) ** 2 * 1e-3 / 1e-3  # [N/m]
    assert (load, crossings) == (100.0, 9.0) and force > 0.0
    assert 0.3 * straight < tension < straight


@pytest.mark.slow
@pytest.mark.parametrize("rows", ["measure_and_force"], indirect=True)
def test_a_stretched_patch_is_stiffer_across(rows: list) -> None:
    strain, tension, deflection, stiffness = np.array(rows).T
    assert strain.tolist() == [0.0, 3.0, 6.0] and np.all(np.diff(tension) > 0.0)
    assert np.all(np.diff(stiffness) > 0.0)
    assert deflection * stiffness == pytest.approx(100.0, rel=0.02)  # [uN]


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
