"""Ranks over MPI, by mpi4py. Imported only where a launcher has started several ranks: importing starts MPI."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np

os.environ.setdefault("MPIR_CVAR_SUPPRESS_ABORT_MESSAGE", "1")  # MPICH: one line says why, and it is ours

from mpi4py import MPI  # noqa: E402

from .ranks import Ranks  # noqa: E402

FORWARDING_S = 1.0  # that the launcher has for passing on what this rank said, before all is ended
PATIENCE_S = 3.0  # that a rank which failed waits for the others to fail alike, before it ends them


class Mpi(Ranks):
    """A rank that mpirun started."""

    def __init__(self) -> None:
        self._all = MPI.COMM_WORLD
        self._leaving = self._all.Dup()
        machine = self._all.Split_type(MPI.COMM_TYPE_SHARED)
        self.rank, self.count = self._all.rank, self._all.size
        self.place, self.neighbours = machine.rank, machine.size
        machine.Free()

    def everyone(self, value: Any) -> list[Any]:
        return self._all.allgather(value)

    def gather(self, values: np.ndarray) -> list[np.ndarray]:
        """Array by array, so that the first rank holds each only once."""
        values = np.ascontiguousarray(values)
        shapes = self._all.gather(values.shape)
        if shapes is None:
            self._all.Send(_bytes(values), dest=0)
            return []
        parts = [values, *(np.empty(shape, dtype=values.dtype) for shape in shapes[1:])]
        for rank, part in enumerate(parts[1:], start=1):
            self._all.Recv(_bytes(part), source=rank)
        return parts

    def channel(self, out: np.ndarray, into: np.ndarray, peers: list[tuple[int, slice, slice]]) -> Callable[[], None]:
        if len(peers) == 1:
            peer, sent, got = peers[0]
            return lambda: self._all.Sendrecv(out[sent], peer, 0, into[got], peer, 0)

        def swap() -> None:
            requests = [self._all.Irecv(into[got], peer) for peer, _, got in peers]
            requests += [self._all.Isend(out[sent], peer) for peer, sent, _ in peers]
            MPI.Request.Waitall(requests)

        return swap

    def table(self, row: np.ndarray, rows: np.ndarray) -> Callable[[], None]:
        return lambda: self._all.Allgather(row, rows)

    def leave(self, status: int) -> tuple[int, bool]:
        """A rank that failed waits PATIENCE_S for the others to leave, as they do where all fail alike, and then ends them."""
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

    _left = False

    def end_all(self, status: int) -> None:
        if not self._left:
            time.sleep(FORWARDING_S)
            self._all.Abort(status)


def _bytes(values: np.ndarray) -> list[Any]:
    return [values.reshape(-1).view(np.uint8), MPI.BYTE]
