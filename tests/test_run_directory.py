"""Directories that hold something already: what is refused, and that the line says what to type."""

import json
import time
from pathlib import Path

import numpy as np
import pytest

from reference.in_words import options
from warpknit.base.errors import RunDirectoryError, naming_arguments
from warpknit.base.files import held_directory
from warpknit.compute.ranks import Ranks
from warpknit.results.run import load_run
from warpknit.runner import run as run_module
from warpknit.runner.monitor import FILE, Checkpoint
from warpknit.runner.run import run_scene
from warpknit.runner.run_directory import check_directory, clear, make_directory
from warpknit.scene import load_scene, make_scene, resolved_toml

SUMMARY = {"run": "summary.json", "map": "map.json", "trade": "trade.json"}
SCENE = make_scene({"name": "cell"})
BEGUN = {"run": "checkpoint/checkpoint.npz", "map": "map.csv", "trade": "trade.csv"}


def directory(path: Path, kind: str, *, ended: bool) -> Path:
    """A directory with what tells that a run, map or trade has ended there, or was interrupted."""
    begun = path / BEGUN[kind]
    begun.parent.mkdir(parents=True, exist_ok=True)
    begun.touch()
    (path / SUMMARY[kind]).write_text(json.dumps({"stop_reason": "finished" if ended else "interrupted"}))
    (path / "scene.toml").write_text(resolved_toml(SCENE))
    return path


@pytest.mark.parametrize("wanted", ["run", "map", "trade"])
@pytest.mark.parametrize("kind", ["run", "map", "trade"])
def test_what_has_ended_is_kept_and_the_line_names_a_free_directory(kind, wanted, tmp_path):
    out = directory(tmp_path / "cell", kind, ended=True)
    with pytest.raises(RunDirectoryError) as error:
        check_directory(out, wanted, SCENE, resume=False, force=False)
    assert str(error.value).startswith(f"{out}: ") and f" {kind}" in str(error.value)
    assert f" --out {out}_{wanted} " in str(error.value) and options(error.value) == {"--out", "--force"}
    (tmp_path / f"cell_{wanted}").mkdir()
    with pytest.raises(RunDirectoryError, match=f"--out {out}_{wanted}_2 "):
        check_directory(out, wanted, SCENE, resume=False, force=False)
    check_directory(out, wanted, SCENE, resume=False, force=True)


def test_a_report_and_a_run_in_one_directory_are_told_by_their_names(tmp_path):
    """A report makes a map: where a run lies it asks for a directory of a report, and a run tells that a report lies there."""
    out = directory(tmp_path / "tile", "run", ended=True)
    (out / "summary.json").write_text(json.dumps({"stop_reason": "steady", "scene": {"name": "tile"}}))
    with pytest.raises(RunDirectoryError) as error:
        check_directory(out, "map", SCENE, resume=True, force=False, command="report")
    assert str(error.value).startswith(f"{out}: ") and " run of scene 'tile'" in str(error.value)
    assert f" --out {out}_report " in str(error.value) and options(error.value) == {"--out", "--force"}
    other = directory(tmp_path / "other", "map", ended=True)
    (other / "report.html").touch()
    with pytest.raises(RunDirectoryError, match="report.* --out .*_run "):
        check_directory(other, "run", SCENE, resume=False, force=False)


@pytest.mark.parametrize("resume", [False, True])
def test_what_was_interrupted_is_not_replaced_by_something_else(resume, tmp_path):
    out = directory(tmp_path / "cell", "map", ended=False)
    with pytest.raises(RunDirectoryError, match=f" map.* --out {out}_run ") as error:
        check_directory(out, "run", SCENE, resume=resume, force=False)
    assert "--resume" not in options(error.value)
    if resume:
        check_directory(out, "map", SCENE, resume=True, force=False)
    else:
        with pytest.raises(RunDirectoryError, match=" map.* --resume"):
            check_directory(out, "map", SCENE, resume=False, force=False)


