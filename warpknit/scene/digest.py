"""Hash of a scene: of all its values, independent of the layout of the file."""

from __future__ import annotations

import hashlib
import json
from dataclasses import fields, is_dataclass
from typing import Any


def digest(frozen: Any, *, without: str) -> str:
    """SHA-256, in hex, of all values of a frozen object but one field of its own and those that do not compare."""
    table = {key: value for key, value in _plain(frozen).items() if key != without}
    return hashlib.sha256(json.dumps(table, sort_keys=True, allow_nan=False).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """A frozen object as nested dicts and lists."""
    if is_dataclass(value):
        return {entry.name: _plain(getattr(value, entry.name)) for entry in fields(value) if entry.compare}
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    return value
