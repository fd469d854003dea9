"""Ranks that share a mesh: what they tell each other, and where this process stands among them.

`One` is the single process, which has nobody to tell; `Mpi` (mpi.py) is a rank that a launcher such as mpirun started
(start.py). Both answer the same questions, so nobody else needs to know which it is. All ranks ask the same questions in the
same order. NumPy is imported where it is used: the command line needs `One` for `--help` too.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from functools import reduce
from itertools import chain
from operator import add
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import numpy as np

Answer = TypeVar("Answer")


class Ranks(ABC):
    """The ranks of a run as one of them sees it."""

    rank: int  # of this process, from 0
    count: int
    place: int  # of this process among those on its machine, from 0
    neighbours: int  # ranks on its machine, itself included

    @property
    def is_first(self) -> bool:
        """Whether this rank is the one that speaks and writes for all."""
        return self.rank == 0

    @abstractmethod
    def everyone(self, value: Any) -> list[Any]:
        """What every rank gave, in the order of the ranks; on all ranks."""

    @abstractmethod
    def gather(self, values: np.ndarray) -> list[np.ndarray]:
        """The arrays of all ranks on the first one, in the order of the ranks; on the others an empty list."""

    @abstractmethod
    def channel(self, out: np.ndarray, into: np.ndarray, peers: list[tuple[int, slice, slice]]) -> Callable[[], None]:
        """What swaps parts of two buffers with other ranks (peer, part of `out`, part of `into`) whenever it is called."""

    @abstractmethod
    def table(self, row: np.ndarray, rows: np.ndarray) -> Callable[[], None]:
        """What collects the `row` (1, n) of every rank into `rows` (ranks, n) whenever it is called; on all ranks."""

    @abstractmethod
    def leave(self, status: int) -> tuple[int, bool]:
        """The exit status that all ranks end with, and whether this one says why.

        Where the others do not leave, this rank has failed alone: see `end_all`.
        """

    @abstractmethod
    def end_all(self, status: int) -> None:
        """End all ranks at once with an exit status."""

    def from_first(self, find: Callable[[], Answer]) -> Answer:
        """What `find` gives on the first rank, on all ranks; an exception of it is raised on all."""
        found: tuple[Answer | None, Exception | None] = (None, None)
        if self.is_first:
            try:
                found = (find(), None)
            except Exception as error:
                found = (None, error)
        answer: Any
        answer, failure = self.everyone(found)[0]
        if failure is not None:
            raise failure
        return answer

    def sum(self, values: np.ndarray) -> np.ndarray:
        """The sum of an array over the ranks, in their order: the same bits on all of them."""
        total: np.ndarray = reduce(add, self.everyone(values))
        return total

    def largest(self, values: np.ndarray) -> np.ndarray:
        """The largest of each entry of an array over the ranks."""
        import numpy as np

        return np.asarray(np.max(self.everyone(values), axis=0))

    def any(self, value: bool) -> bool:
        """Whether it holds on any rank."""
        return any(self.everyone(bool(value)))

    def exact_sum(self, values: np.ndarray) -> np.ndarray:
        """Sum (n,) of the rows (rows, n) of all ranks, correctly rounded: the same bits however they share the rows."""
        import numpy as np

        everyone = self.everyone([exact_parts(column) for column in values.T])
        return np.array([_exact_total(chain(*parts)) for parts in zip(*everyone, strict=True)])


def _exact_total(values: Iterable[float]) -> float:
    """Exactly rounded sum; not a number where it is not finite."""
    try:
        return math.fsum(values)
    except (OverflowError, ValueError):  # beyond the largest number, or infinite with both signs
        return math.nan


class One(Ranks):
    """The only process of a run."""

    rank, count, place, neighbours = 0, 1, 0, 1

    def everyone(self, value: Any) -> list[Any]:
        return [value]

    def exact_sum(self, values: np.ndarray) -> np.ndarray:
        import numpy as np

        return np.array([_exact_total(column) for column in values.T.tolist()])

    def gather(self, values: np.ndarray) -> list[np.ndarray]:
        return [values]

    def channel(self, out: np.ndarray, into: np.ndarray, peers: list[tuple[int, slice, slice]]) -> Callable[[], None]:
        return lambda: None

    def table(self, row: np.ndarray, rows: np.ndarray) -> Callable[[], None]:
        return lambda: rows.__setitem__(slice(None), row)

    def leave(self, status: int) -> tuple[int, bool]:
        return status, True

    def end_all(self, status: int) -> None:
        """Nobody else is there to end."""


def exact_parts(values: np.ndarray) -> list[float]:
    """Few numbers whose sum is exactly that of `values` (n,): each is the rounded sum of what those before it leave out."""
    numbers: list[float] = values.tolist()
    parts: list[float] = []
    if not all(map(math.isfinite, numbers)):
        return [math.nan]
    while (part := math.fsum([*numbers, *(-p for p in parts)])) != 0.0:
        parts.append(part)
    return parts
