"""Runs under mpirun with two ranks, as a user makes them: the same files as one rank leaves, kills, interrupts, errors.

What strips do step by step is tested without MPI in test_strips.py.
"""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from reference.cases import slow
from warpknit.commands.cli import main

SCENES = Path(__file__).parents[1] / "scenes"
MPIRUN = shutil.which("mpirun", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]))
needs_mpi = pytest.mark.skipif(
    importlib.util.find_spec("mpi4py") is None or MPIRUN is None, reason='needs mpi4py and mpirun: pip install "warpknit[mpi]"'
)
SMALL = ("--set", "knit.repeats=[2, 2]", "--set", "model.nodes_per_loop=12")
PATCH = (str(SCENES / "atlas_patch.toml"), "--preset=draft", "--device=cpu", *SMALL)
FACET = str(SCENES / "reflector_facet.toml")
KINDS = {
    "planar": ("--set", "output.figures=false"),
    "spatial": ("--set", "model.kind=spatial", "--set", "model.nodes_per_loop=20"),
}
QUIET = ("--set", "output.usd=false", "--set", "output.figures=false")
FEW = ("--set", "output.frames=2")
PATIENCE = 240  # [s] for what takes some seconds: a rank that hangs is a failure, not the end of the suite

# the command line with a fault put in: rank 1 runs out of memory at its fifth convergence check
OUT_OF_MEMORY = """
import sys
from warpknit.runner import monitor
from warpknit.commands.cli import main
original, checks = monitor.Monitor._check, 0
def fail(self, progress):
    global checks
    checks += 1
    if checks == 5 and self._ranks.rank == 1:
        raise MemoryError("40 GiB needed, 1 GiB available")
    original(self, progress)
monitor.Monitor._check = fail
main(sys.argv[1:])
"""


def command(*arguments: object, ranks: int = 2, code: str | None = None) -> list[str]:
    program = ["-m", "warpknit"] if code is None else ["-c", code]
    launcher = [str(MPIRUN), "-n", str(ranks)] if ranks > 1 else []
    return [*launcher, sys.executable, *program, *map(str, arguments)]


def run(*arguments: object, ranks: int = 2, code: str | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command(*arguments, ranks=ranks, code=code), capture_output=True, text=True, check=False, timeout=PATIENCE,
        env=os.environ | environment,
    )  # fmt: skip


def states(folder: Path) -> list[dict[str, np.ndarray]]:
    return [dict(np.load(path)) for path in sorted((folder / "states").glob("*.npz"))]


def assert_same_states(folder: Path, expected: Path) -> None:
    found, wanted = states(folder), states(expected)
    assert len(found) == len(wanted) > 0
    for a, b in zip(found, wanted, strict=True):
        assert all(np.array_equal(a[name], b[name]) for name in b)


def one_line(text: str) -> str:
    """The one line that warpknit said; what the launcher itself says does not count."""
    lines = [line for line in text.splitlines() if line.startswith("warpknit:")]
    assert len(lines) == 1 and "Traceback" not in text, text
    return lines[0]


@pytest.fixture(scope="module")
def alone(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[str, ...]]:
    """What one process leaves, and the settings of its model."""
    out, kind = tmp_path_factory.mktemp("alone") / "r", KINDS[request.param]
    assert run("run", *PATCH, *FEW, *kind, "--out", out, ranks=1).returncode == 0
    return out, kind


@needs_mpi
@pytest.mark.parametrize("alone", ["planar", *slow("spatial")], indirect=True)
def test_two_ranks_leave_what_one_leaves(tmp_path: Path, alone: tuple[Path, tuple[str, ...]]) -> None:
    """The same files; states and layout to the bit, the summary but for sums over the mesh, which are added in another order."""
    out, (expected, kind) = tmp_path / "r", alone
    done = run("run", *PATCH, *FEW, *kind, "--out", out)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("active contacts") == 1
    names = [{str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()} for folder in (out, expected)]
    assert names[0] == names[1]
    assert_same_states(out, expected)
    assert (out / "layout.npz").read_bytes() == (expected / "layout.npz").read_bytes()
    summaries = [json.loads((folder / "summary.json").read_text()) for folder in (out, expected)]
    assert [summary["solver"].pop("ranks") for summary in summaries] == [2, 1]
    for summary in summaries:
        for measured in ("wall_s", "compile_s", "node_steps_per_s"):
            del summary["solver"][measured]
    assert_near(*summaries)


def assert_near(found: object, expected: object) -> None:
    """The same tree; numbers within what single precision leaves of sums over its bodies that stand in another order."""
    if isinstance(expected, dict):
        assert isinstance(found, dict) and found.keys() == expected.keys()
        for key, value in expected.items():
            assert_near(found[key], value)
    elif isinstance(expected, list):
        assert isinstance(found, list) and len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            assert_near(one, other)
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=1e-5, abs=0)
    else:
        assert found == expected


@needs_mpi
@pytest.mark.slow
@pytest.mark.parametrize("load", ["", 'load.pull=[{at=["6 mm", "0 mm"], by=["20 um", "0 mm"]}]'])
def test_a_facet_on_cords_is_the_same_on_two_ranks(tmp_path: Path, load: str) -> None:
    """Stations of the cord, heights of the paraboloid, corrections as a membrane: the same bits as one process."""
    facet = ("panel.size=6 mm", "panel.grip_pitch=3 mm", "output.usd=false", *([load] if load else ["load.strain_weft=0.09"]))
    changes = [part for change in facet for part in ("--set", change)]
    for ranks in (1, 2):
        done = run("run", FACET, "--preset", "draft", *changes, "--out", tmp_path / str(ranks), ranks=ranks)
        assert done.returncode == 0, done.stderr
    assert_same_states(tmp_path / "2", tmp_path / "1")


