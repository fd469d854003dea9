"""Scenes of tests that are about the planar model."""

from collections.abc import Mapping
from typing import Any

from warpknit.scene import Scene, make_scene


def planar_scene(table: Mapping[str, Any], overrides: Any = (), preset: str | None = None, **options: Any) -> Scene:
    """The scene of a table in the planar model; the rest as in `make_scene`."""
    return make_scene({**table, "model": {"kind": "planar", **table.get("model", {})}}, overrides, preset, **options)
