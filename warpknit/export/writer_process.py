"""A process that writes frames: the run does not wait for the disk.

    run -> shared memory of one frame -> this process -> states/, scene.usda and its layers

The run copies a frame into the memory and goes on; it waits only where the frame before is not written yet. So memory does
not grow with the number of frames. The memory has no name, and belongs to nobody but the two processes; the run's end of
the pipe closes with the run, however it ends: the writer then finishes the frame that it is at, and ends too.
"""

from __future__ import annotations

import mmap
import os
import signal
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass, fields
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from warpknit.base.errors import OutOfResources
from warpknit.base.processes import ending_of, sendable, start_process
from warpknit.results.frame import Frame, WireLayout, drawn_frame, drawn_layout, state_file


@dataclass(frozen=True, kw_only=True)
class StageOptions:
    """Options of the stage; see `StageWriter`."""

    scene_name: str
    scene_hash: str
    version: str
    colour_stress_max: float | None
    full_every: int
    points_per_tile: int


class FrameWriter:
    """Takes frames one by one. `with` ends it whatever happens; a frame that was begun is then finished or absent."""

    def add_frame(self, frame: Frame) -> None:
        """Write a frame. Raises OSError where the disk fails, now or at a later call."""
        raise NotImplementedError

    def check(self) -> None:
        """Raise what went wrong so far."""

    def flush(self) -> None:
        """Wait until all frames are on the disk."""

    def close(self, *, complete: bool) -> None:
        """Wait, and record in the stage whether the run came to its end."""

    def __enter__(self) -> FrameWriter:
        return self

    def __exit__(self, *_: object) -> None:
        """Release memory and process."""


class FrameFiles(FrameWriter):
    """Writes in this process. `stage`: None where no stage is wanted; `resume`: go on with what the directory holds."""

    def __init__(self, directory: Path, layout: WireLayout, stage: StageOptions | None, *, resume: bool = False) -> None:
        self._directory, self._layout = directory, layout
        self._stage: Any = None
        self._is_first = True
        if stage is not None:
            from warpknit.export.usd.writer import StageWriter

            self._stage = StageWriter(directory, drawn_layout(layout), **vars(stage), resume=resume)

    def add_frame(self, frame: Frame) -> None:
        frame.save(state_file(self._directory, frame.index))
        if self._stage is None:
            return
        if self._is_first:
            self._catch_up(frame.index)
        self._stage.add_frame(drawn_frame(self._layout, frame))

    def _catch_up(self, index: int) -> None:
        """Give the stage the states before `index` that it has lost: a run that goes on leaves no gap in it."""
        self._is_first = False
        for missing in range(len(self._stage.earlier_frames), index):
            path = state_file(self._directory, missing)
            if path.is_file():
                self._stage.add_frame(drawn_frame(self._layout, Frame.load(path)))

    def close(self, *, complete: bool) -> None:
        if self._stage is not None:
            self._stage.close(complete=complete)


PROCESS_NODES = 200_000  # a frame of fewer nodes is written in less time than it takes to start a process
BYTES_PER_NODE, BYTES_PER_BODY = 4 * 8, 3 * 8 + 2 * (8 + 1)  # of a frame: position and stress; position, force and state
END_TIME = 600.0  # [s] that the last frame may take


def frame_writer(
    directory: Path, layout: WireLayout, stage: StageOptions | None, *, resume: bool, hold: int | None = None
) -> FrameWriter:
    """Writer of the frames of a run: a process for the stage of a large mesh.

    `hold`: a descriptor that keeps the directory for the run; the process keeps it as long as it lives.
    """
    if stage is None or layout.node_count <= PROCESS_NODES or os.name != "posix":
        return FrameFiles(directory, layout, stage, resume=resume)
    return WriterProcess(directory, layout, stage, resume=resume, hold=hold)


