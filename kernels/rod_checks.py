"""Sums and renewals of a convergence check of rods: a row of partial sums for every block of nodes, so that their order is fixed.

The strain of the arc of a segment, with bow = BOW (w |k|^2 + w' |k'|^2) of the turning vectors at its ends (bend.py), and what
softening leaves of it, with the thermal strain s of the segment beyond the common length factor:

    strain = l/L - 1 + bow - bow at rest        excess = (strain - s)/(1 + s) - T/EA

Beside a clamp the half segment H inside it stretches too, while the clamp keeps its nodes apart: strain - s is (1 + H/L) times as
large.

Multipliers take up a share of the excess: offset -> offset + rate K excess. A change of K keeps the tension T.
"""

from typing import Any

import warp as wp

from . import bend
from .banded_mass import HELD_NODE, HELD_TURN
from .control import LENGTH_FACTOR, MULTIPLIER_RATE, STATUS, STATUS_WAITING
from .native_text import native_text
from .rod_blocks import rests

# columns of the sums of a state
UNBALANCED_SQUARE = wp.constant(0)  # [N2] of free nodes, summed
UNBALANCED_MAX = wp.constant(1)  # [N2] the largest
STRETCH_ENERGY = wp.constant(2)  # [J]
BEND_ENERGY = wp.constant(3)  # [J]
EXCESS_MAX = wp.constant(4)  # largest |excess| of a segment that can stretch
EXCESS_SQUARE = wp.constant(5)  # squares of the excess, summed
EXCESS_SUM = wp.constant(6)  # [m] excess times length of segments that can stretch
STATE_COLUMNS = 7


