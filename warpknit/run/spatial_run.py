"""A run of the spatial model in its directory: the same files as of a planar one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..frame import Frame, WireLayout
from ..solve.simulate import Record, Simulation
from ..spatial.contact_places import frame
from .history import HookRow, Row
from .recorder import Recorder
from .spatial_summary import row_of, spatial_summary, stage_summary
from .summary import Estimate


class SpatialRecorder(Recorder):
    """Of a mesh in space."""

    simulation: Simulation

    def __init__(self, simulation: Simulation, *where: Any, judge: Callable[[Record], Estimate] | None) -> None:
        self.judge = judge
        super().__init__(simulation, *where)

    @property
    def layout(self) -> WireLayout:
        return self.simulation.model.layout()

    @property
    def nodes(self) -> int:
        return self.simulation.model.node_count

    def row_of(self, record: Record) -> Row:
        return row_of(record)

    def frame_of(self, record: Record, row: Row) -> Frame:
        found = frame(
            record.observables,
            index=record.index,
            stage=record.stage,
            load_factor=record.load_factor,
            temperature=record.temperature,
        )
        if isinstance(row, HookRow):
            found.body_position[0, :2] = row.body_x_m, row.body_y_m  # where the wires press, once they do
        return found

    def stage_summary(self, record: Record, *, ended: bool) -> dict[str, Any]:
        return stage_summary(record, self.rows)

    def summary(self, stages: list[dict[str, Any]], **how: Any) -> dict[str, Any]:
        return spatial_summary(self.simulation.model.whole, self.rows, stages, notes=self.simulation.notes, **how)

    def estimate(self) -> Estimate | None:
        return self.judge(self.last) if self.judge is not None and isinstance(self.last, Record) else None
