"""Error messages of a scene in one line: `FILE: KEY: what is wrong; what to write instead`."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..base.errors import SceneError
from ..base.text import at_least, at_most
from .keys import Key, Table, given_values, keys_below
from .scene import SceneFile
from .units import shown

Location = tuple[int | str, ...]
UNKNOWN = ("unexpected_keyword_argument", "invalid_key")  # what pydantic calls an unknown key


def scene_error(file: object, key: str, wrong: str, instead: str, more: Sequence[str] = ()) -> SceneError:
    """The error for one key, or for the whole file (""); more: the keys of other errors."""
    also = f" (also wrong: {', '.join(more)})" if more else ""
    text = f"{file}: {f'{key}: ' if key else ''}{wrong}; {instead}{also}"
    return SceneError("".join(one if one.isprintable() else repr(one)[1:-1] for one in text), key)


def first_error(file: object, error: ValidationError) -> SceneError:
    """The first of pydantic's errors; unknown keys come first, because they often cause the others."""
    found = sorted(error.errors(include_url=False), key=lambda item: item["type"] not in UNKNOWN)
    item, places = found[0], [other["loc"] for other in found]
    location: Location = item["loc"]
    # a list whose entries are wrong counts as empty too, and the key that an unknown one stands for as missing
    more = [
        dotted(other["loc"])
        for other in found[1:]
        if not any(other["loc"] == entry[: len(other["loc"])] for entry in places if entry != other["loc"])
        and not (item["type"] in UNKNOWN and other["type"] == "missing" and other["loc"][:-1] == location[:-1])
    ]
    context, given = item.get("ctx", {}), shown(item["input"])
    match item["type"]:
        case "refused":
            location = (*location, context["key"]) if "key" in context else location
            wrong, instead = f"{context.get('given', given)} {context['wrong']}", context["instead"]
        case "unexpected_keyword_argument" | "invalid_key":
            nested = _nested(location)
            if nested is None:
                return unknown_key(file, location, more)
            wrong, instead = "a table has no dotted keys", nested
        case "missing":
            entry = _key_at(location)
            allowed = "a list with at least one entry" if entry.is_list or entry.check is None else entry.check.allowed
            wrong, instead = "missing", f"write {allowed}"
        case "too_short":
            wrong, instead = f"{given} is empty", "write at least one entry"
        case kind:
            wrong = f"{given} is not a {'list' if kind == 'tuple_type' else 'table'}"
            instead = f"write {_heading(location)}"
    return scene_error(file, dotted(location), wrong, instead, more)


def _heading(location: Location) -> str:
    """How a file writes the table or the list at a location."""
    table = location[:-1] if location and isinstance(location[-1], int) else location
    if not table:
        return "a table"
    entry = _key_at(table)
    if entry.table is None:
        return "a list"
    return f"a list of tables, [[{dotted(table)}]]" if entry.is_list else f"a table, [{dotted(table)}]"


def unknown_key(file: object, location: Location, more: Sequence[str] = ()) -> SceneError:
    """Error for an unknown key, with the nearest known key; more: keys of other errors."""
    depth = unknown_depth(location)
    assert depth is not None
    above, below = location[: depth + 1], dotted(location[depth + 1 :])
    key, is_close = _nearest_key(above)
    nearest = key + ("." if below[:1] not in ("", "[") else "") + below
    table = dotted(above[:-1])
    note = "" if is_close else f"; {f'[{table}]' if table else 'a scene'} has {', '.join(_fields(above[:-1]))}"
    return scene_error(file, dotted(location), "unknown key", f"the nearest is {nearest}{note}", more)


def unknown_depth(location: Location) -> int | None:
    """Place of the first part of a location that is no key; None where all are."""
    parts = enumerate(location)
    return next((k for k, part in parts if isinstance(part, str) and part not in _fields(location[:k])), None)


def value_text(location: Sequence[int | str], value: Any) -> str:
    """A value in SI with its unit, also of an omitted key."""
    try:
        return _key_at(location).text(value)
    except KeyError:
        return shown(value)


def dotted(location: Sequence[int | str]) -> str:
    """Dotted form of a location: ("knit", "bars", 1, "chain") as knit.bars[1].chain."""
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += ("." if text else "") + (part if re.fullmatch(r"[\w-]+", part) else repr(part))
    return text


