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
from types import TracebackType
from typing import Any

from ..text import duration, percent, rounded

_log = logging.getLogger(__name__)

LINE_INTERVAL = 30.0  # [s] between lines where there is no terminal
LEAST_GAINED = 0.1  # of the work: before, the time left is not told
LEFT_OF_STAGE = "of this stage"  # the time that is told to be left, where there are several stages
NOTEBOOK_STEP = 0.01  # of the work, between updates of a notebook


class Progress:
    """The interface; this one shows nothing."""

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        """Nothing to release."""

    def stage(self, name: str, *, number: int, of: int) -> None:
        """A stage of the loading begins; stages are numbered from 1."""

    def update(self, *, done: float, load_factor: float, node_steps_per_s: float | None = None, now: str = "") -> None:
        """Within the stage: the share of the expected work that is `done`, and of the load that is applied (0 to 1); what is done
        now, where that is not the whole."""


class StageLines(Progress):
    """Log lines, without a terminal: one a stage and one every LINE_INTERVAL."""

    def __init__(self) -> None:
        self._last_line = self._begin = time.monotonic()
        self._done_before, self._of_stage = 0.0, ""

    def stage(self, name: str, *, number: int, of: int) -> None:
        self._begin, self._done_before = time.monotonic(), -1.0
        self._of_stage = f" {LEFT_OF_STAGE}" if of > 1 else ""
        _log.info("stage %d of %d: %s", number, of, name)

    def update(self, *, done: float, load_factor: float, node_steps_per_s: float | None = None, now: str = "") -> None:
        clock = time.monotonic()
        if self._done_before < 0.0:  # a stage may go on from a checkpoint
            self._begin, self._done_before = clock, done
        if clock - self._last_line > LINE_INTERVAL:
            self._last_line = clock
            rate = "" if node_steps_per_s is None else f", {rounded(node_steps_per_s):,} node-steps/s"
            gained = done - self._done_before
            left = ""
            if gained >= LEAST_GAINED:
                left = f", {duration((clock - self._begin) * (1.0 - done) / gained)} left{self._of_stage}"
            part = f", {now}" if now else ""
            _log.info("  %.0f %% done, now at load %.0f %%%s%s%s", 100 * done, 100 * load_factor, rate, left, part)


class Bar(Progress):
    """A bar on the terminal: stage, load, node-steps a second, time left."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as RichProgress

        self._bar = RichProgress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("load {task.fields[load_factor]:4.0%}"),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[of_stage]}"),
            console=Console(stderr=True),
            transient=True,
        )
        self._task: Any = None

    def __enter__(self) -> Bar:
        self._bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self._bar.stop()

    def stage(self, name: str, *, number: int, of: int) -> None:
        if self._task is not None:
            self._bar.remove_task(self._task)
        self._task = self._bar.add_task(
            f"{name} ({number}/{of})", total=1.0, load_factor=0.0, rate="", of_stage=LEFT_OF_STAGE if of > 1 else ""
        )

    def update(self, *, done: float, load_factor: float, node_steps_per_s: float | None = None, now: str = "") -> None:
        if self._task is None:
            return
        rate = now if node_steps_per_s is None else f"{rounded(node_steps_per_s):,} node-steps/s"
        self._bar.update(self._task, completed=min(max(done, 0.0), 1.0), load_factor=load_factor, rate=rate)


class NotebookBar(Progress):
    """A bar in the output of a notebook's cell; it goes when the work is done."""

    def __init__(self) -> None:
        from IPython.display import HTML, display

        self._html, self._text, self._shown, self._now = HTML, "", -1.0, ""
        self._place = display(HTML(""), display_id=True)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self._place.update(self._html(""))

    def stage(self, name: str, *, number: int, of: int) -> None:
        self._text, self._shown = f"{escape(name)} ({number}/{of})", -1.0

    def update(self, *, done: float, load_factor: float, node_steps_per_s: float | None = None, now: str = "") -> None:
        if abs(done - self._shown) >= NOTEBOOK_STEP or now != self._now:
            self._shown, self._now = done, now
            bar = f'<progress value="{done:.3f}" max="1"></progress>'
            part = f", {escape(now)}" if now else ""
            self._place.update(self._html(f"{self._text} {bar} load {percent(load_factor, 0)}{part}"))


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    kernel = sys.modules.get("ipykernel.kernelapp")
    return kernel is not None and bool(kernel.IPKernelApp.initialized())


def progress_for(*, quiet: bool) -> Progress:
    """A bar on a terminal or in a notebook, else a line a stage; nothing when `quiet`, or in one of several processes."""
    if quiet or multiprocessing.parent_process() is not None:
        return Progress()
    if in_notebook():
        return NotebookBar()
    return Bar() if sys.stderr.isatty() else StageLines()
