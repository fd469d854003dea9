"""The output directory of a run, map or trade: checks before writing, and removal of old results."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar

from ..base import toml
from ..base.errors import InputError, RunDirectoryError
from ..base.files import write_aside
from ..base.text import listed
from ..scene import Scene, load_scene
from ..scene.scene import RESOLVED, resolved_toml
from ..scene.units import shown
from ..scene.wire_file import WireArrays

MOST_KEYS = 3  # that are named
Tree: TypeAlias = Mapping[str, Any]  # of a JSON file
Result = TypeVar("Result")
OUTPUT_NAMES = ("summary.json", "history.csv", "scene.toml", "wires.npz", "layout.npz", "scene.usda", "wires.topology.usdc",
        "wires.manifest.usda", "states", "frames", "figures", "checkpoint", "vtk", "tables", "panel",
        "variants", "variants.csv", "map.csv", "map.json", "map_details.csv", "reflection.csv", "reflection.npz",
        "trade.csv", "trade_knobs.csv", "trade.json",
        "report.html", "answers.json", "fit.json", "material_card.csv", "material_card.json", "tension_strain.csv",
        "report_states.npz", "softest", "stiffest", "loading",
        "material_card_nastran.bdf", "material_card_abaqus.inp", "material_card_calculix.inp", "material_card_ansys.inp",
        "material_card_lsdyna.k", "material_card_radioss.inc")  # fmt: skip
SUMMARIES = {"summary.json": "run", "map.json": "map", "trade.json": "trade"}
TABLES = {"checkpoint/checkpoint.npz": "run", "map.csv": "map", "trade.csv": "trade"}  # of unfinished ones


def read_summary(out: Path, name: str) -> Tree | None:
    """The summary `name` of a converged or finished run in `out`, or None."""
    summary = _read_json(out / name)
    return summary if summary.get("stop_reason") in ("steady", "finished") else None


def _read_json(path: Path) -> Tree:
    """The table in a JSON file; empty where there is none."""
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return table if isinstance(table, dict) else {}


@dataclass(frozen=True)
class CommandResult(Generic[Result]):
    """Exit code, summary and message of a run, map or trade."""

    exit_code: int
    summary: Result
    message: str = ""
    goes_on: bool = True  # whether an interrupted one has more to compute


def check_directory(
    out: Path, kind: str, scene: Scene, *, resume: bool, force: bool, command: str | None = None
) -> tuple[Tree | None, bool]:
    """Summary of a finished result in `out` on --resume; whether to continue one there.

    kind: run, map or trade. command: the command, where it is not `kind`: a report, which makes a map. Raises RunDirectoryError
    with the options to use, where `out` has other results or other files.
    """
    if out.exists() and not out.is_dir():
        raise RunDirectoryError(f"--out: {out} is a file; give a directory")
    state, held, summary = _held_results(out)
    same = summary.get("scene", {}).get("hash") == scene.hash  # also where the files of the scene have moved
    other = _difference(out, scene) if held and not same else ""
    if resume and held == kind and not other:
        return (summary, False) if state == "finished" else (None, True)
    if force:
        return None, False
    free = f"--out {_free_beside(out, command or kind)}"
    if held:
        what = f"{state} {held}" + (" with its report" if held == "map" and (out / "report.html").exists() else "")
        name = summary.get("scene", {}).get("name")
        of_scene = ("" if name is None else f" of scene {name!r}") + other
        goes_on = "continue it with --resume, " if state == "interrupted" and held == kind and not other else ""
        options = f"{goes_on}give {free} to keep both, or --force to replace the {what}"
        raise RunDirectoryError(f"{out}: contains {'an' if state == 'interrupted' else 'a'} {what}{of_scene}; {options}")
    kept = sorted(p.name for p in out.iterdir() if not p.name.startswith(".")) if out.is_dir() else []
    if kept and not _holds_results(out):
        foreign = next((name for name in kept if name not in OUTPUT_NAMES), kept[0])
        raise RunDirectoryError(f"{out}: contains other files ({foreign}); give {free} for another directory")
    return None, False


def _held_results(out: Path) -> tuple[str, str, Tree]:
    """State and kind of the results in `out`, such as an interrupted map; and their summary."""
    for name, kind in SUMMARIES.items():
        if (summary := read_summary(out, name)) is not None:
            return "finished", kind, summary
    for name, kind in TABLES.items():
        if (out / name).exists():
            return "interrupted", kind, {}
    return ("killed", "run", {}) if holds_killed_run(out) else ("", "", {})


def _difference(out: Path, scene: Scene) -> str:
    """How the scene of the results in `out` differs from another, in words; empty where it has the same values."""
    try:
        kept = load_scene(out / "scene.toml")
    except (InputError, OSError, ValueError):
        return " of another scene"
    if kept.hash == scene.hash:
        return ""
    one, other = (_flat(toml.loads(resolved_toml(each))) for each in (scene, kept))
    keys = [key for key in dict.fromkeys((*one, *other)) if one.get(key) != other.get(key)]
    more = [] if len(keys) <= MOST_KEYS else [f"{len(keys) - MOST_KEYS} more keys"]
    return f" with another {listed([*keys[:MOST_KEYS], *more])}" if keys else " of another scene"


def _flat(table: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    found: dict[str, object] = {}
    for key, value in table.items():
        found |= _flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {f"{prefix}{key}": value}
    return found


def write_scene(out: Path, scene: Scene) -> None:
    """Write scene.toml with every default, and beside it wires that are in no file."""
    if scene.wires is not None and isinstance(scene.wires.file, WireArrays):
        with write_aside(out / WireArrays.name, "wb") as file:
            file.write(scene.wires.file.data)
    with write_aside(out / "scene.toml") as file:
        file.write(resolved_toml(scene))


def open_directory(out: Path, scene: Scene, *, keep: bool) -> None:
    """Make `out` with the scene; remove earlier results unless `keep`."""
    if not keep:
        clear(out)
    make_directory(out)
    write_scene(out, scene)


def _holds_results(out: Path) -> bool:
    """Whether a directory holds results of a run, map or trade, by characteristic files."""
    if any((out / name).exists() for name in TABLES) or any("stop_reason" in _read_json(out / name) for name in SUMMARIES):
        return True
    try:
        return (out / "scene.toml").read_text(encoding="utf-8").startswith(RESOLVED)
    except (OSError, ValueError):
        return False


def holds_killed_run(out: Path) -> bool:
    """Whether `out` has records of a run without a summary or a checkpoint."""
    return (out / "history.csv").exists() and not any((out / name).exists() for name in (*SUMMARIES, *TABLES))


def _free_beside(out: Path, wanted: str) -> Path:
    place = out if out.name not in ("", "..") else out.resolve()
    number, path = 1, place.parent / f"{place.name}_{wanted}"
    while path.exists():
        number += 1
        path = place.parent / f"{place.name}_{wanted}_{number}"
    return path


def directory_of(given: str | os.PathLike[str], name: str) -> Path:
    """The path of a directory from the argument `name` in Python. Raises RunDirectoryError for a value that is no path."""
    if not isinstance(given, str | os.PathLike) or not os.fspath(given):
        raise RunDirectoryError(f"{name}: {shown(given)} is not a path; give a directory, such as 'runs/cell'")
    return Path(given)


def make_directory(out: Path) -> None:
    """Make `out` unless it exists. Raises RunDirectoryError."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        why = (error.strerror or "unusable").lower()
        raise RunDirectoryError(f"--out: {out} cannot be made ({why}); give a directory that can be written to") from error


def clear(out: Path) -> None:
    """Remove results of an earlier run, map or trade, and nothing else; nothing where there are none."""
    if not _holds_results(out):
        return
    for name in OUTPUT_NAMES:
        path = out / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
