"""A mesh as copies of one repeat: what the transfer kernels read of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..kernels.wire_forces import BLOCK_SIZE
from ..mesh.panel import Panel
from ..mesh.rest_table import Table


@dataclass(frozen=True)
class RepeatArrays:
    """Blocks of nodes of a panel with their rest places, on the device."""

    block_first: wp.array  # [block] int
    block_count: wp.array
    block_table: wp.array  # table entry of the first node
    block_wire: wp.array
    block_origin_x: wp.array  # [block] [m]
    block_origin_y: wp.array
    wire_first: wp.array  # [wire] int
    wire_count: wp.array
    place_x: wp.array  # [table entry] [m]
    place_y: wp.array
    block_size: int = BLOCK_SIZE


def upload_repeats(panel: Panel, table: Table, device: str) -> RepeatArrays:
    """The arrays of a panel."""

    def index(values: np.ndarray) -> wp.array:
        return wp.array(np.ascontiguousarray(values, dtype=np.int32), dtype=wp.int32, device=device)

    def real(values: np.ndarray) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=wp.float64, device=device)

    return RepeatArrays(
        block_first=index(panel.block_first),
        block_count=index(panel.block_count),
        block_table=index(panel.block_table),
        block_wire=index(panel.block_wire),
        block_origin_x=real(panel.block_origin[:, 0]),
        block_origin_y=real(panel.block_origin[:, 1]),
        wire_first=index(panel.wire_first),
        wire_count=index(panel.wire_count),
        place_x=real(table.x),
        place_y=real(table.y),
    )


def node_threads(panel: Panel) -> int:
    """Threads of a launch over all nodes of the blocks."""
    return len(panel.block_first) * BLOCK_SIZE
