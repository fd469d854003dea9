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
from html import escape

from ..base.text import duration, percent, rounded

_log = logging.getLogger(__name__)

LINE_INTERVAL = 30.0  # [s] between lines where there is no terminal
LEAST_GAINED = 0.1  # of the work: the time left is shown from here on
NOTEBOOK_STEP = 0.01  # of the work, between updates of a notebook


class Display:
    """Progress of a command, stage by stage; it never decreases. This base class shows nothing."""

    title = now = text = ""  # name of the stage, what is done now where that is not the whole, and the progress in words
    done = load_factor = clock = 0.0  # share of the work and of the load; [s] of the last update
    _left = "left"
    _begin: tuple[float, float] | None = None  # [s] of the clock and share of the work, at the first update of a stage

    def __enter__(self) -> Display:
        return self

    def __exit__(self, *_error: object) -> None:
        """Nothing to release."""

    def stage(self, name: str, *, number: int, of: int) -> None:
        """Begin a stage of the loading; stages are numbered from 1."""
        self.title, self._left = f"{name} ({number} of {of})", "left of this load step" if of > 1 else "left"
        self.done, self.load_factor, self._begin = 0.0, 0.0, None
        self.show_stage()

    def update(self, *, done: float | None, load_factor: float, node_steps_per_s: float | None = None, now: str = "") -> None:
        """Show the share of expected work that is `done` (None: unknown, in a search), and of the load (0 to 1)."""
        self.clock, self.now, self.is_search = time.monotonic(), now, done is None
        self.load_factor = max(self.load_factor, load_factor)
        self.done = max(self.done, min(self.load_factor if done is None else done, 1.0))
        begin, before = self._begin = self._begin or (self.clock, self.done)  # a stage may go on from a checkpoint
        elapsed, gained = self.clock - begin, self.done - before
        known = gained >= LEAST_GAINED and not self.is_search
        left = f"{duration(elapsed * (1.0 - self.done) / gained)} {self._left}" if known else f"{duration(round(elapsed))} so far"
        rate = "" if node_steps_per_s is None else f"{rounded(node_steps_per_s):,} node-steps/s"
        self.text = ", ".join(part for part in (f"load {percent(self.load_factor, 0)}", rate, now, left) if part)
        self.show()

    def show_stage(self) -> None:
        """Show that a stage begins."""

    def show(self) -> None:
        """Show the progress."""


class StageLines(Display):
    """Log lines, without a terminal: one a stage and one every LINE_INTERVAL."""

    def __init__(self) -> None:
        self._last_line = time.monotonic()

    def show_stage(self) -> None:
        _log.info(self.title)

    def show(self) -> None:
        if self.clock - self._last_line > LINE_INTERVAL:
            self._last_line = self.clock
            _log.info("  %s%s", "" if self.is_search else f"{percent(self.done, 0)} done, ", self.text)


class TerminalBar(Display):
    """A bar on the terminal: stage, load, node-steps a second, time left."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn
        from rich.progress import Progress as RichProgress

        columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[text]}")
        self._bar = RichProgress(*columns, console=Console(stderr=True), transient=True)
        self._task = self._bar.add_task("", total=1.0, text="", visible=False)

    def __enter__(self) -> TerminalBar:
        self._bar.start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._bar.stop()

    def show_stage(self) -> None:
        self._bar.reset(self._task, description=self.title, text="", visible=True)

    def show(self) -> None:
        self._bar.update(self._task, completed=self.done, text=self.text)


class NotebookBar(Display):
    """A bar in the output of a notebook's cell; it goes when the work is done."""

    def __init__(self) -> None:
        from IPython.display import HTML, display

        self._html, self._shown = HTML, (-1.0, "")
        self._place = display(HTML(""), display_id=True)

    def __exit__(self, *_error: object) -> None:
        self._place.update(self._html(""))

    def show_stage(self) -> None:
        self._shown = -1.0, ""

    def show(self) -> None:
        done, now = self._shown
        if self.done - done >= NOTEBOOK_STEP or self.now != now:
            self._shown = self.done, self.now
            bar = f'<progress value="{self.done:.3f}" max="1"></progress>'
            self._place.update(self._html(f"{escape(self.title)} {bar} {escape(self.text)}"))


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
