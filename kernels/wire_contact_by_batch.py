"""Contacts that go on from the step before: CPU_LANES pairs at a time on a CPU, a pair by QUAD threads on a GPU (native/lanes.h).

Most pairs have one closest point, or two with a saddle between them, close to where they were a step before. Newton's method
follows them, and their forces are found. wire_closest.py and wire_contact_forces.py have the equations, and the kernels for all
other pairs: friction on a GPU, in real time, of an accepted equilibrium or of a new contact; a pair without a known place, one
whose search is due, whose place is ill-conditioned or moves far, or that may have another place beyond a saddle.

The result of a pair does not depend on the others of its batch.
"""

from typing import Any

import warp as wp

from . import rod_blocks, wire_closest, wire_curve, wire_minima, wire_pairs, wire_weights
from .control import is_halted
from .native_text import native_text
from .wire_curve import Bump
from .wire_near import first_of_share

CPU_LANES = 4  # numbers of a vector of a CPU; with eight they do not fit the registers of AVX2
QUAD = 4  # threads of a pair on a GPU
QUADS_A_BLOCK = 32  # of a CUDA block

_MODULES = (rod_blocks, wire_closest, wire_curve, wire_minima, wire_pairs, wire_weights)


@wp.func_native(native_text("follow_contacts", globals(), *map(vars, _MODULES)))
def follow_contacts(
    lane: wp.int32,
    begin: int,
    end: int,
    stride: int,
    # in: the pairs that may touch, the ones to look at, and all pairs
    touch_pair: wp.array(dtype=wp.int32),
    touch_count: wp.array(dtype=wp.int32),
    touch_awake: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    pair_arc_separation: wp.array(dtype=wp.float64),
    pair_renewal_travel: wp.array(dtype=wp.float64),
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    node_radius: wp.array(dtype=wp.float64),
    rest_row: wp.array(dtype=wp.int32),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=Bump),
    slope_weight: wp.array(dtype=wp.vec4d),
    contact_penalty: wp.array(dtype=wp.float64),
    contact_offset: wp.array(dtype=wp.float64),
    node_block: wp.array(dtype=wp.int32),
    block_rest: wp.array(dtype=wp.int32),
    # in: what steers the step; [m] travel of blocks
    control: wp.array(dtype=wp.float64),
    block_travel: wp.array(dtype=wp.float64),
    min_arc_separation: wp.float64,
    # state in
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    # in: the equilibrium before, of a relaxation with friction
    before_position: wp.array(dtype=wp.vec3d),
    before_length: wp.array(dtype=wp.float64),
    before_tangent: wp.array(dtype=Any),
    before_director: wp.array(dtype=Any),
    before_control: wp.array(dtype=wp.float64),
    stick_share: wp.float64,
    # in and out: elastic slips, see find_contact_forces
    slip_step: wp.array2d(dtype=wp.int32),
    slip_place: wp.array2d(dtype=wp.vec2),
    elastic_slip: wp.array2d(dtype=wp.vec3),
    # in and out: see find_closest_places
    pair_wake_travel: wp.array(dtype=wp.float64),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    # out: pairs that other kernels complete, places or forces alone, in any order, where they are listed
    touch_is_listed: int,
    touch_left: wp.array(dtype=wp.int32),
    touch_left_count: wp.array(dtype=wp.int32),
    touch_found: wp.array(dtype=wp.int32),
    touch_found_count: wp.array(dtype=wp.int32),
    # out: what is done of a pair; the rest as in find_contact_forces
    touch_followed: wp.array(dtype=wp.int32),
    touch_overlap: wp.array(dtype=wp.float64),
    touch_normal_force: wp.array(dtype=wp.float64),
    touch_friction: wp.array(dtype=wp.vec3d),
    touch_normal: wp.array(dtype=wp.vec3d),
    touch_loaded: wp.array(dtype=wp.int32),
    touch_force: wp.array(dtype=Any),
    touch_couple: wp.array(dtype=Any),
    # in and out: [m] largest overlap of a thread
    max_penetration: wp.array(dtype=wp.float64),
): ...


