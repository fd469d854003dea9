"""Contents of a run directory, the input of every export format."""

import csv
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warpknit.base.errors import RunDirectoryError
from warpknit.results.frame import Frame, WireLayout
from warpknit.results.row import Columns, Row, Values, columns_of, read_rows, valued

DAMAGED = (OSError, ValueError, TypeError)  # what a damaged file of arrays raises


@dataclass(frozen=True)
class RunRecord:
    """A run and its directory: what is drawn and exported of it."""

    directory: Path
    layout: WireLayout
    states: tuple[Path, ...]
    name: str = ""  # of the scene
    scene_hash: str = ""
    version: str = ""
    stop_reason: str = ""  # empty while it runs
    yield_stress: float | None = None  # [Pa]
    jumps: Sequence[Sequence[int]] = ()  # neighbouring records of different branches of equilibria

    def frames(self) -> Iterator[Frame]:
        """Yield the frames one by one, to save memory."""
        for index in range(len(self.states)):
            yield self.frame(index)

    def frame(self, index: int) -> Frame:
        """One frame. Raises `RunDirectoryError` where it cannot be read or does not fit the layout."""
        return read_frame(self.states[index], self.layout)

    def history(self) -> Columns:
        """Columns of the history, with `jump` 1 after a snap-through."""
        path, behind = self.directory / "history.csv", {after for _, after in self.jumps}
        try:
            rows = read_rows(path, Row)
        except (OSError, ValueError, csv.Error) as error:
            raise _unreadable(path, error) from error
        if not rows:
            raise RunDirectoryError(f"{path}: no record")
        return columns_of({**vars(row), "jump": int(row.get("index") in behind)} for row in rows)

    def panel(self, index: int) -> Mapping[str, Columns]:
        """Tables `map`, `edge` and `surface` (of a target shape) of a record; may be empty."""
        paths = {kind: self.directory / "panel" / f"{kind}_{index:06d}.csv" for kind in ("map", "edge", "surface")}
        return {kind: columns_of(map(vars, read_rows(path, Values))) for kind, path in paths.items() if path.is_file()}


def read_run(directory: Path, *, also_running: bool = False) -> RunRecord:
    """Raises `RunDirectoryError` where there is no run, or one without states. also_running: take a run that goes on as well."""
    layout_path, summary_path = directory / "layout.npz", directory / "summary.json"
    if not layout_path.is_file() and not summary_path.is_file():
        what = "no layout.npz and no summary.json" if directory.is_dir() else "no such directory"
        raise RunDirectoryError(f"{directory}: {what}; give the directory of a run, not of a map or a trade")
    if not also_running and not summary_path.is_file():
        raise RunDirectoryError(f"{directory}: the run is not finished (no summary.json); continue it with --resume")
    about: dict[str, Any] = {}
    path = summary_path
    try:
        if path.is_file():
            summary = valued(json.loads(path.read_text(encoding="utf-8")))
            limits = [part.wire.get("yield_stress_Pa") for part in (summary, *summary.stages) if "wire" in part]
            about = {
                "name": summary.scene.name,
                "scene_hash": summary.scene.hash,
                "version": summary.version,
                "stop_reason": summary.stop_reason,
                "yield_stress": max((limit for limit in limits if limit), default=None),
                "jumps": summary.get("jumps", ()),
            }
        if not (states := state_files(directory)):
            raise RunDirectoryError(f"{directory}: the run has no states")
        return RunRecord(directory, WireLayout.load(path := layout_path), tuple(states), **about)
    except AttributeError as error:
        raise RunDirectoryError(f"{path}: not the summary of a run") from error
    except DAMAGED as error:  # JSONDecodeError is a ValueError
        raise _unreadable(path, error) from error


def state_files(directory: Path) -> list[Path]:
    """Recorded states of a run in order, finished or not."""
    paths = (path for path in (directory / "states").glob("state_*.npz") if re.fullmatch(r"state_\d+", path.stem))
    return sorted(paths, key=lambda path: int(path.stem[6:]))


def read_frame(path: Path, layout: WireLayout) -> Frame:
    """A recorded state; raises `RunDirectoryError` where it cannot be read or does not fit the layout."""
    try:
        frame = Frame.load(path)
        frame.require_layout(layout)
        frame.require_finite()
    except DAMAGED as error:
        raise _unreadable(path, error) from error
    return frame


def _unreadable(path: Path, error: Exception) -> RunDirectoryError:
    """Error of an unreadable file, which names it once."""
    why = getattr(error, "strerror", None) or " ".join(str(error).split()).removeprefix(f"{path}: ")
    return RunDirectoryError(f"{path}: {why}")
