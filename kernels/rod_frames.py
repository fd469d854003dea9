"""Kinematics of rods: edges, tangents, and the directors of the sections.

A rod is a chain of nodes with a section on each segment. One director a segment, normal to the tangent, gives the rotation of the
section. When a segment tilts from tangent t to t', its director is transported without rotation about the tangent (parallel
transport in time; Bergou, Audoly, Vouga, Wardetzky and Grinspun 2010, "Discrete viscous threads"),

    d' = c d + b x d + b (b . d)/(1 + c)        b = t x t',  c = t . t'

and then rotated by the spin of the segment. The director stores the twist, so no angle is measured against a frame that could
jump.

Positions are x = F X + u; F acts only on in-plane components. The last node of an open wire has no segment.
"""

from typing import Any

import warp as wp

from . import rod_blocks
from .control import FRAMES_AHEAD, GRADIENT, STATUS, STATUS_RUNNING, is_at_rest, is_halted
from .native_text import native_text
from .rod_blocks import RESTS

# when the frames are computed: always; before a step, unless the step before has done so; behind a step, for the next one, where
# nothing else moves nodes until then
ALWAYS = wp.constant(0)
UNLESS_AHEAD = wp.constant(1)
AHEAD = wp.constant(2)


@wp.func
def affine_map(vector: wp.vec3d, control: wp.array(dtype=wp.float64)) -> wp.vec3d:
    """F times a rest vector; the deformation gradient F acts on in-plane components."""
    return wp.vec3d(
        control[GRADIENT] * vector[0] + control[GRADIENT + 1] * vector[1],
        control[GRADIENT + 2] * vector[0] + control[GRADIENT + 3] * vector[1],
        vector[2],
    )


@wp.func_native(native_text("rod_frames", vars(rod_blocks)))
def frames_of_block(
    # in: blocks and wires
    block: wp.int32,
    lane: wp.int32,
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    rest_position: wp.array(dtype=wp.vec3d),
    rest_edge: wp.array(dtype=wp.vec3d),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    # state in
    displacement: wp.array(dtype=wp.vec3d),
    # in and out: the pending rotation [rad] is applied and set to zero
    pending_turn: wp.array(dtype=Any),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    # out
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
): ...


@wp.kernel
def update_frames(
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    rest_row: wp.array(dtype=wp.int32),
    first_block: int,
    threads_a_block: int,
    when: int,
    block_rest: wp.array(dtype=wp.int32),
    rest_position: wp.array(dtype=wp.vec3d),
    rest_edge: wp.array(dtype=wp.vec3d),
    # in: what steers the step
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    # state in
    displacement: wp.array(dtype=wp.vec3d),
    # in and out: the pending rotation [rad] is applied and set to zero
    pending_turn: wp.array(dtype=Any),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    # out
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
):
    """`threads_a_block` threads a block: one, or ROD_LANES on a GPU. `rest_edge` may cross the border of a periodic tile."""
    thread = wp.tid()
    block = first_block + thread / threads_a_block
    own = control[block_first[block] / world_nodes]
    if (when == UNLESS_AHEAD and own[FRAMES_AHEAD] != wp.float64(0.0)) or (when == AHEAD and not is_at_rest(own)):
        return
    if not is_halted(own) and not (own[STATUS] == STATUS_RUNNING and block_rest[block] == RESTS):
        frames_of_block(
            block, thread % threads_a_block, block_first, block_count, block_wire, wire_first, wire_count, wire_closed, rest_row,
            rest_position, rest_edge, own, displacement, pending_turn, tangent, director, position, length,
        )  # fmt: skip
