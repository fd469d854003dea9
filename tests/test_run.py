"""Runs as a user makes them: what a run leaves, interrupts, refusals, resumption to the same bits."""

from __future__ import annotations

import contextlib
import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from reference.cases import slow
from warpknit.base.errors import Diverged, OutOfResources, RunDirectoryError
from warpknit.compute.device import compile_times
from warpknit.measure.table import MEASURES
from warpknit.results.row import Row, read_rows
from warpknit.runner import monitor, recorder
from warpknit.runner.monitor import Monitor
from warpknit.runner.progress_display import Display
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene

SCENES = Path(__file__).parents[1] / "scenes"
QUICK = ["output.frames=4", "solver.preset=draft", "output.usd=false", "output.figures=false"]


def cell(*overrides: str):
    return load_scene(SCENES / "atlas_cell.toml", [*QUICK, *overrides])


def states(directory: Path) -> list[dict[str, np.ndarray]]:
    return [dict(np.load(path)) for path in sorted((directory / "states").glob("*.npz"))]


def test_run_leaves_the_files_of_the_contract(tmp_path: Path) -> None:
    """Every file and every summary key that scripts rely on is there, and no number is missing."""
    run = run_scene(load_scene(SCENES / "atlas_cell.toml", ["output.frames=3", "solver.preset=draft"]), out=tmp_path / "r")
    assert run.exit_code == 0
    for name in ("summary.json", "history.csv", "scene.toml", "scene.usda", "figures/mesh.png", "figures/curves.png"):
        assert (tmp_path / "r" / name).stat().st_size > 0
    summary = json.loads((tmp_path / "r" / "summary.json").read_text())
    expected = {
        "scene": {"name", "hash"},
        "model": {"kind", "kind_reason", "boundary", "precision", "wires", "nodes", "repeats", "bodies", "pairs"},
        "solver": {"time_step_s", "steps", "wall_s", "compile_s", "node_steps_per_s", "mass_scaling", "axial_softening",
                   "preset"},
        "quality": {"kinetic_to_internal", "energy_balance", "residual", "penetration_max", "estimated_error"},
        "contacts": {"pairs", "active", "active_percent", "force_max_N", "force_mean_N", "threshold_N", "central_rhombus"},
        "wire": {"stress_max_Pa", "stress_p99_Pa", "yield_fraction", "axial_strain_max"},
        "mesh": {"tension_weft_N_per_m", "tension_warp_N_per_m", "strain_weft", "strain_warp", "temperature_K",
                 "areal_mass_kg_per_m2"},
    }  # fmt: skip
    for table, keys in expected.items():
        assert keys <= summary[table].keys(), table
    assert summary["stop_reason"] == "steady"
    assert [stage["name"] for stage in summary["stages"]] == ["load"]
    assert not math.isnan(summary["quality"]["energy_balance"])


def test_two_runs_agree_to_the_bit(tmp_path: Path) -> None:
    """Sums have a fixed order on the CPU."""
    for name in ("a", "b"):
        run_scene(cell(), out=tmp_path / name, device="cpu")
    for a, b in zip(states(tmp_path / "a"), states(tmp_path / "b"), strict=True):
        assert all(np.array_equal(a[key], b[key]) for key in a)


class Rates(Display):
    """Keeps the rates that a run shows."""

    def __init__(self) -> None:
        self.shown: list[float | None] = []

    def update(self, *, done: float, load_factor: float, node_steps_per_s: float | None = None, now: str = "") -> None:
        self.shown.append(node_steps_per_s)


