"""Quantities as people type them ("15 um", "-190 degC", "12 /cm") to SI floats, with the dimension checked."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Any


class QuantityError(ValueError):
    """A value that is not a finite quantity of the `wanted` dimension; `hint`: what may have been meant."""

    def __init__(self, given: object, wanted: Dimension, hint: str = "") -> None:
        super().__init__(f"{shown(given)} is not {wanted.noun}; write {wanted}{hint}")
        self.hint = hint


@dataclass(frozen=True)
class Dimension:
    """A kind of quantity: the SI unit that bare numbers are in, what to call it, and an example for messages."""

    unit: str
    noun: str
    example: str

    def __str__(self) -> str:
        return f"{self.noun} such as {self.example}"


DIMENSIONS = {
    "number": Dimension("", "a number", "0.1"),
    "length": Dimension("m", "a length", "'15 um'"),
    "per_length": Dimension("1/m", "a count per length", "'12 /cm'"),
    "stress": Dimension("Pa", "a stress", "'400 GPa'"),
    "density": Dimension("kg/m^3", "a density", "'19250 kg/m^3'"),
    "expansion": Dimension("1/K", "an expansion coefficient", "'4.5e-6 /K'"),
    "temperature": Dimension("K", "a temperature", "'-190 degC'"),
    "tension": Dimension("N/m", "a force per length", "'2 N/m'"),
    "areal_mass": Dimension("kg/m^2", "a mass per area", "'10 g/m^2'"),
    "force": Dimension("N", "a force", "'1 uN'"),
    "angle": Dimension("rad", "an angle", "'30 deg'"),
    "temperature_gradient": Dimension("K/m", "a temperature per length", "'200 K/m'"),
    "time": Dimension("s", "a time", "'60 s'"),
    "rate": Dimension("1/s", "a rate", "'100 /s'"),
    "frequency": Dimension("Hz", "a frequency", "'10 GHz'"),
    "resistance": Dimension("ohm", "a resistance", "'1 ohm'"),
}

_QUANTITY = re.compile(r"\s*([+-]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*", re.DOTALL)
_UNIT = re.compile(r"[^\W\d_]?[\w%°²³µμ/*^().\- ]{0,39}")


def si(value: object, dimension: str) -> float:
    """`value` in the SI unit of `dimension` (a key of DIMENSIONS).

    Bare numbers are SI already. A string is a number and a unit; a string without a unit is a bare number. Raises
    QuantityError for another dimension, an unknown unit, anything that is not a number, NaN and infinity.

    >>> si("400 GPa", "stress")
    400000000000.0
    >>> si("12 /cm", "per_length")
    1200.0
    >>> si(0.2, "tension")
    0.2
    """
    wanted = DIMENSIONS[dimension]
    if isinstance(value, str):
        number = _converted(value, wanted)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        number = _finite(value)
    else:
        number = None
    if number is None:
        raise QuantityError(value, wanted, _case_hint(value, wanted) if isinstance(value, str) else "")
    return number + 0.0  # no negative zero: equal scenes have equal hashes


def has_unit(text: str) -> bool:
    """Whether a string is more than a bare number."""
    try:
        float(text)
    except ValueError:
        return True
    return False


def is_quantity(text: str, *dimensions: str) -> bool:
    """Whether a string is a quantity of these dimensions, default any."""
    return any(_converted(text, DIMENSIONS[name]) is not None for name in dimensions or DIMENSIONS)


def tidy(value: float) -> float:
    """`value` to 14 digits: what arithmetic left in the last two is no part of what was typed."""
    return float(f"{value:.14g}")


def shown(value: object, limit: int = 60) -> str:
    """`value` as in a scene file, on one short line."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, int) and abs(value) >= 10**limit:
        text = "an integer of many digits"
    else:
        text = repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def _finite(value: int | float) -> float | None:
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _converted(text: str, wanted: Dimension) -> float | None:
    match = _QUANTITY.fullmatch(text)
    if match is None:
        return None
    number = _finite(float(match[1]))
    if number is None or not match[2]:
        return number
    unit = _unit(match[2])
    if unit is None or not unit.is_compatible_with(wanted.unit or "dimensionless"):
        return None
    try:
        converted = float(_registry().Quantity(number, unit).to(wanted.unit).magnitude)
    except (ArithmeticError, ValueError):
        return None
    if converted != number:  # 15 um and 0.015 mm are the same 1.5e-05 m: drop the rounding of the conversion itself
        converted = tidy(converted)
    return _finite(converted)


def _case_hint(text: str, wanted: Dimension) -> str:
    """Hint on upper and lower case of a unit; or empty."""
    match = _QUANTITY.fullmatch(text)
    if match is None or not _UNIT.fullmatch(match[2]):
        return ""
    try:
        unit = _registry().parse_units(match[2], case_sensitive=False)
    except Exception:  # as in `_unit`
        return ""
    if not unit.is_compatible_with(wanted.unit or "dimensionless") or f"{unit:~}" == match[2]:
        return ""
    return f" (upper and lower case of a unit count: {unit:~}, not {match[2]})"


@lru_cache(maxsize=1)
def _registry() -> Any:
    """The pint registry. Made when the first unit is read: it costs a third of a second, a tenth of that from pint's cache."""
    import pint

    try:
        return pint.UnitRegistry(cache_folder=":auto:")
    except Exception:  # a folder that cannot be written, or what another process has not written to its end
        return pint.UnitRegistry()


@lru_cache(maxsize=256)
def _unit(text: str) -> Any | None:
    """The pint unit that `text` names ("/cm", "N/m", "kg/m3"), or None."""
    if not _UNIT.fullmatch(text):
        return None
    text = re.sub(r"(?<=[A-Za-zµμ])(\d)(?!\w)", r"^\1", text.lstrip())
    text = re.sub(r"\bmil\b", "thou", text)  # of wire: a thousandth of an inch
    if text.startswith("/"):
        text = "1" + text
    registry = _registry()
    try:
        return registry.parse_units(text)
    except Exception:  # pint lets the tokeniser's, the parser's and its own errors through: all mean an unknown unit
        return None
