"""The source of a scene, for messages with values as written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warpknit.errors import SceneError
from warpknit.scene.messages import dotted, scene_error, value_text
from warpknit.scene.units import shown


@dataclass(frozen=True)
class Source:
    """The source of the values, as written, for messages."""

    path: Path
    table: dict[str, Any]

    def refusal(self, location: Sequence[int | str], value: Any, wrong: str, instead: str) -> SceneError:
        """The error for a value that conflicts with another, such as "is above 1"; `value` is shown if none was written."""
        given: Any = self.table
        for part in location:
            if not (part < len(given) if isinstance(part, int) else part in given):
                return scene_error(self.path, dotted(location), f"{value_text(location, value)} {wrong}", instead)
            given = given[part]
        return scene_error(self.path, dotted(location), f"{shown(given)} {wrong}", instead)
