"""What a rank tells others of the wires that they may touch, and takes over of theirs: all that contact reads of a node.

The values of a node stand side by side in a buffer, BORDER_VALUES of them from its place on; so does the travel of a block of
nodes (wire_travel.py).
"""

from typing import Any

import warp as wp

BORDER_VALUES = 20


@wp.func
def put(values: wp.array(dtype=wp.float64), place: int, vector: wp.vec3d):
    values[place] = vector[0]
    values[place + 1] = vector[1]
    values[place + 2] = vector[2]


@wp.func
def take(values: wp.array(dtype=wp.float64), place: int) -> wp.vec3d:
    return wp.vec3d(values[place], values[place + 1], values[place + 2])


@wp.kernel
def collect_nodes(
    # in: nodes, and where the values of each begin
    border_node: wp.array(dtype=wp.int32),
    border_place: wp.array(dtype=wp.int32),
    # in
    displacement: wp.array(dtype=wp.vec3d),
    position: wp.array(dtype=wp.vec3d),
    velocity: wp.array(dtype=Any),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    pending_turn: wp.array(dtype=Any),
    spin: wp.array(dtype=Any),
    length: wp.array(dtype=wp.float64),
    contact_penalty: wp.array(dtype=wp.float64),
    contact_offset: wp.array(dtype=wp.float64),
    # out
    values: wp.array(dtype=wp.float64),
):
    """A thread a node."""
    k = wp.tid()
    i = border_node[k]
    place = border_place[k]
    put(values, place, displacement[i])
    put(values, place + 3, position[i])
    put(values, place + 6, wp.vec3d(velocity[i]))
    put(values, place + 9, wp.vec3d(tangent[i]))
    put(values, place + 12, wp.vec3d(director[i]))
    values[place + 15] = wp.float64(pending_turn[i])
    values[place + 16] = wp.float64(spin[i])
    values[place + 17] = length[i]
    values[place + 18] = contact_penalty[i]
    values[place + 19] = contact_offset[i]


@wp.kernel
def distribute_nodes(
    # in: nodes, and where the values of each begin
    border_node: wp.array(dtype=wp.int32),
    border_place: wp.array(dtype=wp.int32),
    values: wp.array(dtype=wp.float64),
    # out
    displacement: wp.array(dtype=wp.vec3d),
    position: wp.array(dtype=wp.vec3d),
    velocity: wp.array(dtype=Any),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    pending_turn: wp.array(dtype=Any),
    spin: wp.array(dtype=Any),
    length: wp.array(dtype=wp.float64),
    contact_penalty: wp.array(dtype=wp.float64),
    contact_offset: wp.array(dtype=wp.float64),
):
    """A thread a node."""
    k = wp.tid()
    i = border_node[k]
    place = border_place[k]
    displacement[i] = take(values, place)
    position[i] = take(values, place + 3)
    velocity[i] = velocity.dtype(take(values, place + 6))
    tangent[i] = tangent.dtype(take(values, place + 9))
    director[i] = director.dtype(take(values, place + 12))
    pending_turn[i] = pending_turn.dtype(values[place + 15])
    spin[i] = spin.dtype(values[place + 16])
    length[i] = values[place + 17]
    contact_penalty[i] = values[place + 18]
    contact_offset[i] = values[place + 19]


@wp.kernel
def collect_travel(
    # in: blocks, and where the travel of each stands
    border_block: wp.array(dtype=wp.int32),
    block_place: wp.array(dtype=wp.int32),
    # in: [m]
    block_travel: wp.array(dtype=wp.float64),
    # out
    values: wp.array(dtype=wp.float64),
):
    """A thread a block."""
    k = wp.tid()
    values[block_place[k]] = block_travel[border_block[k]]


@wp.kernel
def distribute_travel(
    # in: blocks, and where the travel of each stands
    border_block: wp.array(dtype=wp.int32),
    block_place: wp.array(dtype=wp.int32),
    values: wp.array(dtype=wp.float64),
    # out: [m]
    block_travel: wp.array(dtype=wp.float64),
):
    """A thread a block."""
    k = wp.tid()
    block_travel[border_block[k]] = values[block_place[k]]
