"""Convergence check of contacts between wires, and their renewal.

Each node gathers from the contacts of the four segments on whose curve it has a weight, in their order: no sum depends on the
number of threads. A contact is a place of a pair with a force, or with a gap below a distance.

Offsets and penalties (spatial/multipliers.py), with the overlaps o and forces N of the contacts that push at a node:

    mean overlap = sum w N o/sum w N        penalty k -> FORCE_PENALTY raised max N/d, within [DECAY, GROWTH] of before
    offset -> offset k_before/k + rate/2 mean overlap

Bounds on the stiffness of a node, for the masses, with the unit normal n of each contact and the penalty k (see
spatial/fictitious_masses.py): sum w total [k (|n_x| + |n_y| + |n_z|) |n_x| + sticking], with an allowance for tilt.
"""

from typing import Any

import warp as wp

from .control import LEVER, MEAN_PUSH, STATUS, STATUS_WAITING, WEIGHT_SQUARE
from .native_text import native_text
from .rod_blocks import rests
from .wire_closest import NOT_NEAR, ONE_PLACE, PLACES

# columns of the sums
PUSHING = wp.constant(0)  # contacts that push
PUSH_SUM = wp.constant(1)  # [N] their forces
ERROR_MAX = wp.constant(2)  # [m] largest |overlap|, of forces below the mean in proportion
ERROR_SQUARE = wp.constant(3)  # [m2] their squares, summed
CONTACT_COLUMNS = 4

WEIGHT_SUM = 0.25  # sum of the sizes of the weights of a wire, beyond 1, over the outer edges' in the slopes
MORE_TILT = 0.1  # allowance for the components of the normal; more between wires that do not touch
LEAST_WEIGHT, BEYOND_WEIGHT = 0.5, 0.16  # of the nodes of the segment, at least; of the nodes beyond, over their edge's

GROWTH, DECAY = 8.0, 0.5  # largest changes of a penalty at a check
WITHOUT_CONTACT = 0.5  # share of the offset that is left after a check without contact
NEIGHBOUR = 0.1  # share of a contact that counts at the two nodes beyond its segment
LEAST_SHARE = 0.3  # the same at the two nodes of its segment, at least
RAISED, MOST_RAISED = 2.0, 64.0  # factor of the penalty where overlaps stall, and the most that it comes to
PROGRESS, PATIENCE = 0.8, 8  # an overlap makes progress if it falls to this share of itself within this number of checks


@wp.func_native(native_text("bound_contact", globals()))
def contact_bound_at(
    # in: the node, and wires
    i: wp.int32,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    rest_row: wp.array(dtype=wp.int32),
    slope_weight: wp.array(dtype=wp.vec4d),
    thickness: wp.float64,
    thickest: wp.float64,
    weight_square: wp.float64,
    lever: wp.float64,
    # in: contacts, also those with a gap below EVALUATED_GAP
    control: wp.array(dtype=wp.float64),
    touch_first_start: wp.array(dtype=wp.int32),
    touch_second_start: wp.array(dtype=wp.int32),
    touch_of_second: wp.array(dtype=wp.int32),
    touch_pair: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    touch_overlap: wp.array(dtype=wp.float64),
    touch_normal_force: wp.array(dtype=wp.float64),
    touch_normal: wp.array(dtype=wp.vec3d),
    contact_penalty: wp.array(dtype=wp.float64),
) -> wp.vec4d: ...


@wp.func_native(native_text("renew_contact", globals()))
def renew_contact_at(
    # in: the node, and wires
    i: wp.int32,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    # in: contacts with a force
    touch_first_start: wp.array(dtype=wp.int32),
    touch_second_start: wp.array(dtype=wp.int32),
    touch_of_second: wp.array(dtype=wp.int32),
    touch_pair: wp.array(dtype=wp.int32),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    touch_overlap: wp.array(dtype=wp.float64),
    touch_normal_force: wp.array(dtype=wp.float64),
    # in: what steers the check; [1/m] penalty over the force; [m] allowed overlap and largest offset
    control: wp.array(dtype=wp.float64),
    force_penalty: wp.float64,
    allowed: wp.float64,
    most_offset: wp.float64,
    # in and out: factor of the penalty where overlaps have stalled, [m] overlap at the last progress, and checks since
    penalty_raised: wp.array(dtype=wp.float64),
    overlap_best: wp.array(dtype=wp.float64),
    overlap_checks: wp.array(dtype=wp.int32),
    contact_penalty: wp.array(dtype=wp.float64),
    contact_offset: wp.array(dtype=wp.float64),
): ...


