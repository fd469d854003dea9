"""Coulomb friction between a body and its wires, with elastic slip, updated at equilibria.

The friction force of a contact point at distance s along its wire from its stick point is k s, limited to mu times the contact
force; at an equilibrium any excess of s becomes slip (`stick_contacts`). A contact that has just closed has no stick point and
no friction. Friction acts along the tangent of the wire at the contact point, on the two nodes beside it by their distance.
"""

from typing import Any

import warp as wp

from .control import CONTACT_STIFFNESS, STATUS, STATUS_RUNNING

TANGENTIAL = wp.constant(wp.float64(0.5))  # stiffness along the wire over the contact penalty
LOOSE = wp.constant(wp.float64(-1.0e30))  # a place on the wire: the contact sticks nowhere


@wp.func
def drawn_back(moved: wp.float64, stiffness: wp.float64, most: wp.float64) -> wp.float64:
    """Friction [N] along the wire on a contact point that has moved [m]."""
    return wp.clamp(-stiffness * moved, -most, most)


@wp.kernel
def add_friction(
    # in
    control: wp.array(dtype=wp.float64),
    friction: wp.float64,
    first_pair: int,
    pair_side: wp.array(dtype=wp.int32),
    pair_table: wp.array(dtype=wp.int32),
    rest_length: wp.array(dtype=Any),
    pair_stuck: wp.array(dtype=wp.float64),
    pair_slide: wp.array(dtype=wp.int32),
    pair_u: wp.array(dtype=Any),
    pair_force: wp.array(dtype=Any),
    # in and out
    pair_body_x: wp.array(dtype=Any),
    pair_body_y: wp.array(dtype=Any),
    pair_nodal_x: wp.array(dtype=Any),
    pair_nodal_y: wp.array(dtype=Any),
):
    """`pair_stuck` is in segments from the seed, as slide + u."""
    pair = first_pair + wp.tid()
    if control[STATUS] != STATUS_RUNNING:
        return
    force = pair_force[pair]
    if wp.float64(force) <= wp.float64(0.0):
        return
    if pair_stuck[pair] == LOOSE:
        return
    u = wp.float64(pair_u[pair])
    moved = (wp.float64(pair_slide[pair]) + u - pair_stuck[pair]) * wp.float64(rest_length[pair_table[pair]])
    pull = drawn_back(moved, TANGENTIAL * control[CONTACT_STIFFNESS], friction * wp.float64(force))
    # the normal force turned onto the wire
    per_force = wp.float64(pair_side[pair]) * pull / wp.float64(force)
    fx = per_force * wp.float64(pair_body_y[pair])
    fy = -per_force * wp.float64(pair_body_x[pair])
    pair_body_x[pair] = pair_body_x.dtype(wp.float64(pair_body_x[pair]) + fx)
    pair_body_y[pair] = pair_body_y.dtype(wp.float64(pair_body_y[pair]) + fy)
    for k in range(2):
        share = wp.where(k == 0, wp.float64(1.0) - u, u)
        i = 4 * pair + 1 + k
        pair_nodal_x[i] = pair_nodal_x.dtype(wp.float64(pair_nodal_x[i]) - share * fx)
        pair_nodal_y[i] = pair_nodal_y.dtype(wp.float64(pair_nodal_y[i]) - share * fy)


@wp.kernel
def stick_contacts(
    # in
    control: wp.array(dtype=wp.float64),
    friction: wp.float64,
    pair_table: wp.array(dtype=wp.int32),
    rest_length: wp.array(dtype=Any),
    pair_slide: wp.array(dtype=wp.int32),
    pair_u: wp.array(dtype=Any),
    pair_force: wp.array(dtype=Any),
    # in and out
    pair_stuck: wp.array(dtype=wp.float64),
    # out
    slipped: wp.array(dtype=wp.float64),
):
    """Set the stick points from an equilibrium; `slipped` [J] is the energy dissipated by each contact."""
    pair = wp.tid()
    slipped[pair] = wp.float64(0.0)
    most = friction * wp.float64(pair_force[pair])
    place = wp.float64(pair_slide[pair]) + wp.float64(pair_u[pair])
    if most <= wp.float64(0.0):
        pair_stuck[pair] = LOOSE
        return
    if pair_stuck[pair] == LOOSE:
        pair_stuck[pair] = place
        return
    spacing = wp.float64(rest_length[pair_table[pair]])
    stiffness = TANGENTIAL * control[CONTACT_STIFFNESS]
    moved = (place - pair_stuck[pair]) * spacing
    pull = drawn_back(moved, stiffness, most)
    left = -pull / stiffness
    slipped[pair] = wp.abs(pull * (moved - left))
    pair_stuck[pair] = place - left / spacing
