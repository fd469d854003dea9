"""Frames written by a thread: errors raised in the run, a bounded memory, and a whole stage whatever happens."""

import errno
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil
import pytest
from pxr import Usd

from reference.cases import slow
from warpknit.export.frame_files import FrameFiles
from warpknit.export.usd.writer import StageWriter
from warpknit.results.frame import Frame, WireLayout, state_file

CELL = Path(__file__).parents[2] / "scenes" / "atlas_cell.toml"


@pytest.fixture
def frames(make_frame: Callable[..., Frame]) -> list[Frame]:
    return [make_frame(index, shear=0.01 * index) for index in range(4)]


def frame_files(directory: Path, layout: WireLayout, **options: object) -> FrameFiles:
    stage = StageWriter(directory, layout, scene_name="zigzag", scene_hash="0123", version="1.0", **options)
    return FrameFiles(directory, layout, stage)


def write(files: FrameFiles, frames: list[Frame]) -> None:
    with files:
        for frame in frames:
            files.add_frame(frame)
        files.close(complete=True)


def wait_until(condition: Callable[[], bool], seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_it_leaves_the_states_and_the_stage(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    write(frame_files(tmp_path, layout), frames)
    for frame in frames:
        found = Frame.load(tmp_path / "states" / f"state_{frame.index:06d}.npz")
        assert np.array_equal(found.node_position, frame.node_position) and found.stage == frame.stage
    stage = Usd.Stage.Open(str(tmp_path / "scene.usda"))
    data = stage.GetRootLayer().customLayerData["warpknit"]
    assert list(data["frames"]) == [0, 1, 2, 3] and data["complete"]
    assert not list(tmp_path.rglob(".*"))


def used_memory(directory: Path, layout: WireLayout, frame: Frame, count: int) -> list[int]:
    """[bytes] of this process after each of several frames."""
    used = []
    with frame_files(directory, layout, colour_stress_max=5e8) as files:
        for index in range(count):
            files.add_frame(replace(frame, index=index))
            used.append(psutil.Process().memory_info().rss)
    return used


def test_memory_is_flat_in_frames(tmp_path: Path, make_frame: Callable[..., Frame]) -> None:
    """A frame of 13 MB adds less than a twelfth of it, in the mean of 40."""
    nodes, wires = 100, 4000
    layout = WireLayout(
        wire_start=np.arange(wires + 1) * nodes, wire_closed=np.zeros(wires, dtype=bool), period=np.ones(2), diameter=1e-5,
        body_radius=1e-6, body_wires=np.zeros((0, 2), dtype=int), rhombus_bodies=np.zeros(0, dtype=int),
    )  # fmt: skip
    position = np.random.default_rng(1).normal(size=(wires * nodes, 3))
    frame = replace(
        make_frame(0), node_position=position, node_stress=position[:, 0] ** 2, body_position=np.zeros((0, 3)),
        pair_force=np.zeros(0), pair_active=np.zeros(0, dtype=bool),
    )  # fmt: skip
    with multiprocessing.get_context("spawn").Pool(1) as pool:  # other tests have left memory in this process
        used = pool.apply(used_memory, (tmp_path, layout, frame, 48))
    growth = (np.median(used[40:]) - np.median(used[:8])) / 40
    assert growth < (position.nbytes + frame.node_stress.nbytes) / 12


def test_what_goes_wrong_in_the_thread_is_raised_in_the_run(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    (tmp_path / "frames").write_text("in the way")
    with frame_files(tmp_path, layout) as files:
        files.add_frame(frames[0])
        with pytest.raises(FileExistsError) as caught:
            wait_until(lambda: files.check() is not None)  # until it raises
        assert Path(caught.value.filename).is_relative_to(tmp_path / "frames")


def test_a_state_is_on_the_disk_or_refused_at_once(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    """A record counts once its state is there."""
    with frame_files(tmp_path, layout) as files:
        files.add_frame(frames[0])
        assert state_file(tmp_path, 0).exists()
        shutil.rmtree(tmp_path / "states")
        (tmp_path / "states").write_text("in the way")
        with pytest.raises(FileExistsError) as caught:
            files.add_frame(frames[1])
        assert caught.value.filename == str(tmp_path / "states")


@pytest.mark.parametrize("is_there", [False, True])
def test_a_run_goes_on_without_a_state_that_is_lost(
    is_there: bool, tmp_path: Path, layout: WireLayout, frames: list[Frame]
) -> None:
    write(frame_files(tmp_path, layout), frames[:2])
    state_file(tmp_path, 1).unlink()
    if is_there:
        state_file(tmp_path, 1).write_bytes(b"no archive")
    write(frame_files(tmp_path, layout), frames[2:])
    names = {path.name for path in (tmp_path / "frames").glob("wires.[0-9]*.usdc")}
    assert names == {f"wires.{index:06d}.usdc" for index in range(len(frames)) if index != 1}


def test_a_full_disk_while_a_stage_is_written_anew_is_no_lost_state(
    tmp_path: Path, layout: WireLayout, frames: list[Frame], monkeypatch: pytest.MonkeyPatch
) -> None:
    write(frame_files(tmp_path, layout), frames[:2])
    written = StageWriter.add_frame

    def fails_once(stage: StageWriter, frame: Frame, **how: bool) -> Path:
        if frame.index == 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return written(stage, frame, **how)

    monkeypatch.setattr(StageWriter, "add_frame", fails_once)
    with frame_files(tmp_path, layout) as files:
        files.add_frame(frames[2])
        with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
            files.flush()


def test_frame_that_is_not_finite_is_refused(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    with frame_files(tmp_path, layout) as files, pytest.raises(ValueError, match="frame 0: node_stress "):
        files.add_frame(replace(frames[0], node_stress=np.full(layout.node_count, np.nan)))
    assert list(tmp_path.iterdir()) == []


def test_resumed_stage_is_the_one_of_a_whole_run(tmp_path: Path, layout: WireLayout, frames: list[Frame]) -> None:
    """Also if it has lost frames: a run that goes on writes the stage anew from the states."""
    options = {"points_per_tile": 100, "full_every": 2}
    write(frame_files(tmp_path / "whole", layout, **options), frames)
    write(frame_files(tmp_path / "broken", layout, **options), frames[:2])
    (tmp_path / "broken" / "frames" / "wires.000001.usdc").unlink()
    write(frame_files(tmp_path / "broken", layout, **options), frames[2:])
    whole = {path.relative_to(tmp_path / "whole"): path for path in (tmp_path / "whole").rglob("*.usd*")}
    assert len(whole) == 3 + len(frames)
    for name, path in whole.items():
        assert (tmp_path / "broken" / name).read_bytes() == path.read_bytes(), name


# --- runs of the program ----------------------------------------------------------------------------------------------


def start(out: Path, *arguments: str) -> subprocess.Popen[str]:
    options = ("--preset=draft", "--set", "output.figures=false", "--set", "variants.sensitivity=false", "--device=cpu")
    command = [sys.executable, "-m", "warpknit", "run", str(CELL), "--out", str(out), *options, *arguments]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


FRAMES = ("--set", "output.frames=12", "--set", "output.checkpoint_interval=0.01")


@pytest.fixture(scope="module")
def whole_run(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The files of the frames of a run that nothing happens to."""
    out = tmp_path_factory.mktemp("whole") / "run"
    assert start(out, *FRAMES).wait() == 0
    return {path.name: path for path in (out / "frames").iterdir()}


@pytest.mark.parametrize("number", [signal.SIGINT, *slow(signal.SIGKILL)])
def test_interrupted_and_killed_runs_leave_a_whole_stage(tmp_path: Path, whole_run: dict[str, Path], number: int) -> None:
    """And go on to the states of a run that nothing happened to, with every frame in the stage."""
    out = tmp_path / "run"
    run = start(out, *FRAMES)
    wait_until((out / "frames" / "wires.000003.usdc").exists)
    os.kill(run.pid, number)
    assert run.wait() == (130 if number == signal.SIGINT else -signal.SIGKILL)
    if number == signal.SIGINT:
        assert not [path for path in out.rglob("*.usd*") if path.name.startswith(".")]
    stage = Usd.Stage.Open(str(out / "scene.usda"))
    named = list(stage.GetRootLayer().customLayerData["warpknit"]["frames"])
    # a kill may come after the fourth frame is written and before the stage names it
    assert named == list(range(len(named))) and len(named) >= 3
    del stage
    assert start(out, *FRAMES, "--resume").wait() == 0
    resumed = {path.name: path for path in (out / "frames").iterdir()}
    assert sorted(whole_run) == sorted(resumed) and len(whole_run) == 13
    assert all(whole_run[name].read_bytes() == resumed[name].read_bytes() for name in whole_run)


def test_full_disk_is_exit_4(tmp_path: Path) -> None:
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
