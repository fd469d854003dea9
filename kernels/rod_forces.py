"""Forces of rods: stretch, bending, twist and contact, summed at the nodes (discrete elastic rods; Bergou and others 2008, 2010).

With e, f the unit tangents before and after the node, d1, d2 the directors of either segment and l the natural length of the
node,

    kb = 2 e x f/(1 + e . f)                                        curvature binormal, integrated over the node
    k1 = (d2_before + d2_after) . kb/2     k2 = - (d1_before + d1_after) . kb/2
    a  = k 2 atan(|k|/2)/|k|                                        turning vector: |k| is 2 tan(angle/2), |a| the angle itself
    m  = angle from d1_before, transported to f, to d1_after        twist, integrated
    E  = (a - A, m - M) . S (a - A, m - M)/2                        A, M: natural values

S is about B/l for bending and C/l for twist (spatial/node_stiffness.py).

Where the wire yields, p [rad] is the plastic part of the turn at the last equilibrium, and the moment is B e/l with

    t = a - A - p      b = kept/(1 - kept) p      e = t - (1 - kept) max(0, 1 - y/|t - b|) (t - b)

in place of a - A. A round section is isotropic: it yields where the moment differs from its back moment by y B/l in any
direction, and flows in that direction (radial return; linear kinematic hardening, `kept` being the tangent stiffness over the
elastic one).

Turns at points represent curvature to second order in the spacing. The missing part is, to fourth order, the energy of the slope
of the moment along each segment (bend.py). The components of a moment turn with the section; R turns those at the node behind a
segment of length L into those at the node before it, by the twist between both as knitted:

    E_slope = sum of L |R m' - m|^2/(12 B) + sum of q . S q/2
    q = [L_before (m - R_before^T m_before) - L (R m' - m)]/(6 B)        g = m + S q(m + S q(m))

Here m is the moment of the turn, dE/dt, and g what acts on the edges in its place; to the twist moment the same is added. Where
g would be beyond the yield surface about the back moment after this step, it is returned to it like the turn. This is not the
gradient of E there; but no force jumps when p takes what has flowed. A beam
loaded at its nodes has moments linear between them: with the lengths l on the diagonal of D and its compliance C, a tridiagonal
matrix of the lengths L, the energy uses C^-1, approximated by the sum D^-1 + D^-1 (D - C) D^-1 + (D^-1 (D - C))^2 D^-1. Behind a
free end m is 0; a segment that a clamp holds has no slope energy.

A segment of length L between turns a and a' is an arc, longer than its chord by L ((L/l)^2 |a|^2 + (L/l')^2 |a'|^2)/48. Where arc
lengths are kept (BOW_MOMENT), its tension T adds the moment T L (L/l)^2 a/24 at either end (bend.py, planar).

The gradient by the two edges, with transported directors, and by the angle of either segment:

    dk1/d(edge before) = (- k1 t' + f x d2')/|edge|       dk1/d(edge after) = (- k1 t' - e x d2')/|edge|
    dk2/d(edge before) = (- k2 t' - f x d1')/|edge|       dk2/d(edge after) = (- k2 t' + e x d1')/|edge|
    dm/d(either edge)  = kb/(2 |edge|)
    dk1/d(angle) = - d1 . kb/2      dk2/d(angle) = - d2 . kb/2      dm/d(angle) = -1 before, +1 after

with t' = (e + f)/(1 + e . f) and d' = (d_before + d_after)/(1 + e . f).

A segment j pulls its nodes and turns by

    n_j = T_j t_j + (gradient of bending and twist by edge j) + t_j x c_j/|e_j|       f_i = n_i - n_(i-1) + contact + load
    torque of segment j = - gradient by its angle + t_j . c_j

with the tension T and the contact couple c_j on its section. Contact forces are gathered from the contacts of the segments in
their order (wire_contact_forces.py), so that sums do not depend on the number of threads.
"""

from typing import Any

import warp as wp

from . import rod_blocks
from .control import STATUS, STATUS_RUNNING, is_halted
from .native_text import native_text
from .rod_blocks import MOVES


