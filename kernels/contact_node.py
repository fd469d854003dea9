"""A single contact point: a node of the first wire of each body against the second wire, its target.

The body has no mass of its own but follows its node. The force of the pair with the target acts on that node, through the other
pair of the body, which has no contact search. Beyond the end of the target, or deeper behind it than `pinball`, the contact
is lost: the pair carries no force.
"""

import warp as wp

from .control import STATUS, STATUS_RUNNING


@wp.kernel
def apply_contact_force(
    # in
    control: wp.array(dtype=wp.float64),
    pinball: wp.float64,
    contact_node: wp.array(dtype=wp.int32),
    pair_low: wp.array(dtype=wp.int32),
    pair_high: wp.array(dtype=wp.int32),
    pair_slide: wp.array(dtype=wp.int32),
    pair_u: wp.array(dtype=wp.float64),
    # in and out
    pair_gap: wp.array(dtype=wp.float64),
    pair_force: wp.array(dtype=wp.float64),
    pair_body_x: wp.array(dtype=wp.float64),
    pair_body_y: wp.array(dtype=wp.float64),
    # out
    pair_node: wp.array(dtype=wp.int32),
    pair_nodal_x: wp.array(dtype=wp.float64),
    pair_nodal_y: wp.array(dtype=wp.float64),
):
    """Apply the force of pair 2b + 1 on body b through pair 2b."""
    body = wp.tid()
    if control[STATUS] != STATUS_RUNNING:
        return
    own = 2 * body
    target = own + 1
    edge = wp.float64(1.0e-6)
    off = pair_slide[target] <= pair_low[target] and pair_u[target] < edge
    off = off or (pair_slide[target] >= pair_high[target] and pair_u[target] > wp.float64(1.0) - edge)
    if off or pair_gap[target] < -pinball:
        pair_force[target] = wp.float64(0.0)
    force = pair_force[target]
    pair_force[own] = force
    pair_gap[own] = pair_gap[target]
    pair_node[own] = contact_node[body]
    if force == wp.float64(0.0):
        return
    pair_body_x[own] = -pair_body_x[target]
    pair_body_y[own] = -pair_body_y[target]
    for k in range(4):
        pair_nodal_x[4 * own + k] = wp.float64(0.0)
        pair_nodal_y[4 * own + k] = wp.float64(0.0)
    pair_nodal_x[4 * own + 1] = pair_body_x[target]
    pair_nodal_y[4 * own + 1] = pair_body_y[target]


@wp.kernel
def follow_contact_node(
    # in
    control: wp.array(dtype=wp.float64),
    contact_node: wp.array(dtype=wp.int32),
    node_ux: wp.array(dtype=wp.float64),
    node_uy: wp.array(dtype=wp.float64),
    # out
    body_ux: wp.array(dtype=wp.float64),
    body_uy: wp.array(dtype=wp.float64),
):
    """Bodies rest where their nodes do, so their displacements are the same."""
    body = wp.tid()
    if control[STATUS] != STATUS_RUNNING:
        return
    body_ux[body] = node_ux[contact_node[body]]
    body_uy[body] = node_uy[contact_node[body]]
