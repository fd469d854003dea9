"""Prolongation: a large mesh starts a load level from the equilibrium of a smaller mesh of the same knit.

Edges and corners need many steps, independent of the size of the mesh. A large mesh therefore has a hierarchy of smaller ones,
solved first; their change of state is prolonged to it (kernels/prolong.py). On a rectangle the repeats within RIM of an edge are
copied one to one, the interior is stretched. The smallest mesh of a periodic tile is one repeat. So is that of a mesh with
another outline, where the change is tapered towards the edge.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ..kernels import control as c
from ..kernels.prolong import Meshes, prolong_bodies, prolong_nodes
from ..launch import bind
from .host_state import node_entries
from .join import Join
from .model import Model, block_threads
from .response import Response, state_variables
from .state import State

RIM = 3  # repeats at an edge that are copied one to one
FADED = 1.5  # loops of wire from a clamp over which the change is tapered


class Prolongation:
    """Adds the change of the small mesh since the last call to the large one."""

    def __init__(self, large: Model, large_state: State, small: Model, small_state: State) -> None:
        self.large, self.large_state = large, large_state
        self.small, self.small_state = small, small_state
        self._last = state_variables(small, small_state)
        self._build_tables()

    def state_dict(self) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint."""
        return {f"prolonged_{name}": value for name, value in self._last.items()}

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        self._last = {name: kept[f"prolonged_{name}"] for name in self._last}

    def _build_tables(self) -> None:
        """Build index tables of nodes and bodies of the small mesh."""
        large, small = self.large.panel, self.small.global_model.panel
        assert self.large.cloth is not None
        repeat = self._repeat = np.array(self.large.cloth.size)
        nodes, start = self.large.table.nodes, self.large.table.start
        periodic = small.boundary == "periodic"
        self._periodic = int(periodic)
        entry = node_entries(self.small.global_model)
        thread = np.repeat(small.wire_thread, small.wire_count)
        first_row = np.repeat(np.rint(small.block_origin / repeat).astype(np.int64), small.block_count, axis=0)
        column, local = first_row[:, 0], entry - start[thread]
        row, k = first_row[:, 1] + local // nodes[thread], local % nodes[thread]
        body_place = np.rint(small.body_origin / repeat).astype(np.int64)
        low = np.zeros(2, dtype=np.int64)
        if not periodic:
            low = np.minimum([column.min(), row.min()], body_place.min(axis=0))
        column, row, body_place = column - low[0], row - low[1], body_place - low
        shape = np.maximum([column.max(), row.max()], body_place.max(axis=0)) + 1
        node_table = np.full((len(nodes), shape[0], shape[1] * nodes.max()), -1, dtype=np.int32)
        node_table[thread, column, row * nodes[thread] + k] = np.arange(small.node_count)
        body_table = np.full((small.body_clasp.max() + 1, *shape), -1, dtype=np.int32)
        body_table[small.body_clasp, body_place[:, 0], body_place[:, 1]] = np.arange(small.body_count)
        large_repeats, small_repeats = np.array(self.large.scene.knit.repeats), np.array(self.small.scene.knit.repeats)
        self._offset = np.zeros(2, dtype=np.int64) if periodic else (large_repeats - small_repeats) // 2 - low
        self._node_table = node_table
        device = self.large.device

        def index(a: np.ndarray) -> wp.array:
            return wp.array(np.ascontiguousarray(a, dtype=np.int32), dtype=wp.int32, device=device)

        m = Meshes()
        m.repeat, m.low = wp.vec2d(*repeat), wp.vec2d(*large.low)
        m.large, m.small, m.offset = (wp.vec2i(*map(int, pair)) for pair in (large_repeats, small_repeats, self._offset))
        m.rim, m.periodic = RIM, self._periodic
        fades = periodic and large.boundary == "gripped"
        m.taper = FADED * self.large.scene.model.nodes_per_loop if fades else 0.0
        self._meshes = m
        block_place = np.rint(large.block_origin / repeat)
        self._block_place = {
            "block_column": index(block_place[:, 0]),
            "block_row": index(block_place[:, 1]),
            "block_thread": index(large.wire_thread[large.block_wire]),
        }
        self._threads = {"thread_start": index(start), "thread_nodes": index(nodes)}
        # over all pairs of a body, also those of other ranks
        mesh = self.large.global_model.panel
        first = mesh.wire_first[mesh.pair_wire]
        from_end = np.minimum(mesh.pair_seed - first, first + mesh.wire_count[mesh.pair_wire] - 1 - mesh.pair_seed)
        body_place = np.rint(large.body_origin / repeat)
        self._body_place = {
            "body_clasp": index(large.body_clasp),
            "body_column": index(body_place[:, 0]),
            "body_row": index(body_place[:, 1]),
            "body_from_end": index(from_end.reshape(-1, 2).min(axis=1)[self.large.bodies]),
        }
        self._node_at: wp.array = index(node_table)
        self._body_at: wp.array = index(body_table)

    def carry(self, response: Response) -> None:
        """Add the change of the small mesh to the large one; update its stiffnesses and masses.

        `response`: of the cloth at the load.
        """
        large, state = self.large, self.large_state
        self._follow_stiffness()
        values = state_variables(self.small, self.small_state)
        real, device = large.precision.real, large.device
        change: dict[str, wp.array] = {
            name: wp.array(values[name] - self._last[name], dtype=real, device=device) for name in values
        }
        self._last = values
        now, sources = state.parity, (large.mesh, state, large.constants)
        of_nodes = {f"change_{name}": change[name] for name in ("x", "y", "tension", "strain")}
        bind(
            prolong_nodes, block_threads(large), *sources, large.rest, response, ux=state.node_ux[now], uy=state.node_uy[now],
            m=self._meshes, small_node=self._node_at, **self._block_place, **self._threads, **of_nodes, **response.of_nodes,
        ).run(device)  # fmt: skip
        if large.panel.body_count:
            of_bodies = {"change_x": change["body_x"], "change_y": change["body_y"], "change_offset": change["offset"]}
            bind(
                prolong_bodies, large.panel.body_count, *sources, ux=state.body_ux, uy=state.body_uy, m=self._meshes,
                small_body=self._body_at, **self._body_place, **of_bodies, **response.of_bodies,
            ).run(device)  # fmt: skip

    def _follow_stiffness(self) -> None:
        """Raise stiffness and mass of each wire to the largest of its source wires on the small mesh."""
        large, small = self.large.panel, self.small.global_model.panel
        join = Join(self.small, everywhere=True)
        source = self._source_of_blocks()
        wire = np.searchsorted(small.wire_first, np.maximum(source, 0), side="right") - 1
        starts = np.searchsorted(large.block_wire, np.arange(len(large.wire_first)))
        for name in ("wire_axial", "wire_mass"):
            array = getattr(self.large_state, name)
            there = np.where(source >= 0, join.wires(getattr(self.small_state, name).numpy())[wire], 0.0)
            array.assign(np.maximum(array.numpy(), np.maximum.reduceat(there, starts)))
        penalty = float(self.small_state.read_control()[int(c.CONTACT_STIFFNESS)])
        if penalty > float(self.large_state.read_control()[int(c.CONTACT_STIFFNESS)]):
            self.large_state.stiffen_contact(penalty)

    def _source_of_blocks(self) -> np.ndarray:
        """[block] node of the small mesh that is the source of the middle node of each block; -1 without one."""
        panel, table = self.large.panel, self.large.table
        thread = panel.wire_thread[panel.block_wire]
        entry = panel.block_table + panel.block_count // 2
        local = entry - table.start[thread]
        n = table.nodes[thread]
        place = np.rint(panel.block_origin / self._repeat).astype(np.int64)
        place[:, 1] += local // n
        if self._periodic:
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
