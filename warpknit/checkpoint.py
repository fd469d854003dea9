"""Checkpoints: all that a run needs to go on to the same bits. Written aside and renamed, one file."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np

from .errors import RunDirectoryError
from .files import write_aside
from .simulate import Progress, Simulation

FILE = Path("checkpoint") / "checkpoint.npz"


def write_checkpoint(directory: Path, simulation: Simulation, scene_hash: str, wall: float) -> None:
    """Save state, loop memory and progress; `wall` [s] is the time the run has taken so far."""
    about = {"scene": scene_hash, "wall_s": wall, "progress": simulation.progress.as_dict()}
    kept = {f"state_{name}": value for name, value in simulation.state.arrays().items()}
    kept |= {f"memory_{name}": value for name, value in simulation.memory().items()}
    path = directory / FILE
    path.parent.mkdir(parents=True, exist_ok=True)
    with write_aside(path, "wb") as file:
        np.savez(file, about=np.array(json.dumps(about)), **kept)


def has_checkpoint(directory: Path) -> bool:
    return (directory / FILE).is_file()


class Checkpoint:
    """A checkpoint read from a run directory. Raises `RunDirectoryError` if it cannot be used for this scene."""

    def __init__(self, directory: Path, scene_hash: str) -> None:
        path = directory / FILE
        try:
            with np.load(path, allow_pickle=False) as file:
                self._arrays = {name: file[name] for name in file.files}
            about = json.loads(str(self._arrays.pop("about")))
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise RunDirectoryError(f"{path}: not a checkpoint of this version ({error}): start over with --force") from error
        if about["scene"] != scene_hash:
            raise RunDirectoryError(
                f"{path}: the checkpoint is of another scene or other settings: run those, or start over with --force"
            )
        self.progress = Progress.from_dict(about["progress"])
        self.wall = float(about["wall_s"])

    def restore(self, simulation: Simulation) -> None:
        """Put state and memory back; `simulation` was made with this checkpoint's progress."""
        state = {name[6:]: value for name, value in self._arrays.items() if name.startswith("state_")}
        simulation.state.restore(state)
        simulation.recall({name[7:]: value for name, value in self._arrays.items() if name.startswith("memory_")})
