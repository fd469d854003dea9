"""Closings of classes of contact: half of the pairs of a class carry more than the threshold.

A closing lasts up to the largest tension of a load step, among the records below first yield if possible: spatial wires may
graze each other and part again long before they carry load there.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..results.row import Row, Values
from .branches import Event, Rows, ranges_of, state_of
from .history import mean_tension, stages_of


class Closing(Event):
    """First record in which half of a class's pairs exceed the threshold."""

    closed_percent: float  # share of its pairs that are closed in the second record of `between`
    first_touch: Row | None  # an earlier record in which the class was closed before it opened again; null without one
    opens: Row | None  # first later record in which less than half of its pairs are closed, with its `stage`; null without one


class ClosedRange(Values):
    """A range of records in which a class is closed: the states `from` and `to`, each with its `stage`."""

    closed_percent: float  # largest share of its pairs that are closed in the range
    lasts: bool  # true where the last record is in the range


class ClassAnswer(Values):
    """Closing of a class of contacts."""

    name: str
    pairs: int
    active_percent: float
    closes: Closing | None  # None: they stay open
    closed: Sequence[ClosedRange]  # ranges of records in which the class is closed


def class_answer(run: Rows, name: str, pairs: int, threshold: float, yields: int | None = None) -> ClassAnswer:
    """Closing of a class of contact, and the ranges in which it is closed.

    threshold [N]: of an active pair. yields: the first row above the elastic limit.
    """
    rows, share = run.rows, f"active_{name}_percent"
    closed = ranges_of([row[f"force_{name}_N"] > threshold for row in rows])
    return ClassAnswer(
        name=name, pairs=pairs, active_percent=rows[-1][share],
        closes=_closing(run, closed, share, yields) if closed else None,
        closed=[
            ClosedRange(
                **{"from": state_of(rows[one[0]], "stage"), "to": state_of(rows[one[-1]], "stage")},
                closed_percent=max(rows[k][share] for k in one), lasts=one.stop == len(rows),
            )
            for one in closed
        ],
    )  # fmt: skip


def _closing(run: Rows, closed: Sequence[range], share: str, yields: int | None) -> Closing:
    """The begin of the range that counts. share: column of the closed pairs."""
    rows, found = run.rows, _closed_at_top(run.rows, closed, yields)
    return Closing(
        **vars(run.first(found.start)),
        closed_percent=rows[found.start][share],
        first_touch=None if found is closed[0] else state_of(rows[closed[0].start]),
        opens=None if found.stop == len(rows) else state_of(rows[found.stop], "stage"),
    )


def _closed_at_top(rows: Sequence[Row], closed: Sequence[range], yields: int | None) -> range:
    """The range with a load step's largest tension, preferably before the wire `yields`; else the first range."""
    for known in (rows[:yields], rows):
        begin = 0
        for part in stages_of(known):
            top = begin + max(range(len(part)), key=lambda k: mean_tension(part[k]))
            if found := next((one for one in closed if top in one), None):
                return found
            begin += len(part) - 1
    return closed[0]
