"""Files of the recorded states of a run: states/, scene.usda and its layers.

A state is on the disk before its record counts. A thread then draws it into the stage, one frame at a time. The run goes on, and
waits only if the frame before is not drawn yet, so memory does not grow with the number of frames.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

from warpknit.results.frame import Frame, WireLayout, drawn_frame, state_file

if TYPE_CHECKING:
    from warpknit.export.usd.writer import StageWriter


class FrameFiles:
    """Writes frames into a directory, and a stage if any. `with` ends the thread after the frame it is at."""

    def __init__(self, directory: Path, layout: WireLayout, stage: StageWriter | None) -> None:
        self._directory, self._layout, self._stage = directory, layout, stage
        self._thread = ThreadPoolExecutor(1, "frames")
        self._pending: Future[None] | None = None
        self._ends = False

    def add_frame(self, frame: Frame) -> None:
        """Write a frame. Raises OSError where the disk fails, now or at a later call."""
        frame.save(state_file(self._directory, frame.index))
        self.flush()
        if self._stage is not None:
            self._pending = self._thread.submit(self._draw, self._stage, frame)

    def check(self) -> None:
        """Raise what went wrong so far."""
        if self._pending is not None and self._pending.done():
            self.flush()

    def flush(self) -> None:
        """Wait until all frames are on the disk."""
        if (pending := self._pending) is not None:
            self._pending = None
            pending.result()

    def close(self, *, complete: bool) -> None:
        """Wait, and record in the stage whether the run came to its end."""
        self.flush()
        if self._stage is not None:
            self._stage.close(complete=complete)

    def __enter__(self) -> FrameFiles:
        return self

    def __exit__(self, *_: object) -> None:
        self._ends = True
        self._thread.shutdown()

    def _draw(self, stage: StageWriter, frame: Frame) -> None:
        if not stage.frames:  # a run that goes on: the stage is written anew from the states that are there
            for index in range(frame.index):
                if self._ends:
                    return
                try:
                    earlier = Frame.load(state_file(self._directory, index))
                except (OSError, ValueError):  # lost or damaged
                    continue
                stage.add_frame(drawn_frame(self._layout, earlier), names=False)
        stage.add_frame(drawn_frame(self._layout, frame))