@wp.func_native(native_text("rod_forces", vars(rod_blocks)))
def forces_of_block(
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
    # in: rest data
    natural_length: wp.array(dtype=wp.float64),
    node_length: wp.array(dtype=wp.float64),
    natural_curvature: wp.array(dtype=wp.vec2d),
    natural_twist: wp.array(dtype=wp.float64),
    slope_length: wp.array(dtype=wp.float64),
    moment_turn: wp.array(dtype=wp.vec2d),
    node_stiffness: wp.array2d(dtype=wp.float64),
    wire_bending: wp.array(dtype=wp.float64),
    wire_yield: wp.array(dtype=wp.float64),
    hardening: wp.float64,
    stretch_stiffness: wp.array(dtype=wp.float64),
    # in, where there is one: load of the nodes [N]
    load_force: wp.array(dtype=wp.vec3d),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    # in: contact
    touch_first_start: wp.array(dtype=wp.int32),
    touch_second_start: wp.array(dtype=wp.int32),
    touch_of_second: wp.array(dtype=wp.int32),
    touch_loaded: wp.array(dtype=wp.int32),
    touch_force: wp.array(dtype=Any),
    touch_couple: wp.array(dtype=Any),
    # state in
    tension_offset: wp.array(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    plastic_turn: wp.array(dtype=wp.vec2d),
    # out, in an evaluation without a step: turning vector [rad], moments of turn and twist [N m], twist [rad], energy of both
    # [J], force of a segment on its first node
    curvature: wp.array(dtype=wp.vec2d),
    moment: wp.array(dtype=wp.vec3d),
    twist: wp.array(dtype=wp.float64),
    bend_energy: wp.array(dtype=wp.float64),
    edge_force: wp.array(dtype=wp.vec3d),
    # out: the sums, from this node on
    stored_from: wp.int32,
    force: wp.array(dtype=Any),
    torque: wp.array(dtype=Any),
): ...


@wp.kernel
def find_rod_forces(
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
    block_rest: wp.array(dtype=wp.int32),
    # in: rest data
    natural_length: wp.array(dtype=wp.float64),
    node_length: wp.array(dtype=wp.float64),
    natural_curvature: wp.array(dtype=wp.vec2d),
    natural_twist: wp.array(dtype=wp.float64),
    slope_length: wp.array(dtype=wp.float64),
    moment_turn: wp.array(dtype=wp.vec2d),
    node_stiffness: wp.array2d(dtype=wp.float64),
    wire_bending: wp.array(dtype=wp.float64),
    wire_yield: wp.array(dtype=wp.float64),
    hardening: wp.float64,
    stretch_stiffness: wp.array(dtype=wp.float64),
    # in, where there is one: load of the nodes [N]
    load_force: wp.array(dtype=wp.vec3d),
    # in: what steers the step
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    # in: contact
    touch_first_start: wp.array(dtype=wp.int32),
    touch_second_start: wp.array(dtype=wp.int32),
    touch_of_second: wp.array(dtype=wp.int32),
    touch_loaded: wp.array(dtype=wp.int32),
    touch_force: wp.array(dtype=Any),
    touch_couple: wp.array(dtype=Any),
    # state in
    tension_offset: wp.array(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    plastic_turn: wp.array(dtype=wp.vec2d),
    # out, in an evaluation without a step: turning vector [rad], moments of turn and twist [N m], twist [rad], energy of both
    # [J], force of a segment on its first node
    curvature: wp.array(dtype=wp.vec2d),
    moment: wp.array(dtype=wp.vec3d),
    twist: wp.array(dtype=wp.float64),
    bend_energy: wp.array(dtype=wp.float64),
    edge_force: wp.array(dtype=wp.vec3d),
    # out: the sums, from this node on
    stored_from: wp.int32,
    force: wp.array(dtype=Any),
    torque: wp.array(dtype=Any),
):
    """`threads_a_block` threads a block: one, or ROD_LANES on a GPU."""
    thread = wp.tid()
    block = first_block + thread / threads_a_block
    own = control[block_first[block] / world_nodes]
    if not is_halted(own) and not (own[STATUS] == STATUS_RUNNING and block_rest[block] != MOVES):
        forces_of_block(
            block, thread % threads_a_block, block_first, block_count, block_wire, wire_first, wire_count, wire_closed, rest_row,
            natural_length, node_length, natural_curvature, natural_twist, slope_length, moment_turn, node_stiffness,
            wire_bending, wire_yield, hardening, stretch_stiffness, load_force, own, touch_first_start, touch_second_start,
            touch_of_second, touch_loaded, touch_force, touch_couple, tension_offset, length, tangent, director, plastic_turn,
            curvature, moment, twist, bend_energy, edge_force, stored_from, force, torque,
        )  # fmt: skip
