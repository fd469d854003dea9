"""Sums over the nodes of rods at a convergence check: one partial sum for every block of nodes, so that their order is fixed."""

from typing import Any

import warp as wp

from .control import STATUS, STATUS_WAITING


@wp.kernel
def sum_mass_products(
    # in: blocks
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    first_block: int,
    following: wp.array(dtype=wp.int32),
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    # in: fictitious masses (banded_mass.py)
    node_mass: wp.array(dtype=wp.vec3d),
    next_mass: wp.array(dtype=wp.float64),
    second_mass: wp.array(dtype=wp.float64),
    spin_inertia: wp.array(dtype=wp.float64),
    next_inertia: wp.array(dtype=wp.float64),
    # in: motions of nodes and sections, zero where held
    move: wp.array(dtype=Any),
    turn: wp.array(dtype=Any),
    # out: [block]
    partial: wp.array(dtype=wp.float64),
):
    """v . M v + w . I w of a block; couplings with nodes behind count twice."""
    block = first_block + wp.tid()
    if control[block_first[block] / world_nodes, STATUS] == STATUS_WAITING:
        return
    two = wp.float64(2.0)
    total = wp.float64(0.0)
    for lane in range(block_count[block]):
        i = block_first[block] + lane
        v = wp.vec3d(move[i])
        coupled = wp.cw_mul(node_mass[i], v)
        spun = spin_inertia[i] * wp.float64(turn[i])
        after = following[i]
        if after >= 0:
            coupled += (two * next_mass[i]) * wp.vec3d(move[after])
            spun += two * next_inertia[i] * wp.float64(turn[after])
            if following[after] >= 0:
                coupled += (two * second_mass[i]) * wp.vec3d(move[following[after]])
        total += wp.dot(v, coupled) + wp.float64(turn[i]) * spun
    partial[block] = total