def default_list(location: Sequence[int | str]) -> list[Any]:
    """The default of a list, as a file has it; empty for others and for unknown keys."""
    try:
        default = _key_at(location).default
    except KeyError:
        return []
    if not isinstance(default, tuple):
        return []
    return [given_values(entry) if isinstance(entry, Table) else entry for entry in default]


def known_keys() -> list[str]:
    """Every key of a scene file, dotted; an entry of a list of tables as list[0]."""
    return [name for name, _ in keys_below(SceneFile)]


def _key_at(location: Sequence[int | str]) -> Key:
    """The key at a location; raises KeyError."""
    return table_at(tuple(location[:-1])).keys[str(location[-1])]


def table_at(location: Location) -> type[Table]:
    """Class of the table, or of the tables in a list, at a location."""
    table: type[Table] = SceneFile
    for part in location:
        if isinstance(part, str):
            table = table.keys[part].table or table
    return table


def _fields(location: Location) -> list[str]:
    return list(table_at(location).keys)


OTHER_NAMES = {  # of finite element codes, and of papers
    "mu": "contact.friction",
    "friction_coefficient": "contact.friction",
    "penalty": "contact.stiffness",
    "young": "wire.youngs_modulus",
    "elastic_modulus": "wire.youngs_modulus",
    "nu": "wire.poissons_ratio",
    "rho": "wire.density",
    "cte": "wire.expansion",
    "alpha": "wire.expansion",
    "increments": "output.frames",
    "steps": "output.frames",
    "tolerance": "solver.residual_tolerance",
    "nodes": "model.nodes_per_loop",
}


def _nearest_key(location: Location) -> tuple[str, bool]:
    """The known key nearest to an unknown one, and whether it is close.

    The same word in another table comes first, then the nearest key of the same table.
    """
    *above, last = location
    unknown = str(last).lower()
    if unknown in OTHER_NAMES:
        return OTHER_NAMES[unknown], True
    elsewhere = [key for key in known_keys() if key.endswith(f".{unknown}")]
    if elsewhere and unknown not in _fields(()):  # a word at the top, such as `name`, belongs to the scene
        return elsewhere[0], True
    here = _fields(tuple(above))
    close = difflib.get_close_matches(unknown, here, n=1, cutoff=0.7)
    nearest = close or difflib.get_close_matches(unknown, here, n=1, cutoff=0.0) or here[:1]
    return dotted((*above, nearest[0])), bool(close)


def _nested(location: Location) -> str | None:
    """Text to write in place of a dotted key in a table; None for other keys."""
    *above, last = location
    key = ".".join([*([dotted(above)] if above else []), str(last)])
    if "." not in str(last) or re.sub(r"\[\d+\]", "[0]", key) not in known_keys():
        return None
    opened = re.sub(r"(\w+)(\[\d+\])?\.?", lambda name: f'{{"{name[1]}": ' + ("[" if name[2] else ""), str(last))
    closed = "".join({"{": "}", "[": "]"}.get(character, "") for character in reversed(opened))
    return f"write tables in each other, {opened}...{closed}, or override {key}"


@dataclass(frozen=True)
class Source:
    """The source of the values, as written, for messages."""

    path: Path
    table: Mapping[str, Any]

    def refusal(self, location: Sequence[int | str], value: Any, wrong: str, instead: str) -> SceneError:
        """Error for a value that conflicts with another, such as "is above 1"; `value` is shown if none was written."""
        given: Any = self.table
        for part in location:
            if not (part < len(given) if isinstance(part, int) else part in given):
                return scene_error(self.path, dotted(location), f"{value_text(location, value)} {wrong}", instead)
            given = given[part]
        return scene_error(self.path, dotted(location), f"{shown(given)} {wrong}", instead)

    def limit(
        self, location: Location, value: float, wrong: str, *, least: float = -math.inf, most: float = math.inf, unit: str = "m"
    ) -> None:
        """Refuse a value beyond limits that follow from other values, all [SI unit]; wrong: such as "is above the radius"."""
        if not least <= value <= most:
            low, high = (None if math.isinf(end) else text(end, unit) for end, text in ((least, at_least), (most, at_most)))
            instead = f"at least {low}" if high is None else f"at most {high}" if low is None else f"{low} to {high}"
            raise self.refusal(location, value, wrong, f"write {instead}")
