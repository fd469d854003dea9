"""Progress of a run on the terminal or in the log.

with progress:
    progress.stage("load", number=1, of=2)
    progress.update(done=0.4, load_factor=0.5, node_steps_per_s=3e8)
"""

from __future__ import annotations

import logging
import multiprocessing
import sys
import time
from dataclasses import dataclass
from html import escape
from types import TracebackType
from typing import Any

from ..base.text import duration, percent, rounded

_log = logging.getLogger(__name__)

LINE_INTERVAL = 30.0  # [s] between lines where there is no terminal
LEAST_GAINED = 0.1  # of the work: the time left is shown from here on
LEFT_OF_STAGE = "of this stage"  # what the time left refers to, where there are several load steps
NOTEBOOK_STEP = 0.01  # of the work, between updates of a notebook


@dataclass
class Course:
    """Progress of a load step from its reports; it never decreases."""

    of_stage: str = ""  # LEFT_OF_STAGE where there are several
    begin: float | None = None  # [s] of the clock, at the first report
    clock: float = 0.0  # [s] at the last report
    done_before: float = 0.0  # at the first report: a stage may go on from a checkpoint
    done: float = 0.0
    load_factor: float = 0.0
    is_search: bool = False  # how much work is left is unknown

    def report(self, done: float | None, load_factor: float) -> None:
        """Report the share of the work done (None: unknown) and of the load."""
        self.clock, self.is_search = time.monotonic(), done is None
        self.load_factor = max(self.load_factor, load_factor)
        self.done = max(self.done, min(self.load_factor if done is None else done, 1.0))
        if self.begin is None:
            self.begin, self.done_before = self.clock, self.done

    @property
    def time(self) -> str:
        """The time left; in a search, and before LEAST_GAINED of the work, the time so far."""
        elapsed, gained = self.clock - (self.begin or self.clock), self.done - self.done_before
        if self.is_search or gained < LEAST_GAINED:
            return f"{duration(elapsed)} so far"
        return f"{duration(elapsed * (1.0 - self.done) / gained)} left{self.of_stage}"


class Display:
    """The interface; this one shows nothing."""

    def __enter__(self) -> Display:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        """Nothing to release."""

    def stage(self, name: str, *, number: int, of: int) -> None:
        """A stage of the loading begins; stages are numbered from 1."""

    def update(self, *, done: float | None, load_factor: float, node_steps_per_s: float | None = None, now: str = "") -> None:
        """Within the stage: the share of the expected work that is `done`, None in a search of unknown length, and of the load
        that is applied (0 to 1); what is done now, where that is not the whole."""


class StageLines(Display):
    """Log lines, without a terminal: one a stage and one every LINE_INTERVAL."""

    def __init__(self) -> None:
        self._last_line, self._course = time.monotonic(), Course()

    def stage(self, name: str, *, number: int, of: int) -> None:
        self._course = Course(f" {LEFT_OF_STAGE}" if of > 1 else "")
        _log.info("%s (%d of %d)", name, number, of)

    def update(self, *, done: float | None, load_factor: float, node_steps_per_s: float | None = None, now: str = "") -> None:
        course = self._course
        course.report(done, load_factor)
        if course.clock - self._last_line > LINE_INTERVAL:
            self._last_line = course.clock
            share = "" if course.is_search else f"{percent(course.done, 0)} done, "
            rate = "" if node_steps_per_s is None else f", {rounded(node_steps_per_s):,} node-steps/s"
            part = f", {now}" if now else ""
            _log.info("  %sload %s%s, %s%s", share, percent(course.load_factor, 0), rate, course.time, part)


class TerminalBar(Display):
    """A bar on the terminal: stage, load, node-steps a second, time left."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn
        from rich.progress import Progress as RichProgress

        self._bar = RichProgress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("load {task.fields[load_factor]:4.0%}"),
            TextColumn("{task.fields[rate]}"),
            TextColumn("{task.fields[time]}"),
            console=Console(stderr=True),
            transient=True,
        )
        self._task: Any = None
        self._course = Course()

    def __enter__(self) -> TerminalBar:
        self._bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self._bar.stop()

    def stage(self, name: str, *, number: int, of: int) -> None:
        if self._task is not None:
            self._bar.remove_task(self._task)
        self._course = Course(f" {LEFT_OF_STAGE}" if of > 1 else "")
        self._task = self._bar.add_task(f"{name} ({number}/{of})", total=1.0, load_factor=0.0, rate="", time="")

    def update(self, *, done: float | None, load_factor: float, node_steps_per_s: float | None = None, now: str = "") -> None:
        if self._task is None:
            return
        rate, course = now if node_steps_per_s is None else f"{rounded(node_steps_per_s):,} node-steps/s", self._course
        course.report(done, load_factor)
        self._bar.update(self._task, completed=course.done, load_factor=course.load_factor, rate=rate, time=course.time)


class NotebookBar(Display):
    """A bar in the output of a notebook's cell; it goes when the work is done."""

    def __init__(self) -> None:
        from IPython.display import HTML, display

        self._html, self._text, self._shown, self._now, self._course = HTML, "", -1.0, "", Course()
        self._place = display(HTML(""), display_id=True)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self._place.update(self._html(""))

    def stage(self, name: str, *, number: int, of: int) -> None:
        self._text, self._shown, self._course = f"{escape(name)} ({number}/{of})", -1.0, Course()

    def update(self, *, done: float | None, load_factor: float, node_steps_per_s: float | None = None, now: str = "") -> None:
        course = self._course
        course.report(done, load_factor)
        if course.done - self._shown >= NOTEBOOK_STEP or now != self._now:
            self._shown, self._now = course.done, now
            bar = f'<progress value="{course.done:.3f}" max="1"></progress>'
            part = f", {escape(now)}" if now else ""
            self._place.update(self._html(f"{self._text} {bar} load {percent(course.load_factor, 0)}{part}"))


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    kernel = sys.modules.get("ipykernel.kernelapp")
    return kernel is not None and bool(kernel.IPKernelApp.initialized())


def progress_for(*, quiet: bool) -> Display:
    """A bar on a terminal or in a notebook, else a line a stage; nothing when `quiet`, or in one of several processes."""
    if quiet or multiprocessing.parent_process() is not None:
        return Display()
    if in_notebook():
        return NotebookBar()
    return TerminalBar() if sys.stderr.isatty() else StageLines()
