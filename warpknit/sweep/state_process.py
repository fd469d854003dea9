"""Brings a mesh in space to rest under one load after the other, for the process that started this one.

    scene -> the mesh -> (number, stage) -> how far it is, again and again -> the outcome -> the next (number, stage)

It ends with the pipe, so with the process at its other end, however that ends.
"""

from __future__ import annotations

import signal
import sys
import time
from contextlib import suppress
from multiprocessing.connection import Connection

from warpknit.processes import sendable
from warpknit.spatial.mesh import build_mesh
from warpknit.sweep.outcome import Outcome
from warpknit.sweep.spatial_states import SAY_INTERVAL, Way, bring_to_rest


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
        mesh = build_mesh(pipe.recv())
        while True:
            index, stage = pipe.recv()
            answer: Outcome | Exception
            try:
                answer = bring_to_rest(mesh, index, stage, watch)
            except (BrokenPipeError, ConnectionResetError):
                raise
            except Exception as error:
                answer = sendable(error)
            pipe.send(answer)


if __name__ == "__main__":
    main(sys.argv[1:])
