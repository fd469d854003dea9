"""Worlds of a large group in several processes with a share of the cores.

Warp runs a launch on one thread, so threads share the steps of worlds but not their checks. Results of a world are the same in
any process.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from multiprocessing.connection import wait
from typing import Any

from ..base.errors import Diverged, OutOfResources
from ..base.processes import worker
from ..compute.kept import Kept
from ..mechanics.numerics import thread_count
from .progress import Progress

NODES_A_PROCESS = 2_000  # fewer take less time than the start of a process
INTERVAL = 0.2  # [s] between news of progress


@dataclass
class RemoteWorld:
    """A world in another process, in place of its drive."""

    model: Any
    progress: Progress = field(default_factory=Progress)
    kept: Kept = field(default_factory=dict)  # where it begins, if not as knitted; in the end, where it is

    def restore(self, kept: Kept) -> None:
        """Begin at a state of a drive."""
        self.kept = kept

    def snapshot(self) -> Kept:
        """State of the drive at the end."""
        return self.kept


@dataclass
class News:
    """Message of a process: progress and, at the end, states of some worlds, and what one of them has found."""

    progress: dict[int, Progress] = field(default_factory=dict)
    kept: dict[int, Any] = field(default_factory=dict)
    world: int = 0
    found: Any = None


def process_count(models: Sequence[Any]) -> int:
    """Number of processes for worlds; 1 for few, and on a GPU."""
    if models[0].device != "cpu" or os.name != "posix":
        return 1
    return thread_count(min(len(models), sum(model.node_count for model in models) // NODES_A_PROCESS))


class WorldProcesses:
    """Worlds that run in processes, in place of `SideBySide` (simulate.py)."""

    def __init__(self, models: Sequence[Any], *, ends_only: bool) -> None:
        self.members = [RemoteWorld(model) for model in models]
        self._ends_only = ends_only

    def run(self, monitor: Callable[[], None] = lambda: None, without: Collection[int] = ()) -> Iterator[tuple[int, Any]]:
        """Number of a world and its record, or its final `Diverged`; in order of arrival.

        monitor: called now and then; may raise to stop. without: worlds that are left out. Raises what a process raises, and
        `OutOfResources` where one is killed.
        """
        rows = [row for row in range(len(self.members)) if row not in without]
        count = process_count([self.members[row].model for row in rows])
        threads = max(1, thread_count(len(rows)) // count)
        with ExitStack() as stack:
            pipes: list[Any] = []
            for part in range(count):
                own = rows[part::count]
                pipes.append(stack.enter_context(worker("warpknit.solve.world_process", threads)))
                pipes[-1].send((own, [self.members[row] for row in own], self._ends_only))
            while pipes:
                monitor()
                for pipe in wait(pipes, INTERVAL):
                    news = self._news(pipe)
                    if news.kept:
                        pipes.remove(pipe)
                    if news.found is not None:
                        yield news.world, news.found

    def _news(self, pipe: Any) -> News:
        try:
            news: News = pipe.recv()
        except (EOFError, OSError):
            raise OutOfResources("a process was killed; memory ran out, or a signal reached it") from None
        if isinstance(news.found, Exception) and not isinstance(news.found, Diverged):
            raise news.found
        for row, progress in news.progress.items():
            self.members[row].progress = progress
        for row, kept in news.kept.items():
            self.members[row].kept = kept
        return news
