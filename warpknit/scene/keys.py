"""One declaration a key of a scene file: type with unit and range, default, and a sentence on what it means.

    class Solver(Table):
        damping: Annotated[float, Quantity("rate", least=0.0)] | None = key("Ramp: mass-proportional damping.", None)

`Quantity` (values.py) is the unit and the range. From this line follow the check of the file, the attribute of the scene, the
resolved file, the nearest known key, and the row in docs/scenes.md. A class that derives from `Table` is first the checked table
of the file, where values may be None, and then the frozen object of the scene, which `warpknit.scene.scene_loader` has filled in.
The annotations describe the object.
"""

from __future__ import annotations

import inspect
import re
import textwrap
import typing
from collections.abc import Iterator
from dataclasses import MISSING, Field, dataclass, field
from typing import Any, ClassVar, TypeVar

from pydantic import ConfigDict, model_validator

from ..base.text import celsius, exact
from .units import DIMENSIONS, shown
from .values import Pair, Quantity, ValueCheck, refused

LINE, INDENT = 120, "    "  # of a docstring


class Table:
    """Base of frozen dataclasses for the tables of a scene file: unknown keys are errors.

    one_of: groups of alternative keys; a table has one key of a group, and an override of it removes the others.
    Unit, default and meaning of each key stand in the docstring too, for `help(scene.wire)`.
    """

    __pydantic_config__ = ConfigDict(extra="forbid")
    one_of: ClassVar[tuple[tuple[str, ...], ...]] = ()
    keys: ClassVar[dict[str, Key]] = {}
    _exclusive: ClassVar[Any]

    def __init_subclass__(cls, *, one_of: tuple[tuple[str, ...], ...] = ()) -> None:
        cls.one_of = one_of

        def exclusive(data: Any) -> Any:
            for group in one_of:
                given = [key for key in group if isinstance(data, dict) and key in data]
                if len(given) > 1:
                    first, second = given[:2]
                    other = f"[{first}]" if isinstance(data[first], dict) else f"{first} = {shown(data[first])}"
                    own = "the table" if isinstance(data[second], dict) else shown(data[second])
                    instead = f"leave out one of {', '.join(group)}"
                    raise refused(f"cannot be combined with {other}", instead, key=second, given=own)
            return data

        if one_of:
            cls._exclusive = model_validator(mode="before")(staticmethod(exclusive))
        hints = typing.get_type_hints(cls, include_extras=True)
        own = {
            name: Key(name, annotation=hints[name], default=entry.default, **entry.metadata)
            for name, entry in vars(cls).items()
            if isinstance(entry, Field) and "about" in entry.metadata
        }
        cls.keys = cls.keys | own
        lines = [entry.line for entry in own.values()]
        cls.__doc__ = "\n".join(
            [inspect.cleandoc(cls.__doc__ or ""), "", "Keys, with the unit of their values in the scene:", *lines]
        )


def key(about: str, default: Any = MISSING, *, left_out: str = "", allowed: str = "", compare: bool = True) -> Any:
    """The field of a key.

    about: its meaning, for docs/scenes.md. default: required if not given; None: nothing, or a consequence of others. left_out:
    the default in words, if `default` does not say it. allowed: allowed values in words, if its type does not say it. compare:
    whether scenes that differ in it differ.
    """
    return field(default=default, compare=compare, metadata={"about": about, "left_out": left_out, "allowed_words": allowed})


@dataclass(frozen=True)
class Key:
    """A key of a table."""

    name: str
    about: str
    default: Any  # MISSING: required
    left_out: str
    allowed_words: str
    annotation: Any

    @property
    def check(self) -> ValueCheck | None:
        """The check of its value, or of each entry of its list."""
        metadata = (entry for part in _parts(self.annotation) for entry in getattr(part, "__metadata__", ()))
        return next((entry for entry in metadata if isinstance(entry, ValueCheck)), None)

    @property
    def is_list(self) -> bool:
        """Whether it takes a list of values or of tables."""
        return any(part is not ... and ... in typing.get_args(part) for part in _parts(self.annotation))

    @property
    def table(self) -> type[Table] | None:
        """Class of its table, or of the tables in its list."""
        found = (part for part in _parts(self.annotation) if isinstance(part, type) and issubclass(part, Table))
        return next(found, None)

    @property
    def si_unit(self) -> str:
        """SI unit of its value or of its entries; empty for numbers."""
        check = self.check.each if isinstance(self.check, Pair) else self.check
        return DIMENSIONS[check.dimension].unit if isinstance(check, Quantity) else ""

    @property
    def unit(self) -> str:
        """SI unit of its written value; empty for numbers, pairs and lists."""
        return "" if self.is_list or isinstance(self.check, Pair) else self.si_unit

    def text(self, value: Any) -> str:
        """A value in SI, with its unit if it has one."""
        if not self.unit or not isinstance(value, int | float):
            return shown(value)
        return celsius(value) if self.unit == "K" else exact(value, self.unit)

    @property
    def default_text(self) -> str:
        """The default, in words."""
        value = self.default
        if self.left_out or value is None:
            return self.left_out
        if value is MISSING:
            return "required"
        if isinstance(value, bool):
            return str(value).lower()
        if isinstance(value, str):
            return f'`"{value}"`'
        if isinstance(value, tuple):
            return str(list(value))
        return self.text(value) if value and self.unit else f"{value:.6g}"

    @property
    def line(self) -> str:
        """Name, unit, default and meaning, for a docstring."""
        unit = f" [{self.si_unit}]" if self.si_unit else ""
        default = "" if self.table is not None else self.default_text
        shown = default if default in ("", "required") else f"default {default.replace('`', '')}"
        head = f"{self.name}{unit}" + (f", {shown}" if shown else "")
        about = re.sub(r"\[([^]]+)\]\([^)]*\)", r"\1", self.about)  # a link by its text
        return textwrap.fill(f"{head}: {about}", LINE, initial_indent=INDENT, subsequent_indent=2 * INDENT)

    @property
    def allowed(self) -> str:
        """Allowed values, in words."""
        words = self.allowed_words or ("" if self.check is None else self.check.allowed)
        return f"a list, each {words}" if self.is_list and not self.allowed_words else words


Object = TypeVar("Object", bound=Table)


def as_object(kind: type[Object], table: Table, **filled_in: Any) -> Object:
    """Object of a checked table, with some values replaced."""
    return kind(**({name: getattr(table, name) for name in kind.keys} | filled_in))


def given_values(table: Table) -> dict[str, Any]:
    """Given values of a table, including defaults."""
    return {name: value for name in table.keys if (value := getattr(table, name)) is not None}


def keys_below(table: type[Table], prefix: str = "") -> Iterator[tuple[str, Key]]:
    """Every key of a table and of those it holds, dotted; an entry of a list of tables as list[0]."""
    for name, entry in table.keys.items():
        yield prefix + name, entry
        if entry.table is not None:
            yield from keys_below(entry.table, f"{prefix}{name}{'[0]' if entry.is_list else ''}.")


def _parts(annotation: Any) -> Iterator[Any]:
    """An annotation and all that it is made of."""
    yield annotation
    for part in typing.get_args(annotation):
        yield from _parts(part)
