"""Exchange between strips: contact forces on bodies that two strips share.

Each strip finds the forces of the pairs on its own wires. A shared body is there in both strips; its foreign pair gets force
and components from the other strip, three numbers a pair, so that both copies of the body take the same step.
"""

from typing import Any

import warp as wp


@wp.kernel
def collect_forces(
    # in: pairs of shared bodies on wires of this strip, and all pairs
    own_pair: wp.array(dtype=wp.int32),
    pair_force: wp.array(dtype=Any),
    pair_body_x: wp.array(dtype=Any),
    pair_body_y: wp.array(dtype=Any),
    # out: force and its components [N]
    sent: wp.array(dtype=Any),
):
    i = wp.tid()
    pair = own_pair[i]
    sent[3 * i] = pair_force[pair]
    sent[3 * i + 1] = pair_body_x[pair]
    sent[3 * i + 2] = pair_body_y[pair]


@wp.kernel
def distribute_forces(
    # in: pairs of shared bodies on wires of other strips, and what came from there
    foreign_pair: wp.array(dtype=wp.int32),
    received: wp.array(dtype=Any),
    # out
    pair_force: wp.array(dtype=Any),
    pair_body_x: wp.array(dtype=Any),
    pair_body_y: wp.array(dtype=Any),
):
    i = wp.tid()
    pair = foreign_pair[i]
    pair_force[pair] = received[3 * i]
    pair_body_x[pair] = received[3 * i + 1]
    pair_body_y[pair] = received[3 * i + 2]
