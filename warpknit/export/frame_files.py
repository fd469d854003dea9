"""`FrameFiles`: what a run writes of each recorded state, `states/state_######.npz` and its frame of the stage.

The same in the run's own process and in another one (writer_process.py).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from warpknit.results.frame import Frame, WireLayout, drawn_frame, drawn_layout

__all__ = ["FrameFiles", "FrameWriter", "StageOptions", "state_file"]


@dataclass(frozen=True, kw_only=True)
class StageOptions:
    """How the stage is written; see `StageWriter`."""

    scene_name: str
    scene_hash: str
    version: str
    colour_stress_max: float | None
    full_every: int
    points_per_tile: int


def state_file(directory: Path, index: int) -> Path:
    return directory / "states" / f"state_{index:06d}.npz"


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
        """Wait, and say in the stage whether the run came to its end."""

    def __enter__(self) -> "FrameWriter":
        return self

    def __exit__(self, *_: object) -> None:
        """Let go of what is held."""


class FrameFiles(FrameWriter):
    """Writes in this process. `stage`: None where no stage is wanted; `resume`: go on with what the directory holds."""

    def __init__(self, directory: Path, layout: WireLayout, stage: StageOptions | None, *, resume: bool = False) -> None:
        self._directory, self._layout = directory, layout
        self._stage: Any = None
        self._is_first = True
        if stage is not None:
            from warpknit.export.usd import StageWriter

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
