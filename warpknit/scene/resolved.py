"""A scene written back: every value resolved, as TOML."""

from __future__ import annotations

import typing
from dataclasses import fields, is_dataclass
from typing import Annotated, Any

from warpknit.scene.objects import Scene
from warpknit.scene.units import si_text


def resolved_toml(scene: Scene) -> str:
    """The scene as a TOML file with every default written out, in SI units; it loads to an equal scene."""
    import tomli_w

    left_out: list[str] = []
    table: dict[str, Any] = {"name": scene.name}
    mesh = "hook" if scene.hook is not None else "wires" if scene.wires is not None else "knit"
    for key in ("wire", mesh, "model", *(("panel",) if mesh == "knit" else ())):
        table[key] = _written(getattr(scene, key), key, left_out)
    if scene.wires is not None:
        del table["wires"]["digest"]  # of what is in the file
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
    comment = f"# Left to the model and the solver: {', '.join(left_out)}\n\n" if left_out else ""
    return comment + tomli_w.dumps(table)


def _written(value: Any, key: str, left_out: list[str]) -> Any:
    """A frozen object as a table of TOML values. Keys without a value are named in `left_out`."""
    if isinstance(value, tuple):
        return [_written(entry, f"{key}[{index}]", left_out) for index, entry in enumerate(value)]
    if not is_dataclass(value):
        return value
    table = {}
    hints = typing.get_type_hints(type(value), include_extras=True)
    for entry in fields(value):
        content, below = getattr(value, entry.name), f"{key}.{entry.name}"
        if content is None:
            left_out.append(below)
        else:
            unit = _unit(hints[entry.name])
            table[entry.name] = si_text(content, unit) if unit else _written(content, below, left_out)
    return table


def _unit(hint: Any) -> str | None:
    """The unit in an annotation such as `Annotated[float, "m"] | None`."""
    if typing.get_origin(hint) is Annotated:
        return str(hint.__metadata__[0])
    return next((unit for part in typing.get_args(hint) if (unit := _unit(part))), None)
