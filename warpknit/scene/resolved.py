"""A scene written back: every value resolved, as TOML."""

from __future__ import annotations

from typing import Any

from warpknit.scene.keys import Table, keys_of
from warpknit.scene.scene import Scene
from warpknit.scene.units import si_text

RESOLVED = "# Left to the model and the solver:"  # begins every resolved scene


def resolved_toml(scene: Scene) -> str:
    """The scene as a TOML file with every default written out, in SI units; it loads to an equal scene."""
    import tomli_w

    left_out: list[str] = []
    table: dict[str, Any] = {"name": scene.name}
    mesh = "hook" if scene.hook is not None else "wires" if scene.wires is not None else "knit"
    for key in ("wire", mesh, "model", *(("panel",) if mesh == "knit" else ())):
        table[key] = _written(getattr(scene, key), key, left_out)
    table["load"], *path = [_written(stage, "", []) for stage in scene.stages]
    if scene.hook is not None:
        kept = ("name", "displacement", "temperature")
        table["load"], *path = [{key: stage[key] for key in kept} for stage in (table["load"], *path)]
    if path:
        table["path"] = path
    for key in ("contact", "solver", "output"):
        table[key] = _written(getattr(scene, key), key, left_out)
    if scene.sweep is not None:
        table["sweep"] = _written(scene.sweep, "sweep", left_out)
    return f"{RESOLVED} {', '.join(left_out)}\n\n" + tomli_w.dumps(table)


def _written(value: Any, key: str, left_out: list[str]) -> Any:
    """A frozen object as a table of TOML values. Keys without a value are named in `left_out`."""
    if isinstance(value, tuple):
        return [_written(entry, f"{key}[{index}]", left_out) for index, entry in enumerate(value)]
    if not isinstance(value, Table):
        return value
    table = {}
    for name, entry in keys_of(type(value)).items():
        content, below = getattr(value, name), f"{key}.{name}"
        if content is None:
            left_out.append(below)
        else:
            table[name] = si_text(content, entry.unit) if entry.unit else _written(content, below, left_out)
    return table
