"""A process that runs some worlds of a group (world_processes.py)."""

from __future__ import annotations

import time
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from warpknit.base.processes import pipe_of_worker
from warpknit.compute.device import start_warp
from warpknit.solve.progress import Progress
from warpknit.solve.simulate import Simulation
from warpknit.solve.world_processes import INTERVAL, News, RemoteWorld


def main() -> None:
    """Run the worlds that come through the pipe, until it closes."""
    pipe = pipe_of_worker()
    start_warp()
    with suppress(EOFError, BrokenPipeError):  # the parent has ended
        rows, worlds, ends_only = pipe.recv()
        try:
            _run(pipe, rows, worlds, ends_only=ends_only)
        except BrokenPipeError:
            raise
        except Exception as error:  # which the parent raises
            pipe.send(News(found=error))


def _run(pipe: Connection, rows: list[int], worlds: list[RemoteWorld], *, ends_only: bool) -> None:
    """Run worlds, and send their records and progress; rows: their numbers in the group."""
    models, sent = [world.model for world in worlds], time.perf_counter()

    def monitor(_progress: Progress) -> None:
        nonlocal sent
        if time.perf_counter() - sent > INTERVAL:
            sent = time.perf_counter()
            pipe.send(News({row: drive.progress for row, drive in zip(rows, simulation.drives, strict=True)}))

    begun = [world.progress for world in worlds] if worlds[0].kept else None
    simulation = Simulation(models[0], worlds=models, progress=begun, monitor=monitor, ends_only=ends_only)
    for drive, world in zip(simulation.drives, worlds, strict=True):
        if world.kept:
            drive.restore(world.kept)

    def send(world: int, found: Any) -> None:
        pipe.send(News({rows[world]: simulation.drives[world].progress}, world=rows[world], found=found))

    for record in simulation.run():
        send(record.world, record)
    for number, error in simulation.failures.items():
        send(number, error)
    pipe.send(News(kept={row: drive.snapshot() for row, drive in zip(rows, simulation.drives, strict=True)}))


if __name__ == "__main__":
    main()
