"""Constant device arrays: rest data of one repeat and indices of the mesh, in the precision of the run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..compute.arrays import Precision, array, names_of, new_arrays
from ..kernels.contact import CURVE_COEFFICIENTS
from ..mesh.hook_mesh import Treatment
from ..mesh.panel import Panel
from ..mesh.rest_table import Table
from ..mesh.strip import Strip
from .numerics import Numerics


@dataclass(frozen=True)
class RestArrays:
    """Rest data of one repeat on the device; [entry], see table.py."""

    place_x: wp.array = array(wp.float64)  # [m] for the neighbour search
    place_y: wp.array = array(wp.float64)
    table_x: wp.array = array("coordinate")  # [counts], wrapped around
    table_y: wp.array = array("coordinate")
    rest_x: wp.array = array("real")  # [m]
    rest_y: wp.array = array("real")
    rest_length: wp.array = array("real")  # [m]
    inverse_length: wp.array = array("real")  # [1/m]
    rest_bow: wp.array = array("real")  # [-] share by which the arc is longer
    rest_angle: wp.array = array("real")  # [rad]
    hinge_stiffness: wp.array = array("real")  # [N m] EI over the length that belongs to the node
    inverse_mass: wp.array = array("real")  # [1/kg]
    node_mass: wp.array = array("real")  # [kg]
    curve: wp.array = array("real")  # [entry, CURVE_COEFFICIENTS] [-]


@dataclass(frozen=True)
class MeshArrays:
    """Index arrays of the mesh on the device; see panel.py for their meaning."""

    block_first: wp.array = array(wp.int32)
    block_count: wp.array = array(wp.int32)
    block_table: wp.array = array(wp.int32)
    block_wire: wp.array = array(wp.int32)
    block_origin_x: wp.array = array(wp.float64)
    block_origin_y: wp.array = array(wp.float64)
    block_pair_start: wp.array = array(wp.int32)  # [block + 1] where pairs that may touch the block stand in `block_pair`
    block_pair: wp.array = array(wp.int32)
    block_held_start: wp.array = array(wp.int32)  # [block + 1] into held_node
    wire_first: wp.array = array(wp.int32)
    wire_count: wp.array = array(wp.int32)
    wire_closed: wp.array = array(wp.int32)
    wire_clamp: wp.array = array("real")  # [wire, 2 CLAMP_NUMBERS]
    pair_wire: wp.array = array(wp.int32)
    pair_seed: wp.array = array(wp.int32)
    pair_table: wp.array = array(wp.int32)
    pair_low: wp.array = array(wp.int32)
    pair_high: wp.array = array(wp.int32)
    pair_side: wp.array = array(wp.int32)
    pair_rest_x: wp.array = array("coordinate")  # [counts] body in the frame of the table
    pair_rest_y: wp.array = array("coordinate")
    body_origin_x: wp.array = array(wp.float64)  # [m] body at rest
    body_origin_y: wp.array = array(wp.float64)
    held_node: wp.array = array(wp.int32)  # of clamps that do not slide
    held_lever_x: wp.array = array(wp.float64)
    held_lever_y: wp.array = array(wp.float64)
    held_clamp: wp.array = array(wp.int32)
    contact_node: wp.array = array(wp.int32)  # [body] node that a single contact point sits on; empty in other treatments
    slide_node: wp.array = array(wp.int32)  # [sliding clamp] first of its two nodes
    slide_block: wp.array = array(wp.int32)
    slide_lever_x: wp.array = array(wp.float64)  # [sliding clamp, 2] [m]
    slide_lever_y: wp.array = array(wp.float64)


def upload_rest(table: Table, precision: Precision, numerics: Numerics, bending_stiffness: float, device: str) -> RestArrays:
    """The rest data of a table with the masses of the run; `bending_stiffness` [N m2]."""
    assert table.curve.shape[1] == CURVE_COEFFICIENTS
    values = {name: getattr(table, name) for name in names_of(RestArrays, "node") if hasattr(table, name)} | {
        "place_x": table.x,
        "place_y": table.y,
        "table_x": precision.counts(table.x),
        "table_y": precision.counts(table.y),
        "inverse_length": 1.0 / table.rest_length,
        "hinge_stiffness": bending_stiffness / table.hinge_length,
        "inverse_mass": np.broadcast_to(1.0 / numerics.node_mass, table.rest_length.shape),
        "node_mass": np.broadcast_to(numerics.node_mass, table.rest_length.shape),
    }
    return new_arrays(RestArrays, device, {}, values, precision)


def upload_mesh(panel: Panel, strip: Strip | None, precision: Precision, device: str, treatment: Treatment) -> MeshArrays:
    """Index arrays of a panel, or of the strip of a rank."""
    pair_rest = np.repeat(panel.body_rest, 2, axis=0) - panel.pair_shift
    body_origin = panel.body_rest + panel.body_origin
    # in the order of the global mesh, so that contact forces are summed in the same order
    body = np.arange(panel.body_count) if strip is None else strip.body
    pair_start, pair = _pairs_of_blocks(panel, (2 * body[:, None] + np.arange(2)).ravel())
    slides = np.isin(panel.held_clamp, panel.sliding_clamp)
    held_node, held_lever = panel.held_node[~slides], panel.held_lever[~slides]
    held_start = np.searchsorted(held_node, np.append(panel.block_first, panel.node_count))
    slide_node, slide_lever = panel.held_node[slides][::2], panel.held_lever[slides].reshape(-1, 2, 2)
    slide_block = np.searchsorted(panel.block_first, slide_node)
    assert np.array_equal(panel.block_first[slide_block], slide_node) and np.all(panel.block_count[slide_block] == 2)
    values = {name: getattr(panel, name) for name in names_of(MeshArrays, "node") if hasattr(panel, name)} | {
        **_columns("block_origin", panel.block_origin),
        "block_pair_start": pair_start,
        "block_pair": pair,
        "block_held_start": held_start,
        "wire_clamp": panel.wire_clamp.reshape(len(panel.wire_first), -1),
        **_columns("pair_rest", precision.counts(pair_rest)),
        **_columns("body_origin", body_origin),
        "held_node": held_node,
        **_columns("held_lever", held_lever),
        "held_clamp": panel.held_clamp[~slides],
        "contact_node": panel.pair_seed[::2] if treatment.contact_node is not None else np.zeros(0),
        "slide_node": slide_node,
        "slide_block": slide_block,
        **_columns("slide_lever", slide_lever),
    }
    return new_arrays(MeshArrays, device, {}, {name: np.ascontiguousarray(value) for name, value in values.items()}, precision)


def _columns(name: str, values: np.ndarray) -> dict[str, np.ndarray]:
    """Values (..., 2) by the names of their columns."""
    return {f"{name}_x": values[..., 0], f"{name}_y": values[..., 1]}


def _pairs_of_blocks(panel: Panel, number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs that may act on each block's nodes, in the order of `number`: starts (block + 1,) and pairs.

    A pair acts on the nodes from one before its first segment to two behind the start of its last; on a closed wire the
    range wraps around, so three copies of the wire are used and clipped.
    """
    low = panel.pair_seed + panel.pair_low - 1
    high = panel.pair_seed + panel.pair_high + 2
    count = panel.wire_count[panel.pair_wire]
    first = panel.wire_first[panel.pair_wire]
    blocks, pairs = [], []
    for turn in (-1, 0, 1):
        a = np.maximum(low + turn * count, first)
        b = np.minimum(high + turn * count, first + count - 1)
        if turn != 0:
            a = np.where(panel.wire_closed[panel.pair_wire], a, b + 1)
        there = np.nonzero((a <= b) & (panel.pair_wire >= 0))[0]
        block_a = np.searchsorted(panel.block_first, a[there], side="right") - 1
        block_b = np.searchsorted(panel.block_first, b[there], side="right") - 1
        spans = block_b - block_a + 1
        blocks.append(np.repeat(block_a, spans) + np.arange(spans.sum()) - np.repeat(np.cumsum(spans) - spans, spans))
        pairs.append(np.repeat(there, spans))
    block, pair = np.concatenate(blocks), np.concatenate(pairs)
    span = int(number.max(initial=0)) + 1
    key = np.unique(block.astype(np.int64) * span + number[pair])
    block, place = np.divmod(key, span)
    order = np.argsort(number)
    return np.searchsorted(block, np.arange(len(panel.block_first) + 1)), order[np.searchsorted(number[order], place)]
