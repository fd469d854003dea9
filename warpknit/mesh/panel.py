"""The mesh made of copies of one repeat: wires, blocks of nodes, contact bodies with their pairs, and clamps.

*Periodic*: the tile is closed onto itself, every wire is an endless loop. *Gripped*: the mesh is cut along an outline from
endless cloth (strands.py); a clamp sits where a wire is cut and holds the nodes before and behind. A hinge next to a clamp stands
for the wire from there to the middle of the next segment, so what a wire does between its grips does not depend on where
its nodes fall.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..base.errors import ModelError
from ..base.text import short_repr
from ..kernels import clamp
from ..kernels.bend import BOW
from ..kernels.wire_forces import BLOCK_PAD, BLOCK_SIZE
from ..knit.cloth import Cloth
from ..results.finding import ResultWarning
from ..scene.outline import Outline
from .rest_table import Table, ThreadCurve
from .strands import Strands, closed_strands, cut_strands

TANGENT_SHARE = 1e-3  # of a node spacing, either side of a clamp: where its direction is taken from


def _clamps(
    cloth: Cloth, table: Table, strands: Strands, used: np.ndarray, first: np.ndarray, set_fraction: float
) -> dict[str, Any]:
    """Fields of a panel for the clamps of its wires, two a wire (kernels/clamp.py)."""
    thread, begin, count = strands.thread[used], strands.begin[used], strands.count[used]
    spacing = table.spacing[thread]
    arc = np.stack([strands.arc_begin[used], strands.arc_end[used]], axis=1)
    # the clamp, points a little before and behind it, and the five nodes at its end of the wire, the outermost first
    inward = np.array([1, -1])
    local = np.stack([np.zeros_like(count), count - 1], axis=1)[:, :, None] + inward[:, None] * np.arange(5)
    node_arc = (begin[:, None, None] + local) * spacing[:, None, None]
    apart = TANGENT_SHARE * spacing[:, None]
    at = np.concatenate([np.stack([arc, arc - apart, arc + apart], axis=2), node_arc], axis=2)
    place = np.zeros((*at.shape, 2))
    for t, line in enumerate(cloth.threads):
        here = thread == t
        place[here] = ThreadCurve(line, cloth.size[1])(at[here].ravel())[:, :2].reshape(*at[here].shape, 2)
    place[..., 0] += (strands.column[used] * cloth.size[0])[:, None, None]
    centre, node = place[:, :, 0], place[:, :, 3:]
    tangent = place[:, :, 2] - place[:, :, 1]
    tangent /= np.linalg.norm(tangent, axis=2)[:, :, None]

    # edges from the clamp inwards, and turned so that they run along the wire at both ends
    edge = np.diff(np.concatenate([centre[:, :, None], node[:, :, 2:]], axis=2), axis=2) * inward[:, None, None]
    length = np.linalg.norm(edge, axis=3)
    turn = np.stack([_turn(tangent, edge[:, :, 0], inward), _turn(edge[:, :, 0], edge[:, :, 1], inward)], axis=2)
    first_arc = np.abs(node_arc[..., 2] - arc)
    hinge = np.stack([0.5 * first_arc, 0.5 * (first_arc + spacing[:, None])], axis=2)
    # table entries [wire, end, hinge] of the two nodes
    entry = np.mod(begin[:, None, None] + local[:, :, 1:3], table.nodes[thread][:, None, None])
    entry += table.start[thread][:, None, None]
    in_table = table.rest_turn[entry]
    numbers = np.zeros((len(used), 2, clamp.CLAMP_NUMBERS))
    lever = centre - node[:, :, 1]
    numbers[..., [clamp.LEVER_X, clamp.LEVER_Y]] = -lever * inward[:, None]
    numbers[..., [clamp.TANGENT_X, clamp.TANGENT_Y]] = tangent
    numbers[..., clamp.LENGTH] = length[..., 0]
    numbers[..., [clamp.ANGLE, clamp.NEXT_ANGLE]] = set_fraction * turn
    numbers[..., [clamp.HINGE, clamp.NEXT_HINGE]] = table.hinge_length[entry] / hinge
    own = (length[..., :1] / hinge) ** 2
    beyond = (length[..., 1] / hinge[..., 1]) ** 2
    numbers[..., [clamp.BOW_WEIGHT, clamp.NEXT_BOW_WEIGHT]] = own - 1.0
    numbers[..., clamp.BEYOND_BOW_WEIGHT] = beyond - 1.0
    numbers[..., clamp.BOW_CHANGE] = BOW * (own * turn**2 - in_table**2).sum(axis=2)
    numbers[..., clamp.NEXT_BOW_CHANGE] = BOW * (beyond * turn[..., 1] ** 2 - in_table[..., 1] ** 2)
    held = (first[:, None, None] + np.sort(local[:, :, :2], axis=2)).reshape(-1)
    held_place = np.where((inward < 0)[:, None, None], node[:, :, 1::-1], node[:, :, :2])
    return {
        "wire_begin": strands.arc_begin[used] - np.floor_divide(begin, table.nodes[thread]) * (table.nodes[thread] * spacing),
        "wire_clamp": numbers,
        "held_node": as32(held),
        "held_lever": (held_place - centre[:, :, None]).reshape(-1, 2),
        "held_clamp": as32(np.repeat(np.arange(2 * len(used)), 2)),
        "clamp_position": centre.reshape(-1, 2),
    }


def _turn(a: np.ndarray, b: np.ndarray, inward: np.ndarray) -> np.ndarray:
    """Turning angle [wire, end] [rad] from edge a to b (wire, end, 2) at the near end; from b to a at the far one."""
    cross = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return np.arctan2(inward * cross, np.sum(a * b, axis=-1))


END_NODES = 1  # segments at the end of a wire that a contact point may not come to: its curve needs a node beyond
SHORTEST = 5  # segments of a cut wire: with less, the two clamps would share a hinge
SHORTEST_PIECE = 0.25  # loops of wire between two grips: what is shorter is part of the grips, and holds no loop
NOT_HELD = "hold no clasp, or are shorter than a quarter of a loop"
GRIP_CLEARANCE = 0.05  # loops of wire that a lens must keep from a grip, or its clasp is left out


def _empty(dtype: type, *columns: int) -> Any:
    """A field that is empty by default."""
    return field(default_factory=lambda: np.zeros((0, *columns), dtype=dtype))


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Wires, bodies and grips of the mesh. Index arrays are int32; wires hold consecutive nodes."""

    __repr__ = short_repr

    size: np.ndarray  # (2,) [m] rest size of the mesh, or of the box around it
    low: np.ndarray  # (2,) [m] its lower corner
    outline: Outline | None = None  # that it is cut along; None where it is periodic
    boundary: str  # gripped | periodic
    wire_first: np.ndarray  # [wire] first node
    wire_count: np.ndarray  # [wire] nodes
    wire_closed: np.ndarray  # [wire] bool
    wire_thread: np.ndarray  # [wire] thread of the repeat
    wire_length: np.ndarray  # [wire] [m] between its clamps, or all round
    wire_clamp: np.ndarray  # [wire, 2, CLAMP_NUMBERS] its clamps (kernels/clamp.py), zero where it has none
    block_first: np.ndarray = _empty(np.int32)  # [block] first node
    block_count: np.ndarray = _empty(np.int32)  # [block] nodes, at most BLOCK_SIZE
    block_table: np.ndarray = _empty(np.int32)  # [block] table entry of the first node
    block_wire: np.ndarray = _empty(np.int32)  # [block]
    block_origin: np.ndarray = _empty(float, 2)  # [block, 2] [m]
    body_clasp: np.ndarray = _empty(np.int32)  # [body] clasp of the repeat
    body_rest: np.ndarray  # [body, 2] [m] position at rest in the frame of its repeat
    body_origin: np.ndarray  # [body, 2] [m] what to add to it
    pair_wire: np.ndarray  # [pair]; pairs 2b and 2b + 1 belong to body b
    pair_seed: np.ndarray = _empty(np.int32)  # [pair] node that starts the segment nearest to the body at rest
    pair_table: np.ndarray = _empty(np.int32)  # [pair] table entry of that node, in the first period
    pair_shift: np.ndarray = _empty(float, 2)  # [pair, 2] [m] position of the body in the frame of the table = body_rest - shift
    pair_low: np.ndarray = _empty(np.int32)  # [pair] reach along the wire in segments from the seed
    pair_high: np.ndarray = _empty(np.int32)  # [pair]
    pair_side: np.ndarray = _empty(np.int32)  # [pair] +1 | -1
    held_node: np.ndarray = _empty(np.int32)  # [held] sorted
    held_lever: np.ndarray = _empty(float, 2)  # [held, 2] [m] rest position of the node relative to its clamp
    held_clamp: np.ndarray = _empty(np.int32)  # [held] clamp that holds it
    clamp_position: np.ndarray = _empty(float, 2)  # [clamp, 2] [m]
    rhombus_bodies: np.ndarray = _empty(np.int32)  # bodies round the complete opening nearest to the middle
    # [wire] [m] arc of its lower clamp along its thread, counted as `block_table` of its first block; without clamps: empty
    wire_begin: np.ndarray = _empty(float)
    # (2,) distance of the outermost clamps over `size`; below 1 for wires from a file, whose clamps end inside it
    clamp_share: np.ndarray = field(default_factory=lambda: np.ones(2))
    notes: tuple[str, ...] = ()  # how the mesh was cut
    warnings: tuple[ResultWarning, ...] = ()  # about the wires of a file
    # clamps that are free to move along warp (kernels/slide.py), each of two nodes that are a block of their own
    sliding_clamp: np.ndarray = _empty(np.int32)

    @cached_property
    def area(self) -> float:
        """[m2] area at rest."""
        return float(np.prod(self.size)) if self.outline is None else self.outline.area

    @cached_property
    def node_count(self) -> int:
        return int(self.wire_count.sum())

    @property
    def node_entry(self) -> np.ndarray:
        """[node] entry of each node in the table."""
        lane = np.arange(self.node_count, dtype=np.int32) - np.repeat(self.block_first, self.block_count)
        return np.repeat(self.block_table, self.block_count) + lane

    @property
    def body_count(self) -> int:
        return len(self.body_rest)


