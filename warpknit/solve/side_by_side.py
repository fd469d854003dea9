"""Worlds side by side: in this process, or a large group in several processes with a share of the cores.

Warp runs a launch on one thread, so threads share the steps of worlds but not their checks. Results of a world are the same in
any process.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..base.errors import Diverged
from ..base.processes import INTERVAL, messages
from ..compute.device import start_warp
from ..compute.kept import Kept
from ..mechanics.numerics import process_count, thread_count
from ..mechanics.protocols import Model
from .equilibrium import Equilibrium
from .model import worlds_of
from .progress import Progress
from .relax import Relaxation, Unsolved

NODES_A_PROCESS = 2_000  # fewer take less time than the start of a process
# what a world goes through: what it finds, and UNSOLVED wherever it is to be brought to equilibrium; `Diverged` is thrown in
Findings = Generator[Any, None, None]


class SideBySide:
    """Worlds of one topology, each with a relaxation (`members`).

    Each world has its own levels. Worlds that are done or have failed wait.
    """

    def __init__(
        self, models: Sequence[Model], findings_of: Callable[[Relaxation], Findings], progress: Sequence[Progress] = ()
    ) -> None:
        """models: of each world; findings_of: what a relaxation goes through; progress: of each, where they go on."""
        self.group = worlds_of(models)
        self.members: list[Relaxation] = []
        self.equilibrium = Equilibrium(self.group, self.members)
        for row, mechanics in enumerate(self.group.members):
            begun = progress[row] if progress else None
            self.members.append(Relaxation(mechanics, begun, equilibrium=self.equilibrium, row=row))
        self.resumed = bool(progress)
        self._findings = [findings_of(member) for member in self.members]

    def run(self, monitor: Callable[[], None] = lambda: None, without: Collection[int] = ()) -> Iterator[tuple[int, Any]]:
        """Number of a world and its finding, or its final `Diverged`; in order of arrival.

        monitor: called at every convergence check; may raise to stop. without: worlds that have ended before.
        """
        rows = np.setdiff1d(np.arange(len(self.members)), list(without))
        if not self.resumed:
            self.group.search(rows)
        due: dict[int, Diverged | None] = dict.fromkeys(rows.tolist())  # worlds that go on, after an error or none
        active: list[int] = []
        while due or active:
            found: list[tuple[int, Any]] = []
            with self.group.together():
                active += [row for row, error in due.items() if self._goes_on(row, error, found)]
            yield from found
            if not active:
                return
            monitor()
            converged, failed = self.equilibrium.advance(np.array(sorted(active)))
            due = {row: failed.get(row) for row in [*failed, *converged]}
            active = [row for row in active if row not in due]

    def _goes_on(self, row: int, error: Diverged | None, found: list[tuple[int, Any]]) -> bool:
        """Go to the next equilibrium of a world, or end; adds to what is `found` on the way."""
        findings = self._findings[row]
        try:
            step = next(findings, None) if error is None else findings.throw(error)
            while step is not None and not isinstance(step, Unsolved):
                found.append((row, step))
                step = next(findings, None)
        except Diverged as failure:  # also where no strain carries the tension
            found.append((row, failure))
            return False
        return step is not None


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
    kept: dict[int, Kept] = field(default_factory=dict)
    world: int = 0
    found: Any = None


def processes_of(models: Sequence[Any]) -> int:
    """Number of processes for worlds; 1 for few."""
    pieces = sum(model.node_count for model in models) // NODES_A_PROCESS
    return process_count(min(len(models), pieces), models[0].device)


class WorldProcesses:
    """Worlds that run in processes, in place of `SideBySide`."""

    def __init__(self, models: Sequence[Any], begin: Callable[..., Any], *, ends_only: bool) -> None:
        """begin: `Simulation`."""
        self.members = [RemoteWorld(model) for model in models]
        self._begin, self._ends_only = begin, ends_only

    def run(self, monitor: Callable[[], None] = lambda: None, without: Collection[int] = ()) -> Iterator[tuple[int, Any]]:
        """Number of a world and its record, or its final `Diverged`; in order of arrival.

        monitor: called now and then; may raise to stop. without: worlds that are left out. Raises as `messages` does.
        """
        rows = [row for row in range(len(self.members)) if row not in without]
        count = processes_of([self.members[row].model for row in rows])
        shares = [{row: self.members[row] for row in rows[part::count]} for part in range(count)]
        calls = [(run_worlds, self._begin, share, self._ends_only) for share in shares]
        for news in messages(calls, monitor, threads=max(1, thread_count(len(rows)) // count)):
            for row, progress in news.progress.items():
                self.members[row].progress = progress
            for row, kept in news.kept.items():
                self.members[row].kept = kept
            if news.found is not None:
                yield news.world, news.found


def run_worlds(send: Callable[[News], None], begin: Callable[..., Any], worlds: dict[int, RemoteWorld], ends_only: bool) -> None:
    """Run worlds, and send their records and progress. worlds: by their numbers in the group."""
    start_warp()
    rows, models, sent = list(worlds), [world.model for world in worlds.values()], time.perf_counter()

    def monitor(_progress: Progress) -> None:
        nonlocal sent
        if time.perf_counter() - sent > INTERVAL:
            sent = time.perf_counter()
            send(News({row: drive.progress for row, drive in zip(rows, simulation.drives, strict=True)}))

    begun = [world.progress for world in worlds.values()] if any(world.kept for world in worlds.values()) else None
    simulation = begin(models[0], worlds=models, progress=begun, monitor=monitor, ends_only=ends_only)
    for drive, world in zip(simulation.drives, worlds.values(), strict=True):
        if world.kept:
            drive.restore(world.kept)

    def send_found(world: int, found: Any) -> None:
        send(News({rows[world]: simulation.drives[world].progress}, world=rows[world], found=found))

    for record in simulation.run():
        send_found(record.world, record)
    for number, error in simulation.failures.items():
        send_found(number, error)
    send(News(kept={row: drive.snapshot() for row, drive in zip(rows, simulation.drives, strict=True)}))
