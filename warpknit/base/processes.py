"""Child processes of the program: workers that take their work from a pipe and send results back."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import Pipe
from multiprocessing.connection import Connection


@contextmanager
def worker(module: str, threads: int = 1) -> Iterator[Connection]:
    """Run `python -m module PIPE` on some threads, and end it with the context; the parent's end of the pipe.

    The terminal's interrupt does not reach it. Raises OSError.
    """
    here, there = Pipe()
    with here:
        with there:
            process = subprocess.Popen(
                [sys.executable, "-m", module, str(there.fileno())],
                pass_fds=(there.fileno(),),
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "WARPKNIT_THREADS": str(threads)},
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        with process:
            try:
                yield here
            finally:
                process.kill()


def pipe_of_worker() -> Connection:
    """The worker's end of the pipe. Signals are left to the parent."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    return Connection(int(sys.argv[1]))
