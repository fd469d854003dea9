"""A run in the browser: wires and contacts of its records in 3D. Needs the extra `view`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ...base.errors import needing_extra

if TYPE_CHECKING:
    from .viewer import Viewer


def open_viewer(directory: Path, *, host: str = "localhost", port: int = 8080) -> Viewer:
    """Serve the page of a run; raises `MissingExtra` where the extra is not installed."""
    with needing_extra("view", "view"):
        from .viewer import Viewer
    return Viewer(directory, host=host, port=port)