@pytest.mark.parametrize("drive", ["relax", "relax by tension", "ramp"])
def test_interrupt_and_resume_give_the_same_bits(tmp_path: Path, drive: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that is interrupted and resumed equals one that was not. The rate it shows is of the steps since then."""
    extra = [f"solver.drive={drive.split(maxsplit=1)[0]}"]
    if drive == "ramp":
        extra += ['solver.loading_time="1 ms"', "solver.damping=30000", "solver.residual_tolerance=0.05"]
    elif drive == "relax by tension":
        extra += ["load.tension_weft=0.05", "load.tension_warp=0.05", "output.frames=1"]
    scene = cell(*extra)
    run_scene(scene, out=tmp_path / "whole", device="cpu")
    original = Monitor._check
    checks = 0

    def interrupt_once(self: object, progress: object) -> None:
        nonlocal checks
        checks += 1
        if checks in (7, 21):
            self.interrupts.request()
        original(self, progress)

    monkeypatch.setattr(Monitor, "_check", interrupt_once)
    first = run_scene(scene, out=tmp_path / "parts", device="cpu")
    assert (
        first.exit_code == 130
        and first.summary.json()["stop_reason"] == "interrupted" == first.message == first.summary.json()["message"]
    )
    with pytest.raises(RunDirectoryError, match="--resume"):
        run_scene(scene, out=tmp_path / "parts", device="cpu")
    second = run_scene(scene, out=tmp_path / "parts", device="cpu", resume=True)
    assert second.exit_code == 130
    monkeypatch.setattr(monitor, "DISPLAY_INTERVAL", 0.0)
    rates = Rates()
    assert run_scene(scene, out=tmp_path / "parts", device="cpu", resume=True, progress=rates).exit_code == 0
    assert rates.shown[0] is None and None not in rates.shown[1:]
    assert (tmp_path / "whole" / "history.csv").read_text() == (tmp_path / "parts" / "history.csv").read_text()
    for a, b in zip(states(tmp_path / "whole"), states(tmp_path / "parts"), strict=True):
        assert all(np.array_equal(a[key], b[key]) for key in a)


@wp.kernel(module="unique")
def do_nothing() -> None:
    pass


def test_only_what_this_process_compiles_counts_as_compilation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a module in an empty cache, and of the same one read from it, while others write there."""
    monkeypatch.setattr(wp.config, "kernel_cache_dir", str(tmp_path))
    counts = []
    for _ in range(2):
        with compile_times() as times:
            do_nothing.module.unload()
            (tmp_path / f"of_another_process_{len(counts)}").write_text("")
            wp.launch(do_nothing, dim=1, device="cpu")
        counts.append(len(times))
    assert counts == [1, 0]


@pytest.mark.parametrize("kind", [*slow("planar"), "spatial"])
def test_a_run_loads_its_kernels_before_it_starts(kind: str) -> None:
    """Else their compilation would count as time of the run. In a new process, which has loaded nothing."""
    script = f"""
from types import SimpleNamespace
import warp as wp
from warpknit import Simulation, build_model, load_scene

scene = load_scene({str(SCENES / "atlas_cell.toml")!r}, {{"model.kind": {kind!r}, "output.frames": 20}})
simulation = Simulation(build_model(scene))
simulation.compile()
said = []
wp.set_logger(SimpleNamespace(debug=print, info=said.append, warning=print, error=print))
wp.config.log_level = wp.LOG_INFO
records = [record for record, _ in zip(simulation.run(), range(2))]
assert records[-1].steps > 0 and not said, said
"""
    subprocess.run([sys.executable, "-c", script], check=True)


def test_finished_run_is_never_lost(tmp_path: Path) -> None:
    """A finished directory is refused without --force, and --resume of it runs nothing."""
    run_scene(cell(), out=tmp_path / "r", device="cpu")
    before = (tmp_path / "r" / "summary.json").read_text()
    with pytest.raises(RunDirectoryError, match="--force"):
        run_scene(cell(), out=tmp_path / "r", device="cpu")
    assert run_scene(cell(), out=tmp_path / "r", device="cpu", resume=True).exit_code == 0
    assert (tmp_path / "r" / "summary.json").read_text() == before
    for resume in (True, False):
        with pytest.raises(RunDirectoryError, match="with another load.strain_weft;"):
            run_scene(cell("load.strain_weft=0.03"), out=tmp_path / "r", device="cpu", resume=resume)
    assert run_scene(cell(), out=tmp_path / "r", device="cpu", force=True).exit_code == 0


def test_resume_of_nothing_is_told_to_be_a_new_run(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert run_scene(cell("output.frames=1"), out=tmp_path / "new", device="cpu", resume=True).exit_code == 0
    (said,) = [record for record in caplog.records if "no checkpoint" in record.message]
    assert said.levelname == "WARNING" and str(tmp_path / "new") in said.message


def test_foreign_directory_is_refused(tmp_path: Path) -> None:
    """A directory with somebody's files is not written into."""
    (tmp_path / "thesis.tex").write_text("x")
    with pytest.raises(RunDirectoryError, match="thesis.tex"):
        run_scene(cell(), out=tmp_path, device="cpu")


def test_ctrl_c_ends_with_130_and_a_checkpoint(tmp_path: Path) -> None:
    """SIGINT to the program: exit status 130, one line, a checkpoint, no traceback."""
    command = [sys.executable, "-m", "warpknit", "run", str(SCENES / "atlas_patch.toml"), "--out", str(tmp_path / "r"),
               "--device", "cpu", "--set", "output.usd=false", "--set", "output.figures=false"]  # fmt: skip
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=os.environ)
    deadline = time.monotonic() + 120
    while not list((tmp_path / "r").glob("states/*.npz")) and time.monotonic() < deadline:
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "--resume" in errors and "Traceback" not in errors
    assert (tmp_path / "r" / "checkpoint" / "checkpoint.npz").is_file()
    assert json.loads((tmp_path / "r" / "summary.json").read_text())["stop_reason"] == "interrupted"


INTERRUPTED_IMPORT = """
import os, signal, sys
class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name == "pxr.UsdGeom":
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
from warpknit.commands.cli import main
main()
"""


@pytest.mark.slow
def test_ctrl_c_while_usd_is_imported_is_not_lost(tmp_path: Path) -> None:
    """USD's import keeps exceptions to itself: the request must wait for the first check."""
    arguments = ["run", str(SCENES / "atlas_cell.toml"), "--preset", "draft", "--out", str(tmp_path / "r"), "--device", "cpu"]
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED_IMPORT, *arguments], check=False, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 130 and "--resume" in done.stderr