@wp.kernel(launch_bounds=(QUAD * QUADS_A_BLOCK, 3))
def find_followed_contacts(
    # in: the pairs that may touch, the ones to look at, and all pairs
    touch_first_start: wp.array(dtype=wp.int32),
    first_node: int,
    end_node: int,
    part: int,
    parts: int,
    threads: int,
    threads_a_block: int,
    touch_pair: wp.array(dtype=wp.int32),
    touch_count: wp.array(dtype=wp.int32),
    touch_awake: wp.array(dtype=wp.int32),
    touch_awake_count: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    pair_arc_separation: wp.array(dtype=wp.float64),
    pair_renewal_travel: wp.array(dtype=wp.float64),
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    node_radius: wp.array(dtype=wp.float64),
    rest_row: wp.array(dtype=wp.int32),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=Bump),
    slope_weight: wp.array(dtype=wp.vec4d),
    contact_penalty: wp.array(dtype=wp.float64),
    contact_offset: wp.array(dtype=wp.float64),
    node_block: wp.array(dtype=wp.int32),
    block_rest: wp.array(dtype=wp.int32),
    # in: what steers the step; [m] travel of blocks
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    block_travel: wp.array(dtype=wp.float64),
    min_arc_separation: wp.float64,
    # state in
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    # in: the equilibrium before, of a relaxation with friction
    before_position: wp.array(dtype=wp.vec3d),
    before_length: wp.array(dtype=wp.float64),
    before_tangent: wp.array(dtype=Any),
    before_director: wp.array(dtype=Any),
    before_control: wp.array2d(dtype=wp.float64),
    stick_share: wp.float64,
    # in and out: elastic slips, see find_contact_forces
    slip_step: wp.array2d(dtype=wp.int32),
    slip_place: wp.array2d(dtype=wp.vec2),
    elastic_slip: wp.array2d(dtype=wp.vec3),
    # in and out: see find_closest_places
    pair_wake_travel: wp.array(dtype=wp.float64),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    # out: pairs that other kernels complete, places or forces alone, in any order, where they are listed
    touch_is_listed: int,
    touch_left: wp.array(dtype=wp.int32),
    touch_left_count: wp.array(dtype=wp.int32),
    touch_found: wp.array(dtype=wp.int32),
    touch_found_count: wp.array(dtype=wp.int32),
    # out: what is done of a pair; the rest as in find_contact_forces
    touch_followed: wp.array(dtype=wp.int32),
    touch_overlap: wp.array(dtype=wp.float64),
    touch_normal_force: wp.array(dtype=wp.float64),
    touch_friction: wp.array(dtype=wp.vec3d),
    touch_normal: wp.array(dtype=wp.vec3d),
    touch_loaded: wp.array(dtype=wp.int32),
    touch_force: wp.array(dtype=Any),
    touch_couple: wp.array(dtype=Any),
    # in and out: [m] largest overlap of a thread
    max_penetration: wp.array2d(dtype=wp.float64),
):
    """Follow the contacts of a part's pairs: a thread a pair, or QUAD of `threads_a_block` threads on a GPU. Other kernels skip
    pairs in `touch_followed`, or find their forces alone.
    """
    a_pair = wp.min(threads_a_block, QUAD)
    k = first_of_share(touch_is_listed, touch_awake_count, touch_first_start, first_node, end_node, part, parts)
    k += wp.tid() / a_pair
    end = first_of_share(touch_is_listed, touch_awake_count, touch_first_start, first_node, end_node, part + 1, parts)
    while k < end:  # pairs of one world after another's; of a list one by one
        world = pair_first[touch_pair[touch_awake[k]]] / world_nodes
        own = control[world]
        first = k
        behind = wp.min(end, touch_first_start[(world + 1) * world_nodes])
        k = behind
        if touch_is_listed != 0:
            behind = first + 1
            k = first + threads / a_pair
        if is_halted(own):
            continue
        follow_contacts(
            wp.tid() % a_pair, first, behind, 1, touch_pair, touch_count, touch_awake, pair_first, pair_second, pair_shift,
            pair_arc_separation, pair_renewal_travel, previous, following, natural_length, node_radius, rest_row, rest_slope,
            rest_bump, slope_weight, contact_penalty, contact_offset, node_block, block_rest, own, block_travel,
            min_arc_separation, position, length, tangent, director, before_position, before_length, before_tangent,
            before_director, before_control[world], stick_share, slip_step, slip_place, elastic_slip, pair_wake_travel,
            pair_found, pair_place, touch_is_listed, touch_left, touch_left_count, touch_found, touch_found_count, touch_followed,
            touch_overlap, touch_normal_force, touch_friction, touch_normal, touch_loaded, touch_force, touch_couple,
            max_penetration[part + world],
        )  # fmt: skip
