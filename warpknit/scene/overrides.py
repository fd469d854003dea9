"""Dotted overrides of a scene file: load.strain_warp=0.05, knit.bars[1].chain="1-0/1-2"."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from warpknit.scene.messages import (
    Location,
    default_list,
    dotted,
    required_keys,
    scene_error,
    unknown_depth,
    unknown_key,
)
from warpknit.scene.scene import Override, Overrides
from warpknit.scene.units import shown

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

DOTTED_KEY = "write one such as load.strain_warp or knit.bars[1].chain"
_PART = re.compile(r"(?P<name>[A-Za-z0-9_-]+)(?P<indices>(\[\d{1,6}\])*)")

# Alternative keys: an override of one removes the other from the file.
RIVALS = {
    "strain_weft": ("tension_weft",),
    "tension_weft": ("strain_weft",),
    "strain_warp": ("tension_warp",),
    "tension_warp": ("strain_warp",),
    "displacement": ("strain_weft", "tension_weft", "strain_warp", "tension_warp"),
    "wale_spacing": ("wales",),
    "wales": ("wale_spacing",),
    "course_spacing": ("courses",),
    "courses": ("course_spacing",),
}


def as_list(overrides: Overrides) -> list[Override]:
    """Overrides in any form as a list."""
    if isinstance(overrides, Mapping):
        return list(overrides.items())
    return list(overrides) if isinstance(overrides, Iterable) and not isinstance(overrides, str) else [overrides]


def with_overrides(file: object, table: Mapping[str, Any], overrides: Overrides) -> dict[str, Any]:
    """A copy of `table` with the overrides set, in their order. The values are checked later, with the rest."""
    made = as_written(table, file)
    keys_set: set[tuple[int | str, ...]] = set()
    added: dict[Location, Location] = {}  # entries of lists that are new, by the override that added each
    for override in as_list(overrides):
        key, value = _key_and_value(file, override)
        location = _location(file, key)
        for entry in _set(file, made, location, value):
            added[entry] = location
        keys_set.add(location)
        *above, last = location
        if above and above[0] in ("load", "path", "knit", "sweep"):
            holder = _at(made, above)
            for rival in RIVALS.get(str(last), ()):
                if (*above, rival) not in keys_set:
                    holder.pop(rival, None)
    for entry, location in added.items():
        _refuse_incomplete(file, made, entry, location)
    return made


def _refuse_incomplete(file: object, table: Mapping[str, Any], entry: Location, location: Location) -> None:
    """Refuse an override that adds an incomplete entry to a list: another entry was meant."""
    here = _at(table, entry)
    if not isinstance(here, Mapping) or unknown_depth(location) is not None:
        return
    if missing := [name for name in required_keys(entry) if name not in here]:
        size = int(entry[-1])
        name = f" {entry[-2]}" if str(entry[-2]).endswith("s") else " entries"
        numbers = "0 and 1" if size == 2 else f"0 to {size - 1}"
        there = "there is none" if size == 0 else "there is one, 0" if size == 1 else f"there are {size}{name}, {numbers}"
        new = " and ".join(dotted((*entry, one)) for one in missing)
        wrong = f"the entry does not exist ({there})"
        raise scene_error(file, dotted(location), wrong, f"name one that exists, or set {new} of a new one")


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
        parsed = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return parsed["value"] if parsed.keys() == {"value"} else text


def _location(file: object, key: object) -> tuple[int | str, ...]:
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


def _at(table: Any, location: Sequence[int | str]) -> Any:
    for part in location:
        table = table[part]
    return table


def _set(file: object, table: Any, location: Location, value: Any) -> list[Location]:
    """Set one value; tables on the way are made, a list starts from its default and grows by one entry at its end.

    Returns the entries that are new.
    """
    added: list[Location] = []
    for depth, part in enumerate(location):
        here = dotted(location[:depth])
        if isinstance(part, int):
            if not isinstance(table, list) or part > len(table):
                if unknown_depth(location[:depth]) is not None:
                    raise unknown_key(file, location)
                size = len(table) if isinstance(table, list) else 0
                wrong = f"the list has {size} {'entry' if size == 1 else 'entries'}"
                instead = f"write {f'0 to {size - 1}, or ' if size else ''}{size} for a new entry"
                raise scene_error(file, dotted(location[: depth + 1]), wrong, instead)
            if part == len(table):
                table.append({})
                added.append(location[: depth + 1])
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
    return added
