"""A run in the browser: wires and contacts of its records in space. Needs the extra `view`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import InputError

if TYPE_CHECKING:
    from .viewer import Viewer


def open_viewer(directory: Path, *, host: str = "localhost", port: int = 8080) -> Viewer:
    """Serve the page of a run; raises `InputError` where the extra is not installed."""
    try:
        from .viewer import Viewer
    except ModuleNotFoundError as error:
        raise InputError(f'view needs the package {error.name}, of the extra "view": pip install -e ".[view]"') from error
    return Viewer(directory, host=host, port=port)
