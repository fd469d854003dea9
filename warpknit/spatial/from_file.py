"""Wires from a file (`warpknit.wires`) as rods: closed where they repeat or are rings, clamped at both ends where open."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import ModelError
from ..kernels.clamp import CLAMP_NUMBERS
from ..mesh.panel import Panel
from ..wires.wires import Wires
from .rods import Rods, Section, rods_of
from .wires import SpatialWires

FEWEST = 5  # nodes of an open wire, of which the clamps hold four
# what a panel of wires from a file has none of
NO_NUMBERS = (
    "block_first", "block_count", "block_table", "block_wire", "body_clasp", "pair_wire", "pair_seed", "pair_table", "pair_low",
    "pair_high", "pair_side", "held_node", "held_clamp", "rhombus_bodies",
)  # fmt: skip
NO_PLACES = ("block_origin", "body_rest", "body_origin", "pair_shift", "held_lever")


def mesh_of_wires(section: Section, wires: Wires) -> tuple[Panel, SpatialWires, Rods]:
    """The wires as a panel, which knows no places where they hook each other; what holds their ends; and the rods, free of stress
    where the file has them but for the lengths free of stress that it may give. Raises `ModelError`."""
    count = np.array([len(points) for points in wires.points], dtype=np.int32)
    first = np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.int32)
    is_open = np.array([kind == "open" for kind in wires.kinds])
    if (count[is_open] < FEWEST).any():
        number = int(np.flatnonzero(is_open & (count < FEWEST))[0])
        allowed = f"{FEWEST} or more, of which its clamps hold four"
        raise ModelError(f"wires.node_spacing: wire {number + 1} gets {count[number]} nodes, allowed: {allowed}")
    if wires.period is None and not is_open.any():
        raise ModelError("wires: given rings only, allowed: wires with ends to hold, or that repeat (wires.period)")
    placed = _clamped(wires, first[is_open], count[is_open])
    rods = rods_of(section, wires.points, [None if end else wires.closing(w) for w, end in enumerate(is_open)], tile=placed.tile)
    if wires.rest_lengths is not None:
        own = rods.natural_length.copy()
        own[rods.following >= 0] = np.concatenate(wires.rest_lengths)
        rods = replace(rods, natural_length=own)
    rods = rods.holding(placed.held_node.tolist(), placed.held_section.tolist())
    return _panel(wires, placed, first, count, section.thickness), placed, rods


def _clamped(wires: Wires, first: np.ndarray, count: np.ndarray) -> SpatialWires:
    """What holds open wires with these first nodes and numbers of nodes: clamps in the middles of their end segments."""
    held = np.stack([first, first + 1, first + count - 2, first + count - 1], axis=1).astype(np.int64)
    places = np.concatenate(wires.points)[held][..., :2]
    middle = np.repeat(places.reshape(-1, 2, 2, 2).mean(axis=2), 2, axis=1)
    none = np.zeros((0, 2), dtype=np.int64)
    return SpatialWires(
        points=wires.points,
        tile=np.zeros(3) if wires.period is None else np.array([*wires.period, 0.0]),
        line=None,
        held_node=held.ravel(),
        held_lever=(places - middle).reshape(-1, 2),
        held_section=held[:, [0, 2]].ravel(),
        site_wire=none,
        site_seed=none,
        site_low=none,
        site_high=none,
    )


def _panel(wires: Wires, placed: SpatialWires, first: np.ndarray, count: np.ndarray, thickness: float) -> Panel:
    points = np.concatenate(wires.points)[:, :2]
    none: dict[str, Any] = dict.fromkeys(NO_NUMBERS, np.zeros(0, dtype=np.int32)) | dict.fromkeys(NO_PLACES, np.zeros((0, 2)))
    return Panel(
        size=np.maximum(np.ptp(points, axis=0), thickness) if wires.period is None else wires.period,
        low=points.min(axis=0) if wires.period is None else np.zeros(2),
        outline=None,
        boundary="gripped" if wires.period is None else "periodic",
        wire_first=first,
        wire_count=count,
        wire_closed=np.array([kind != "open" for kind in wires.kinds]),
        wire_thread=np.zeros(len(count), dtype=np.int32),
        wire_length=wires.lengths,
        clamp_position=(points[placed.held_node] - placed.held_lever)[::2],
        wire_clamp=np.zeros((len(count), 2, int(CLAMP_NUMBERS))),
        **none,
    )
