"""Copies of one repeat make a mesh: wires, blocks of nodes, contact bodies with their pairs, and what is held.

*Periodic*: the tile is closed onto itself, every wire is an endless loop. *Gripped*: the mesh is cut by a rectangle from
endless cloth; the two nodes on either side of a cut form a clamp, which sits half way between them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .errors import ModelError
from .kernels.wires_by_block import BLOCK_SIZE
from .knit.cloth import Cloth
from .table import Table

END_NODES = 3  # nodes next to a clamp that a contact point may not come to: its curve needs two beyond


@dataclass(frozen=True)
class Panel:
    """Wires, bodies and grips of the mesh. Index arrays are int32; wires hold consecutive nodes."""

    size: np.ndarray  # (2,) [m] rest size of the mesh
    boundary: str  # gripped | periodic
    wire_first: np.ndarray  # [wire] first node
    wire_count: np.ndarray  # [wire] nodes
    wire_closed: np.ndarray  # [wire] bool
    wire_thread: np.ndarray  # [wire] thread of the repeat
    block_first: np.ndarray  # [block] first node
    block_count: np.ndarray  # [block] nodes, at most BLOCK_SIZE
    block_table: np.ndarray  # [block] table entry of the first node
    block_wire: np.ndarray  # [block]
    block_origin: np.ndarray  # [block, 2] [m]
    body_rest: np.ndarray  # [body, 2] [m] position at rest in the frame of its repeat
    body_origin: np.ndarray  # [body, 2] [m] what to add to it
    pair_wire: np.ndarray  # [pair]; pairs 2b and 2b + 1 belong to body b
    pair_seed: np.ndarray  # [pair] node that starts the segment nearest to the body at rest
    pair_table: np.ndarray  # [pair] table entry of that node, in the first period
    pair_shift: np.ndarray  # [pair, 2] [m] position of the body in the frame of the table = body_rest - shift
    pair_low: np.ndarray  # [pair] reach along the wire in segments from the seed
    pair_high: np.ndarray  # [pair]
    pair_side: np.ndarray  # [pair] +1 | -1
    held_node: np.ndarray  # [held] sorted
    held_lever: np.ndarray  # [held, 2] [m] rest position of the node less that of its clamp
    held_clamp: np.ndarray  # [held] clamp that holds it
    clamp_position: np.ndarray  # [clamp, 2] [m]
    rhombus_bodies: np.ndarray  # bodies round the complete opening nearest to the middle
    notes: tuple[str, ...] = field(default=())  # what the user should know about how the mesh was cut

    @property
    def node_count(self) -> int:
        return int(self.wire_count.sum())

    @property
    def body_count(self) -> int:
        return len(self.body_rest)


@dataclass(frozen=True)
class _Strands:
    """Copies of the threads and which of their nodes belong to which wire.

    A strand is thread t in column c of repeats; its nodes are counted by K = row * nodes[t] + k with k in one period.
    """

    columns: np.ndarray  # [column] columns of repeats that are kept
    rows: np.ndarray  # [row]
    closed: bool
    first_column: int  # of `wire_at`
    first_node: np.ndarray  # [thread] K of the first column of `wire_at`
    wire_at: list[np.ndarray]  # [thread][column, K - first_node] wire, or -1
    thread: np.ndarray  # [wire]
    column: np.ndarray  # [wire]
    begin: np.ndarray  # [wire] K of its first node
    count: np.ndarray  # [wire] nodes

    def wire(self, thread: np.ndarray, column: np.ndarray, node: np.ndarray) -> np.ndarray:
        """Wire (m,) that holds nodes K (m,) of strands (thread, column), -1 where none does."""
        found = np.full(node.shape, -1, dtype=np.int64)
        for t, wire_at in enumerate(self.wire_at):
            here = thread == t
            c = column - self.first_column
            k = node - self.first_node[t]
            if self.closed:
                c, k = np.mod(c, wire_at.shape[0]), np.mod(k, wire_at.shape[1])
            here &= (c >= 0) & (c < wire_at.shape[0]) & (k >= 0) & (k < wire_at.shape[1])
            found[here] = wire_at[c[here], k[here]]
        return found


def _closed_strands(table: Table, repeats: tuple[int, int]) -> _Strands:
    threads = len(table.nodes)
    columns = np.arange(repeats[0])
    wire_at = []
    for t in range(threads):
        wires = columns * threads + t
        wire_at.append(np.broadcast_to(wires[:, None], (repeats[0], table.nodes[t] * repeats[1])))
    thread = np.tile(np.arange(threads), repeats[0])
    return _Strands(
        columns=columns,
        rows=np.arange(repeats[1]),
        closed=True,
        first_column=0,
        first_node=np.zeros(threads, dtype=np.int64),
        wire_at=wire_at,
        thread=thread,
        column=np.repeat(columns, threads),
        begin=np.zeros(len(thread), dtype=np.int64),
        count=table.nodes[thread] * repeats[1],
    )


def _cut_strands(cloth: Cloth, table: Table, low: np.ndarray, high: np.ndarray) -> _Strands:
    """Runs of nodes inside the rectangle low .. high, each with one node more at either end to make its clamps."""
    width, height = cloth.size
    columns = np.arange(int(np.floor(low[0] / width)) - 2, int(np.ceil(high[0] / width)) + 2)
    rows = np.arange(int(np.floor(low[1] / height)) - 1, int(np.ceil(high[1] / height)) + 1)
    wire_at, thread, column, begin, count = [], [], [], [], []
    wires = 0
    for t, n in enumerate(table.nodes):
        entry = table.start[t] + np.arange(n)
        x = np.tile(table.x[entry], len(rows))
        y = (table.y[entry][None, :] + rows[:, None] * height).ravel()
        shifted = x[None, :] + columns[:, None] * width
        inside = (shifted >= low[0]) & (shifted <= high[0]) & ((y >= low[1]) & (y <= high[1]))[None, :]
        inside[:, 0] = inside[:, -1] = False
        edges = np.diff(inside.astype(np.int8), axis=1)
        c_on, k_on = np.nonzero(edges == 1)  # K of the node before the run
        c_off, k_off = np.nonzero(edges == -1)  # K of the last node of the run
        assert np.array_equal(c_on, c_off)
        long_enough = k_off - k_on >= 2 * END_NODES
        label = np.full(inside.shape, -1, dtype=np.int64)
        runs_before = np.concatenate([[0], np.cumsum(np.bincount(c_on, minlength=len(columns)))[:-1]])  # [column]
        run = np.cumsum(edges == 1, axis=1) + runs_before[:, None] - 1
        number = np.where(long_enough, np.cumsum(long_enough) - 1 + wires, -1)
        label[:, 1:] = np.where(inside[:, 1:], number[np.clip(run, 0, None)] if len(number) else -1, -1)
        wire_at.append(label)
        kept = np.nonzero(long_enough)[0]
        thread.append(np.full(len(kept), t))
        column.append(columns[c_on[kept]])
        begin.append(k_on[kept] + rows[0] * n)
        count.append(k_off[kept] - k_on[kept] + 2)
        wires += len(kept)
    return _Strands(
        columns=columns,
        rows=rows,
        closed=False,
        first_column=int(columns[0]),
        first_node=rows[0] * np.asarray(table.nodes),
        wire_at=wire_at,
        thread=np.concatenate(thread),
        column=np.concatenate(column),
        begin=np.concatenate(begin),
        count=np.concatenate(count),
    )


@dataclass(frozen=True)
class _Bodies:
    """Bodies that are kept, with their pairs; arrays over [body] or [body, 2]."""

    clasp: np.ndarray
    column: np.ndarray
    row: np.ndarray
    wire: np.ndarray  # [body, 2]
    node: np.ndarray  # [body, 2] K of the seed
    low: np.ndarray
    high: np.ndarray
    side: np.ndarray
    strand_column: np.ndarray  # [body, 2]


def _place_bodies(cloth: Cloth, table: Table, strands: _Strands, slack: float) -> _Bodies:
    """All copies of the clasps whose lens lies whole on wires that are there.

    `slack` [m] is how far a contact may slide beyond its lens along the wire.
    """
    arms = [[clasp.arms[0], clasp.arms[1]] for clasp in cloth.clasps]
    thread = np.array([[a.thread for a in pair] for pair in arms], dtype=np.int64).reshape(-1, 2)
    h = table.spacing[thread]
    seed = np.floor(np.array([[a.arc for a in pair] for pair in arms]).reshape(-1, 2) / h).astype(np.int64)
    lens_low = np.floor(np.array([[a.arc_low for a in pair] for pair in arms]).reshape(-1, 2) / h).astype(np.int64)
    lens_high = np.ceil(np.array([[a.arc_high for a in pair] for pair in arms]).reshape(-1, 2) / h).astype(np.int64)
    arm_column = np.array([[a.column for a in pair] for pair in arms], dtype=np.int64).reshape(-1, 2)
    side = np.array([[a.side for a in pair] for pair in arms], dtype=np.int64).reshape(-1, 2)
    extra = np.ceil(slack / h).astype(np.int64)

    clasp, column, row = (a.ravel() for a in np.meshgrid(
        np.arange(len(arms)), strands.columns, strands.rows, indexing="ij"))
    order = np.lexsort((clasp, row, column))  # neighbours in the mesh are neighbours in memory
    clasp, column, row = clasp[order], column[order], row[order]
    t = thread[clasp]
    strand_column = column[:, None] + arm_column[clasp]
    lift = row[:, None] * np.asarray(table.nodes)[t]
    node = seed[clasp] + lift
    first, last = lens_low[clasp] + lift, lens_high[clasp] + lift
    wire = strands.wire(t, strand_column, node)
    keep = wire >= 0
    low, high = (lens_low - extra - seed)[clasp], (lens_high + extra - 1 - seed)[clasp]
    if not strands.closed:
        keep &= (strands.wire(t, strand_column, first) == wire) & (strands.wire(t, strand_column, last) == wire)
        begin = strands.begin[wire]
        end = begin + strands.count[wire] - 1
        low = np.maximum(low, begin + END_NODES - node)
        high = np.minimum(high, end - END_NODES - 1 - node)
        keep &= (low <= 0) & (high >= 0)
    keep = keep.all(axis=1)
    return _Bodies(
        clasp=clasp[keep], column=column[keep], row=row[keep], wire=wire[keep], node=node[keep],
        low=low[keep], high=high[keep], side=side[clasp][keep], strand_column=strand_column[keep],
    )  # fmt: skip


def table_lead(cloth: Cloth, spacing: float, slack: float) -> int:
    """Entries that a table needs before and behind a period [-], at the given node spacing [m]."""
    spans = [arm.arc_high - arm.arc_low for clasp in cloth.clasps for arm in clasp.arms]
    reach = int(np.ceil((max(spans, default=0.0) + slack) / spacing))
    return max(BLOCK_SIZE, reach) + 6


def build_panel(cloth: Cloth, table: Table, *, repeats: tuple[int, int], boundary: str, slack: float) -> Panel:
    """Lay out `repeats` (weft, warp) copies of the repeat; `slack` [m]: see `table_lead`.

    Raises `ModelError` where nothing is left after the cut.
    """
    repeat = np.array(cloth.size)
    size = repeat * np.array(repeats)
    nodes = np.asarray(table.nodes)
    notes: list[str] = []
    if boundary == "periodic":
        middle = 0.5 * size
        strands = _closed_strands(table, repeats)
    else:
        # an opening sits in the middle, so that its rhombus is as far from the grips as it can be
        middle = np.zeros(2) if cloth.rhombus is None else np.array(cloth.rhombus.centre)
        strands = _cut_strands(cloth, table, middle - 0.5 * size, middle + 0.5 * size)
    bodies = _place_bodies(cloth, table, strands, slack)
    if boundary == "periodic":
        used = np.arange(len(strands.thread))
    else:
        used = np.unique(bodies.wire)
        if len(used) < len(strands.thread):
            notes.append(f"{len(strands.thread) - len(used)} wire fragments at the edges hold no clasp: dropped")
    if len(bodies.clasp) == 0:
        raise ModelError(f"knit.repeats: {repeats[0]} x {repeats[1]} leave no clasp inside the boundary: use more")
    new_index = np.full(len(strands.thread), -1, dtype=np.int64)
    # wires side by side in the mesh are side by side in memory
    used = used[np.lexsort((strands.begin[used], strands.thread[used], strands.column[used]))]
    new_index[used] = np.arange(len(used))
    thread, column = strands.thread[used], strands.column[used]
    begin, count = strands.begin[used], strands.count[used]
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    n = nodes[thread]
    pieces = -(-count // BLOCK_SIZE)
    block_wire = np.repeat(np.arange(len(used)), pieces)
    piece = np.arange(len(block_wire)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    block_low = count[block_wire] * piece // pieces[block_wire]
    block_high = count[block_wire] * (piece + 1) // pieces[block_wire]
    block_node = begin[block_wire] + block_low
    block_n = n[block_wire]

    pair_wire = new_index[bodies.wire]
    pair_local = bodies.node - begin[pair_wire]
    pair_n = n[pair_wire]
    if boundary == "periodic":
        pair_local = np.mod(pair_local, count[pair_wire])
    pair_period = np.floor_divide(bodies.node, pair_n)
    shift = np.stack(
        [
            (bodies.strand_column - bodies.column[:, None]) * repeat[0],
            (pair_period - bodies.row[:, None]) * repeat[1],
        ],
        axis=2,
    )
    held_node, held_lever, held_clamp, clamp_position = _clamps(
        table, repeat, boundary, thread, column, begin, count, first
    )
    return Panel(
        size=size,
        boundary=boundary,
        wire_first=_as32(first),
        wire_count=_as32(count),
        wire_closed=np.full(len(used), strands.closed),
        wire_thread=_as32(thread),
        block_first=_as32(first[block_wire] + block_low),
        block_count=_as32(block_high - block_low),
        block_table=_as32(table.start[thread[block_wire]] + np.mod(block_node, block_n)),
        block_wire=_as32(block_wire),
        block_origin=np.stack(
            [column[block_wire] * repeat[0], np.floor_divide(block_node, block_n) * repeat[1]], axis=1
        ),
        body_rest=np.array([c.position for c in cloth.clasps]).reshape(-1, 2)[bodies.clasp],
        body_origin=np.stack([bodies.column * repeat[0], bodies.row * repeat[1]], axis=1),
        pair_wire=_as32(pair_wire.ravel()),
        pair_seed=_as32((first[pair_wire] + pair_local).ravel()),
        pair_table=_as32((table.start[thread[pair_wire]] + np.mod(bodies.node, pair_n)).ravel()),
        pair_shift=shift.reshape(-1, 2),
        pair_low=_as32(bodies.low.ravel()),
        pair_high=_as32(bodies.high.ravel()),
        pair_side=_as32(bodies.side.ravel()),
        held_node=_as32(held_node),
        held_lever=held_lever,
        held_clamp=_as32(held_clamp),
        clamp_position=clamp_position,
        rhombus_bodies=_central_rhombus(cloth, bodies, strands, middle, repeat),
        notes=tuple(notes),
    )


def _as32(a: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(a, dtype=np.int32)


def _clamps(
    table: Table,
    repeat: np.ndarray,
    boundary: str,
    thread: np.ndarray,
    column: np.ndarray,
    begin: np.ndarray,
    count: np.ndarray,
    first: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Held nodes, their levers and clamps, and the clamps' positions: two clamps an open wire, two nodes a clamp."""
    if boundary == "periodic":
        return np.zeros(0, int), np.zeros((0, 2)), np.zeros(0, int), np.zeros((0, 2))
    local = np.stack([np.zeros_like(count), np.ones_like(count), count - 2, count - 1], axis=1)
    node = begin[:, None] + local
    n = np.asarray(table.nodes)[thread][:, None]
    entry = table.start[thread][:, None] + np.mod(node, n)
    position = np.stack(
        [
            table.x[entry] + column[:, None] * repeat[0],
            table.y[entry] + np.floor_divide(node, n) * repeat[1],
        ],
        axis=2,
    ).reshape(-1, 2, 2)  # [clamp, node of the clamp, xy]
    centre = position.mean(axis=1)
    lever = (position - centre[:, None, :]).reshape(-1, 2)
    held = (first[:, None] + local).ravel()
    return held, lever, np.repeat(np.arange(len(centre)), 2), centre


