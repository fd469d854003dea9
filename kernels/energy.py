"""What the segments and nodes of the wires carry: tension, strain, turning, moment. Read at records, not in the step.

stretch energy = (EA/L) (|e| - L)^2 / 2 a segment        bend energy = EI/l (theta - theta0)^2 / 2 a node
"""

from typing import Any

import warp as wp

from .bend import bow, turning_angle
from .clamp import bow_at_clamp, bow_weights_at_clamp, edge_at_clamp, hinge_at_clamp, length_at_clamp
from .control import GRADIENT, LENGTH_FACTOR
from .stretch import axial_force, edge_component
from .wires import node_at


@wp.kernel
def evaluate_wires(
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    block_size: int,
    first_block: int,
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    wire_clamp: wp.array2d(dtype=Any),
    wire_axial: wp.array(dtype=Any),
    wire_warmth: wp.array(dtype=wp.vec2d),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    unit: Any,
    # in: rest data
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    rest_length: wp.array(dtype=Any),
    rest_angle: wp.array(dtype=Any),
    rest_bow: wp.array(dtype=Any),
    tension_offset: wp.array(dtype=Any),
    # state in
    ux: wp.array(dtype=Any),
    uy: wp.array(dtype=Any),
    gripped: int,
    # out: of the segment that starts at the node (zero behind the last node of an open wire; a segment that a clamp holds
    # rigid has an edge only) ...
    edge_x: wp.array(dtype=Any),
    edge_y: wp.array(dtype=Any),
    strain: wp.array(dtype=Any),
    tension: wp.array(dtype=Any),
    # out: ... and at the node itself (zero at the ends of an open wire)
    turning: wp.array(dtype=Any),
):
    """Edge [m], strain of the curved segment [-], tension [N], and theta - theta0 [rad]."""
    thread = wp.tid()
    block = thread / block_size
    lane = thread - block * block_size
    block = first_block + block
    if lane >= block_count[block]:
        return
    i = block_first[block] + lane
    t = block_table[block] + lane
    wire = block_wire[block]
    first = wire_first[wire]
    count = wire_count[wire]
    closed = wire_closed[wire]
    fxx = type(unit)(control[GRADIENT])
    fxy = type(unit)(control[GRADIENT + 1])
    fyx = type(unit)(control[GRADIENT + 2])
    fyy = type(unit)(control[GRADIENT + 3])
    before = node_at(i - 1, first, count, closed)
    after = node_at(i + 1, first, count, closed)
    bx = edge_component(fxx, fxy, rest_x[t - 1], rest_y[t - 1], ux[i], ux[before], unit)
    by = edge_component(fyx, fyy, rest_x[t - 1], rest_y[t - 1], uy[i], uy[before], unit)
    ex = edge_component(fxx, fxy, rest_x[t], rest_y[t], ux[after], ux[i], unit)
    ey = edge_component(fyx, fyy, rest_x[t], rest_y[t], uy[after], uy[i], unit)
    local = i - first
    bx, by = edge_at_clamp(bx, by, local - 1, count, gripped, wire, wire_clamp)
    ex, ey = edge_at_clamp(ex, ey, local, count, gripped, wire, wire_clamp)
    zero = type(unit)(0.0)
    edge_x[i] = zero
    edge_y[i] = zero
    strain[i] = zero
    tension[i] = zero
    turning[i] = zero
    angle = zero
    if closed != 0 or (local > 0 and local < count - 1):
        angle = turning_angle(bx, by, ex, ey)
        natural_angle, _share = hinge_at_clamp(rest_angle[t], local, count, gripped, wire, wire_clamp)
        turning[i] = angle - natural_angle
    if closed != 0 or local < count - 1:
        edge_x[i] = ex
        edge_y[i] = ey
    if closed != 0 or (local >= gripped and local < count - 1 - gripped):
        length = wp.sqrt(ex * ex + ey * ey)
        natural = length_at_clamp(rest_length[t], local, count, gripped, wire, wire_clamp) * type(unit)(control[LENGTH_FACTOR])
        tension[i] = axial_force(length, natural, wire_axial[wire], tension_offset[i])
        beyond = node_at(i + 2, first, count, closed)
        angle_after = zero
        if closed != 0 or local < count - 2:
            ax = edge_component(fxx, fxy, rest_x[t + 1], rest_y[t + 1], ux[beyond], ux[after], unit)
            ay = edge_component(fyx, fyy, rest_x[t + 1], rest_y[t + 1], uy[beyond], uy[after], unit)
            ax, ay = edge_at_clamp(ax, ay, local + 1, count, gripped, wire, wire_clamp)
            angle_after = turning_angle(ex, ey, ax, ay)
        _, weight = bow_weights_at_clamp(length, local, count, gripped, wire, wire_clamp)
        weight_after, _ = bow_weights_at_clamp(length, local + 1, count, gripped, wire, wire_clamp)
        natural_bow = bow_at_clamp(rest_bow[t], local, count, gripped, wire, wire_clamp)
        # the step itself knows the mean temperature only: multipliers bring in the rest
        warmth = type(unit)(wire_warmth[wire][0] + wire_warmth[wire][1] * wp.float64(local))
        longer = bow(angle, angle_after, weight, weight_after) - natural_bow
        strain[i] = ((length - natural) / natural - warmth) / (type(unit)(1.0) + warmth) + longer