@wp.func_native(native_text("excess_strain", vars(bend)))
def excess_strain(
    # in: the node before the segment; rest data
    i: wp.int32,
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    half_in_clamp: wp.array(dtype=wp.float64),
    bow_weight: wp.array(dtype=wp.vec2d),
    bow_at_rest: wp.array(dtype=wp.float64),
    thermal_strain: wp.array(dtype=wp.float64),
    axial_stiffness: wp.float64,
    keeps_arc_length: wp.int32,
    # in
    control: wp.array(dtype=wp.float64),
    stretch_stiffness: wp.array(dtype=wp.float64),
    tension_offset: wp.array(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
    curvature: wp.array(dtype=wp.vec2d),
) -> wp.float64: ...


@wp.func
def chord_strain(
    i: int,
    natural_length: wp.array(dtype=wp.float64),
    control: wp.array(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
) -> wp.float64:
    """l/L - 1 of the segment behind node i."""
    return length[i] / (natural_length[i] * control[LENGTH_FACTOR]) - wp.float64(1.0)


@wp.func
def is_free(i: int, held: wp.array(dtype=wp.int32)) -> bool:
    """Whether the node moves."""
    return (held[i] & HELD_NODE) == 0


@wp.func
def can_turn(i: int, following: wp.array(dtype=wp.int32), held: wp.array(dtype=wp.int32)) -> bool:
    """Whether the section of the segment behind the node turns."""
    return following[i] >= 0 and (held[i] & HELD_TURN) == 0


@wp.kernel
def sum_states(
    # in: blocks
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    first_block: int,
    # in: rest data
    following: wp.array(dtype=wp.int32),
    held: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    half_in_clamp: wp.array(dtype=wp.float64),
    bow_weight: wp.array(dtype=wp.vec2d),
    bow_at_rest: wp.array(dtype=wp.float64),
    thermal_strain: wp.array(dtype=wp.float64),
    wire_axial: wp.array(dtype=wp.float64),
    keeps_arc_length: wp.int32,
    # in
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    stretch_stiffness: wp.array(dtype=wp.float64),
    tension_offset: wp.array(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
    curvature: wp.array(dtype=wp.vec2d),
    bend_energy: wp.array(dtype=wp.float64),
    unbalanced: wp.array(dtype=Any),
    # out: (block, STATE_COLUMNS)
    state_partial: wp.array2d(dtype=wp.float64),
):
    """A thread a block."""
    block = first_block + wp.tid()
    own = control[block_first[block] / world_nodes]
    if own[STATUS] == STATUS_WAITING:
        return
    axial_stiffness = wire_axial[block_wire[block]]
    half = wp.float64(0.5)
    square = wp.float64(0.0)
    largest = wp.float64(0.0)
    stretched = wp.float64(0.0)
    bent = wp.float64(0.0)
    excess_max = wp.float64(0.0)
    excess_square = wp.float64(0.0)
    excess_sum = wp.float64(0.0)
    for lane in range(block_count[block]):
        i = block_first[block] + lane
        bent += bend_energy[i]
        if is_free(i, held):
            force = wp.length_sq(wp.vec3d(unbalanced[i]))
            square += force
            largest = wp.max(largest, force)
        after = following[i]
        if after >= 0:
            strain = chord_strain(i, natural_length, own, length)
            tension = tension_offset[i] + stretch_stiffness[i] * strain
            stored = wp.where(keeps_arc_length != 0, axial_stiffness, stretch_stiffness[i])
            stretching = natural_length[i] + wp.where(keeps_arc_length != 0, half_in_clamp[i], wp.float64(0.0))
            stretched += half * stretching * own[LENGTH_FACTOR] * tension * tension / stored
            if is_free(i, held) or is_free(after, held):
                excess = excess_strain(
                    i, following, natural_length, half_in_clamp, bow_weight, bow_at_rest, thermal_strain, axial_stiffness,
                    keeps_arc_length, own, stretch_stiffness, tension_offset, length, curvature,
                )  # fmt: skip
                excess_max = wp.max(excess_max, wp.abs(excess))
                excess_square += excess * excess
                excess_sum += excess * natural_length[i]
    state_partial[block, UNBALANCED_SQUARE] = square
    state_partial[block, UNBALANCED_MAX] = wp.where(square == square, largest, square)  # not a number stays
    state_partial[block, STRETCH_ENERGY] = stretched
    state_partial[block, BEND_ENERGY] = bent
    state_partial[block, EXCESS_MAX] = wp.where(excess_sum == excess_sum, excess_max, excess_sum)
    state_partial[block, EXCESS_SQUARE] = excess_square
    state_partial[block, EXCESS_SUM] = excess_sum


@wp.kernel
def renew_tension_offsets(
    # in: rest data
    first_node: int,
    node_wire: wp.array(dtype=wp.int32),
    node_block: wp.array(dtype=wp.int32),
    block_rest: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    held: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    half_in_clamp: wp.array(dtype=wp.float64),
    bow_weight: wp.array(dtype=wp.vec2d),
    bow_at_rest: wp.array(dtype=wp.float64),
    thermal_strain: wp.array(dtype=wp.float64),
    wire_axial: wp.array(dtype=wp.float64),
    keeps_arc_length: wp.int32,
    # in: [wire] by which the softened stiffness of a wire is multiplied
    stiffening: wp.array(dtype=wp.float64),
    # in
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    length: wp.array(dtype=wp.float64),
    curvature: wp.array(dtype=wp.vec2d),
    # in and out
    stretch_stiffness: wp.array(dtype=wp.float64),
    tension_offset: wp.array(dtype=wp.float64),
):
    """A thread a node. A segment between two held nodes has no offset; offsets at rest stay."""
    i = first_node + wp.tid()
    own = control[i / world_nodes]
    if own[STATUS] == STATUS_WAITING or rests(i, node_block, block_rest):
        return
    stiffness = stretch_stiffness[i]
    axial_stiffness = wire_axial[node_wire[i]]
    stiffer = wp.min(stiffening[node_wire[i]] * stiffness, axial_stiffness)
    offset = wp.float64(0.0)
    after = following[i]
    if after >= 0:
        if is_free(i, held) or is_free(after, held):
            excess = excess_strain(
                i, following, natural_length, half_in_clamp, bow_weight, bow_at_rest, thermal_strain, axial_stiffness,
                keeps_arc_length, own, stretch_stiffness, tension_offset, length, curvature,
            )  # fmt: skip
            offset = tension_offset[i] + own[MULTIPLIER_RATE] * stiffness * excess
            offset += (stiffness - stiffer) * chord_strain(i, natural_length, own, length)
    tension_offset[i] = offset
    stretch_stiffness[i] = stiffer


@wp.kernel
def find_motion(
    # in: blocks
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    first_block: int,
    # in: rest data
    following: wp.array(dtype=wp.int32),
    held: wp.array(dtype=wp.int32),
    # in
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    displacement: wp.array(dtype=wp.vec3d),
    force: wp.array(dtype=Any),
    angle: wp.array(dtype=Any),
    torque: wp.array(dtype=Any),
    # in and out: of the last check; the motion since then, zero where held
    last_place: wp.array(dtype=wp.vec3d),
    last_angle: wp.array(dtype=wp.float64),
    # in: of the last check
    last_force: wp.array(dtype=wp.vec3d),
    last_torque: wp.array(dtype=wp.float64),
    # out: [block] [J] motion times change of the forces
    partial: wp.array(dtype=wp.float64),
):
    """A thread a block."""
    block = first_block + wp.tid()
    if control[block_first[block] / world_nodes, STATUS] == STATUS_WAITING:
        return
    work = wp.float64(0.0)
    for lane in range(block_count[block]):
        i = block_first[block] + lane
        move = wp.vec3d()
        turn = wp.float64(0.0)
        if is_free(i, held):
            move = displacement[i] - last_place[i]
            work += wp.dot(move, wp.vec3d(force[i]) - last_force[i])
        if can_turn(i, following, held):
            turn = wp.float64(angle[i]) - last_angle[i]
            work += turn * (wp.float64(torque[i]) - last_torque[i])
        last_place[i] = move
        last_angle[i] = turn
    partial[block] = work


@wp.kernel
def keep_motion(
    # in
    first_node: int,
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    displacement: wp.array(dtype=wp.vec3d),
    force: wp.array(dtype=Any),
    angle: wp.array(dtype=Any),
    torque: wp.array(dtype=Any),
    # out: for the next check; forces are summed anew
    last_place: wp.array(dtype=wp.vec3d),
    last_force: wp.array(dtype=wp.vec3d),
    last_angle: wp.array(dtype=wp.float64),
    last_torque: wp.array(dtype=wp.float64),
    force_sum: wp.array(dtype=Any),
):
    """A thread a node."""
    i = first_node + wp.tid()
    if control[i / world_nodes, STATUS] == STATUS_WAITING:
        return
    last_place[i] = displacement[i]
    last_force[i] = wp.vec3d(force[i])
    last_angle[i] = wp.float64(angle[i])
    last_torque[i] = wp.float64(torque[i])
    force_sum[i] = force_sum.dtype()


@wp.kernel
def slow_motion(
    # in
    first_node: int,
    world_nodes: int,
    slowed: wp.array(dtype=wp.float64),
    # in and out
    velocity: wp.array(dtype=Any),
    spin: wp.array(dtype=Any),
):
    """A thread a node: velocities become a share of themselves, `slowed` [world]."""
    i = first_node + wp.tid()
    share = slowed[i / world_nodes]
    if share == wp.float64(1.0):
        return
    velocity[i] = velocity.dtype(share * wp.vec3d(velocity[i]))
    spin[i] = spin.dtype(share * wp.float64(spin[i]))
