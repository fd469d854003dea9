"""The public API: `load_scene`, `build_model`, `initial_state`, `Simulation` give on every scene what `warpknit run` gives."""

import pydoc
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import warpknit
from reference.cases import slow
from warpknit.base.errors import DeviceError, InputError
from warpknit.results.row import Row, read_rows
from warpknit.runner.history import row_of
from warpknit.runner.run import run_scene
from warpknit.solve.model import build_model, mechanics_of

SCENES = Path(__file__).parents[1] / "scenes"
SMALL = ["output.usd=false", "output.figures=false"]
COARSE = [*SMALL, "solver.preset=draft", "model.nodes_per_loop=40", "load.strain_weft=0.02", "load.strain_warp=0.02"]


@pytest.mark.parametrize(
    ("scene", "settings"),
    [
        ("atlas_cell.toml", [*SMALL, "solver.preset=draft", "output.frames=2"]),
        *slow(("atlas_cell.toml", [*SMALL, "solver.preset=draft", "output.frames=2", "solver.drive=ramp"])),
        ("atlas_patch.toml", [*SMALL, "solver.preset=draft", "output.frames=1", "knit.repeats=[2, 2]"]),
        ("hook_free_body.toml", [*SMALL, "output.frames=2"]),
        ("atlas_cell_spatial.toml", [*COARSE, "output.frames=1"]),
        ("atlas_cell_spatial.toml", [*COARSE, "output.frames=1", "solver.drive=ramp", "solver.loading_time='0.3 ms'"]),
        ("hook_spatial.toml", [*SMALL, "output.frames=1", "load.displacement='0.2 mm'"]),
    ],
    ids=lambda value: value if isinstance(value, str) else next((o for o in value if "drive" in o), ""),
)
def test_a_simulation_gives_what_run_gives(tmp_path: Path, scene: str, settings: list[str]) -> None:
    """To the bit, in all columns of history.csv that come from one state alone."""
    loaded = warpknit.load_scene(SCENES / scene, settings)
    model = warpknit.build_model(loaded)
    records = list(warpknit.Simulation(model, warpknit.initial_state(model)).run())
    ending = run_scene(loaded, out=tmp_path / "run", device="cpu")
    rows = read_rows(tmp_path / "run" / "history.csv", Row)
    assert ending.exit_code == 0 and ending.summary.json()["model"]["kind"] == loaded.model.kind
    assert len(rows) == len(records)
    around = rows[-1].active_rhombus_percent  # empty where there is no opening to count around, as in the summary
    assert (around is None) == (model.panel.rhombus_bodies.size == 0)
    assert ending.summary.json()["contacts"]["central_rhombus"]["active_percent"] == around
    accounted = {"work_J", "slide_left_m", "slide_right_m"}  # from row to row
    for row, record in zip(rows, records, strict=True):
        found, columns = row_of(record), vars(row).keys() - accounted
        assert {name: row[name] for name in columns} == {name: found[name] for name in columns}


def test_the_model_is_of_the_kind_that_the_scene_asks_for() -> None:
    for kind in ("planar", "spatial"):
        model = build_model(warpknit.load_scene(SCENES / "atlas_cell.toml", [f"model.kind={kind}", "solver.precision=double"]))
        assert type(model).__module__.split(".")[1] == kind
        assert type(mechanics_of(model, warpknit.initial_state(model))).__module__.split(".")[1] == kind


def test_the_door_lists_its_names_and_imports_little() -> None:
    """Exactly these, and nothing heavy until it is asked for."""
    names = {"load_scene", "build_model", "initial_state", "Simulation", "run", "run_map", "make_report", "load_run"}
    assert set(dir(warpknit)) == names | {"wires_from_arrays", "measure", "scene", "errors", "Run", "Scene", "__version__"}
    heavy = ("warp", "numpy", "scipy", "pydantic", "matplotlib", "pandas")
    code = f"import sys, warpknit; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
    with pytest.raises(AttributeError, match="'plot'"):
        _ = warpknit.plot


def test_errors_import_as_a_module_of_the_package() -> None:
    code = "from warpknit.base.errors import SceneError; import warpknit; assert SceneError is warpknit.errors.SceneError"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_function_run_is_no_module() -> None:
    """Submodules that are imported later do not take the place of a public name."""
    for name in sorted(path.stem for path in Path(warpknit.__file__).parent.iterdir()):
        assert name in ("measure", "scene", "errors") or name not in dir(warpknit)


def test_the_documents_name_nothing_that_the_door_has_not() -> None:
    """Each can be had in a process of its own, before anything else is imported."""
    text = (Path(__file__).parents[1] / "docs" / "python.md").read_text(encoding="utf-8")
    named = sorted(set(re.findall(r"\bwarpknit\.([A-Za-z_]\w*)", text)))
    assert {"errors", "load_scene", "run"} <= set(named)
    code = f"import warpknit; print([name for name in {named} if not hasattr(warpknit, name)])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (lambda: warpknit.build_model(warpknit.load_scene({}), device="gpu"), DeviceError, "device: 'gpu'"),
        (lambda: warpknit.build_model(None), InputError, "build_model: None"),
        (lambda: warpknit.initial_state(None), InputError, "initial_state: None"),
        (lambda: warpknit.Simulation(None), InputError, "Simulation: None"),
    ],
)
def test_a_wrong_argument_is_one_line(call: Callable, error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=f"^{said}"):
        call()


def test_help_shows_every_name_with_its_text() -> None:
    page = pydoc.plain(pydoc.render_doc(warpknit))
    for name in ("load_scene", "run", "run_map", "make_report", "load_run", "build_model", "initial_state", "class Simulation"):
        assert name in page
    assert "probes" in page and "SceneError" in page
