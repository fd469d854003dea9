"""Child processes of the program: each calls a function, which sends messages to the parent.

with worker(count_knots, net, 2) as pipe:         # calls count_knots(send, net, 2) in a process
    print(pipe.recv())
for message in messages([(count_knots, net, part) for part in range(3)]): ...
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from typing import Any

from .errors import OutOfResources

INTERVAL = 0.2  # [s] between calls of a monitor


@contextmanager
def worker(function: Callable[..., None], *arguments: Any, threads: int = 1) -> Iterator[Connection]:
    """Call function(send, *arguments) in a process with some threads, and end it with the context; yields the pipe.

    The function is one of a module. Messages come in pairs with an error or None, and end with (None, None). The terminal's
    interrupt does not reach the process. Raises OSError.
    """
    here, there = Pipe()
    with here:
        with there:
            process = subprocess.Popen(
                [sys.executable, "-m", __spec__.name, str(there.fileno())],
                pass_fds=(there.fileno(),),
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "WARPKNIT_THREADS": str(threads)},
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        with process:
            try:
                here.send((function, arguments))
                yield here
            finally:
                process.kill()


def messages(calls: Sequence[tuple[Any, ...]], monitor: Callable[[], None] = lambda: None, *, threads: int = 1) -> Iterator[Any]:
    """What functions send, each in a process of its own; calls: a function with its arguments each.

    monitor: called now and then, may raise to stop. Raises what a function raises; `OutOfResources` where a process is killed.
    """
    with ExitStack() as stack:
        pipes: list[Any] = [stack.enter_context(worker(*call, threads=threads)) for call in calls]
        while pipes:
            monitor()
            ready: list[Any] = wait(pipes, INTERVAL)
            for pipe in ready:
                try:
                    message, error = pipe.recv()
                except (EOFError, OSError):
                    raise OutOfResources("a process was killed; memory ran out, or a signal reached it") from None
                if error is not None:
                    raise error
                if message is None:
                    pipes.remove(pipe)
                else:
                    yield message


def main() -> None:
    """Call the function that comes through the pipe."""
    for number in (signal.SIGINT, signal.SIGTERM):  # meant for the parent
        signal.signal(number, signal.SIG_IGN)
    pipe = Connection(int(sys.argv[1]))
    with suppress(EOFError, BrokenPipeError):  # the parent has ended
        function, arguments = pipe.recv()
        try:
            function(lambda message: pipe.send((message, None)), *arguments)
            pipe.send((None, None))  # the end
        except BrokenPipeError:
            raise
        except Exception as error:  # which the parent raises
            pipe.send((None, error))


if __name__ == "__main__":
    main()
