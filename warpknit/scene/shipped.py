"""Scenes that ship with the package: in scenes/ of a clone, beside the modules in a wheel."""

from __future__ import annotations

import difflib
import re
from itertools import takewhile
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
FOLDER = next((folder for folder in (PACKAGE / "scenes", PACKAGE.parent / "scenes") if folder.is_dir()), PACKAGE / "scenes")


def shipped_scenes() -> dict[str, Path]:
    """Files of the scenes by name, such as `atlas_patch`."""
    return {path.stem: path for path in sorted(FOLDER.rglob("*.toml"))}


def first_sentence(path: Path) -> str:
    """The first sentence of the comment on top of a scene."""
    lines = path.read_text(encoding="utf-8").splitlines()
    comment = " ".join(line.removeprefix("#").strip() for line in takewhile(lambda line: line.startswith("#"), lines))
    return re.split(r"(?<=[.:]) ", comment, maxsplit=1)[0].rstrip(":.")


def file_of_scene(path: Path) -> Path:
    """The file of a path: an existing file first, else the scene of that name; `path` itself where there is neither."""
    return path if path.is_file() else shipped_scenes().get(str(path), path)


def nearest_scene(path: Path) -> str | None:
    """The name of the scene nearest to a path, if one is close."""
    return next(iter(difflib.get_close_matches(path.stem, shipped_scenes(), n=1)), None)
