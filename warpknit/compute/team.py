"""Threads that share the launches of a step on the CPU. Warp runs a launch on one thread."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
import warp as wp

from ..kernels.barrier import wait_for_all
from ..kernels.control import STATUS, STATUS_DIVERGED, STATUS_STALE, STATUS_WAITING
from .host import fetch
from .launch import Launch, bind, replay

FROZEN = frozenset(float(status) for status in (STATUS_STALE, STATUS_DIVERGED, STATUS_WAITING))
RETRY_CALLS = 20  # calls after which the slower way is tried again


class Team:
    """Threads that replay their parts of launches, with barriers in between."""

    def __init__(self, threads: int, device: str) -> None:
        self.threads = threads
        self._on_cpu = device == "cpu"
        self._state = wp.zeros(64, dtype=wp.int32, device=device)
        self._helpers = ThreadPoolExecutor(threads - 1, "step") if threads > 1 else None

    def together(self, parts: Sequence[Callable[[], object]]) -> None:
        """Call each part in its own thread; return when all are done."""
        waiting = [self._helpers.submit(part) for part in parts[1:]] if self._helpers is not None else []
        parts[0]()
        for helper in waiting:
            helper.result()

    def each(self, calls: Sequence[Callable[[], object]], threads: int | None = None) -> None:
        """Call independent functions on the next free of at most `threads` threads; return when all are done."""
        left = iter(calls)  # each thread takes the next one

        def take_turns() -> None:
            for call in left:
                call()

        self.together([take_turns] * min(threads or self.threads, self.threads))

    def replay(self, graphs: Sequence[Sequence[wp.Graph]], control: wp.array) -> int:
        """Replay graphs[thread] of steps in turn; return the number. On the CPU until the state freezes.

        All threads see the control array of a shared world freeze after the same step.
        """
        status = fetch(control)[..., int(STATUS)] if self._on_cpu else np.zeros(0)
        replayed: list[int] = []
        first, *others = (partial(self._until_frozen, own, status) for own in graphs)
        self.together([lambda: replayed.append(first()), *others])
        return replayed[0]

    def replay_worlds(self, graphs: Sequence[wp.Graph], times: int, status: Sequence[np.ndarray], threads: int) -> None:
        """Replay each graph `times` times, on at most `threads` threads; on the CPU until all its worlds freeze.

        status [graph]: of its worlds, views.
        """
        self.each([partial(self._until_frozen, [graph] * times, own) for graph, own in zip(graphs, status, strict=True)], threads)

    def _until_frozen(self, graphs: Sequence[wp.Graph], status: np.ndarray) -> int:
        """Launch graphs in turn; return the number. On the CPU until all entries of `status`, a view, are frozen."""
        for number, graph in enumerate(graphs):
            if self._on_cpu and FROZEN.issuperset(status.ravel().tolist()):
                return number
            wp.capture_launch(graph)
        return len(graphs)

    def barrier(self) -> list[Launch]:
        """Launch by which a thread waits for all others; none for a single thread."""
        if self.threads == 1:
            return []
        return [bind(wait_for_all, 1, threads=self.threads, yield_address=_yield_address(), state=self._state)]

    def share(self, count: int, part: int, parts: int | None = None) -> tuple[int, int]:
        """Begin and number of the share of a part in `count` items; parts: see `share_of`."""
        parts = parts or self.threads
        begin, end = count * part // parts, count * (part + 1) // parts
        return begin, end - begin

    def share_of(self, items: range, part: int, parts: int | None = None) -> range:
        """Items of one of `parts` parts; default: one a thread."""
        begin, count = self.share(len(items), part, parts)
        return items[begin : begin + count]


class SharedLaunches:
    """Launches that a team repeats, recorded once by name."""

    def __init__(self, team: Team, device: str, threads: int | None = None) -> None:
        """threads: how many of the team take part, default all; few items are launched faster by one."""
        self._team, self._device, self._threads = team, device, threads or team.threads
        self._recorded: dict[str, list[Callable[[], None]]] = {}

    def run(self, name: str, kernel: wp.Kernel, by: str, items: range, *sources: object, threads: int = 1, **named: Any) -> None:
        """Launch a kernel for items of `threads` threads, shared by the team.

        by: name of the argument for the first item of a part; sources and the other arguments as in `bind`, of the first call.
        """
        if name not in self._recorded:
            shares = [self._team.share_of(items, part, self._threads) for part in range(self._threads)]
            parts = [bind(kernel, threads * len(own), *sources, **{by: own.start}, **named) for own in shares]
            self._recorded[name] = [replay([launch], self._device) for launch in parts if launch.threads]
        self._team.together(self._recorded[name])


class StepSharing:
    """Chooses between sharing steps and running them alone, by their last times.

    Threads that share a step wait for each other, which takes far longer than the step where other programs use the cores.
    """

    def __init__(self) -> None:
        self._seconds = [0.0, 0.0]  # a step, alone and shared
        self._calls = 0

    def is_shared(self) -> bool:
        """Whether to share the next steps: what is faster, and now and then the other."""
        self._calls += 1
        return (self._seconds[1] <= self._seconds[0]) != (self._calls % RETRY_CALLS == 0)

    def note_time(self, shared: bool, seconds: float) -> None:
        """Note what a step took."""
        self._seconds[shared] = seconds


def _yield_address() -> int:
    """Address of sched_yield in the C library, 0 without one."""
    try:
        return ctypes.cast(ctypes.CDLL(None).sched_yield, ctypes.c_void_p).value or 0
    except (AttributeError, OSError, TypeError):
        return 0
