"""What a result says: findings, the lines of tables and pages, and warnings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from warpknit.base.text import alike, engineering

__all__ = ["Finding", "ResultWarning", "warning_lines"]


@dataclass(frozen=True)
class Finding:
    """One finding of a result: a line of the table of a command, of a report or a notebook.

        Finding("largest stress", 1.48e8, "Pa", where="31 % of the elastic limit", sure="assumed").text

    value: a number, or the numbers in weft and warp; or words, without a unit.
    """

    name: str
    value: float | tuple[float, ...] | str
    unit: str = ""  # SI; numbers are shown with a prefix
    where: str = ""  # where, when or beside what, as it stands behind the value
    sure: str = ""  # how sure, as it stands behind that

    @property
    def text(self) -> str:
        """Value, place and certainty in words."""
        if isinstance(self.value, tuple):
            shown = " / ".join(alike(self.value, self.unit))
        else:
            shown = self.value if isinstance(self.value, str) else engineering(self.value, self.unit)
        return f"{shown}{self.where}{self.sure}"


@dataclass(frozen=True)
class ResultWarning:
    """A limit to the use of a result."""

    code: str  # W01, W02, ...: the same for all warnings of one kind
    text: str  # what is the case
    advice: str = ""  # what to do
    link: str = ": "  # between the two in one line

    def __str__(self) -> str:
        return self.text + (self.link + self.advice if self.advice else "")


def warning_lines(warnings: Iterable[ResultWarning]) -> list[Finding]:
    """The lines of a table for warnings."""
    return [Finding("warning", str(warning)) for warning in warnings]
