"""Whatever ends a run, what was finished is kept: killed at any moment, on a full disk, out of memory."""

import errno
import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from reference.cases import slow
from warpknit.base.files import path_aside
from warpknit.runner.run import run_scene
from warpknit.scene import load_scene

CELL = Path(__file__).parents[1] / "scenes" / "atlas_cell.toml"
QUIET = ("output.usd=false", "output.figures=false", "output.checkpoint_interval=0.01")
OPTIONS = ("solver.preset=draft", "output.frames=10", *QUIET)


def result(folder: Path) -> tuple[str, list[dict[str, np.ndarray]]]:
    """history.csv and all states of a run."""
    states = []
    for path in sorted((folder / "states").glob("*.npz")):
        with np.load(path) as file:
            states.append({name: file[name] for name in file.files})
    return (folder / "history.csv").read_text(), states


def run_in_child(out: Path, kill_after: float | None) -> int | None:
    """Exit status of a run of the cell in another process, None where it was killed."""
    child = os.fork()
    if child == 0:
        status = 99
        try:
            resume = (out / "scene.toml").exists()
            status = run_scene(load_scene(CELL, OPTIONS), out=out, device="cpu", resume=resume).exit_code
        finally:
            os._exit(status)
    if kill_after is not None:
        time.sleep(kill_after)
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return None if os.WIFSIGNALED(status) else os.waitstatus_to_exitcode(status)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize("kills", [4, pytest.param(30, marks=pytest.mark.slow)])
def test_killed_run_goes_on_to_the_same_bits(tmp_path: Path, kills: int) -> None:
    """SIGKILL at random moments: every file is whole, and the resumed run ends as one that nothing happened to."""
    begin = time.perf_counter()
    run_scene(load_scene(CELL, OPTIONS), out=tmp_path / "whole", device="cpu")
    lasts = time.perf_counter() - begin
    expected = result(tmp_path / "whole")
    rng = random.Random(7)
    killed, attempt = 0, 0
    while killed < kills:
        out = tmp_path / f"run{attempt}"
        attempt += 1
        while True:
            status = run_in_child(out, rng.uniform(0.05, 0.6) * lasts if killed < kills else None)
            if status is not None:
                break
            killed += 1
            for path in out.rglob("*.npz"):
                if not path.name.startswith("."):
                    np.load(path).close()
        assert status == 0
        history, states = result(out)
        assert history == expected[0]
        assert len(states) == len(expected[1])
        for a, b in zip(states, expected[1], strict=True):
            assert all(np.array_equal(a[name], b[name]) for name in a)


def command(*arguments: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "warpknit", "run", str(CELL), *arguments], capture_output=True, text=True, check=False, **options
    )


def test_full_disk_is_exit_4_and_keeps_what_was_finished(tmp_path: Path) -> None:
    """On a disk of 300 KiB the run ends with one line; every file there is whole."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("may not mount a small disk")
    try:
        keys = ("output.frames=40", "output.figures=false", "variants.sensitivity=false")
        done = command("--out", str(disk / "run"), "--preset=draft", *(word for key in keys for word in ("--set", key)))
        assert done.returncode == 4
        assert "Traceback" not in done.stderr and done.stderr.splitlines()[-1].startswith("warpknit: ")
        assert not [path for path in disk.rglob("*") if "partial" in path.name]
        kept = sorted((disk / "run" / "states").glob("*.npz"))
        assert kept
        for path in kept:
            np.load(path).close()
        assert json.loads((disk / "run" / "summary.json").read_text())["stop_reason"] == "interrupted"
    finally:
        subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs a limit of address space")
@pytest.mark.parametrize("gibibytes", [1.0, *slow(1.3, 1.4)])
def test_too_little_memory_is_one_line(tmp_path: Path, gibibytes: float) -> None:
    """With a limit of address space a mesh that cannot fit is refused (2), and one that runs out on the way ends with 4. Threads
    take addresses too, so there is one of each kind, whatever the machine."""
    limit = int(gibibytes * 2**30)
    done = command(
        "--out", str(tmp_path / "run"), "--set", "knit.repeats=[60, 60]", "--set", "model.boundary=gripped", "--preset=draft",
        "--set", "output.frames=1", "--set", "load.strain_weft=0.01", "--set", "load.strain_warp=0.01",
        env=os.environ | dict.fromkeys(("WARPKNIT_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1"),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
    )  # fmt: skip
    assert done.returncode in (2, 4), done.stderr
    assert "Traceback" not in done.stderr
    assert "memory" in done.stderr or "available" in done.stderr


def test_an_error_names_the_file_that_was_asked_for(tmp_path: Path) -> None:
    """Not the hidden one beside it, of which the user knows nothing: a disk that takes no changes refuses that one."""
    asked = tmp_path / "scene.toml"
    with pytest.raises(OSError, match="Read-only") as raised, path_aside(asked) as aside:
        raise OSError(errno.EROFS, "Read-only file system", str(aside))
    assert raised.value.filename == str(asked)
