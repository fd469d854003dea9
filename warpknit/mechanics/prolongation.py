"""Prolongation: a large mesh starts a load level from the equilibrium of a smaller mesh of the same knit.

Edges and corners need many steps, independent of the size of the mesh. A large mesh therefore has a hierarchy of smaller ones,
solved first, whose fields are transferred to the large one (kernels/prolong.py). On a rectangle the repeats within RIM of an edge
are copied one to one, and the interior is stretched. The fields replace the fields of the large mesh: contacts close together
only where wires lie as on the smaller mesh, and either mesh may be in another of many nearly equal states.
The smallest mesh of a periodic tile is one repeat, and so is the smallest mesh of another outline, where the change is tapered
towards the edge. One repeat has no edges: its change is added.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from ..compute.launch import bind
from ..kernels.prolong import Meshes, prolong_bodies, prolong_nodes
from ..kernels.wire_forces import BLOCK_SIZE
from ..mesh.panel import Panel
from .protocols import Model
from .response import Response

RIM = 3  # repeats at an edge that are copied one to one
FADED = 1.5  # loops of wire from a clamp over which the change is tapered
OF_PANEL = ("block_first", "block_count", "block_table", "block_wire", "wire_first", "wire_count")


class RepeatProlongation:
    """Adds fields of a small mesh, or their changes, to a large one; each model says to which arrays."""

    KEPT: tuple[str, ...] = ("_last", "_former")

    def __init__(self, large: Model, small: Model, read: Callable[[], dict[str, np.ndarray]], *, fades: bool = True) -> None:
        """read: fields of the small mesh, see `Mechanics.state_variables`; fades: a change of one repeat, along the wires."""
        self.large, self.small, self._read = large, small.global_model, read
        self._last = self._former = read()
        panel, table, self._device = large.panel, large.table, large.device
        assert large.cloth is not None
        repeat = self._repeat = np.array(large.cloth.size)
        self.is_periodic = self.small.panel.boundary == "periodic"
        self.replaces = not self.is_periodic  # the fields of the large mesh, in place of adding to them
        self._build_tables()
        large_repeats, small_repeats = np.array(large.scene.knit.repeats), np.array(small.scene.knit.repeats)
        m = Meshes()
        m.repeat, m.low = wp.vec2d(*repeat), wp.vec2d(*panel.low)
        m.large, m.small, m.offset = (wp.vec2i(*map(int, pair)) for pair in (large_repeats, small_repeats, self._offset))
        m.rim, m.periodic = RIM, int(self.is_periodic)
        fades = fades and self.is_periodic and panel.boundary == "gripped"
        m.taper = wp.float64(FADED * large.scene.model.nodes_per_loop if fades else 0.0)
        self._meshes = m
        block_place = np.rint(panel.block_origin / repeat)
        self._of_nodes = {
            **{name: self._index(getattr(panel, name)) for name in OF_PANEL},
            "place_x": self._real(table.x),
            "place_y": self._real(table.y),
            "block_size": BLOCK_SIZE,
            "block_column": self._index(block_place[:, 0]),
            "block_row": self._index(block_place[:, 1]),
            "block_thread": self._index(panel.wire_thread[panel.block_wire]),
            "thread_start": self._index(table.start),
            "thread_nodes": self._index(table.nodes),
            "small_node": self._index(self._node_table),
        }

    def _index(self, values: np.ndarray) -> wp.array:
        return wp.array(np.ascontiguousarray(values, dtype=np.int32), dtype=wp.int32, device=self._device)

    def _real(self, values: np.ndarray) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=wp.float64, device=self._device)

    def _build_tables(self) -> None:
        """Index tables of nodes and bodies of the small mesh: [thread, column, row n + k] and [clasp, column, row]."""
        small, nodes, start, repeat = self.small.panel, self.large.table.nodes, self.large.table.start, self._repeat
        thread = np.repeat(small.wire_thread, small.wire_count)
        first_row = np.repeat(np.rint(small.block_origin / repeat).astype(np.int64), small.block_count, axis=0)
        column, local = first_row[:, 0], small.node_entry - start[thread]
        row, k = first_row[:, 1] + local // nodes[thread], local % nodes[thread]
        body_place = np.rint(small.body_origin / repeat).astype(np.int64)
        low = np.zeros(2, dtype=np.int64)
        if not self.is_periodic:
            low = np.minimum([column.min(), row.min()], body_place.min(axis=0))
        column, row, body_place = column - low[0], row - low[1], body_place - low
        shape = np.maximum([column.max(), row.max()], body_place.max(axis=0)) + 1
        self._node_table = np.full((len(nodes), shape[0], shape[1] * nodes.max()), -1, dtype=np.int32)
        self._node_table[thread, column, row * nodes[thread] + k] = np.arange(small.node_count)
        self._body_table = np.full((small.body_clasp.max() + 1, *shape), -1, dtype=np.int32)
        self._body_table[small.body_clasp, body_place[:, 0], body_place[:, 1]] = np.arange(small.body_count)
        large_repeats, small_repeats = np.array(self.large.scene.knit.repeats), np.array(self.small.scene.knit.repeats)
        self._offset = np.zeros(2, dtype=np.int64) if self.is_periodic else (large_repeats - small_repeats) // 2 - low

    @cached_property
    def _of_bodies(self) -> dict[str, wp.array]:
        """Arrays of the bodies of the large mesh, over pairs of all ranks."""
        panel, mesh = self.large.panel, self.large.global_model.panel
        first = mesh.wire_first[mesh.pair_wire]
        from_end = np.minimum(mesh.pair_seed - first, first + mesh.wire_count[mesh.pair_wire] - 1 - mesh.pair_seed)
        place, rest = np.rint(panel.body_origin / self._repeat), panel.body_rest + panel.body_origin
        return {
            "body_clasp": self._index(panel.body_clasp),
            "body_origin_x": self._real(rest[:, 0]),
            "body_origin_y": self._real(rest[:, 1]),
            "body_column": self._index(place[:, 0]),
            "body_row": self._index(place[:, 1]),
            "body_from_end": self._index(from_end.reshape(-1, 2).min(axis=1)[self.large.bodies]),
            "small_body": self._index(self._body_table),
        }

    def carry(self, response: Response) -> bool:
        """Bring the large mesh to the state of the small one; update its stiffnesses and masses.

        `response`: of the cloth at the load. False where the large mesh cannot take it, which `put_back` undoes.
        """
        raise NotImplementedError

    def put_back(self) -> None:
        """Undo the last `carry`; nothing to undo in a plane, where bodies take any displacement."""

    def forget(self) -> None:
        """Drop what `put_back` needs: the last `carry` stays."""

    def taken(self) -> dict[str, np.ndarray] | None:
        """Transferred fields of the small mesh: whole, or their change since the last call; None without a change."""
        last, now = self._last, self._read()
        self._former, self._last = last, now
        if not any(np.any(now[name] != last[name]) for name in now):
            return None
        return now if self.replaces else {name: now[name] - last[name] for name in now}

    def repeat(self) -> None:
        """Let the next `carry` transfer what the last one did."""
        self._last = self._former

    def changes(self, fields: dict[str, np.ndarray], real: type) -> dict[str, wp.array]:
        """Changes of fields of the small mesh on the device of the large one."""
        return {name: wp.array(value, dtype=real, device=self._device) for name, value in fields.items()}

    def add_to_nodes(self, change: dict[str, wp.array], response: Response, name: str, value: wp.array, **scales: Any) -> None:
        """Add `scale` times `wire_scale` [wire] times the change of a field to its value [node].

        change: of all fields of the nodes of the small mesh, by name; `x` and `y` are planar displacements.
        """
        bind(
            prolong_nodes, node_threads(self.large.panel), response, m=self._meshes, **self._of_nodes, change_x=change["x"],
            change_y=change["y"], change=change[name], cell=response.of(name), value=value, **scales,
        ).run(self._device)  # fmt: skip

    def add_to_bodies(self, change: dict[str, wp.array], response: Response, name: str, value: wp.array, **how: Any) -> None:
        """The same for a field of bodies, or their pairs (two `per_body`); positive with `is_positive`."""
        if self.large.panel.body_count:
            bind(
                prolong_bodies, len(value), m=self._meshes, **self._of_bodies, change_x=change["body_x"],
                change_y=change["body_y"], change=change[name], cell=response.of(name), value=value, **how,
            ).run(self._device)  # fmt: skip

    def source_of_blocks(self) -> np.ndarray:
        """Source node, on the small mesh, of the middle node of each block [block]; -1 without one.

        The shift is linear from the rim on; beside it, kernels/prolong.py differs by up to a repeat.
        """
        panel, table = self.large.panel, self.large.table
        thread = panel.wire_thread[panel.block_wire]
        entry = panel.block_table + panel.block_count // 2
        local = entry - table.start[thread]
        n = table.nodes[thread]
        place = np.rint(panel.block_origin / self._repeat).astype(np.int64)
        place[:, 1] += local // n
        if self.is_periodic:
            place = np.mod(place, self.small.scene.knit.repeats)
        else:
            x = np.stack([table.x[entry], table.y[entry]], axis=1) + panel.block_origin
            large_repeats, small_repeats = np.array(self.large.scene.knit.repeats), np.array(self.small.scene.knit.repeats)
            share = np.clip(((x - panel.low) / self._repeat - RIM) / np.maximum(large_repeats - 2 * RIM, 1), 0.0, 1.0)
            place = place + np.rint(-share * (large_repeats - small_repeats)).astype(np.int64) + self._offset
        there = np.all((place >= 0), axis=1) & (place[:, 0] < self._node_table.shape[1])
        k = place[:, 1] * n + local % n
        there &= k < self._node_table.shape[2]
        return np.where(there, self._node_table[thread, np.where(there, place[:, 0], 0), np.where(there, k, 0)], -1)


def node_threads(panel: Panel) -> int:
    """Threads of a launch over all nodes of the blocks."""
    return len(panel.block_first) * BLOCK_SIZE
