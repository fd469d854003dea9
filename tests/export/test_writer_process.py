"""Frames written by another process: the same files, a bounded memory, and an end of it whatever happens."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
from pxr import Usd

from reference.cases import slow
from warpknit.base.errors import OutOfResources
from warpknit.export import writer_process
from warpknit.export.writer_process import FrameFiles, FrameWriter, StageOptions, WriterProcess, frame_writer
from warpknit.results.frame import Frame, WireLayout

pytestmark = pytest.mark.skipif(os.name != "posix", reason="the writer is a process on POSIX systems only")

STAGE = StageOptions(
    scene_name="zigzag", scene_hash="0123", version="1.0", colour_stress_max=5e8, full_every=1, points_per_tile=500_000
)
CELL = Path(__file__).parents[2] / "scenes" / "atlas_cell.toml"
# The program with every run large enough for a writer process.
PROGRAM = (
    "import sys; from warpknit.export import writer_process as w; w.PROCESS_NODES = 0; "
    "from warpknit.commands.cli import main; main(sys.argv[1:])"
)


@pytest.fixture
def frames(make_frame: Callable[..., Frame]) -> list[Frame]:
    return [make_frame(index) for index in range(4)]


@pytest.fixture
def directory(tmp_path: Path, layout: WireLayout) -> Path:
    layout.save(tmp_path / "run" / "layout.npz")
    return tmp_path / "run"


def write(writer: FrameWriter, frames: list[Frame]) -> None:
    with writer:
        for frame in frames:
            writer.add_frame(frame)
        writer.close(complete=True)


def wait_until(condition: Callable[[], bool], seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def is_gone(pid: int) -> bool:
    return not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE


@pytest.mark.parametrize("in_space", [False, True])
def test_it_leaves_the_same_files(
    in_space: bool, tmp_path: Path, layout: WireLayout, space_layout: WireLayout, frames: list[Frame],
    make_space_frame: Callable[..., Frame],
) -> None:  # fmt: skip
    """Also of records with contacts elsewhere, of which there are more than nodes, then none."""
    directory = tmp_path / "run"
    if in_space:
        layout, frames = space_layout, [make_space_frame(index, count) for index, count in enumerate((0, 2, 20_000, 0))]
    layout.save(directory / "layout.npz")
    write(WriterProcess(directory, layout, STAGE), frames)
    write(FrameFiles(tmp_path / "here", layout, STAGE), frames)
    expected = {path.relative_to(tmp_path / "here") for path in (tmp_path / "here").rglob("*") if path.is_file()}
    found = {path.relative_to(directory) for path in directory.rglob("*") if path.is_file()}
    assert found == expected | {Path("layout.npz")} and len(expected) == 3 + 2 * len(frames)
    for name in expected:
        if name.suffix != ".npz":
            assert (directory / name).read_bytes() == (tmp_path / "here" / name).read_bytes(), name
            continue
        with np.load(directory / name) as a, np.load(tmp_path / "here" / name) as b:
            assert a.files == b.files and all(np.array_equal(a[key], b[key]) for key in a.files)


def test_small_meshes_and_runs_without_a_stage_write_themselves(
    directory: Path, layout: WireLayout, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert isinstance(frame_writer(directory, layout, STAGE, resume=False), FrameFiles)
    monkeypatch.setattr(writer_process, "PROCESS_NODES", 0)
    assert isinstance(frame_writer(directory, layout, None, resume=False), FrameFiles)
    with frame_writer(directory, layout, STAGE, resume=False) as writer:
        assert isinstance(writer, WriterProcess)


def test_memory_is_flat_in_frames(directory: Path, make_frame: Callable[..., Frame]) -> None:
    """The memory of both processes after 4 and after 16 frames of 13 MB differs by less than a frame."""
    nodes, wires = 100, 4000
    layout = WireLayout(
        wire_start=np.arange(wires + 1) * nodes, wire_closed=np.zeros(wires, dtype=bool), period=np.ones(2), diameter=1e-5,
        body_radius=1e-6, body_wires=np.zeros((0, 2), dtype=int), rhombus_bodies=np.zeros(0, dtype=int),
    )  # fmt: skip
    layout.save(directory / "layout.npz")
    position = np.random.default_rng(1).normal(size=(wires * nodes, 3))
    frame = replace(
        make_frame(0), node_position=position, node_stress=position[:, 0] ** 2, body_position=np.zeros((0, 3)),
        pair_force=np.zeros(0), pair_active=np.zeros(0, dtype=bool),
    )  # fmt: skip
    used = []
    with WriterProcess(directory, layout, STAGE) as writer:
        for index in range(16):
            writer.add_frame(replace(frame, index=index))
            if index in (3, 15):
                writer.flush()
                used.append(sum(psutil.Process(pid).memory_info().rss for pid in (writer.pid, os.getpid())))
        writer.close(complete=True)
    assert used[1] - used[0] < position.nbytes + frame.node_stress.nbytes


def test_killed_writer_is_an_error_of_one_line(directory: Path, layout: WireLayout, frames: list[Frame]) -> None:
    with WriterProcess(directory, layout, STAGE) as writer:
        writer.add_frame(frames[0])
        writer.flush()
        os.kill(writer.pid, signal.SIGKILL)
        with pytest.raises(OutOfResources, match="signal 9") as caught:
            wait_until(lambda: writer.check() is not None)  # until it raises
        assert "\n" not in str(caught.value)
        with pytest.raises(OutOfResources):
            writer.add_frame(frames[1])
    stage = Usd.Stage.Open(str(directory / "scene.usda"))
    assert list(stage.GetRootLayer().customLayerData["warpknit"]["frames"]) == [0]


def test_what_goes_wrong_there_is_raised_here(directory: Path, layout: WireLayout, frames: list[Frame]) -> None:
    (directory / "states").write_text("in the way")
    with WriterProcess(directory, layout, STAGE) as writer:
        writer.add_frame(frames[0])
        with pytest.raises(FileExistsError) as caught:
            writer.flush()
        assert caught.value.filename == str(directory / "states")
        pid = writer.pid
    assert is_gone(pid)


def test_frame_that_is_not_finite_is_refused(directory: Path, layout: WireLayout, frames: list[Frame]) -> None:
    with WriterProcess(directory, layout, STAGE) as writer:
        writer.add_frame(replace(frames[0], node_stress=np.full(layout.node_count, np.nan)))
        with pytest.raises(ValueError, match="frame 0: node_stress "):
            writer.flush()
    assert sorted(path.name for path in directory.iterdir()) == ["layout.npz"]


def test_stage_that_lost_frames_is_completed_from_the_states(directory: Path, layout: WireLayout, frames: list[Frame]) -> None:
    """A run that goes on leaves no gap: the stage gets what it lacks before the frame that is new."""
    write(WriterProcess(directory, layout, STAGE), frames[:3])
    (directory / "frames" / "wires.000001.usdc").unlink()
    write(WriterProcess(directory, layout, STAGE, resume=True), frames[3:])
    stage = Usd.Stage.Open(str(directory / "scene.usda"))
    assert list(stage.GetRootLayer().customLayerData["warpknit"]["frames"]) == [0, 1, 2, 3]
    assert len(list((directory / "frames").glob("*.usdc"))) == 4


# --- runs of the program ----------------------------------------------------------------------------------------------


def start(out: Path, *arguments: str) -> subprocess.Popen[str]:
    options = ("--preset=draft", "--set", "output.figures=false", "--set", "variants.sensitivity=false", "--device=cpu")
    command = [sys.executable, "-c", PROGRAM, "run", str(CELL), "--out", str(out), *options, *arguments]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


def writer_of(run: subprocess.Popen[str]) -> psutil.Process:
    """The writer among the processes that the run has started."""
    found: list[psutil.Process] = []

    def has_started() -> bool:
        for child in psutil.Process(run.pid).children():
            with suppress(psutil.NoSuchProcess):
                if "warpknit.export.writer_process" in child.cmdline():
                    found.append(child)
        return bool(found)

    wait_until(has_started)
    return found[0]


FRAMES = ("--set", "output.frames=12", "--set", "output.checkpoint_interval=0.01")


@pytest.fixture(scope="module")
def whole_run(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The files of the frames of a run that nothing happens to."""
    out = tmp_path_factory.mktemp("whole") / "run"
    assert start(out, *FRAMES).wait() == 0
    return {path.name: path for path in (out / "frames").iterdir()}


