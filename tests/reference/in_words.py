"""Warnings, messages and tables of results, and the values that they state."""

import re
from collections.abc import Callable, Iterable
from itertools import takewhile

from warpknit.results.finding import Finding, ResultWarning
from warpknit.results.row import Row

UNIT = r"%|degC|K\b|[numkMG]?(?:N/m|Pa|Hz|N|m|s)\b|GiB|min\b|h\b|/inch|/cm"
QUANTITY = re.compile(rf"(?<![\w.])[-+]?\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?(?: (?:{UNIT}))?(?!\w)")


def in_words(warnings_of: Callable[..., Iterable[ResultWarning]]) -> Callable[..., list[str]]:
    """The function with the lines of its warnings."""
    return lambda *given: [str(warning) for warning in warnings_of(*given)]


def codes(warnings: Iterable[ResultWarning]) -> list[str]:
    """Codes of warnings: ["W04", "W20"]."""
    return [warning.code for warning in warnings]


def quantities(said: object) -> list[str]:
    """Numbers of a text or an error, with their units: "from 2 N/m to 5 GPa" has ["2 N/m", "5 GPa"]."""
    return QUANTITY.findall(str(said))


def key_of(said: object) -> str:
    """Key, option or argument that an error in one line, `FILE: KEY: ...`, is about; "" of one without."""
    begin = takewhile(lambda part: " " not in part, str(said).removeprefix("warpknit: ").split(": ")[:-1])
    keys = [part for part in begin if re.fullmatch(r"[\w.\[\]-]+", part) and not part.endswith(".toml")]
    return keys[-1] if keys else ""


def options(said: object) -> set[str]:
    """Options that a text names: {"--out", "--force"}."""
    return set(re.findall(r"(?<![\w-])--[a-z][\w-]*", str(said)))


def table_of(findings: Iterable[Finding]) -> dict[str, str]:
    """Texts of a table by their names; of several of one name the last."""
    return {finding.name: finding.text for finding in findings}


class ChangingRow(Row):
    """A row that a test changes."""

    __setattr__ = object.__setattr__
