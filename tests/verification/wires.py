"""Meshes made by hand for the verification tests: single wires of any shape, with bodies where a test puts them."""

from __future__ import annotations

import numpy as np

from warpknit.model import Model, assemble_model
from warpknit.panel import END_NODES, Panel
from warpknit.kernels.wires_by_block import BLOCK_SIZE
from warpknit.scene import make_scene
from warpknit.table import Table

LEAD = BLOCK_SIZE + 40


def scene_with(**solver: object):
    """A scene for its wire and solver tables; the knit in it is not used."""
    contact = solver.pop("contact", {})
    wire = solver.pop("wire", {})
    table = {
        "wire": {"material": "tungsten", "diameter": "15 um", **wire},
        "knit": {
            "bars": [
                {"chain": "1-0/1-2/2-3/2-1", "threading": "|.", "shift": 0},
                {"chain": "2-3/2-1/1-0/1-2", "threading": "|.", "shift": 1},
            ],
            "repeats": [1, 1],
        },
        "solver": {"drive": "ramp", "precision": "double", "axial_softening": 1.0, **solver},
        "contact": contact,
    }
    return make_scene(table)


def table_of_wires(shapes: list[np.ndarray], closed: bool = False, natural: list[np.ndarray] | None = None) -> Table:
    """Table with one thread a wire; `shapes` are node positions (n, 2) [m]. A closed wire returns to its first node.

    `natural` gives the stress-free shapes where they differ from the ones to start from (same number of nodes).
    """
    parts: dict[str, list[np.ndarray]] = {}
    start, nodes, offset = [], [], 0
    for w, shape in enumerate(shapes):
        n = len(shape)
        free = shape if natural is None else natural[w]
        index = np.arange(-LEAD, n + LEAD)
        wrap = np.mod(index, n) if closed else np.clip(index, 0, n - 1)
        step = np.mod(wrap + 1, n) if closed else np.clip(wrap + 1, 0, n - 1)
        back = np.mod(wrap - 1, n) if closed else np.clip(wrap - 1, 0, n - 1)
        edge = shape[step] - shape[wrap]
        e, b = free[step] - free[wrap], free[wrap] - free[back]
        length, before = np.hypot(*e.T), np.hypot(*b.T)
        spacing = np.mean(length[length > 0])
        length = np.where(length > 0, length, spacing)  # beyond the ends: never used, but divided by
        before = np.where(before > 0, before, spacing)
        edge = np.where(np.hypot(*edge.T)[:, None] > 0, edge, [[spacing, 0.0]])
        angle = np.arctan2(b[:, 0] * e[:, 1] - b[:, 1] * e[:, 0], np.sum(b * e, axis=1))
        hinge = 0.5 * (length + before)
        for name, value in dict(
            x=shape[wrap, 0], y=shape[wrap, 1], z=0 * hinge, rest_x=edge[:, 0], rest_y=edge[:, 1], rest_length=length,
            rest_angle=angle, hinge_length=hinge, node_length=hinge, curve=np.zeros((len(wrap), 8)),
        ).items():  # fmt: skip
            parts.setdefault(name, []).append(value)
        start.append(offset + LEAD)
        nodes.append(n)
        offset += len(index)
    spacing = np.array([np.mean(np.hypot(*np.diff(s, axis=0).T)) for s in shapes])
    return Table(
        start=np.array(start), nodes=np.array(nodes), spacing=spacing, lead=LEAD, curve_error=0.0,
        **{name: np.concatenate(value) for name, value in parts.items()},
    )  # fmt: skip


def panel_of_wires(
    table: Table,
    closed: bool = False,
    held: list[int] = (),
    bodies: np.ndarray | None = None,
    pairs: list[tuple[int, int, int]] = (),
) -> Panel:
    """Wires of the table, held nodes that move with nothing, and bodies with pairs (wire, segment near the body, side)."""
    count = table.nodes
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    block_first, block_count, block_table, block_wire = [], [], [], []
    for w in range(len(count)):
        for low in range(0, count[w], BLOCK_SIZE):
            block_first.append(first[w] + low)
            block_count.append(min(BLOCK_SIZE, count[w] - low))
            block_table.append(table.start[w] + low)
            block_wire.append(w)
    bodies = np.zeros((0, 2)) if bodies is None else np.asarray(bodies, float)
    wire = np.array([p[0] for p in pairs], dtype=int)
    segment = np.array([p[1] for p in pairs], dtype=int)
    margin = 0 if closed else END_NODES
    low = -segment + margin if not closed else np.full(len(wire), -30)
    high = count[wire] - 2 - margin - segment if not closed else np.full(len(wire), 30)
    i32 = lambda a: np.array(a, dtype=np.int32)  # noqa: E731
    return Panel(
        size=np.array([1.0, 1.0]),
        boundary="periodic" if closed else "gripped",
        wire_first=i32(first),
        wire_count=i32(count),
        wire_closed=np.full(len(count), closed),
        wire_thread=i32(np.arange(len(count))),
        block_first=i32(block_first),
        block_count=i32(block_count),
        block_table=i32(block_table),
        block_wire=i32(block_wire),
        block_origin=np.zeros((len(block_first), 2)),
        body_rest=bodies,
        body_origin=np.zeros_like(bodies),
        pair_wire=i32(wire),
        pair_seed=i32(first[wire] + segment if len(wire) else []),
        pair_table=i32(table.start[wire] + segment if len(wire) else []),
        pair_shift=np.zeros((len(wire), 2)),
        pair_low=i32(low),
        pair_high=i32(high),
        pair_side=i32([p[2] for p in pairs]),
        held_node=i32(sorted(held)),
        held_lever=np.zeros((len(held), 2)),
        held_clamp=i32(np.zeros(len(held))),
        clamp_position=np.zeros((1 if held else 0, 2)),
        rhombus_bodies=np.zeros(0, dtype=int),
    )


def model_of_wires(table: Table, panel: Panel, device: str = "cpu", **solver: object) -> Model:
    return assemble_model(scene_with(**solver), table, panel, device=device, loop_length=1e-3, displacement_range=4e-3)