@pytest.mark.parametrize("number", [signal.SIGINT, *slow(signal.SIGKILL)])
def test_interrupted_and_killed_runs_leave_no_process_and_a_whole_stage(
    tmp_path: Path, whole_run: dict[str, Path], number: int
) -> None:
    """And go on to the states of a run that nothing happened to, with every frame in the stage."""
    out = tmp_path / "run"
    run = start(out, *FRAMES)
    writer = writer_of(run)
    wait_until((out / "frames" / "wires.000003.usdc").exists)
    os.kill(run.pid, number)
    assert run.wait() == (130 if number == signal.SIGINT else -signal.SIGKILL)
    wait_until(lambda: is_gone(writer.pid))
    assert not [path for path in out.rglob("*.usd*") if path.name.startswith(".")]
    stage = Usd.Stage.Open(str(out / "scene.usda"))
    named = list(stage.GetRootLayer().customLayerData["warpknit"]["frames"])
    assert named == list(range(len(named))) and len(named) >= 4
    del stage
    assert start(out, *FRAMES, "--resume").wait() == 0
    resumed = {path.name: path for path in (out / "frames").iterdir()}
    assert sorted(whole_run) == sorted(resumed) and len(whole_run) == 13
    assert all(whole_run[name].read_bytes() == resumed[name].read_bytes() for name in whole_run)


def test_run_whose_writer_is_killed_ends_with_4(tmp_path: Path) -> None:
    """One line, at once: not at the next record."""
    run = start(tmp_path / "run", "--quiet", "--set", "output.frames=40")
    writer = writer_of(run)
    wait_until((tmp_path / "run" / "frames" / "wires.000001.usdc").exists)
    writer.kill()
    assert run.wait(120) == 4
    assert run.stderr is not None
    error = run.stderr.read()
    assert error.count("\n") == 1 and "signal 9" in error


def test_full_disk_in_the_writer_is_exit_4(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(disk)], check=False).returncode:
        pytest.skip("may not mount a small disk")
    try:
        run = start(disk / "run", "--set", "output.frames=40", "--set", "model.nodes_per_loop=16")
        assert run.wait() == 4
        assert run.stderr is not None
        error = run.stderr.read()
        assert "Traceback" not in error and error.splitlines()[-1].startswith("warpknit: ")
        assert not [path for path in disk.rglob("*") if "partial" in path.name]
        for path in (disk / "run" / "states").glob("*.npz"):
            np.load(path).close()
        assert json.loads((disk / "run" / "summary.json").read_text())["stop_reason"] == "interrupted"
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_two_runs_do_not_write_into_one_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from warpknit.base.errors import RunDirectoryError
    from warpknit.base.files import held_directory
    from warpknit.runner import run as run_module
    from warpknit.scene import load_scene

    monkeypatch.setattr(run_module, "LOCK_TIMEOUT", 0.0)
    with held_directory(tmp_path, 0.0), pytest.raises(RunDirectoryError, match="--out"):
        run_module.run_scene(load_scene(CELL), out=tmp_path, device="cpu")
