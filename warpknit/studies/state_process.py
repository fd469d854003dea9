"""A worker process: finds the equilibrium of a mesh under one load after another.

    scene -> model -> (index, stage) -> progress messages -> outcome -> next (index, stage)

It ends when the pipe closes, so also when the parent process ends.
"""

from __future__ import annotations

import signal
import sys
import time
from contextlib import suppress
from multiprocessing.connection import Connection

from warpknit.base.processes import sendable
from warpknit.solve.model import build_model
from warpknit.studies.outcome import Outcome
from warpknit.studies.state_processes import REPORT_INTERVAL, LoadProgress, equilibrium_under


def main(arguments: list[str]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe = Connection(int(arguments[0]))
    last_report = time.monotonic()

    def watch(progress: LoadProgress) -> None:
        nonlocal last_report
        if time.monotonic() - last_report > REPORT_INTERVAL:
            last_report = time.monotonic()
            pipe.send(progress)

    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        model = build_model(pipe.recv())
        while True:
            index, stage, levels = pipe.recv()
            answer: Outcome | Exception
            try:
                answer = equilibrium_under(model, index, stage, levels, watch)
            except (BrokenPipeError, ConnectionResetError):
                raise
            except Exception as error:
                answer = sendable(error)
            pipe.send(answer)


if __name__ == "__main__":
    main(sys.argv[1:])