class _Bodies(NamedTuple):
    """Kept bodies with their pairs; arrays [body] or [body, 2]."""

    clasp: np.ndarray
    column: np.ndarray
    row: np.ndarray
    wire: np.ndarray  # [body, 2]
    node: np.ndarray  # [body, 2] K of the seed
    low: np.ndarray
    high: np.ndarray
    side: np.ndarray
    strand_column: np.ndarray  # [body, 2]


def _place_bodies(cloth: Cloth, table: Table, strands: Strands, slack: float) -> _Bodies:
    """Copies of clasps with the lens whole on wires, GRIP_CLEARANCE from grips.

    `slack` [m] is how far a contact may slide beyond its lens along the wire.
    """

    loop = cloth.stitch_length
    clearance = GRIP_CLEARANCE * loop

    def of_arms(name: str, dtype: type = np.int64) -> np.ndarray:
        return np.array([[getattr(a, name) for a in clasp.arms] for clasp in cloth.clasps], dtype=dtype).reshape(-1, 2)

    thread, arm_column, side = of_arms("thread"), of_arms("column"), of_arms("side")
    arc, arc_low, arc_high = (of_arms(name, float) for name in ("arc", "arc_low", "arc_high"))
    h = table.spacing[thread]
    seed = np.floor(arc / h).astype(np.int64)
    reach_low = np.floor((arc_low - slack) / h).astype(np.int64) - seed
    reach_high = np.ceil((arc_high + slack) / h).astype(np.int64) - 1 - seed

    clasp, column, row = (a.ravel() for a in np.meshgrid(np.arange(len(thread)), strands.columns, strands.rows, indexing="ij"))
    order = np.lexsort((clasp, row, column))  # neighbours in the mesh are neighbours in memory
    clasp, column, row = clasp[order], column[order], row[order]
    t = thread[clasp]
    strand_column = column[:, None] + arm_column[clasp]
    period = np.array([thread.length for thread in cloth.threads])[t]
    lift = row[:, None] * period
    wire = strands.wire(t, strand_column, arc_low[clasp] + lift - clearance, arc_high[clasp] + lift + clearance)
    node = seed[clasp] + row[:, None] * np.asarray(table.nodes)[t]
    low, high = reach_low[clasp], reach_high[clasp]
    if not strands.closed:
        begin = strands.begin[wire]
        end = begin + strands.count[wire] - 1
        low = np.maximum(low, begin + END_NODES - node)
        high = np.minimum(high, end - 1 - END_NODES - node)
        is_piece = (strands.arc_end - strands.arc_begin)[wire] < SHORTEST_PIECE * loop
        wire[(low > 0) | (high < 0) | (strands.count[wire] <= SHORTEST) | is_piece] = -1
    keep = (wire >= 0).all(axis=1)
    return _Bodies(*(a[keep] for a in (clasp, column, row, wire, node, low, high, side[clasp], strand_column)))


