"""Constant device arrays: rest data of one repeat and indices of the mesh, in the precision of the run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..compute.precision import Precision
from ..kernels.contact import CURVE_COEFFICIENTS
from ..mesh.hook_mesh import Treatment
from ..mesh.panel import Panel
from ..mesh.rest_table import Table
from ..mesh.strip import Strip
from .numerics import Numerics


@dataclass(frozen=True)
class RestArrays:
    """Rest data of one repeat on the device; [entry], see table.py."""

    place_x: wp.array  # [m] float64, for the neighbour search
    place_y: wp.array
    table_x: wp.array  # [counts], wrapped around
    table_y: wp.array
    rest_x: wp.array  # [m]
    rest_y: wp.array
    rest_length: wp.array  # [m]
    inverse_length: wp.array  # [1/m]
    rest_bow: wp.array  # [-] share by which the arc is longer
    rest_angle: wp.array  # [rad]
    hinge_stiffness: wp.array  # [N m] EI over the length that belongs to the node
    inverse_mass: wp.array  # [1/kg]
    node_mass: wp.array  # [kg]
    curve: wp.array  # [entry, CURVE_COEFFICIENTS] [-]


@dataclass(frozen=True)
class MeshArrays:
    """Index arrays of the mesh on the device; see panel.py for their meaning."""

    block_first: wp.array
    block_count: wp.array
    block_table: wp.array
    block_wire: wp.array
    block_origin_x: wp.array
    block_origin_y: wp.array
    block_pair_start: wp.array  # [block + 1] where the pairs that may touch the block stand in `block_pair`
    block_pair: wp.array
    block_held_start: wp.array  # [block + 1] into held_node
    wire_first: wp.array
    wire_count: wp.array
    wire_closed: wp.array
    wire_clamp: wp.array  # [wire, 2 CLAMP_NUMBERS]
    pair_wire: wp.array
    pair_seed: wp.array
    pair_table: wp.array
    pair_low: wp.array
    pair_high: wp.array
    pair_side: wp.array
    pair_rest_x: wp.array  # [counts] body in the frame of the table
    pair_rest_y: wp.array
    body_origin_x: wp.array  # [m] body at rest
    body_origin_y: wp.array
    held_node: wp.array  # of clamps that do not slide
    held_lever_x: wp.array
    held_lever_y: wp.array
    held_clamp: wp.array
    contact_node: wp.array  # [body] node that a single contact point sits on; empty in other treatments
    slide_node: wp.array  # [sliding clamp] first of its two nodes
    slide_block: wp.array
    slide_lever_x: wp.array  # [sliding clamp, 2] [m]
    slide_lever_y: wp.array


def upload_rest(table: Table, precision: Precision, numerics: Numerics, bending_stiffness: float, device: str) -> RestArrays:
    """The rest data of a table with the masses of the run; `bending_stiffness` [N m2]."""

    def real(a: np.ndarray) -> wp.array:
        return wp.array(a, dtype=precision.real, device=device)

    def counts(a: np.ndarray) -> wp.array:
        return wp.array(precision.counts(a), dtype=precision.coordinate, device=device)

    assert table.curve.shape[1] == CURVE_COEFFICIENTS
    return RestArrays(
        place_x=wp.array(table.x, dtype=wp.float64, device=device),
        place_y=wp.array(table.y, dtype=wp.float64, device=device),
        table_x=counts(table.x),
        table_y=counts(table.y),
        rest_x=real(table.rest_x),
        rest_y=real(table.rest_y),
        rest_length=real(table.rest_length),
        inverse_length=real(1.0 / table.rest_length),
        rest_bow=real(table.rest_bow),
        rest_angle=real(table.rest_angle),
        hinge_stiffness=real(bending_stiffness / table.hinge_length),
        inverse_mass=real(1.0 / numerics.node_mass),
        node_mass=real(np.broadcast_to(numerics.node_mass, table.rest_length.shape)),
        curve=wp.array(table.curve, dtype=precision.real, device=device),
    )


def upload_mesh(panel: Panel, strip: Strip | None, precision: Precision, device: str, treatment: Treatment) -> MeshArrays:
    """Index arrays of a panel, or of the strip of a rank."""

    def index(a: np.ndarray) -> wp.array:
        return wp.array(np.ascontiguousarray(a, dtype=np.int32), dtype=wp.int32, device=device)

    def double(a: np.ndarray) -> wp.array:
        return wp.array(np.ascontiguousarray(a, dtype=np.float64), dtype=wp.float64, device=device)

    def counts(a: np.ndarray) -> wp.array:
        return wp.array(precision.counts(a), dtype=precision.coordinate, device=device)

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
    return MeshArrays(
        block_first=index(panel.block_first),
        block_count=index(panel.block_count),
        block_table=index(panel.block_table),
        block_wire=index(panel.block_wire),
        block_origin_x=double(panel.block_origin[:, 0]),
        block_origin_y=double(panel.block_origin[:, 1]),
        block_pair_start=index(pair_start),
        block_pair=index(pair),
        block_held_start=index(held_start),
        wire_first=index(panel.wire_first),
        wire_count=index(panel.wire_count),
        wire_closed=index(panel.wire_closed),
        wire_clamp=wp.array(panel.wire_clamp.reshape(len(panel.wire_first), -1), dtype=precision.real, device=device),
        pair_wire=index(panel.pair_wire),
        pair_seed=index(panel.pair_seed),
        pair_table=index(panel.pair_table),
        pair_low=index(panel.pair_low),
        pair_high=index(panel.pair_high),
        pair_side=index(panel.pair_side),
        pair_rest_x=counts(pair_rest[:, 0]),
        pair_rest_y=counts(pair_rest[:, 1]),
        body_origin_x=double(body_origin[:, 0]),
        body_origin_y=double(body_origin[:, 1]),
        held_node=index(held_node),
        held_lever_x=double(held_lever[:, 0]),
        held_lever_y=double(held_lever[:, 1]),
        held_clamp=index(panel.held_clamp[~slides]),
        contact_node=index(panel.pair_seed[::2] if treatment.contact_node is not None else np.zeros(0)),
        slide_node=index(slide_node),
        slide_block=index(slide_block),
        slide_lever_x=double(slide_lever[..., 0]),
        slide_lever_y=double(slide_lever[..., 1]),
    )


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