def _central_rhombus(
    cloth: Cloth, bodies: _Bodies, strands: _Strands, middle: np.ndarray, repeat: np.ndarray
) -> np.ndarray:
    """Bodies (k,) round the complete opening whose centre is nearest to `middle` (2,) [m]; empty where none is complete."""
    if cloth.rhombus is None:
        return np.zeros(0, dtype=np.int64)
    rows, columns = len(strands.rows), len(strands.columns)
    index = np.full((len(cloth.clasps), columns, rows), -1, dtype=np.int64)
    index[bodies.clasp, bodies.column - strands.columns[0], bodies.row - strands.rows[0]] = np.arange(len(bodies.clasp))
    parts = np.array(cloth.rhombus.clasps, dtype=np.int64).reshape(-1, 3)
    c, r = (a.ravel() for a in np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij"))
    pc, pr = c[:, None] + parts[:, 1], r[:, None] + parts[:, 2]
    if strands.closed:
        pc, pr = np.mod(pc, columns), np.mod(pr, rows)
        there = np.ones(pc.shape, dtype=bool)
    else:
        there = (pc >= 0) & (pc < columns) & (pr >= 0) & (pr < rows)
    members = np.where(there, index[parts[:, 0], np.clip(pc, 0, columns - 1), np.clip(pr, 0, rows - 1)], -1)
    complete = np.nonzero((members >= 0).all(axis=1))[0]
    if len(complete) == 0:
        return np.zeros(0, dtype=np.int64)
    centre = np.array(cloth.rhombus.centre) + np.stack(
        [(c[complete] + strands.columns[0]) * repeat[0], (r[complete] + strands.rows[0]) * repeat[1]], axis=1
    )
    return members[complete[np.argmin(np.sum((centre - middle) ** 2, axis=1))]]
