"""Brings a mesh to equilibrium under one load after the other, for the process that started this one.

    scene -> the model -> (number, stage) -> how far it is, again and again -> the outcome -> the next (number, stage)

It ends with the pipe, so with the process at its other end, however that ends.
"""

from __future__ import annotations

import signal
import sys
import time
from contextlib import suppress
from multiprocessing.connection import Connection

from warpknit.model import build_model
from warpknit.processes import sendable
from warpknit.sweep.outcome import Outcome
from warpknit.sweep.state_processes import SAY_INTERVAL, Way, equilibrium_under


def main(arguments: list[str]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipe = Connection(int(arguments[0]))
    said = time.monotonic()

    def watch(way: Way) -> None:
        nonlocal said
        if time.monotonic() - said > SAY_INTERVAL:
            said = time.monotonic()
            pipe.send(way)

    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        model = build_model(pipe.recv())
        while True:
            index, stage = pipe.recv()
            answer: Outcome | Exception
            try:
                answer = equilibrium_under(model, index, stage, watch)
            except (BrokenPipeError, ConnectionResetError):
                raise
            except Exception as error:
                answer = sendable(error)
            pipe.send(answer)


if __name__ == "__main__":
    main(sys.argv[1:])
