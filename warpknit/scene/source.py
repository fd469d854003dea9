"""Where the values of a scene came from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warpknit.errors import SceneError
from warpknit.scene.messages import dotted, scene_error
from warpknit.scene.units import shown


@dataclass(frozen=True)
class Source:
    """Where the values came from, as they were written, for messages."""

    path: Path
    table: dict[str, Any]

    def refusal(self, location: Sequence[int | str], value: Any, allowed: str) -> SceneError:
        """The error for a value that clashes with another; `value` is what was checked, shown if none was written."""
        given: Any = self.table
        for part in location:
            known = part < len(given) if isinstance(part, int) else part in given
            given = given[part] if known else value
            if not known:
                break
        return scene_error(self.path, dotted(location), shown(given), allowed)
