"""Contact of bodies with the smooth curves of wires on the CPU: PAIR_BATCH pairs at a time (see contact.py for the equations).

The algorithm is `find_contact_forces`. Table values of a pair change only when its contact point slides to another segment; they
are cached in batches as structures of arrays, and `cached_slide` holds the segment. The curve is evaluated for a batch by loops
that the CPU compiler vectorises, until all closest points are found. It is C++ because loops of a Warp kernel do not vectorise on
the CPU. The result of a pair does not depend on its batch.
"""

from typing import Any

import warp as wp

from . import contact
from .control import STATUS, STATUS_RUNNING
from .native_text import native_text

PAIR_BATCH = wp.constant(16)  # pairs
UNCACHED_PAIRS = 30_000  # pairs whose data, 300 bytes each, are beyond the cache
CACHED_NODES = 4  # indices a pair: the nodes whose place the curve depends on
CACHED_NUMBERS = 20  # numbers a pair: three rest edges, place of the body from the first node, coefficients of the curve

UNCACHED = -(2**30)  # in cached_slide: nothing is kept yet


@wp.func_native(native_text("contact_of_batch", globals(), vars(contact)))
def contact_of_batch(
    # in: what steers the step
    batch: wp.int32,
    control: wp.array(dtype=wp.float64),
    unit: Any,
    reach_at_rest: Any,
    # in: rest data of one repeat
    table_x: wp.array(dtype=Any),
    table_y: wp.array(dtype=Any),
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    curve: wp.array2d(dtype=Any),
    # in: pairs
    pair_wire: wp.array(dtype=wp.int32),
    pair_seed: wp.array(dtype=wp.int32),
    pair_table: wp.array(dtype=wp.int32),
    pair_low: wp.array(dtype=wp.int32),
    pair_high: wp.array(dtype=wp.int32),
    pair_side: wp.array(dtype=wp.int32),
    pair_rest_x: wp.array(dtype=Any),
    pair_rest_y: wp.array(dtype=Any),
    pair_wake: wp.array(dtype=Any),
    pair_offset: wp.array(dtype=Any),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    # state in
    ux: wp.array(dtype=Any),
    uy: wp.array(dtype=Any),
    body_ux: wp.array(dtype=Any),
    body_uy: wp.array(dtype=Any),
    # state in and out
    pair_slide: wp.array(dtype=wp.int32),
    pair_u: wp.array(dtype=Any),
    cached_slide: wp.array(dtype=wp.int32),
    cached_node: wp.array(dtype=wp.int32),
    cached_number: wp.array(dtype=Any),
    # out
    pair_node: wp.array(dtype=wp.int32),
    pair_gap: wp.array(dtype=Any),
    pair_force: wp.array(dtype=Any),
    pair_body_x: wp.array(dtype=Any),
    pair_body_y: wp.array(dtype=Any),
    pair_nodal_x: wp.array(dtype=Any),
    pair_nodal_y: wp.array(dtype=Any),
): ...


@wp.kernel
def find_contact_forces_by_batch(
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    unit: Any,
    reach_at_rest: Any,
    first_batch: int,
    # in: rest data of one repeat
    table_x: wp.array(dtype=Any),
    table_y: wp.array(dtype=Any),
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    curve: wp.array2d(dtype=Any),
    # in: pairs
    pair_wire: wp.array(dtype=wp.int32),
    pair_seed: wp.array(dtype=wp.int32),
    pair_table: wp.array(dtype=wp.int32),
    pair_low: wp.array(dtype=wp.int32),
    pair_high: wp.array(dtype=wp.int32),
    pair_side: wp.array(dtype=wp.int32),
    pair_rest_x: wp.array(dtype=Any),
    pair_rest_y: wp.array(dtype=Any),
    pair_wake: wp.array(dtype=Any),
    pair_offset: wp.array(dtype=Any),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    # state in
    ux: wp.array(dtype=Any),
    uy: wp.array(dtype=Any),
    body_ux: wp.array(dtype=Any),
    body_uy: wp.array(dtype=Any),
    # state in and out
    pair_slide: wp.array(dtype=wp.int32),
    pair_u: wp.array(dtype=Any),
    cached_slide: wp.array(dtype=wp.int32),
    cached_node: wp.array(dtype=wp.int32),
    cached_number: wp.array(dtype=Any),
    # out
    pair_node: wp.array(dtype=wp.int32),
    pair_gap: wp.array(dtype=Any),
    pair_force: wp.array(dtype=Any),
    pair_body_x: wp.array(dtype=Any),
    pair_body_y: wp.array(dtype=Any),
    pair_nodal_x: wp.array(dtype=Any),
    pair_nodal_y: wp.array(dtype=Any),
):
    """A batch a thread, from `first_batch` on."""
    if control[STATUS] != STATUS_RUNNING:
        return
    contact_of_batch(
        first_batch + wp.tid(), control, unit, reach_at_rest, table_x, table_y, rest_x, rest_y, curve, pair_wire, pair_seed,
        pair_table, pair_low, pair_high, pair_side, pair_rest_x, pair_rest_y, pair_wake, pair_offset, wire_first, wire_count,
        wire_closed, ux, uy, body_ux, body_uy, pair_slide, pair_u, cached_slide, cached_node, cached_number, pair_node, pair_gap,
        pair_force, pair_body_x, pair_body_y, pair_nodal_x, pair_nodal_y,
    )  # fmt: skip
