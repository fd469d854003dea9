"""Ranks that share a mesh, and their messages to each other.

`Ranks` is the single process; `Mpi` is a rank that a launcher such as mpirun started. Both have the same methods, and all ranks
call them in the same order. NumPy is imported on use: the command line needs `Ranks` for `--help` too.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterable
from functools import reduce
from operator import add
from typing import TYPE_CHECKING, Any, TypeVar

from ..base.errors import InputError

if TYPE_CHECKING:
    import numpy as np

Answer = TypeVar("Answer")
FORWARDING_S = 1.0  # for the launcher to forward the output of this rank before the end
PATIENCE_S = 3.0  # that a rank which failed waits for the others to fail alike, before it ends them
# environment variables of MPICH, Open MPI, PMIx and MVAPICH with the rank of a process
RANK_VARIABLES = ("PMI_RANK", "OMPI_COMM_WORLD_RANK", "PMIX_RANK", "MV2_COMM_WORLD_RANK")
SIZE_VARIABLES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "MV2_COMM_WORLD_SIZE")


class Ranks:
    """The ranks of a run as one of them sees it; of this class, the only process of a run."""

    rank = 0  # of this process
    count = 1
    place = 0  # of this process among those on its machine
    neighbours = 1  # ranks on its machine, itself included

    @property
    def is_first(self) -> bool:
        """Whether this rank prints and writes for all."""
        return self.rank == 0

    def everyone(self, value: Any) -> list[Any]:
        """Values of all ranks in order, on all ranks."""
        return [value]

    def gather(self, values: np.ndarray) -> list[np.ndarray]:
        """Arrays of all ranks on the first rank, in order; an empty list on the others."""
        return [values]

    def channel(self, out: np.ndarray, into: np.ndarray, peers: list[tuple[int, slice, slice]]) -> Callable[[], None]:
        """A function that swaps parts of two buffers with other ranks (peer, part of `out`, part of `into`)."""
        return lambda: None

    def table(self, row: np.ndarray, rows: np.ndarray) -> Callable[[], None]:
        """A function that collects the `row` (1, n) of all ranks into `rows` (ranks, n)."""
        return lambda: rows.__setitem__(slice(None), row)

    def leave(self, status: int) -> tuple[int, bool]:
        """Common exit status of all ranks; whether this rank prints the reason.

        Where the others do not leave, this rank has failed alone: see `end_all`.
        """
        return status, True

    def end_all(self, status: int) -> None:
        """End all ranks at once with an exit status."""

    def from_first(self, find: Callable[[], Answer]) -> Answer:
        """Result of `find` on the first rank, or its exception, on all ranks."""
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

        return np.array([_exact_total(column) for column in np.concatenate(self.everyone(values)).T.tolist()])


def _exact_total(values: Iterable[float]) -> float:
    """Exactly rounded sum; not a number where it is not finite."""
    try:
        return math.fsum(values)
    except (OverflowError, ValueError):  # beyond the largest number, or infinite with both signs
        return math.nan


class Mpi(Ranks):
    """A rank that mpirun started, over mpi4py, whose import starts MPI. Raises ImportError where it is missing."""

    _left = False

    def __init__(self) -> None:
        os.environ.setdefault("MPIR_CVAR_SUPPRESS_ABORT_MESSAGE", "1")  # MPICH: one line says why, and it is ours
        from mpi4py import MPI

        self._mpi, self._all = MPI, MPI.COMM_WORLD
        self._leaving = self._all.Dup()
        machine = self._all.Split_type(MPI.COMM_TYPE_SHARED)
        self.rank, self.count = self._all.rank, self._all.size
        self.place, self.neighbours = machine.rank, machine.size
        machine.Free()

    def everyone(self, value: Any) -> list[Any]:
        return self._all.allgather(value)

    def gather(self, values: np.ndarray) -> list[np.ndarray]:
        """Array by array, so that the first rank holds each only once."""
        import numpy as np

        values = np.ascontiguousarray(values)
        shapes = self._all.gather(values.shape)
        if shapes is None:
            self._all.Send(self._bytes(values), dest=0)
            return []
        parts = [values, *(np.empty(shape, dtype=values.dtype) for shape in shapes[1:])]
        for rank, part in enumerate(parts[1:], start=1):
            self._all.Recv(self._bytes(part), source=rank)
        return parts

    def channel(self, out: np.ndarray, into: np.ndarray, peers: list[tuple[int, slice, slice]]) -> Callable[[], None]:
        if len(peers) == 1:
            peer, sent, got = peers[0]
            return lambda: self._all.Sendrecv(out[sent], peer, 0, into[got], peer, 0)

        def swap() -> None:
            requests = [self._all.Irecv(into[got], peer) for peer, _, got in peers]
            requests += [self._all.Isend(out[sent], peer) for peer, sent, _ in peers]
            self._mpi.Request.Waitall(requests)

        return swap

    def table(self, row: np.ndarray, rows: np.ndarray) -> Callable[[], None]:
        return lambda: self._all.Allgather(row, rows)

    def leave(self, status: int) -> tuple[int, bool]:
        """A rank that failed waits PATIENCE_S for the others; then it ends them."""
        import numpy as np

        statuses = np.zeros(self.count, dtype=np.int32)
        request = self._leaving.Iallgather(np.array([status], dtype=np.int32), statuses)
        given_up = time.monotonic() + PATIENCE_S
        while not request.Test():
            if status and time.monotonic() > given_up:
                return status, True
            time.sleep(0.01)
        worst = int(statuses.max())
        self._left = True
        return worst, self.rank == int(np.argmax(statuses))

    def end_all(self, status: int) -> None:
        if not self._left:
            time.sleep(FORWARDING_S)
            self._all.Abort(status)

    def _bytes(self, values: np.ndarray) -> list[Any]:
        return [values.reshape(-1).view("uint8"), self._mpi.BYTE]


def join_ranks() -> Ranks:
    """The ranks that this process was started among. Raises `InputError` where that needs mpi4py and it is missing."""
    if started_as() is None or any(os.environ.get(name) == "1" for name in SIZE_VARIABLES):
        return Ranks()
    try:
        ranks = Mpi()
    except ImportError as error:
        raise InputError(
            f'several ranks need mpi4py and an MPI library ({error}); pip install "warpknit[mpi]", or run without mpirun'
        ) from error
    if ranks.count == 1:
        return Ranks()
    share_cores(ranks)
    return ranks


def started_as() -> int | None:
    """Rank that a launcher gave this process, or None."""
    return next((int(os.environ[name]) for name in RANK_VARIABLES if os.environ.get(name, "").isdecimal()), None)


def share_cores(ranks: Ranks) -> None:
    """Set each rank's threads to its share of the cores, unless given (step.thread_count)."""
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))
    # a launcher may have bound each rank to its own cores
    sharing = min(ranks.neighbours, ranks.everyone(cores).count(cores))
    os.environ.setdefault("WARPKNIT_THREADS", str(max(1, len(cores) // sharing)))
