"""Ctrl-C and requests to terminate, taken where a command can stop in good order."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress


class Interrupted(Exception):
    """The command was asked to stop; raised by `Interrupts.check`."""


class Interrupts:
    """Remembers the first request to stop until `check` is called; a second one stops at once."""

    def __init__(self) -> None:
        self.asked = False

    def ask(self) -> None:
        """Ask for a stop at the next `check`; asked twice, it stops at once."""
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True

    def check(self) -> None:
        """Raise `Interrupted` where a stop was asked for."""
        if self.asked:
            raise Interrupted

    @contextmanager
    def caught(self) -> Iterator[None]:
        """While inside, requests are kept for `check`."""

        def take(number: int, _frame: object) -> None:
            self.ask()

        before = {}
        for number in (signal.SIGINT, signal.SIGTERM):
            with suppress(ValueError):  # not in the main thread: signals stay with whoever has them
                before[number] = signal.signal(number, take)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
