"""Checkpoints: all that a run needs to go on to the same bits. Every file is written aside and renamed.

Each rank writes its strip. The file of the first rank comes last, when all others are whole, and names the turn they belong
to: until it is renamed the files of the turn before are in force, and they have other names.
"""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RunDirectoryError
from ..files import write_aside
from ..ranks.ranks import Ranks
from ..solve.simulate import Progress, Simulation

FILE = Path("checkpoint") / "checkpoint.npz"
UNUSABLE = (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile)


def write_checkpoint(directory: Path, simulation: Simulation, scene_hash: str, wall: float) -> None:
    """Save state, loop memory and progress; `wall` [s] is the time the run has taken so far."""
    ranks = simulation.model.ranks
    turn = ranks.from_first(lambda: 1 - _turn_in_force(directory))
    about = {
        "scene": scene_hash, "wall_s": wall, "progress": simulation.progress.as_dict(), "ranks": ranks.count, "turn": turn
    }  # fmt: skip
    kept = {f"state_{name}": value for name, value in simulation.state.arrays().items()}
    kept |= {f"memory_{name}": value for name, value in simulation.state_dict().items()}
    (directory / FILE).parent.mkdir(parents=True, exist_ok=True)
    if not ranks.is_first:
        _write(_strip_file(directory, turn, ranks.rank), about, kept)
    ranks.everyone(None)  # all others are whole
    if ranks.is_first:
        _write(directory / FILE, about, kept)


def _write(path: Path, about: dict[str, Any], kept: dict[str, Any]) -> None:
    with write_aside(path, "wb") as file:
        np.savez(file, about=np.array(json.dumps(about)), **kept)


def _strip_file(directory: Path, turn: int, rank: int) -> Path:
    return directory / FILE.parent / f"strip_{rank:05d}_turn_{turn}.npz"


def _turn_in_force(directory: Path) -> int:
    """The turn of the checkpoint in a directory; 0 where there is none that can be read."""
    try:
        return int(_about(directory / FILE)["turn"])
    except UNUSABLE:
        return 0


def _about(path: Path) -> dict[str, Any]:
    with np.load(path, allow_pickle=False) as file:
        about: dict[str, Any] = json.loads(str(file["about"]))
    return about


def has_checkpoint(directory: Path) -> bool:
    return (directory / FILE).is_file()


class Checkpoint:
    """A checkpoint read from a run directory. Raises `RunDirectoryError` if it cannot be used for this scene and these ranks."""

    def __init__(self, directory: Path, scene_hash: str, ranks: Ranks) -> None:
        path = directory / FILE
        try:
            about = _about(path)
            count, scene = about["ranks"], about["scene"]
            self.progress = Progress.from_dict(about["progress"])
            if count == ranks.count and not ranks.is_first:
                path = _strip_file(directory, about["turn"], ranks.rank)
            with np.load(path, allow_pickle=False) as file:
                self._arrays = {name: file[name] for name in file.files if name != "about"}
        except UNUSABLE as error:
            raise RunDirectoryError(f"{path}: not a checkpoint of this version ({error}): start over with --force") from error
        if scene != scene_hash:
            raise RunDirectoryError(
                f"{path}: the checkpoint is of another scene or other settings: run those, or start over with --force"
            )
        if count != ranks.count:
            raise RunDirectoryError(
                f"{path}: given {ranks.count} ranks, allowed: the {count} that wrote the checkpoint (mpirun -n {count});"
                f" or start over with --force"
            )
        self.wall = float(about["wall_s"])

    def restore(self, simulation: Simulation) -> None:
        """Put state and memory back; `simulation` was made with this checkpoint's progress."""
        state = {name[6:]: value for name, value in self._arrays.items() if name.startswith("state_")}
        simulation.state.restore(state)
        simulation.load_state_dict({name[7:]: value for name, value in self._arrays.items() if name.startswith("memory_")})
