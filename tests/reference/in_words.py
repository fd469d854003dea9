"""Warnings and tables of results as a reader sees them."""

from collections.abc import Callable, Iterable

from warpknit.results.finding import Finding, ResultWarning
from warpknit.results.row import Row


def in_words(warnings_of: Callable[..., Iterable[ResultWarning]]) -> Callable[..., list[str]]:
    """The function with the lines of its warnings."""
    return lambda *given: [str(warning) for warning in warnings_of(*given)]


def codes(warnings: Iterable[ResultWarning]) -> list[str]:
    """Codes of warnings."""
    return [warning.code for warning in warnings]


def table_of(findings: Iterable[Finding]) -> dict[str, str]:
    """Texts of a table by their names; of several of one name the last."""
    return {finding.name: finding.text for finding in findings}


class ChangingRow(Row):
    """A row that a test changes."""

    __setattr__ = object.__setattr__
