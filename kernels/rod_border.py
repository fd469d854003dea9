"""Border of a rank: all that contact reads of nodes, sent and received.

The values of a node stand side by side in a buffer, BORDER_VALUES of them from its place on; so does the travel of a block of
nodes (wire_travel.py).
"""

from typing import Any

import warp as wp

BORDER_VALUES = 21


@wp.func
def copied(collects: int, values: wp.array(dtype=wp.float64), place: int, vector: wp.vec3d) -> wp.vec3d:
    """The vector, which goes to its place in the buffer, or what stands there."""
    if collects != 0:
        for k in range(3):
            values[place + k] = vector[k]
        return vector
    return wp.vec3d(values[place], values[place + 1], values[place + 2])


@wp.kernel
def copy_nodes(
    # in: 1 to collect, 0 to distribute; nodes, and where the values of each begin
    collects: int,
    border_node: wp.array(dtype=wp.int32),
    border_place: wp.array(dtype=wp.int32),
    # in and out: taken or given
    values: wp.array(dtype=wp.float64),
    # in and out: given or taken
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
    displacement[i] = copied(collects, values, place, displacement[i])
    position[i] = copied(collects, values, place + 3, position[i])
    velocity[i] = velocity.dtype(copied(collects, values, place + 6, wp.vec3d(velocity[i])))
    tangent[i] = tangent.dtype(copied(collects, values, place + 9, wp.vec3d(tangent[i])))
    director[i] = director.dtype(copied(collects, values, place + 12, wp.vec3d(director[i])))
    turns = copied(collects, values, place + 15, wp.vec3d(wp.float64(pending_turn[i]), wp.float64(spin[i]), length[i]))
    pending_turn[i] = pending_turn.dtype(turns[0])
    spin[i] = spin.dtype(turns[1])
    length[i] = turns[2]
    contact = copied(collects, values, place + 18, wp.vec3d(contact_penalty[i], contact_offset[i], wp.float64(0.0)))
    contact_penalty[i] = contact[0]
    contact_offset[i] = contact[1]


@wp.kernel
def copy_travel(
    # in: 1 to collect, 0 to distribute; blocks, and where the travel of each stands
    collects: int,
    border_block: wp.array(dtype=wp.int32),
    block_place: wp.array(dtype=wp.int32),
    # in and out: taken or given
    values: wp.array(dtype=wp.float64),
    # in and out: [m], given or taken
    block_travel: wp.array(dtype=wp.float64),
):
    """A thread a block."""
    k = wp.tid()
    if collects != 0:
        values[block_place[k]] = block_travel[border_block[k]]
    else:
        block_travel[border_block[k]] = values[block_place[k]]
