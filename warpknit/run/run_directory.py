"""The directory of a run, of a map or of a trade: what may be written there, and what is ours to remove."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import RunDirectoryError
from ..files import write_aside

OURS = ("summary.json", "history.csv", "scene.toml", "layout.npz", "scene.usda", "wires.topology.usdc",
        "wires.manifest.usda", "stages.json", "states", "frames", "figures", "checkpoint", "vtk", "tables", "panel",
        "map.csv", "map.json", "map_details.csv", "seeds",
        "trade.csv", "trade_knobs.csv", "trade.json",
        "report.html", "material_card.csv", "material_card.json", "tension_strain.csv")  # fmt: skip
SUMMARIES = {"summary.json": "run", "map.json": "map", "trade.json": "trade"}
BEGUN = {"checkpoint/checkpoint.npz": "run", "map.csv": "map", "trade.csv": "trade"}  # where it has not ended


def read_summary(out: Path, name: str) -> dict[str, Any] | None:
    """The summary `name` of what ended steady or finished in `out`, or None."""
    try:
        summary = json.loads((out / name).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return summary if isinstance(summary, dict) and summary.get("stop_reason") in ("steady", "finished") else None


@dataclass(frozen=True)
class Ending:
    """How a run, a map or a trade ended."""

    exit_code: int
    summary: dict[str, Any]
    message: str = ""


def finished_before(out: Path, name: str, scene_hash: str) -> Ending | None:
    """What ended in `out`, by its summary `name`; None where nothing did.

    Raises RunDirectoryError where that was another scene.
    """
    summary = read_summary(out, name)
    if summary is None:
        return None
    if summary.get("scene", {}).get("hash") != scene_hash:
        kind = SUMMARIES[name]
        raise RunDirectoryError(
            f"{out}: holds the finished {kind} of another scene, or of this one with other --set, --preset or --error;"
            f" {_ways_out(out, kind)}"
        )
    return Ending(0, summary)


def goes_on(out: Path, table: str, kind: str, resolved: str, *, resume: bool, force: bool) -> bool:
    """Whether the map or trade (`kind`) of the scene `resolved` that `out` holds by its `table` is to be gone on with.

    Raises RunDirectoryError where `out` cannot be used.
    """
    begun = (out / table).exists()
    check_directory(out, kind, resume=resume, force=force)
    if not (resume and begun):
        return False
    if (out / "scene.toml").read_text(encoding="utf-8") != resolved:
        raise RunDirectoryError(f"{out}: holds the {kind} of another scene; {_ways_out(out, kind)}")
    return True


def open_directory(out: Path, resolved: str, *, keep: bool) -> None:
    """Make `out` with the scene `resolved`, without what an earlier run left unless that is to be kept."""
    if not keep:
        clear(out)
    make_directory(out)
    with write_aside(out / "scene.toml") as file:
        file.write(resolved)


def check_directory(out: Path, wanted: str, *, resume: bool, force: bool) -> None:
    """Refuse a directory that holds something else than what a run, map or trade (`wanted`) goes on with.

    Raises RunDirectoryError, which says what to type.
    """
    if out.exists() and not out.is_dir():
        raise RunDirectoryError(f"--out {out}: given a file, allowed: a directory")
    if force:
        return
    ended = [kind for name, kind in SUMMARIES.items() if read_summary(out, name) is not None]
    if ended:
        raise RunDirectoryError(f"{out}: holds a finished {ended[0]}; {_ways_out(out, wanted)}")
    begun = [kind for name, kind in BEGUN.items() if (out / name).exists()]
    for kind in begun:
        if kind != wanted:
            raise RunDirectoryError(f"{out}: holds an interrupted {kind}; {_ways_out(out, wanted)}")
        if not resume:
            raise RunDirectoryError(f"{out}: holds an interrupted {kind}; --resume goes on with it, --force starts over")
    foreign = [p.name for p in out.iterdir() if p.name not in OURS and not p.name.startswith(".")] if out.is_dir() else []
    if foreign and not (out / "scene.toml").exists():
        raise RunDirectoryError(
            f"{out}: holds files of something else ({foreign[0]}); --out {_free_beside(out, wanted)} is another directory"
        )


def _ways_out(out: Path, wanted: str) -> str:
    """What to type for a run, map or trade (`wanted`) to have its own directory, or this one."""
    return f"--out {_free_beside(out, wanted)} keeps both, --force replaces what is there"


def _free_beside(out: Path, wanted: str) -> Path:
    """A directory beside `out` that is not there yet."""
    place = out if out.name not in ("", "..") else out.resolve()
    number, found = 1, place.parent / f"{place.name}_{wanted}"
    while found.exists():
        number += 1
        found = place.parent / f"{place.name}_{wanted}_{number}"
    return found


def make_directory(out: Path) -> None:
    """Make `out` where it is not there. Raises RunDirectoryError."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunDirectoryError(f"--out {out}: cannot be made here: {(error.strerror or 'unusable').lower()}") from error


def clear(out: Path) -> None:
    """Remove what an earlier run or map left, and nothing else."""
    for name in OURS:
        path = out / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