def test_records_of_a_killed_run_are_kept_and_of_another_scene_on_resume_too(tmp_path):
    """A run that was killed before its first checkpoint leaves its scene and history alone."""
    out, scene = tmp_path / "cell", SCENE
    out.mkdir()
    (out / "scene.toml").write_text(resolved_toml(scene))
    (out / "history.csv").touch()
    with pytest.raises(RunDirectoryError, match="--out .*_run .*--force"):
        run_scene(scene, out=out)
    with pytest.raises(RunDirectoryError, match=f"--out {out}_run"):
        run_scene(scene.changed({"wire.diameter": "20 um"}), out=out, resume=True)
    with pytest.raises(RunDirectoryError, match="resume=True"):
        load_run(out)
    assert (out / "history.csv").exists()
    check_directory(out, "run", SCENE, resume=True, force=False)
    check_directory(out, "run", SCENE, resume=False, force=True)


def test_a_directory_that_cannot_be_made_is_one_line(tmp_path):
    """Below a file; the message of an argument is that of the option."""
    (tmp_path / "file").touch()
    said = f"{tmp_path}/file/run cannot be made (not a directory)"
    with pytest.raises(RunDirectoryError) as error:
        make_directory(tmp_path / "file" / "run")
    assert str(error.value).startswith(f"--out: {said}") and error.value.exit_code == 2
    with pytest.raises(RunDirectoryError, match=f"^out: {tmp_path}/file/run "), naming_arguments():
        make_directory(tmp_path / "file" / "run")


def test_the_current_directory_has_a_name_too(tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    Path("notes.txt").touch()
    with pytest.raises(RunDirectoryError, match=f"notes.txt.* --out {tmp_path}/here_run "):
        check_directory(Path("."), "run", SCENE, resume=False, force=False)


@pytest.mark.parametrize("progress", [{"settling": True, "search": {}, "start": {}}, {}, None])
def test_a_checkpoint_of_another_version_is_refused_in_one_line(progress, tmp_path):
    """One whose progress has other names than this version's."""
    path = tmp_path / FILE
    path.parent.mkdir()
    np.savez(path, about=np.array(json.dumps({"ranks": 1, "turn": 0, "wall_s": 0.0, "progress": progress})))
    with pytest.raises(RunDirectoryError, match=f"{FILE}: .* --force"):
        Checkpoint(tmp_path, Ranks())


@pytest.mark.parametrize("names", [("scene.toml",), ("history.csv", "summary.json"), ("figures/paper.png",)])
@pytest.mark.parametrize("force", [False, True])
def test_files_of_others_are_kept_whatever_their_names(names, force, tmp_path):
    """A directory is only one of results where something in it says so: a summary, a checkpoint, a resolved scene."""
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("{}")
    if force:
        check_directory(tmp_path, "run", SCENE, resume=False, force=True)
    else:
        with pytest.raises(RunDirectoryError) as error:
            check_directory(tmp_path, "run", SCENE, resume=False, force=False)
        assert options(error.value) == {"--out"} and names[0].partition("/")[0] in str(error.value)
    clear(tmp_path)
    assert all((tmp_path / name).read_text() == "{}" for name in names)


@pytest.mark.parametrize("force", [False, True])
def test_a_directory_that_another_run_writes_is_refused_at_once_before_the_model_is_built(force, tmp_path, monkeypatch):
    """A new run does not wait; --force waits for one that was killed, to write its last frame."""
    monkeypatch.setattr(run_module, "LOCK_TIMEOUT", 0.3)
    monkeypatch.setattr(run_module, "build_model", lambda *_: pytest.fail("built"))
    scene = load_scene(Path(__file__).parent.parent / "scenes" / "atlas_cell.toml")
    begin = time.monotonic()
    with held_directory(tmp_path, 0.0), pytest.raises(RunDirectoryError, match="--out"):
        run_module.run_scene(scene, out=tmp_path, force=force)
    assert (time.monotonic() - begin >= 0.3) == force
