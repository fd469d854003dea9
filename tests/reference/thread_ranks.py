"""Ranks that are threads of one process: what they would tell each other over MPI goes through memory.

One thread runs at a time; it lets go only where it waits for another rank.
"""

from __future__ import annotations

import pickle
import queue
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from warpknit.compute.ranks import Ranks


class _Shared:
    def __init__(self, count: int) -> None:
        self.running = threading.Lock()
        self.meeting = threading.Barrier(count, timeout=60)
        self.said: list[Any] = [None] * count
        self.sent = {(a, b): queue.Queue() for a in range(count) for b in range(count)}


class ThreadRanks(Ranks):
    """One of the ranks of `run_ranks`."""

    def __init__(self, shared: _Shared, rank: int, count: int) -> None:
        self._shared, self.rank, self.count, self.place, self.neighbours = shared, rank, count, rank, count

    def everyone(self, value: Any) -> list[Any]:
        shared = self._shared
        shared.said[self.rank] = pickle.dumps(value)
        self._wait(shared.meeting.wait)
        said = [pickle.loads(given) for given in shared.said]
        self._wait(shared.meeting.wait)
        return said

    def gather(self, values: np.ndarray) -> list[np.ndarray]:
        parts = self.everyone(values.copy())
        return parts if self.is_first else []

    def channel(self, out: np.ndarray, into: np.ndarray, peers: list[tuple[int, slice, slice]]) -> Callable[[], None]:
        def swap() -> None:
            for peer, sent, _ in peers:
                self._shared.sent[self.rank, peer].put(out[sent].copy())
            for peer, _, got in peers:
                into[got] = self._wait(lambda peer=peer: self._shared.sent[peer, self.rank].get(timeout=60))

        return swap

    def table(self, row: np.ndarray, rows: np.ndarray) -> Callable[[], None]:
        def collect() -> None:
            rows[:] = np.concatenate(self.everyone(row.copy()))

        return collect

    def leave(self, status: int) -> tuple[int, bool]:
        return status, self.is_first

    def end_all(self, status: int) -> None:
        self._shared.meeting.abort()

    def _wait(self, until: Callable[[], Any]) -> Any:
        self._shared.running.release()
        try:
            return until()
        finally:
            self._shared.running.acquire()


def run_ranks(count: int, work: Callable[[Ranks], Any]) -> list[Any]:
    """What `work` returns on each of `count` ranks; an exception of one of them is raised."""
    shared = _Shared(count)
    results: list[Any] = [None] * count
    failed: list[BaseException] = []

    def one(rank: int) -> None:
        ranks = ThreadRanks(shared, rank, count)
        with shared.running:
            try:
                results[rank] = work(ranks)
            except BaseException as error:
                failed.append(error)
                ranks.end_all(1)

    threads = [threading.Thread(target=one, args=(rank,)) for rank in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failed:
        raise failed[0]
    return results