@needs_mpi
@pytest.mark.parametrize(("alone", "kills"), [("planar", 1), *slow(("planar", 2), ("spatial", 2))], indirect=["alone"])
def test_killed_ranks_go_on_to_the_same_bits(tmp_path: Path, alone: tuple[Path, tuple[str, ...]], kills: int) -> None:
    """SIGKILL to the launcher, which takes its ranks along, at several moments: every file is whole, the run goes on with as many
    ranks, is refused with another number, and ends like one that nothing happened to."""
    out, (expected, kind) = tmp_path / "r", alone
    arguments = ("run", *PATCH, *FEW, *QUIET, *kind, "--set", "output.checkpoint_interval=0.02", "--out", out)
    for attempt in range(kills):
        process = subprocess.Popen(
            command(*arguments, *(["--resume"] if attempt else [])), stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True,
            start_new_session=True,
        )  # fmt: skip
        deadline = time.monotonic() + PATIENCE
        known = stamp(out)
        while stamp(out) in (None, known) and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(0.05 * attempt)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait(timeout=PATIENCE)
        wait_for_ranks_to_end(out)
        for path in out.rglob("*.npz"):
            if not path.name.startswith("."):
                np.load(path).close()
    assert stamp(out) is not None, "the run ended before it could be killed"
    refused = CliRunner().invoke(main, [*map(str, arguments), "--resume"])
    assert refused.exit_code == 2
    assert "2 ranks" in one_line(refused.stderr)
    done = run(*arguments, "--resume")
    assert done.returncode == 0, done.stderr
    assert_same_states(out, expected)


def stamp(out: Path) -> int | None:
    """When the checkpoint in force was written."""
    path = out / "checkpoint" / "checkpoint.npz"
    return path.stat().st_mtime_ns if path.exists() else None


def wait_for_ranks_to_end(out: Path) -> None:
    """Until no process works on `out` any more."""
    import psutil

    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        lines = [" ".join(p.info["cmdline"] or []) for p in psutil.process_iter(["cmdline", "pid"]) if p.pid != os.getpid()]
        if not any(str(out) in line for line in lines):
            return
        time.sleep(0.05)
    raise AssertionError("ranks outlived their launcher")


@needs_mpi
def test_ctrl_c_ends_all_ranks_with_a_checkpoint(tmp_path: Path) -> None:
    """SIGINT to mpirun: exit status 130, one line, a checkpoint that goes on."""
    out = tmp_path / "r"
    arguments = ("run", *PATCH, "--set", "output.frames=100", *QUIET, "--out", out)
    process = subprocess.Popen(command(*arguments), stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    deadline = time.monotonic() + PATIENCE
    while not list(out.glob("states/*.npz")) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130, errors
    assert "--resume" in one_line(errors)
    assert json.loads((out / "summary.json").read_text())["stop_reason"] == "interrupted"
    assert {path.name for path in (out / "checkpoint").iterdir()} == {"checkpoint.npz", "strip_00001_turn_1.npz"}


@needs_mpi
@pytest.mark.slow
def test_an_error_on_one_rank_ends_all(tmp_path: Path) -> None:
    """Rank 1 runs out of memory while rank 0 waits for it: exit status 4 and the line of rank 1, soon."""
    done = run("run", *PATCH, *FEW, *QUIET, "--out", tmp_path / "r", code=OUT_OF_MEMORY)
    assert done.returncode == 4
    assert "40 GiB needed" in one_line(done.stderr)


@needs_mpi
@pytest.mark.parametrize(
    ("ranks", "arguments", "status", "says"),
    [
        (2, ("--set", "load.strain_wft=0.1"), 2, "strain_wft"),
        *slow(
            (3, ("--set", "knit.repeats=[1, 1]", "--set", "model.boundary=periodic"), 2, "knit.repeats: 2 wires "),
            (2, ("--set", "solver.max_steps=100"), 3, "max_steps"),
        ),
    ],
)
def test_an_error_on_all_ranks_is_said_once(
    tmp_path: Path, ranks: int, arguments: tuple[str, ...], status: int, says: str
) -> None:
    done = run("run", *PATCH, *QUIET, *arguments, "--out", tmp_path / "r", ranks=ranks)
    assert done.returncode == status
    assert says in one_line(done.stderr)


@needs_mpi
@pytest.mark.slow
def test_other_commands_speak_once() -> None:
    done = run("plan", *PATCH, "--json")
    assert done.returncode == 0
    assert json.loads(done.stdout)["nodes"] > 0


def test_ranks_without_mpi4py_are_refused(tmp_path: Path) -> None:
    """Started as one of two ranks, but mpi4py is not there: exit status 2 and what to install, from the first rank only."""
    code = "import sys; sys.modules['mpi4py'] = None; from warpknit.commands.cli import main; main(sys.argv[1:])"
    for rank in range(2):
        done = run("run", *PATCH, "--out", tmp_path / "r", ranks=1, code=code, PMI_RANK=str(rank), PMI_SIZE="2")
        assert done.returncode == 2
        assert done.stderr == "" if rank else 'pip install "warpknit[mpi]"' in one_line(done.stderr)
