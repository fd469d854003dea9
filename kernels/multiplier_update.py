"""Augmented Lagrangian multipliers, which correct the errors of softened segments and contact penalties.

A softened segment carries T = offset + K e with K = EA/s and e the strain of its chord. The constraint is T/EA as the strain of
its arc, which is longer than the chord by a bow (bend.py). The offset grows by K times the strain error of the arc. In a soft
mesh T stays and e adapts at once. Where the stretch is imposed, as in a straight wire between two grips, an update removes only
a share K/EA of the error: such wires are softened less (warpknit/planar/multipliers.py).

A closed pair carries F = offset - k gap; with offset = F the gap vanishes at the same force.
"""

from typing import Any

import warp as wp

from .control import EXTRAPOLATION, MULTIPLIER_RATE


@wp.kernel
def update_tension_offset(
    # in: where
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    first_block: int,
    block_size: int,
    # in
    control: wp.array(dtype=wp.float64),
    axial_before: wp.array(dtype=Any),
    axial: wp.array(dtype=Any),
    true_stiffness: wp.float64,
    tension: wp.array(dtype=Any),
    strain: wp.array(dtype=Any),
    # in and out
    tension_offset: wp.array(dtype=Any),
):
    """One update of every segment; a change of a wire's stiffness from `axial_before` to `axial` keeps T."""
    thread = wp.tid()
    block = first_block + thread / block_size
    lane = thread % block_size
    if lane >= block_count[block]:
        return
    i = block_first[block] + lane
    k = wp.float64(axial[block_wire[block]])
    k_before = wp.float64(axial_before[block_wire[block]])
    t = wp.float64(tension[i])
    offset = t - k / k_before * (t - wp.float64(tension_offset[i]))
    excess = wp.float64(strain[i]) - t / true_stiffness
    tension_offset[i] = tension_offset.dtype(offset + control[MULTIPLIER_RATE] * k * excess)


@wp.kernel
def update_pair_offset(
    # in
    first_pair: int,
    control: wp.array(dtype=wp.float64),
    pair_force: wp.array(dtype=Any),
    # in and out
    pair_offset: wp.array(dtype=Any),
):
    """offset += rate (F - offset)."""
    pair = first_pair + wp.tid()
    offset = pair_offset[pair] + pair_offset.dtype(control[MULTIPLIER_RATE]) * (pair_force[pair] - pair_offset[pair])
    if offset < pair_offset.dtype(1.0e-16):
        offset = pair_offset.dtype(0.0)  # an open pair forgets
    pair_offset[pair] = offset


@wp.kernel
def extrapolate(
    # in
    control: wp.array(dtype=wp.float64),
    limit: wp.float64,
    lowest: wp.float64,
    # in and out: the value of this level replaces the previous one
    value: wp.array(dtype=Any),
    last: wp.array(dtype=Any),
):
    """value += EXTRAPOLATION (value - last), at most `limit` far and not below `lowest`: where two levels point to."""
    i = wp.tid()
    now = value[i]
    step = wp.clamp(control[EXTRAPOLATION] * wp.float64(now - last[i]), -limit, limit)
    value[i] = value.dtype(wp.max(wp.float64(now) + step, lowest))
    last[i] = now


@wp.kernel
def extrapolate_held_bodies(
    # in
    control: wp.array(dtype=wp.float64),
    limit: wp.float64,
    pair_force: wp.array(dtype=Any),
    # in and out
    value: wp.array(dtype=Any),
    last: wp.array(dtype=Any),
):
    """The same for bodies, where both wires hold them: a free body has nowhere to go."""
    body = wp.tid()
    now = value[body]
    if pair_force[2 * body] != pair_force.dtype(0.0) and pair_force[2 * body + 1] != pair_force.dtype(0.0):
        step = wp.clamp(control[EXTRAPOLATION] * wp.float64(now - last[body]), -limit, limit)
        value[body] = value.dtype(wp.float64(now) + step)
    last[body] = now
