"""Numbers formatted for people."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from typing import Any

INTERIOR_SHARE = 0.95  # of the largest stress: below it, the stress away from the grips is shown too
ZERO_CELSIUS = 273.15  # [K]
PREFIXES = (
    (1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "u"), (1e-9, "n"), (1e-12, "p"),
)  # fmt: skip
LARGEST = {"m": 1e3, "s": 1.0}  # prefix of these units: no Mm, no ks
PREFIXED = {"m", "s", "N", "N/m", "Pa", "Hz"}  # units of a scene that take a prefix
ALL_DIGITS = 12  # what was typed, without the round-off of its unit
LIMIT_DIGITS = 4
FINEST_PLACE = 1e-8  # [m] coordinates of places below it count as zero
FIELDS_SHOWN = 12  # of an object with arrays, on one line


def engineering(value: float, unit: str, digits: int = 3) -> str:
    """`value` with three digits and a prefix: 1.48e8, "Pa" as 148 MPa.

    >>> engineering(5.726e8, "Pa")
    '573 MPa'
    """
    size, largest = abs(float(f"{value:.{digits}g}")), LARGEST.get(unit, 1e12)  # 999.8 of one prefix is 1 of the next
    scale, prefix = next(((scale, prefix) for scale, prefix in PREFIXES if scale <= largest and size >= scale), (1.0, ""))
    return f"{float(f'{value / scale:.{digits}g}'):.{ALL_DIGITS}g} {prefix}{unit}"


def alike(values: Sequence[float], unit: str, digits: int = 3) -> list[str]:
    """`engineering` of values that stand in one row: zeros fill them up to the same number of digits.

    >>> alike([5.4, 5.39], "N/m"), alike([3.0, 3.0], "N/m")
    (['5.40 N/m', '5.39 N/m'], ['3 N/m', '3 N/m'])
    """
    numbers = [engineering(value, unit, digits).split(maxsplit=1) for value in values]
    shown = max((len(number.lstrip("-").replace(".", "").strip("0")) for number, _ in numbers if "e" not in number), default=0)
    return [f"{_filled(number, shown)} {prefixed}" for number, prefixed in numbers]


def sides_text(values: Sequence[float], unit: str, digits: int = 3) -> str:
    """A quantity in weft and warp in words; once where both print alike.

    >>> sides_text([5.4, 5.39], "N/m"), sides_text([2.0, 2.0], "N/m")
    ('5.40 N/m weft, 5.39 N/m warp', '2 N/m')
    """
    weft, warp = alike(values, unit, digits)
    return weft if weft == warp else of_sides((weft, warp))


def of_sides(texts: Sequence[str]) -> str:
    """Two texts, for weft and warp.

    >>> of_sides(["8 %", "6 %"])
    '8 % weft, 6 % warp'
    """
    return f"{texts[0]} weft, {texts[1]} warp"


def _filled(number: str, digits: int) -> str:
    """A number with zeros behind the point, up to `digits` digits."""
    if "e" in number or not float(number):
        return number
    whole = len(number.lstrip("-0").partition(".")[0])
    return f"{float(number):.{max(digits - whole, 0)}f}"


def exact(value: float, unit: str) -> str:
    """`value` [SI unit] of a scene with all its digits: 0.0123456, "m" as 12.3456 mm."""
    return engineering(value, unit, ALL_DIGITS) if unit in PREFIXED else f"{value:.{ALL_DIGITS}g} {unit}".rstrip()


def counted(number: int, noun: str) -> str:
    """A number and its noun.

    >>> counted(1, "pair"), counted(2, "pair")
    ('1 pair', '2 pairs')
    """
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def either(options: Sequence[str]) -> str:
    """Alternatives in words.

    >>> either(["a", "b", "c"])
    'a, b or c'
    """
    return " or ".join(part for part in (", ".join(options[:-1]), options[-1]) if part)


def listed(names: Sequence[str]) -> str:
    """Names in words.

    >>> listed(["A", "B", "C"])
    'A, B and C'
    """
    return " and ".join(part for part in (", ".join(names[:-1]), names[-1]) if part)


def both(one: str, other: str) -> str:
    """Two values in words; one where they print alike.

    >>> both("8 %", "34 %"), both("50.0 %", "50.0 %")
    ('8 % and 34 %', '50.0 %')
    """
    return one if one == other else f"{one} and {other}"


def between(low: str, high: str) -> str:
    """A range by its ends; its value where they print alike.

    >>> between("8 %", "34 %"), between("50.0 %", "50.0 %")
    ('between 8 % and 34 %', 'at 50.0 %')
    """
    return f"at {low}" if low == high else f"between {low} and {high}"


def span(low: str, high: str) -> str:
    """A range by its ends, with the unit once.

    >>> span("500 mN/m", "600 mN/m"), span("500 mN/m", "1 N/m")
    ('500 to 600 mN/m', '500 mN/m to 1 N/m')
    """
    number, _, unit = low.rpartition(" ")
    return f"{number if high.endswith(f' {unit}') else low} to {high}"


def place_text(x: float, y: float) -> str:
    """A place [m] in one unit; three digits of the larger coordinate, 10 nm at most.

    >>> place_text(3.91e-9, 751e-6), place_text(-1.4e-3, 45e-6)
    ('(0, 751) um', '(-1.4, 0.05) mm')
    """
    largest = max(abs(x), abs(y), FINEST_PLACE)
    number, unit = engineering(largest, "m").split(maxsplit=1)
    decimals = max(0, 3 - len(number.partition(".")[0]))
    scale = next(scale for scale, prefix in PREFIXES if f"{prefix}m" == unit)
    shown = (round(value / scale, decimals) if abs(value) >= FINEST_PLACE else 0.0 for value in (x, y))
    return f"({', '.join(f'{value + 0.0:g}' for value in shown)}) {unit}"


def at_most(limit: float, unit: str) -> str:
    """A computed upper limit [SI unit], rounded down to an allowed value."""
    return exact(_limit(limit, ROUND_FLOOR), unit)


def at_least(limit: float, unit: str) -> str:
    """A computed lower limit [SI unit], rounded up."""
    return exact(_limit(limit, ROUND_CEILING), unit)


def _limit(limit: float, rounding: str) -> float:
    return float(Context(LIMIT_DIGITS, rounding).create_decimal(f"{limit:.{ALL_DIGITS}g}"))


def celsius(temperature: float) -> str:
    """A temperature [K] in degrees Celsius: 83.15 as -190 degC.

    >>> celsius(83.15)
    '-190 degC'
    """
    return f"{temperature - ZERO_CELSIUS:.6g} degC"


def percent(share: float, digits: int = 1, *, signed: bool = False) -> str:
    """A share in percent with `digits` decimals: 0.0966 as 9.7 %, or +9.7 %; never -0.0 %."""
    value = round(100.0 * share, digits) + 0.0
    return f"{value:+.{digits}f} %" if signed and value else f"{value:.{digits}f} %"


def short_percent(share: float) -> str:
    """A share in percent with two digits and no exponent.

    >>> short_percent(0.996), short_percent(0.00123)
    ('100 %', '0.12 %')
    """
    return f"{float(f'{100.0 * share:.2g}'):g} %"


def memory(count: int) -> str:
    """Bytes with a binary prefix."""
    return f"{float(f'{count / 2**30:.3g}'):,.{ALL_DIGITS}g} GiB" if count >= 2**30 else f"{count / 2**20:.0f} MiB"


def duration(seconds: float, digits: int = 2) -> str:
    """A time with two digits and a suitable unit."""
    units = (("days", 86400.0), ("h", 3600.0), ("min", 60.0))
    unit, length = next(((unit, length) for unit, length in units if seconds >= 2 * length), ("s", 1.0))
    return f"{float(f'{seconds / length:.{digits}g}'):g} {unit}"


def rounded(count: float) -> int:
    """A count rounded to two digits."""
    return int(float(f"{count:.2g}"))


def short_repr(item: Any) -> str:
    """`repr` of a dataclass with arrays, on one line: arrays by their shape, large objects by their kind."""
    shown = [f"{entry.name} {_short(getattr(item, entry.name))}" for entry in fields(item)]
    more = f", and {len(shown) - FIELDS_SHOWN} more fields" if len(shown) > FIELDS_SHOWN else ""
    return f"<{type(item).__name__}: {', '.join(shown[:FIELDS_SHOWN])}{more}>"


def _short(value: Any) -> str:
    """A value in a few characters."""
    if isinstance(getattr(value, "shape", None), tuple):
        return str(tuple(value.shape))
    if isinstance(value, list | tuple | dict):
        return f"of {len(value)}"
    return repr(value) if value is None or isinstance(value, str | int | float) else type(value).__name__


def is_at_grips(interior: float, largest: float) -> bool:
    """Whether the largest stress is well above the interior stress, both [Pa]."""
    return bool(interior < INTERIOR_SHARE * largest)