class WriterProcess(FrameWriter):
    """`FrameFiles` in another process. `directory` holds layout.npz, the layout of the run."""

    def __init__(
        self, directory: Path, layout: WireLayout, stage: StageOptions | None, *, resume: bool = False, hold: int | None = None
    ) -> None:
        per_node = BYTES_PER_NODE + 12 * (layout.curve_parts - 1)
        size = per_node * layout.node_count + BYTES_PER_BODY * layout.body_count + 64 * len(fields(Frame))
        memory = _nameless_memory(size)
        try:
            self._memory = mmap.mmap(memory, size)
            kept = () if hold is None else (hold,)
            self._process, self._pipe = start_process(__spec__.name, memory, keep=kept)
        except OSError as error:
            raise OutOfResources(f"memory ran out: the writer of frames did not start: {error.strerror}") from error
        finally:
            os.close(memory)
        self._is_busy = False
        self._send("open", (directory, stage, resume))

    @property
    def pid(self) -> int:
        return self._process.pid

    def add_frame(self, frame: Frame) -> None:
        self._wait()
        values: dict[str, object] = {}
        first = 0
        for entry in fields(Frame):
            value = getattr(frame, entry.name)
            # contacts, which may be any number, go through the pipe
            if isinstance(value, np.ndarray) and not entry.name.startswith(("elsewhere_", "contact_")):
                target = np.ndarray(value.shape, value.dtype, buffer=self._memory, offset=first)
                target[...] = value
                value = (value.shape, value.dtype.str, first)
                first += -(-target.nbytes // 64) * 64
            values[entry.name] = value
        self._send("frame", values)

    def check(self) -> None:
        if self._pipe.poll(0):
            self._receive()

    def flush(self) -> None:
        self._wait()
        self._send("flush", None)
        self._wait()

    def close(self, *, complete: bool) -> None:
        self._wait()
        self._send("close", complete)
        self._wait()

    def __exit__(self, *_: object) -> None:
        """End the process; a frame that was handed over is finished first, unless the disk has failed."""
        self._pipe.close()
        try:
            self._process.wait(END_TIME)
        except BaseException:  # the user does not want to wait, or it hangs
            self._process.kill()
            self._process.wait()
            raise
        finally:
            with suppress(BufferError):  # an array that looks into it is still held by somebody's traceback
                self._memory.close()

    def _wait(self) -> None:
        if self._is_busy:
            self._receive()

    def _send(self, what: str, value: Any) -> None:
        try:
            self._pipe.send((what, value))
        except OSError:
            self._receive()  # it says why, or the process is gone
        self._is_busy = True

    def _receive(self) -> None:
        try:
            error = self._pipe.recv()
        except (EOFError, OSError):
            raise OutOfResources(
                "memory ran out or the process was killed: the process that writes the frames"
                f" {ending_of(self._process)};"
                " finished frames are kept, continue with --resume"
            ) from None
        self._is_busy = False
        if error is not None:
            raise error


def _nameless_memory(size: int) -> int:
    """Descriptor of `size` bytes of memory that two processes can share."""
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("warpknit-frame")
    else:
        with tempfile.TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    os.ftruncate(descriptor, size)
    return descriptor


# --- in the other process ---------------------------------------------------------------------------------------------


def main(arguments: list[str]) -> None:
    """Write what comes through the pipe, until the run closes it."""
    for number in (signal.SIGINT, signal.SIGTERM):  # meant for the run, which says what becomes of the writer
        signal.signal(number, signal.SIG_IGN)
    pipe, memory = Connection(int(arguments[0])), mmap.mmap(int(arguments[1]), 0)
    files: FrameFiles | None = None
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            what, value = pipe.recv()
            answer: BaseException | None = None
            try:
                if what == "open":
                    directory, stage, resume = value
                    files = FrameFiles(directory, WireLayout.load(directory / "layout.npz"), stage, resume=resume)
                else:
                    assert files is not None
                    if what == "frame":
                        files.add_frame(_frame(value, memory))
                    elif what == "flush":
                        files.flush()
                    else:
                        files.close(complete=value)
            except Exception as error:
                answer = sendable(error)
            pipe.send(answer)


def _frame(values: dict[str, Any], memory: mmap.mmap) -> Frame:
    """The frame whose arrays lie in the shared memory."""
    for name, value in values.items():
        if isinstance(value, tuple):
            shape, kind, first = value
            values[name] = np.ndarray(shape, np.dtype(kind), buffer=memory, offset=first)
    return Frame(**values)


if __name__ == "__main__":
    main(sys.argv[1:])