def table_lead(cloth: Cloth, spacing: float, slack: float) -> int:
    """Entries of a table before and behind a period [-], at the given node spacing [m]."""
    spans = [arm.arc_high - arm.arc_low for clasp in cloth.clasps for arm in clasp.arms]
    reach = int(np.ceil((max(spans, default=0.0) + slack) / spacing))
    return max(BLOCK_SIZE + BLOCK_PAD, reach) + 6


def build_panel(
    cloth: Cloth, table: Table, *, repeats: tuple[int, int], outline: Outline | None, slack: float, set_fraction: float = 1.0
) -> Panel:
    """Lay out copies of the repeat; `slack` [m]: see `table_lead`; `set_fraction` as in `rest_table`.

    outline: of a gripped mesh, its origin where the middle of the mesh is to be; None: `repeats` (weft, warp) copies make a
    periodic tile.
    Raises `ModelError` where nothing is left after the cut.
    """
    repeat = np.array(cloth.size)
    size = repeat * np.array(repeats)
    nodes = np.asarray(table.nodes)
    if outline is None:
        low, middle = np.zeros(2), 0.5 * size
        strands = closed_strands(cloth, table, repeats)
    else:
        # an opening sits in the middle, so that its rhombus is as far from the grips as it can be
        middle = np.zeros(2) if cloth.rhombus is None else np.array(cloth.rhombus.opening.centre)
        outline = outline.shifted(middle)
        low, size = outline.low, outline.size
        strands = cut_strands(cloth, table.spacing, outline)
    if not len(strands.thread):
        raise ModelError("panel.size: no wire crosses the outline; use a larger outline")
    bodies = _place_bodies(cloth, table, strands, slack)
    used = np.arange(len(strands.thread)) if outline is None else np.unique(bodies.wire)
    dropped = len(strands.thread) - len(used)
    if len(bodies.clasp) == 0:
        raise ModelError(
            f"knit.repeats: {repeats[0]} x {repeats[1]} leave no clasp inside the boundary; write more, or a larger panel.size"
        )
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
    if outline is None:
        pair_local = np.mod(pair_local, count[pair_wire])
    pair_period = np.floor_divide(bodies.node, pair_n)
    shift = np.stack(
        [(bodies.strand_column - bodies.column[:, None]) * repeat[0], (pair_period - bodies.row[:, None]) * repeat[1]], axis=2
    )
    grips: dict[str, Any] = {"wire_clamp": np.zeros((len(used), 2, clamp.CLAMP_NUMBERS))}
    if not strands.closed:
        grips = _clamps(cloth, table, strands, used, first, set_fraction)
    return Panel(
        size=size,
        low=low,
        outline=outline,
        boundary="periodic" if outline is None else "gripped",
        wire_first=as32(first),
        wire_count=as32(count),
        wire_closed=np.full(len(used), strands.closed),
        wire_thread=as32(thread),
        wire_length=strands.arc_end[used] - strands.arc_begin[used],
        block_first=as32(first[block_wire] + block_low),
        block_count=as32(block_high - block_low),
        block_table=as32(table.start[thread[block_wire]] + np.mod(block_node, block_n)),
        block_wire=as32(block_wire),
        block_origin=np.stack([column[block_wire] * repeat[0], np.floor_divide(block_node, block_n) * repeat[1]], axis=1),
        body_clasp=as32(bodies.clasp),
        body_rest=np.array([c.position for c in cloth.clasps]).reshape(-1, 2)[bodies.clasp],
        body_origin=np.stack([bodies.column * repeat[0], bodies.row * repeat[1]], axis=1),
        pair_wire=as32(pair_wire.ravel()),
        pair_seed=as32((first[pair_wire] + pair_local).ravel()),
        pair_table=as32((table.start[thread[pair_wire]] + np.mod(bodies.node, pair_n)).ravel()),
        pair_shift=shift.reshape(-1, 2),
        pair_low=as32(bodies.low.ravel()),
        pair_high=as32(bodies.high.ravel()),
        pair_side=as32(bodies.side.ravel()),
        rhombus_bodies=_central_rhombus(cloth, bodies, strands, middle, repeat),
        notes=(f"{dropped} cut pieces of wire at the edges {NOT_HELD}; they are left out",) if dropped else (),
        **grips,
    )


def as32(a: object) -> np.ndarray:
    """An index array, as kernels take it."""
    return np.ascontiguousarray(a, dtype=np.int32)


def _central_rhombus(cloth: Cloth, bodies: _Bodies, strands: Strands, middle: np.ndarray, repeat: np.ndarray) -> np.ndarray:
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
    centre = np.array(cloth.rhombus.opening.centre) + np.stack(
        [(c[complete] + strands.columns[0]) * repeat[0], (r[complete] + strands.rows[0]) * repeat[1]], axis=1
    )
    return members[complete[np.argmin(np.sum((centre - middle) ** 2, axis=1))]]