@wp.kernel
def bound_contact_stiffness(
    # in: wires
    first_node: int,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    rest_row: wp.array(dtype=wp.int32),
    slope_weight: wp.array(dtype=wp.vec4d),
    thickness: wp.float64,
    thickest: wp.float64,
    # in: contacts, also those with a gap below EVALUATED_GAP
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    touch_first_start: wp.array(dtype=wp.int32),
    touch_second_start: wp.array(dtype=wp.int32),
    touch_of_second: wp.array(dtype=wp.int32),
    touch_pair: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    touch_overlap: wp.array(dtype=wp.float64),
    touch_normal_force: wp.array(dtype=wp.float64),
    touch_normal: wp.array(dtype=wp.vec3d),
    contact_penalty: wp.array(dtype=wp.float64),
    # out: of the node [N/m] along x, y, z, and of the section behind it [N m]
    sweep: wp.array(dtype=Any),
):
    """A thread a node."""
    i = first_node + wp.tid()
    own = control[i / world_nodes]
    if own[STATUS] == STATUS_WAITING:
        return
    bound = contact_bound_at(
        i, previous, following, natural_length, rest_row, slope_weight, thickness, thickest, own[WEIGHT_SQUARE], own[LEVER],
        own, touch_first_start, touch_second_start, touch_of_second, touch_pair, pair_first, pair_second, pair_found,
        pair_place, touch_overlap, touch_normal_force, touch_normal, contact_penalty,
    )  # fmt: skip
    sweep[i] = sweep.dtype(bound)


@wp.kernel
def renew_contact_offsets(
    # in: wires
    first_node: int,
    node_block: wp.array(dtype=wp.int32),
    block_rest: wp.array(dtype=wp.int32),
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    # in: contacts with a force
    touch_first_start: wp.array(dtype=wp.int32),
    touch_second_start: wp.array(dtype=wp.int32),
    touch_of_second: wp.array(dtype=wp.int32),
    touch_pair: wp.array(dtype=wp.int32),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    touch_overlap: wp.array(dtype=wp.float64),
    touch_normal_force: wp.array(dtype=wp.float64),
    # in: as above
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    force_penalty: wp.float64,
    allowed: wp.float64,
    most_offset: wp.float64,
    # in and out: as above
    penalty_raised: wp.array(dtype=wp.float64),
    overlap_best: wp.array(dtype=wp.float64),
    overlap_checks: wp.array(dtype=wp.int32),
    contact_penalty: wp.array(dtype=wp.float64),
    contact_offset: wp.array(dtype=wp.float64),
):
    """A thread a node; those at rest keep theirs."""
    i = first_node + wp.tid()
    own = control[i / world_nodes]
    if own[STATUS] == STATUS_WAITING or rests(i, node_block, block_rest):
        return
    renew_contact_at(
        i, previous, following, touch_first_start, touch_second_start, touch_of_second, touch_pair,
        pair_found, pair_place, touch_overlap, touch_normal_force, own, force_penalty, allowed,
        most_offset, penalty_raised, overlap_best, overlap_checks, contact_penalty, contact_offset,
    )  # fmt: skip


@wp.kernel
def sum_contacts(
    # in: blocks of nodes
    first_block: int,
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    # in: contacts with a force
    touch_first_start: wp.array(dtype=wp.int32),
    touch_pair: wp.array(dtype=wp.int32),
    pair_found: wp.array(dtype=wp.int32),
    touch_overlap: wp.array(dtype=wp.float64),
    touch_normal_force: wp.array(dtype=wp.float64),
    # in: mean force of those that push, if it is known
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    # out: (block, CONTACT_COLUMNS)
    contact_partial: wp.array2d(dtype=wp.float64),
):
    """A thread for the touches whose first segments are in a block."""
    block = first_block + wp.tid()
    begin = block_first[block]
    own = control[begin / world_nodes]
    if own[STATUS] == STATUS_WAITING:
        return
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    pushing = wp.float64(0.0)
    total = wp.float64(0.0)
    error = wp.float64(0.0)
    square = wp.float64(0.0)
    for touch in range(touch_first_start[begin], touch_first_start[begin + block_count[block]]):
        found = pair_found[touch_pair[touch]]
        if found > NOT_NEAR:
            for a in range(wp.where(found == ONE_PLACE, 1, PLACES)):
                push = touch_normal_force[PLACES * touch + a]
                if push > zero:
                    pushing += one
                    total += push
                    counts = wp.min(one, push / own[MEAN_PUSH]) * wp.abs(touch_overlap[PLACES * touch + a])
                    error = wp.max(error, counts)
                    square += counts * counts
    contact_partial[block, PUSHING] = pushing
    contact_partial[block, PUSH_SUM] = total
    contact_partial[block, ERROR_MAX] = error
    contact_partial[block, ERROR_SQUARE] = square
