"""SIGINT and SIGTERM, handled where a command can stop safely."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress

STOPPING = b"\nstopping after this check; press Ctrl-C again to stop at once\n"


def to_continue(again: str, *, resume: bool, force: bool) -> str:
    """Advice to continue an interrupted command, with its options.

    again: what to repeat, such as the command. resume: whether it already resumes, always or by the option.
    """
    by_option = "" if resume else ", with --resume" if force else " and --resume"
    in_place = "" if not force else " without --force" if resume else " in place of --force"
    return f"; continue with the same {again}{by_option}{in_place}"


class Interrupted(Exception):
    """A stop was requested; raised by `Interrupts.check`."""


class Interrupts:
    """Stores a stop request until `check` is called; a second request stops at once."""

    def __init__(self) -> None:
        self.is_requested = False

    def request(self) -> None:
        """Request a stop at the next `check`; the second request stops at once."""
        if self.is_requested:
            raise KeyboardInterrupt
        self.is_requested = True

    def check(self) -> None:
        """Raise `Interrupted` if a stop was requested."""
        if self.is_requested:
            raise Interrupted

    @contextmanager
    def handled(self) -> Iterator[None]:
        """Store signals for `check` while inside."""

        def take(number: int, _frame: object) -> None:
            self.request()
            if number == signal.SIGINT:
                os.write(2, STOPPING)  # no lock: the handler may have interrupted a write to stderr

        before = {}
        for number in (signal.SIGINT, signal.SIGTERM):
            with suppress(ValueError):  # not in the main thread
                before[number] = signal.signal(number, take)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