def test_divergence_ends_with_3_and_no_nan(tmp_path: Path) -> None:
    """A level that is never steady stops with one line; what was recorded stays whole."""
    run = run_scene(cell("solver.max_steps=200"), out=tmp_path / "r", device="cpu")
    assert run.exit_code == 3 and "max_steps" in run.message and "\n" not in run.message
    assert run.summary.stop_reason == "diverged" and "did not converge" in run.message
    assert "NaN" not in (tmp_path / "r" / "summary.json").read_text()
    for state in states(tmp_path / "r"):
        assert all(np.isfinite(value).all() for value in state.values() if value.dtype.kind == "f")


ENDINGS = ("interrupted", "interrupted again", "diverged", "resumed, then diverged", "out of memory")


@pytest.mark.parametrize("records", [2, 4])
@pytest.mark.parametrize("ending", ENDINGS)
def test_the_summary_has_the_last_record_however_a_run_ends(
    tmp_path: Path, ending: str, records: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Right after the second record, in the first load step, and after the first one of the second load step: the summary has
    the values of the last row of history.csv, and is the same for each ending."""
    path = "path=[{name='more', strain_weft=0.12, strain_warp=0.1}]"
    scene, original = cell(path, "output.frames=2"), Monitor._check

    def interrupt(self: Monitor, progress: object) -> None:
        if self.simulation.progress.records == records:
            self.interrupts.request()
        original(self, progress)

    def fail(self: Monitor, progress: object) -> None:
        if self.simulation.progress.records == records:
            raise Diverged("it failed")
        original(self, progress)

    def end(check: object, *, resume: bool = False) -> int:
        monkeypatch.setattr(Monitor, "_check", check)
        return run_scene(scene, out=tmp_path / "r", device="cpu", resume=resume).exit_code

    def summary() -> dict[str, object]:
        return json.loads((tmp_path / "r" / "summary.json").read_text())

    assert end(interrupt) == 130
    first = summary()
    if ending == "interrupted again":
        assert end(interrupt, resume=True) == 130
    elif ending == "resumed, then diverged":
        assert end(fail, resume=True) == 3
    elif ending == "diverged":
        (tmp_path / "r").rename(tmp_path / "interrupted")
        assert end(fail) == 3
    elif ending == "out of memory":
        monkeypatch.setattr(recorder, "available_memory", lambda: 0)
        with pytest.raises(OutOfResources):
            end(original, resume=True)
    found, rows = summary(), read_rows(tmp_path / "r" / "history.csv", Row)
    assert len(rows) == records and found["stop_reason"] == ("diverged" if "diverged" in ending else "interrupted")
    assert [stage["name"] for stage in found["stages"]] == ["load", "more"][: 1 + (records > 3)]
    measured = [line for line in MEASURES if line.summary and line.history and line.name in vars(rows[-1])]
    assert {line.summary for line in measured} == {"mesh", "contacts", "wire", "quality"}
    for line in measured:
        assert found[line.summary][line.name] == vars(rows[-1])[line.name], line.name
    assert found["stages"][-1]["mesh"] == found["mesh"] and found["mesh"]["strain_weft"] > 0.0
    for group in ("mesh", "contacts", "wire", "quality", "stages", "answers", "jumps", "warnings"):
        assert found[group] == first[group], group


def test_the_summary_has_the_last_record_after_an_interrupt_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second Ctrl-C stops two records behind the checkpoint; a resumed run begins there again, and so do its rows."""
    scene, original, out = cell("output.frames=3"), Monitor._check, tmp_path / "r"

    def records_of_a_part(until: int, requests: int, *, resume: bool) -> int:
        def interrupt(self: Monitor, progress: object) -> None:
            for _ in range(requests if self.simulation.progress.records == until else 0):
                self.interrupts.request()
            original(self, progress)

        monkeypatch.setattr(Monitor, "_check", interrupt)
        with contextlib.suppress(KeyboardInterrupt):
            assert run_scene(scene, out=out, device="cpu", resume=resume).exit_code == 130
        found, rows = json.loads((out / "summary.json").read_text()), read_rows(out / "history.csv", Row)
        assert found["stop_reason"] == "interrupted" and found["mesh"]["strain_weft"] == rows[-1].strain_weft
        assert found["contacts"]["force_max_N"] == rows[-1].contact_force_max_N
        return len(rows)

    assert records_of_a_part(1, 1, resume=False) == 1
    assert records_of_a_part(3, 2, resume=True) == 3
    assert records_of_a_part(1, 1, resume=True) == 1
