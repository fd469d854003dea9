"""Child processes of the program, and messages to and from them."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from multiprocessing import Pipe
from multiprocessing.connection import Connection


def start_process(module: str, *descriptors: int, keep: tuple[int, ...] = ()) -> tuple[subprocess.Popen[bytes], Connection]:
    """Start `python -m module PIPE DESCRIPTORS...`; return it with the parent's end of the pipe.

    The process inherits its end of the pipe and the descriptors; `keep` is inherited too, without an argument. The terminal's
    interrupt does not reach it. Raises OSError.
    """
    here, there = Pipe()
    command = [sys.executable, "-m", module, *(str(number) for number in (there.fileno(), *descriptors))]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with there:
        process = subprocess.Popen(
            command,
            pass_fds=(there.fileno(), *descriptors, *keep),
            env=environment,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
    return process, here


def ending_of(process: subprocess.Popen[bytes]) -> str:
    """Ending of a process, in words; waits for it."""
    status = process.wait()
    return f"was ended by signal {-status}" if status < 0 else f"ended with status {status}"


def sendable(error: Exception) -> Exception:
    """The error itself where it can be pickled, else its text."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error
