"""Child processes of the program."""

from __future__ import annotations

import os
import subprocess
import sys
from multiprocessing import Pipe
from multiprocessing.connection import Connection


def start_process(module: str) -> tuple[subprocess.Popen[bytes], Connection]:
    """Start `python -m module PIPE`; return it with the parent's end of the pipe, whose other end it inherits.

    The terminal's interrupt does not reach it. Raises OSError.
    """
    here, there = Pipe()
    with there:
        process = subprocess.Popen(
            [sys.executable, "-m", module, str(there.fileno())],
            pass_fds=(there.fileno(),),
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
    return process, here
