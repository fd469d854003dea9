"""Checkpoints: a resumed run gives bit-identical results. Files are written atomically.

Each rank writes its strip. Files alternate between turn 0 and turn 1. The file of the first rank names the valid turn; it is
written last, when all others are complete, so the earlier turn stays valid until then.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..base.errors import RunDirectoryError
from ..base.files import write_arrays
from ..compute.kept import strip_prefix
from ..compute.ranks import Ranks
from ..results.row import Row, Values
from ..solve.simulate import Progress, Simulation

FILE = Path("checkpoint") / "checkpoint.npz"
UNUSABLE = (OSError, ValueError, AttributeError, KeyError, TypeError, zipfile.BadZipFile)


def write_checkpoint(
    directory: Path, simulation: Simulation, scene_hash: str, wall: float, recorded: Mapping[str, Any] | None = None
) -> None:
    """Save state, solver variables and progress of each world; `wall` [s] is the wall time so far.

    recorded: the `rows` of the records so far, and more that is plain.
    """
    ranks = simulation.model.ranks
    turn = ranks.from_first(lambda: 1 - _valid_turn(directory))
    header = {
        "scene": scene_hash, "wall_s": wall, "ranks": ranks.count, "turn": turn,
        "progress": [drive.progress.as_dict() for drive in simulation.drives],
        **(recorded or {"rows": []}),
    }  # fmt: skip
    kept = {
        f"{world}/{name}": value
        for world, drive in enumerate(simulation.drives)
        for name, value in drive.state_dict(copied=False).items()
    }
    (directory / FILE).parent.mkdir(parents=True, exist_ok=True)
    if not ranks.is_first:
        _write(_strip_file(directory, turn, ranks.rank), header, kept)
    ranks.everyone(None)  # the files of all others are complete
    if ranks.is_first:
        _write(directory / FILE, header, kept)


def _write(path: Path, header: Mapping[str, object], kept: Mapping[str, np.ndarray]) -> None:
    write_arrays(path, {"about": np.array(json.dumps(header, default=lambda value: value.item())), **kept})


def _strip_file(directory: Path, turn: int, rank: int) -> Path:
    return directory / FILE.parent / f"strip_{rank:05d}_turn_{turn}.npz"


def _valid_turn(directory: Path) -> int:
    """Turn of the checkpoint in a directory; 0 where none is readable."""
    try:
        return int(_header(directory / FILE).turn)
    except UNUSABLE:
        return 0


def _header(path: Path) -> Values:
    with np.load(path, allow_pickle=False) as file:
        return Values(**json.loads(str(file["about"])))


def has_checkpoint(directory: Path) -> bool:
    return (directory / FILE).is_file()


class Checkpoint:
    """A checkpoint read from a run directory. Raises `RunDirectoryError` if it cannot be used for this scene and these ranks."""

    def __init__(self, directory: Path, scene_hash: str, ranks: Ranks) -> None:
        path = directory / FILE
        try:
            header = _header(path)
            count, scene, self.header = header.ranks, header.scene, header
            self.progress = [Progress.from_dict(one) for one in header.progress]
            self.rows = [Row(**row) for row in header.rows]
            if count == ranks.count and not ranks.is_first:
                path = _strip_file(directory, header.turn, ranks.rank)
            with np.load(path, allow_pickle=False) as file:
                self._arrays = {name: file[name] for name in file.files if name != "about"}
        except UNUSABLE as error:
            raise RunDirectoryError(f"{path}: not a checkpoint of this version ({error}); start over with --force") from error
        if scene != scene_hash:
            raise RunDirectoryError(
                f"{path}: of another scene, or of this one with other --set, --preset or --error; run that one, or start over"
                " with --force"
            )
        if count != ranks.count:
            raise RunDirectoryError(
                f"{path}: written by {count} ranks, not {ranks.count}; run with mpirun -n {count}, or start over with --force"
            )
        self.wall = float(header.wall_s)

    def restore(self, simulation: Simulation) -> None:
        """Restore state and solver variables; `simulation` was made with the progress of this checkpoint."""
        try:
            for world, drive in enumerate(simulation.drives):
                drive.load_state_dict(strip_prefix(f"{world}/", self._arrays))
        except (AttributeError, KeyError, ValueError) as error:
            raise RunDirectoryError(f"{FILE}: not a checkpoint of this version ({error}); start over with --force") from error
