"""Variables that outlast a step: each class names its own once, and one walk saves and restores them.

A class names its variables in `KEPT`; a dataclass has all its fields saved. They are

    device arrays                     restored in place
    host arrays, numbers, text, None  restored by value; arrays of many worlds in place
    lists, tuples and dictionaries    of these
    objects                           walked in turn

The first axis of an array counts worlds, or rows of one world after the other. A class whose variables are no arrays of fixed
length has `state_dict(world)`, which may return views, and `load_state_dict(kept, world)` instead.
"""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from .host import fetch, is_in_place, store

Kept = dict[str, np.ndarray]
ARRAYS, VALUES, COLLECTIONS = (wp.array, np.ndarray), (bool, int, float, str, np.generic), (list, tuple, dict)
TYPE = "/type"  # ending of the name under which the type of a collection is saved, with its length or keys; also of None


class Owner(NamedTuple):
    """An object with variables to save: of one world among `worlds`."""

    variables: Any
    world: int = 0
    worlds: int = 1


def strip_prefix(prefix: str, kept: Kept) -> Kept:
    """The entries whose names begin with `prefix`, without it."""
    return {name.removeprefix(prefix): value for name, value in kept.items() if name.startswith(prefix)}


def save(*owners: Owner, copied: bool = True) -> Kept:
    """The variables of owners, by name; not `copied`: those in arrays on a CPU are valid until the next step."""
    kept: Kept = {}
    for owner in owners:
        _save_variables(owner, f"{type(owner.variables).__name__}.", kept, copied=copied)
    return kept


def restore(kept: Kept, *owners: Owner) -> None:
    """Set the variables of owners to what `save` returned. Raises `KeyError` for a missing one, `ValueError` for another size."""
    for owner in owners:
        _restore_variables(owner, f"{type(owner.variables).__name__}.", kept)


def rows_of(array: Any, world: int, worlds: int) -> slice:
    """Rows of an array that belong to one world; all of them with a single world."""
    count = array.shape[0]
    if worlds == 1 or count == 1:
        return slice(0, count)
    return slice(world * count // worlds, (world + 1) * count // worlds)


def _names(variables: Any) -> tuple[str, ...]:
    return variables.KEPT if hasattr(variables, "KEPT") else tuple(field.name for field in fields(variables))


def _save_variables(owner: Owner, prefix: str, kept: Kept, *, copied: bool) -> None:
    variables, world, _ = owner
    if hasattr(variables, "arrays") and hasattr(variables, "restore"):
        kept.update({f"{prefix}{name}": value for name, value in variables.arrays(copied=copied).items()})
    elif not hasattr(variables, "KEPT") and hasattr(variables, "state_dict"):
        own = variables.state_dict(world)
        kept.update({f"{prefix}{name}": np.array(value) if copied else value for name, value in own.items()})
    else:
        for name in _names(variables):
            _save(getattr(variables, name), f"{prefix}{name}", owner, kept, copied=copied)


def _save(value: Any, name: str, owner: Owner, kept: Kept, *, copied: bool) -> None:
    if isinstance(value, ARRAYS):
        kept[name] = _part(value, owner, copied=copied)
    elif isinstance(value, VALUES):
        kept[name] = np.array(value)
    elif value is None:
        kept[name + TYPE] = np.array(json.dumps(["NoneType", []]))
    elif isinstance(value, COLLECTIONS):
        keys = list(value) if isinstance(value, dict) else list(range(len(value)))
        kept[name + TYPE] = np.array(json.dumps([type(value).__name__, keys]))
        for key in keys:
            _save(value[key], f"{name}.{key}", owner, kept, copied=copied)
    else:
        _save_variables(owner._replace(variables=value), f"{name}.", kept, copied=copied)


def _part(array: Any, owner: Owner, *, copied: bool) -> np.ndarray:
    """The rows of a world, on the host."""
    if owner.worlds > 1 and array.ndim:
        rows = rows_of(array, owner.world, owner.worlds)
        is_host = not isinstance(array, wp.array) or not is_in_place(array.device)
        array = array[rows] if is_host else fetch(array)[rows]
    host = fetch(array) if isinstance(array, wp.array) else array
    return np.array(host) if copied else np.asarray(host)


def _restore_variables(owner: Owner, prefix: str, kept: Kept) -> None:
    variables, world, _ = owner
    if hasattr(variables, "arrays") and hasattr(variables, "restore"):
        variables.restore(strip_prefix(prefix, kept))
    elif not hasattr(variables, "KEPT") and hasattr(variables, "state_dict"):
        variables.load_state_dict(strip_prefix(prefix, kept), world)
    else:
        for name in _names(variables):
            before = getattr(variables, name)
            now = _restored(before, f"{prefix}{name}", owner, kept)
            if now is not before:
                setattr(variables, name, now)


def _restored(value: Any, name: str, owner: Owner, kept: Kept) -> Any:
    """The value of a variable as it was saved: `value` itself where it is restored in place."""
    if isinstance(value, wp.array):
        if value.size:
            store(value[rows_of(value, owner.world, owner.worlds)] if owner.worlds > 1 else value, kept[name])
        return value
    if isinstance(value, np.ndarray) and (owner.worlds > 1 or not value.ndim):
        value[rows_of(value, owner.world, owner.worlds) if value.ndim else ...] = kept[name]
        return value
    if name in kept:
        saved = np.asarray(kept[name])
        return saved.copy() if saved.ndim else saved.item()
    if name + TYPE in kept:
        return _restored_items(value, name, owner, kept)
    if hasattr(value, "KEPT") or hasattr(value, "state_dict") or is_dataclass(value):
        _restore_variables(owner._replace(variables=value), f"{name}.", kept)
        return value
    raise KeyError(name)


def _restored_items(value: Any, name: str, owner: Owner, kept: Kept) -> Any:
    """A list, tuple or dictionary; objects and device arrays in one of the same length are restored in place."""
    kind, keys = json.loads(str(kept[name + TYPE]))
    if kind == "NoneType":
        return None
    now: dict[Any, Any] = {}
    if type(value).__name__ == kind and len(value) == len(keys):
        now = value if isinstance(value, dict) else dict(enumerate(value))
    items = {key: _restored(now.get(key), f"{name}.{key}", owner, kept) for key in keys}
    return items if kind == "dict" else list(items.values()) if kind == "list" else tuple(items.values())
