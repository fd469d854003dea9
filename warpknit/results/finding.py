"""What a result says: findings, warnings, and the table of both."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from warpknit.base.text import counted, engineering
from warpknit.results.warning_kinds import KINDS

__all__ = ["Finding", "ResultTable", "ResultWarning"]

SHOWN = 3  # warnings of the short table
WITH_CODE = re.compile(r"(W\d\d) (.*)", re.DOTALL)


@dataclass(frozen=True)
class Finding:
    """One finding of a result: a line of the table of a command, of a report or a notebook.

        Finding("largest stress", 1.48e8, "Pa", where=", 31 % of yield (assumed)").text

    value: a number; or words, without a unit.
    """

    name: str
    value: float | str
    unit: str = ""  # SI; numbers are shown with a prefix
    where: str = ""  # where, when, beside what and how sure, as it stands behind the value
    short: bool = False  # whether it belongs to the short table; --verbose shows all

    @property
    def text(self) -> str:
        """Value and place in words."""
        shown = self.value if isinstance(self.value, str) else engineering(self.value, self.unit)
        return f"{shown}{self.where}"


@dataclass(frozen=True)
class ResultWarning:
    """A limit to the use of a result: a fact and an advice, one sentence each."""

    code: str  # W01, W02, ...: a kind of results/warning_kinds.py; empty where it was read from an older file
    text: str  # what is the case
    advice: str | None = None  # what to do; None: the advice of its kind

    def __str__(self) -> str:
        advice = KINDS[self.code].advice if self.advice is None and self.code else self.advice
        return " ".join(part for part in (self.code, self.text, advice) if part)

    @property
    def rank(self) -> int:
        """0 for the gravest kinds."""
        return KINDS[self.code].rank if self.code else 0

    @classmethod
    def of(cls, line: str) -> ResultWarning:
        """The warning with this text."""
        found = WITH_CODE.fullmatch(line)
        return cls(found[1], found[2], "") if found and found[1] in KINDS else cls("", line, "")


@dataclass(frozen=True)
class ResultTable:
    """What a command prints at its end."""

    findings: tuple[Finding, ...]
    warnings: tuple[ResultWarning, ...] = ()
    file: str = "summary.json"  # which has all warnings

    def lines(self, *, verbose: bool = False) -> Iterator[Finding]:
        """The findings and the gravest warnings of the short table, or all of both."""
        yield from (finding for finding in self.findings if verbose or finding.short)
        warnings = sorted(self.warnings, key=lambda warning: warning.rank)
        shown = warnings if verbose else warnings[:SHOWN]
        for warning in shown:
            yield Finding(warning.code or "warning", str(warning).removeprefix(warning.code).strip())
        if more := len(warnings) - len(shown):
            yield Finding("", f"{counted(more, 'more warning')}: --verbose, or {self.file}")

    def with_lines(self, more: Iterable[Finding]) -> ResultTable:
        """The same with further findings."""
        return ResultTable((*self.findings, *more), self.warnings, self.file)
