"""Checks of single values of a scene, with descriptions of allowed values."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ..base.text import either, exact
from .materials import MATERIALS
from .presets import PRESETS
from .units import DIMENSIONS, QuantityError, has_unit, shown, si, tidy


def refused(wrong: str, instead: str, **context: Any) -> PydanticCustomError:
    """The error that a check raises: what is wrong with the value, such as "is above 1", and what to write instead.

    `context` may hold `key` (below the value's own key), and `given`, the value of this key as text.
    """
    return PydanticCustomError("refused", "{wrong}; {instead}", {"wrong": wrong, "instead": instead, **context})


class ValueCheck:
    """A callable value -> checked value in an annotation, with `allowed`: the allowed values, in words."""

    allowed: str
    example: str

    @property
    def instead(self) -> str:
        """Advice: allowed values, in words."""
        return f"write {self.allowed}"

    def refusal(self, wrong: str = "cannot be used", hint: str = "") -> PydanticCustomError:
        """The error for a value; `hint` is added to what to write."""
        return refused(wrong, self.instead + hint)

    def entry(self, check: Callable[[Any], Any], value: Any) -> Any:
        """An entry of the value, checked by itself; errors are reported for the whole value."""
        try:
            return check(value)
        except PydanticCustomError as error:
            raise self.refusal(f"has {shown(value)}, which {(error.context or {})['wrong']}") from error

    def __call__(self, value: Any) -> Any:
        raise NotImplementedError

    def __get_pydantic_core_schema__(self, kind: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self, handler(kind))


@dataclass(frozen=True)
class Quantity(ValueCheck):
    """A number of one dimension (a key of units.DIMENSIONS) within bounds, in SI."""

    dimension: str
    above: float | None = None  # exclusive lower bound [SI]
    least: float | None = None  # inclusive lower bound [SI]
    most: float | None = None  # inclusive upper bound [SI]
    usual: str = ""  # a usual value, where the example of the dimension is none
    bare_least: float | None = None  # smallest bare number [SI]: below it a forgotten unit is likelier
    hint: str = ""  # added where a value is refused
    no_change: bool = False  # whether a text that begins with + is refused: it means a change of the value

    @property
    def example(self) -> str:  # type: ignore[override]
        """A usual value, as written in a scene file."""
        return f"'{self.usual}'" if self.usual else DIMENSIONS[self.dimension].example

    @property
    def allowed(self) -> str:  # type: ignore[override]
        kind = DIMENSIONS[self.dimension]
        unit = f" {kind.unit}" if kind.unit else ""
        if self.least is not None and self.most is not None:
            bounds = [f"from {self.least:g} to {self.most:g}{unit}"]
        else:
            words = (("above", self.above), ("of at least", self.least), ("at most", self.most))
            bounds = [f"{word} {exact(bound, kind.unit)}" for word, bound in words if bound is not None]
        example = "" if not kind.unit and bounds else f", such as {self.example}"
        return kind.noun + (" " + " and ".join(bounds) if bounds else "") + example

    def __call__(self, value: Any) -> float:
        kind = DIMENSIONS[self.dimension]
        try:
            number = si(value, self.dimension)
        except QuantityError as error:
            raise self.refusal(f"is not {kind.noun}", error.hint or self.hint) from error
        if self.no_change and isinstance(value, str) and value.lstrip().startswith("+"):
            raise self.refusal("is a change", self.hint)
        bare = f" (a bare number is in {kind.unit})" if kind.unit and (not isinstance(value, str) or not has_unit(value)) else ""
        for passed, bound, is_passed in (
            ("not above", self.above, float.__le__),
            ("below", self.least, float.__lt__),
            ("above", self.most, float.__gt__),
        ):
            if bound is not None and is_passed(number, bound):
                raise self.refusal(f"is {passed} {exact(bound, kind.unit)}{bare}", self.hint)
        if bare and self.bare_least is not None and number < self.bare_least:
            raise self.refusal(f"has no unit{bare}", self.hint)
        return number


@dataclass(frozen=True)
class Unit(Quantity):
    """One unit of a file, as a quantity or by its name."""

    def __call__(self, value: Any) -> float:
        return super().__call__(f"1 {value}" if isinstance(value, str) and not value[:1].isdigit() else value)


@dataclass(frozen=True)
class Integer(ValueCheck):
    """A whole number within bounds, or a word. `true` and 2.0 are not whole numbers."""

    least: int
    most: int
    word: str = ""
    example = "1"

    @property
    def allowed(self) -> str:  # type: ignore[override]
        return f"{f'{self.word!r} or ' if self.word else ''}a whole number from {self.least} to {self.most}"

    def __call__(self, value: Any) -> int | str:
        if isinstance(value, str) and value and value == self.word:
            return value
        if isinstance(value, bool) or not isinstance(value, int):
            raise self.refusal("is not a whole number")
        if not self.least <= value <= self.most:
            raise self.refusal(f"is below {self.least}" if value < self.least else f"is above {self.most}")
        return value


@dataclass(frozen=True)
class Pair(ValueCheck):
    """Two values, one for weft and one for warp."""

    each: ValueCheck

    @property
    def allowed(self) -> str:  # type: ignore[override]
        example = self.each.example
        return f"a pair, each {self.each.allowed.partition(', such')[0]}, such as [{example}, {example}]"

    def __call__(self, value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise self.refusal("is not a pair")
        return tuple(self.entry(self.each, one) for one in value)


@dataclass(frozen=True)
class Frequencies(ValueCheck):
    """Frequencies in a list, or evenly over a range."""

    each: Quantity = field(default_factory=lambda: Quantity("frequency", least=1e6, most=1e12))
    allowed: str = "a frequency from 1 MHz to 1 THz, a list, or a range with their number, such as '1 to 40 GHz, 50'"

    def __call__(self, value: Any) -> tuple[float, ...]:
        if isinstance(value, str):
            return self._range(value) if " to " in value else (self.entry(self.each, value),)
        if not isinstance(value, list | tuple) or not value:
            raise self.refusal("is neither a list nor a range")
        return tuple(sorted({self.entry(self.each, one) for one in value}))

    def _range(self, text: str) -> tuple[float, ...]:
        """The frequencies of a text "FIRST to LAST, COUNT"; the first one may leave out its unit."""
        found = re.fullmatch(r"\s*(.+?)\s+to\s+(.+?)\s*,\s*(\d{1,4})\s*", text)
        if found is None or not 2 <= (count := int(found[3])):
            raise self.refusal("is not a range of at least 2 frequencies")
        first = found[1] if has_unit(found[1]) else f"{found[1]} {found[2].split()[-1]}"
        low, high = self.entry(self.each, first), self.entry(self.each, found[2])
        return tuple(tidy(low + (high - low) * step / (count - 1)) for step in range(count))


@dataclass(frozen=True)
class Choice(ValueCheck):
    """One of a few words, or true or false."""

    options: tuple[str | bool, ...]

    @property
    def allowed(self) -> str:  # type: ignore[override]
        return ", ".join(map(shown, self.options))

    @property
    def instead(self) -> str:
        return f"write {either([shown(option) for option in self.options])}"

    def __call__(self, value: Any) -> str | bool:
        found = next((option for option in self.options if type(option) is type(value) and option == value), None)
        if found is None:
            raise self.refusal("is unknown")
        return found


@dataclass(frozen=True)
class Text(ValueCheck):
    """A string that matches a pattern."""

    pattern: str
    allowed: str

    def __call__(self, value: Any) -> str:
        if not isinstance(value, str) or not re.fullmatch(self.pattern, value):
            raise self.refusal()
        return value


class Links(Text):
    """A chain of links a-b, without spaces and without the final //."""

    def __call__(self, value: Any) -> str:
        text = re.sub(r"\s", "", value).removesuffix("//") if isinstance(value, str) else value
        if isinstance(text, str) and (three := re.search(r"(?<![\d-])(\d+-\d+)-\d+(?![\d-])", text)):
            raise refused(f"has three numbers in one link ({three[0]})", f"write {three[1]}")
        return super().__call__(text)


TREATMENTS = ("free-body", "point", "spring-point", "spring-cylinder", "ring", "friction-plane")

Length = Annotated[float, Quantity("length", above=0.0)]
Coating = Annotated[float, Quantity("length", above=0.0, usual="0.2 um")]
LoopLength = Annotated[float, Quantity("length", above=0.0, usual="1.2 mm")]
EdgeLength = Annotated[float, Quantity("length", above=0.0, usual="20 mm")]
PanelLength = Annotated[float, Quantity("length", above=0.0, usual="0.5 m")]
Vector = Annotated[tuple[float, float], Pair(Quantity("length", usual="1 mm"))]
Angle = Annotated[float, Quantity("angle")]
PerLength = Annotated[float, Quantity("per_length", above=0.0, usual="26 /inch", bare_least=100.0)]
Strength = Annotated[float, Quantity("stress", above=0.0, usual="800 MPa")]
Density = Annotated[float, Quantity("density", above=0.0)]
Expansion = Annotated[float, Quantity("expansion", least=-1e-3, most=1e-3)]
ABSOLUTE = " (absolute, not a change; degrees Celsius are degC)"
Temperature = Annotated[float, Quantity("temperature", above=0.0, most=4000.0, hint=ABSOLUTE, no_change=True)]
RoomTemperature = Annotated[
    float, Quantity("temperature", above=0.0, most=4000.0, usual="20 degC", hint=ABSOLUTE, no_change=True)
]
Tension = Annotated[float, Quantity("tension", least=0.0)]
Coefficient = Annotated[float, Quantity("number", above=0.0, most=1e3)]
TimeStep = Annotated[float, Quantity("time", above=0.0, usual="0.1 us")]
STRAIN = Quantity("number", least=-0.5, most=2.0, hint=" (a share: 0.1 is '10 %')")
Strain = Annotated[float, STRAIN]
Shear = Annotated[float, Quantity("number", least=-1.0, most=1.0)]
Scatter = Annotated[float, Quantity("number", least=0.0, most=0.2)]
Fraction = Annotated[float, Quantity("number", least=0.0, most=1.0)]
Tolerance = Annotated[float, Quantity("number", above=0.0, most=0.5)]
Factor = Annotated[float, Quantity("number", least=1.0, most=1e12)]
Flag = Annotated[bool, Choice((True, False))]
Seed = Annotated[int, Integer(0, 2**32 - 1)]
WireRepeats = Annotated[tuple[int, int], Pair(Integer(1, 10_000))]
TileSize = Annotated[int, Integer(100_000, 1_000_000)]
PresetName = Annotated[str, Choice(tuple(PRESETS))]
LINKS = Links(
    r"[0-9]{1,4}-[0-9]{1,4}(/[0-9]{1,4}-[0-9]{1,4})*", "links a-b of whole numbers joined by /, such as '1-0/1-2/2-3/2-1'"
)
Chain = Annotated[str, LINKS]
Threading = Annotated[
    str,
    Text(r"\.{0,4096}\|[|.]{0,4096}", "'|' for a threaded and '.' for an empty guide, at least one '|', such as '|.'"),
]
FILE_NAME = Text(r"[^\x00-\x1f\x7f]{1,400}", "the name of a file")
FileName = Annotated[str, FILE_NAME]
Name = Annotated[
    str,
    Text(r"(?!\.{1,2}$)[^/\\\x00-\x1f\x7f]{1,100}", "a name of 1 to 100 characters that can name a directory"),
]
MaterialName = Annotated[str, Choice(tuple(MATERIALS))]
Drive = Annotated[str, Choice(("relax", "ramp"))]
Treatment = Annotated[str, Choice(TREATMENTS)]
FrequencyList = Annotated[tuple[float, ...], Frequencies()]
