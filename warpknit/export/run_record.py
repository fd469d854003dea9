"""Contents of the directory of a run, the input of every export format."""

import csv
import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warpknit.errors import ExportError
from warpknit.results.frame import Frame, WireLayout

DAMAGED = (OSError, ValueError, TypeError)  # what a damaged file of arrays raises


@dataclass(frozen=True)
class RunRecord:
    """Contents of the directory of a run."""

    directory: Path
    summary: dict[str, Any]
    layout: WireLayout
    states: tuple[Path, ...]

    def frames(self) -> Iterator[Frame]:
        """Yield the frames one by one, so that they need not fit in memory together."""
        for index in range(len(self.states)):
            yield self.frame(index)

    def frame(self, index: int) -> Frame:
        """One frame. Raises `ExportError` where it cannot be read or does not fit the layout."""
        return read_frame(self.states[index], self.layout)

    def history(self) -> list[dict[str, str]]:
        path = self.directory / "history.csv"
        try:
            with open(path, newline="", encoding="utf-8") as file:
                rows = list(csv.DictReader(file))
        except (OSError, ValueError, csv.Error) as error:
            raise _unreadable(path, error) from error
        if not rows:
            raise ExportError(f"{path}: no record")
        return rows

    def quantity(self, *names: str) -> float | None:
        """A positive number of the summary, the largest over its stages, or None."""
        values = [item(part, names) for part in (self.summary, *(item(self.summary, ("stages",)) or ()))]
        numbers = [float(value) for value in values if isinstance(value, int | float) and math.isfinite(value)]
        return max((number for number in numbers if number > 0.0), default=None)


def read_run(directory: Path, *, also_running: bool = False) -> RunRecord:
    """Raises `ExportError` where there is no run, or one without states.

    also_running: take a run that goes on as well; its summary is empty.
    """
    if not directory.is_dir():
        raise ExportError(f"{directory}: no such directory; give the directory of a run")
    layout_path, summary_path = directory / "layout.npz", directory / "summary.json"
    states = state_files(directory)
    if not layout_path.is_file() and not summary_path.is_file():
        raise ExportError(f"{directory}: {_held(directory)}")
    if not also_running and not summary_path.is_file():
        raise ExportError(f"{directory}: the run is not finished (no summary.json); continue it with --resume")
    path = summary_path
    try:
        summary = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        if not states:
            raise ExportError(f"{directory}: the run has no states")
        layout = WireLayout.load(path := layout_path)
    except DAMAGED as error:  # JSONDecodeError is a ValueError
        raise _unreadable(path, error) from error
    if not isinstance(summary, dict) or (summary and not isinstance(item(summary, ("scene", "name")), str)):
        raise ExportError(f"{summary_path}: not the summary of a run: it has no scene name")
    return RunRecord(directory, summary, layout, tuple(states))


def _held(directory: Path) -> str:
    """What a directory without a run has in its place, and where states are."""
    for name, kind in (("map.json", "map"), ("map.csv", "map"), ("trade.json", "study of settings")):
        if (directory / name).is_file():
            return f"a {kind} keeps no states; give the directory of a run at one of its loads"
    return "no layout.npz and no summary.json; give the directory of a run"


def state_files(directory: Path) -> list[Path]:
    """The recorded states of a run in order, also of one that is not finished."""
    paths = (path for path in (directory / "states").glob("state_*.npz") if re.fullmatch(r"state_\d+", path.stem))
    return sorted(paths, key=lambda path: int(path.stem[6:]))


def read_frame(path: Path, layout: WireLayout) -> Frame:
    """A recorded state; raises `ExportError` where it cannot be read or does not fit the layout."""
    try:
        frame = Frame.load(path)
        frame.require_layout(layout)
        frame.require_finite()
    except DAMAGED as error:
        raise _unreadable(path, error) from error
    return frame


def item(tree: Any, names: tuple[str, ...]) -> Any:
    """The value under these keys of nested tables, or None."""
    for name in names:
        tree = tree.get(name) if isinstance(tree, dict) else None
    return tree


def _unreadable(path: Path, error: Exception) -> ExportError:
    """The error of a file that cannot be read, which names it once."""
    why = getattr(error, "strerror", None) or " ".join(str(error).split()).removeprefix(f"{path}: ")
    return ExportError(f"{path}: {why}")
