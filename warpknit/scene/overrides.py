"""Dotted overrides of a scene file: load.strain_warp=0.05, knit.bars[1].chain="1-0/1-2"."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ..base import toml
from .messages import Location, default_list, dotted, scene_error, table_at, unknown_depth, unknown_key
from .scene import Override, Overrides
from .units import shown

_log = logging.getLogger(__name__)
DOTTED_KEY = "write one such as load.strain_warp or knit.bars[1].chain"
_PART = re.compile(r"(?P<name>[A-Za-z0-9_-]+)(?P<indices>(\[\d{1,6}\])*)")


def as_list(overrides: Overrides) -> list[Override]:
    """Overrides in any form as a list."""
    if isinstance(overrides, Mapping):
        return list(overrides.items())
    return list(overrides) if isinstance(overrides, Iterable) and not isinstance(overrides, str) else [overrides]


def with_overrides(file: object, table: Mapping[str, Any], overrides: Overrides) -> Mapping[str, Any]:
    """A copy of `table` with the overrides set, in their order; logs what they replace. The values are checked later."""
    made = as_written(table, file)
    keys_set: set[Location] = set()
    for override in as_list(overrides):
        key, value = _key_and_value(file, override)
        location = _location(file, key)
        holder = _set(file, made, location, value)
        keys_set.add(location)
        if isinstance(holder, dict):
            for rival in _alternatives(location):
                replaced = (*location[:-1], rival)
                if rival in holder and replaced not in keys_set:
                    _log.info("%s replaces %s = %s", dotted(location), dotted(replaced), shown(holder.pop(rival)))
    return made


def _alternatives(location: Location) -> set[str]:
    """Keys that an override of this key removes: all groups of theirs contain it, too."""
    *above, last = location
    if unknown_depth(location) is not None:
        return set()
    groups = table_at(tuple(above)).one_of
    names = {name for group in groups if last in group for name in group if name != last}
    return {name for name in names if all(last in group for group in groups if name in group)}


def as_written(value: Any, file: object, location: Location = ()) -> Any:
    """A copy of a value given in code, as TOML has it: arrays as lists, NumPy's numbers as numbers, paths as strings.

    file, location: for the error of a key that is no text.
    """
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                wrong = f"the key {shown(key)} is not text"
                raise scene_error(file, dotted(location), wrong, "write keys such as 'wire' or 'diameter'")
        return {key: as_written(entry, file, (*location, key)) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [as_written(entry, file, (*location, k)) for k, entry in enumerate(value)]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value.tolist() if hasattr(value, "tolist") else value


def _key_and_value(file: object, override: Override) -> tuple[str, Any]:
    if not isinstance(override, str):
        if not isinstance(override, Sequence) or len(override) != 2:
            wrong = f"{shown(override)} is neither text nor a pair"
            raise scene_error(file, "override", wrong, "write KEY=VALUE as text, or a pair of a key and its value")
        key, value = override[0], override[1]
        return key, as_written(value, file, _location(file, key))
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        wrong = f"{shown(override)} has no {'key' if equals else 'value'}"
        raise scene_error(file, "override", wrong, "write KEY=VALUE, such as load.strain_warp=0.05")
    return key.strip(), _value(text.strip())


def _value(text: str) -> Any:
    """`text` as a TOML value, else as it stands."""
    try:
        parsed = toml.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return parsed["value"] if parsed.keys() == {"value"} else text


def _location(file: object, key: object) -> Location:
    """knit.bars[1].chain or knit.bars.1.chain as ("knit", "bars", 1, "chain")."""
    parts: list[int | str] = []
    for piece in key.split(".") if isinstance(key, str) else [""]:
        match = _PART.fullmatch(piece)
        if match is None:
            raise scene_error(file, "override", f"{shown(key)} is not a dotted key", DOTTED_KEY)
        name = match["name"]
        parts.append(int(name) if name.isdecimal() and len(name) < 7 else name)
        parts.extend(int(index) for index in re.findall(r"\d+", match["indices"]))
    return tuple(parts)


def _set(file: object, table: Any, location: Location, value: Any) -> Any:
    """Set one value; tables on the way are made, a list starts from its default and grows by one entry at its end.

    Returns the table or the list that has the value.
    """
    for depth, part in enumerate(location):
        here = dotted(location[:depth])
        if isinstance(part, int):
            if not isinstance(table, list) or part > len(table):
                if unknown_depth(location[:depth]) is not None:
                    raise unknown_key(file, location)
                size = len(table) if isinstance(table, list) else 0
                raise scene_error(file, dotted(location[: depth + 1]), f"the list has {size} entries", f"write 0 to {size}")
            if part == len(table):
                table.append({})
        elif not isinstance(table, dict):
            instead = f"name an entry, such as {here}[0]" if isinstance(table, list) else f"set {here} itself"
            raise scene_error(file, dotted(location), f"{here} is {shown(table)}, not a table", instead)
        if depth == len(location) - 1:
            table[part] = value
        elif isinstance(part, int):
            table = table[part]
        else:
            is_list = isinstance(location[depth + 1], int)
            table = table.setdefault(part, as_written(default_list(location[: depth + 1]), file) if is_list else {})
    return table
