"""The curves of a report and its states under equal tensions on disk, for a further report of the same scene and map."""

from __future__ import annotations

import json
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..base.files import write_arrays
from ..runner.history import Row
from ..scene import Scene
from ..solve.drive import under
from .curves import CurvePoint
from .equal_tension import EqualTensionPath
from .load_path import PathState, under_tension

STATES = "report_states.npz"
UNUSABLE = (OSError, ValueError, LookupError, TypeError, zipfile.BadZipFile)


@dataclass(frozen=True)
class KeptStates:
    """What a report computes whatever tension is requested."""

    curves: list[CurvePoint]
    path: EqualTensionPath


def write_states(scene: Scene, out: Path, states: KeptStates) -> None:
    """Write the file into `out`."""
    path = states.path
    numbers = {id(row): number for number, row in enumerate(path.rows)}
    about = {
        "made_by": _made_by(scene),
        "curves": [asdict(point) for point in states.curves],
        "rows": [vars(row) for row in path.rows],
        "tensions": list(path.states),
        "row_at": [numbers[id(path.at[tension])] for tension in path.states],
        "ended": path.ended,
    }
    arrays = {"about": np.array(json.dumps(about, default=lambda value: value.item()))}
    for number, state in enumerate(path.states.values()):
        arrays |= {f"{number}_{name}": value for name, value in state.kept.items()}
    write_arrays(out / STATES, arrays)


def read_states(scene: Scene, out: Path) -> KeptStates | None:
    """What `write_states` wrote for this scene, by this version, bit-identical; None without a file that can be read."""
    try:
        with np.load(out / STATES, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        about: dict[str, Any] = json.loads(str(arrays.pop("about")))
        if about["made_by"] != _made_by(scene):
            return None
        rows, tensions = [Row(**row) for row in about["rows"]], about["tensions"]
        stages = [under_tension(scene, tension) for tension in tensions]
        states = {
            tension: PathState(tuple(stages[: number + 1]), under(f"{number}_", arrays))
            for number, tension in enumerate(tensions)
        }
        at = {tension: rows[number] for tension, number in zip(tensions, about["row_at"], strict=True)}
        return KeptStates([CurvePoint(**point) for point in about["curves"]], EqualTensionPath(rows, states, at, about["ended"]))
    except UNUSABLE:
        return None


def _made_by(scene: Scene) -> list[str]:
    return [scene.hash, __version__]
