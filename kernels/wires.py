"""One explicit step of all wires, one thread a node: stretch, bend, contact gathered from the pairs, update.

    f_i = n_i - n_(i-1) + contact          n_j = T_j t_j + (g_j - g_(j+1)) / |e_j| nu_j

with T_j the tension and t_j, nu_j the unit tangent and left normal of the segment from node j to node j + 1, and g_j the
moment at node j with what the slope of the moment and the tension of its two arcs add (see stretch.py and bend.py).
`wires_by_block.py` does the same for the CPU, a block of nodes a thread; a test holds the two together.

Nodes of a wire are consecutive; block b holds nodes `block_first[b]` and on, and the threads of a block are consecutive
too. Displacements are read from `*_in` and written to `*_out`, so that the neighbours of a node are never half updated.
"""

from typing import Any

import warp as wp

from .bend import elastic_turning, slope_moment, turning_angle
from .clamp import bow_weights_at_clamp, edge_at_clamp, hinge_at_clamp, length_at_clamp
from .control import (
    BOW_MOMENT,
    FORCE_FACTOR,
    FORCE_PART,
    GRADIENT,
    KINETIC_PART,
    LENGTH_FACTOR,
    LOOK_AHEAD,
    SLOPE_FACTOR,
    SPEED_PART,
    STATUS,
    STATUS_RUNNING,
    STEP,
    STRONGEST_PART,
    TIME_STEP,
    VELOCITY_FACTOR,
)
from .stretch import axial_force, edge_component


@wp.func
def rounding_phase(step: wp.float64) -> wp.float64:
    """Where in [0, 1) a step rounds: multiples of the golden ratio, which cover it evenly whenever one stops.

    A step adds floor(x + phase) counts, so that n equal steps add n x to a count or two, however small x is.
    """
    turns = step * wp.float64(0.6180339887498949)
    return turns - wp.floor(turns)


@wp.func
def round_count(x: wp.float32, phase: wp.float32, like: wp.int32) -> wp.int32:
    return wp.int32(wp.floor(x + phase))


@wp.func
def round_count(x: wp.float64, phase: wp.float64, like: wp.float64) -> wp.float64:  # noqa: F811  (an overload)
    return x


@wp.func
def without_denormals(speed: wp.float32) -> wp.float32:
    """What dies out stops before its square is a denormal number, which is slow on a CPU."""
    return wp.where(wp.abs(speed) < wp.float32(1.0e-18), wp.float32(0.0), speed)


@wp.func
def without_denormals(speed: wp.float64) -> wp.float64:  # noqa: F811  (an overload)
    return wp.where(wp.abs(speed) < wp.float64(1.0e-150), wp.float64(0.0), speed)


@wp.func
def node_at(i: int, wire_first: int, wire_count: int, closed: int) -> int:
    """Index of a node counted beyond the ends of its wire: wrapped if closed, else held at the end."""
    j = i - wire_first
    if closed != 0:
        j = ((j % wire_count) + wire_count) % wire_count
    else:
        j = wp.clamp(j, 0, wire_count - 1)
    return wire_first + j


@wp.kernel
def step_wires_by_node(
    # in: blocks and wires
    block_first: wp.array(dtype=wp.int32),
    block_count: wp.array(dtype=wp.int32),
    block_table: wp.array(dtype=wp.int32),
    block_wire: wp.array(dtype=wp.int32),
    block_pair_start: wp.array(dtype=wp.int32),
    block_held_start: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    wire_count: wp.array(dtype=wp.int32),
    wire_closed: wp.array(dtype=wp.int32),
    wire_clamp: wp.array2d(dtype=Any),
    wire_axial: wp.array(dtype=Any),
    wire_mass: wp.array(dtype=Any),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    unit: Any,
    first_block: int,
    gripped: int,
    # in: rest data
    rest_x: wp.array(dtype=Any),
    rest_y: wp.array(dtype=Any),
    rest_length: wp.array(dtype=Any),
    rest_angle: wp.array(dtype=Any),
    hinge_stiffness: wp.array(dtype=Any),
    inverse_mass: wp.array(dtype=Any),
    tension_offset: wp.array(dtype=Any),
    yield_moment: Any,
    kept_stiffness: Any,
    plastic_turn: wp.array(dtype=Any),
    back_turn: wp.array(dtype=Any),
    # in: contact and grips
    block_pair: wp.array(dtype=wp.int32),
    pair_node: wp.array(dtype=wp.int32),
    pair_force: wp.array(dtype=Any),
    pair_nodal_x: wp.array(dtype=Any),
    pair_nodal_y: wp.array(dtype=Any),
    held_node: wp.array(dtype=wp.int32),
    # state in
    ux_in: wp.array(dtype=Any),
    uy_in: wp.array(dtype=Any),
    # state in and out
    vx: wp.array(dtype=Any),
    vy: wp.array(dtype=Any),
    # out
    ux_out: wp.array(dtype=Any),
    uy_out: wp.array(dtype=Any),
    partial: wp.array2d(dtype=wp.float64),
    # launch
    block_size: int,
):
    thread = wp.tid()
    block = thread / block_size
    lane = thread - block * block_size
    block = first_block + block
    if lane >= block_count[block]:
        return
    i = block_first[block] + lane
    if control[STATUS] != STATUS_RUNNING:
        ux_out[i] = ux_in[i]
        uy_out[i] = uy_in[i]
        return
    zero = type(unit)(0.0)
    wire = block_wire[block]
    first = wire_first[wire]
    count = wire_count[wire]
    closed = wire_closed[wire]
    table = block_table[block] + lane
    fxx = type(unit)(control[GRADIENT])
    fxy = type(unit)(control[GRADIENT + 1])
    fyx = type(unit)(control[GRADIENT + 2])
    fyy = type(unit)(control[GRADIENT + 3])
    length_factor = type(unit)(control[LENGTH_FACTOR])
    bow_moment = type(unit)(control[BOW_MOMENT])
    slope_factor = type(unit)(control[SLOPE_FACTOR])
    axial_stiffness = wire_axial[wire]

    # edges of the six segments around the node: i-3 to i+2
    ex = wp.vector(zero, zero, zero, zero, zero, zero)
    ey = wp.vector(zero, zero, zero, zero, zero, zero)
    length = wp.vector(zero, zero, zero, zero, zero, zero)
    for k in range(6):
        j = node_at(i - 3 + k, first, count, closed)
        j_next = node_at(i - 2 + k, first, count, closed)
        t = table - 3 + k
        ex[k] = edge_component(fxx, fxy, rest_x[t], rest_y[t], ux_in[j_next], ux_in[j], unit)
        ey[k] = edge_component(fyx, fyy, rest_x[t], rest_y[t], uy_in[j_next], uy_in[j], unit)
        edge_x, edge_y = edge_at_clamp(ex[k], ey[k], i - 3 + k - first, count, gripped, wire, wire_clamp)
        ex[k] = edge_x
        ey[k] = edge_y
        length[k] = wp.sqrt(ex[k] * ex[k] + ey[k] * ey[k])
    # natural lengths and tensions of the segments i-2 to i+1, but of those that a clamp holds rigid, times their natural length
    natural_length = wp.vector(zero, zero, zero, zero)
    pull = wp.vector(zero, zero, zero, zero)
    for k in range(4):
        local = i - 2 + k - first
        natural_length[k] = length_at_clamp(rest_length[table - 2 + k], local, count, gripped, wire, wire_clamp)
        if closed != 0 or (local >= gripped and local < count - 1 - gripped):
            natural = natural_length[k] * length_factor
            j = node_at(i - 2 + k, first, count, closed)
            pull[k] = natural * axial_force(length[k + 1], natural, axial_stiffness, tension_offset[j])
    # angles, stiffnesses at the rest length, and moments of the turns of the five nodes i-2 to i+2
    angle = wp.vector(zero, zero, zero, zero, zero)
    stiffness = wp.vector(zero, zero, zero, zero, zero)
    bend = wp.vector(zero, zero, zero, zero, zero)
    for k in range(5):
        local = i - 2 + k - first
        if closed != 0 or (local > 0 and local < count - 1):
            t = table - 2 + k
            angle[k] = turning_angle(ex[k], ey[k], ex[k + 1], ey[k + 1])
            natural_angle, share = hinge_at_clamp(rest_angle[t], local, count, gripped, wire, wire_clamp)
            turning = angle[k] - natural_angle
            stiffness[k] = share * hinge_stiffness[t]
            if yield_moment > zero:
                j = node_at(i - 2 + k, first, count, closed)
                yield_turn = yield_moment * length_factor / stiffness[k]
                turning = elastic_turning(turning, plastic_turn[j], back_turn[j], yield_turn, kept_stiffness)
            bend[k] = stiffness[k] * turning / length_factor
    # moments at the three nodes i-1, i, i+1
    moment = wp.vector(zero, zero, zero)
    for k in range(3):
        local = i - 1 + k - first
        if closed != 0 or (local > 0 and local < count - 1):
            length_before = natural_length[k]
            length_after = natural_length[k + 1]
            if gripped != 0 and local == 1:
                length_before = zero
            if gripped != 0 and local == count - 2:
                length_after = zero
            moment[k] = bend[k + 1] + slope_moment(
                bend[k], bend[k + 1], bend[k + 2], length_before, length_after, stiffness[k + 1], slope_factor
            )
            before, after = bow_weights_at_clamp(unit, local, count, gripped, wire, wire_clamp)
            moment[k] = moment[k] + bow_moment * angle[k + 1] * (before * pull[k] + after * pull[k + 1])
    fx = zero
    fy = zero
    for k in range(2):
        # segment i-1 pulls with a minus sign, segment i with a plus sign
        local = i - 1 + k - first
        if closed != 0 or (local >= 0 and local < count - 1):
            s = type(unit)(2 * k - 1)
            inverse = type(unit)(1.0) / length[k + 2]
            tx = ex[k + 2] * inverse
            ty = ey[k + 2] * inverse
            tension = pull[k + 1] / (natural_length[k + 1] * length_factor)
            shear = (moment[k] - moment[k + 1]) * inverse
            fx += s * (tension * tx - shear * ty)
            fy += s * (tension * ty + shear * tx)
    for q in range(block_pair_start[block], block_pair_start[block + 1]):
        p = block_pair[q]
        if pair_force[p] != zero:
            c = i - pair_node[p] + 1
            if closed != 0:
                c = ((c % count) + count) % count
            if c >= 0 and c < 4:
                fx += pair_nodal_x[4 * p + c]
                fy += pair_nodal_y[4 * p + c]
    for q in range(block_held_start[block], block_held_start[block + 1]):
        if held_node[q] == i:
            fx = zero
            fy = zero
    im = inverse_mass[table] / wire_mass[wire]
    px = vx[i]
    py = vy[i]
    a = type(unit)(control[VELOCITY_FACTOR])
    b = type(unit)(control[FORCE_FACTOR]) * im
    qx = without_denormals(a * px + b * fx)
    qy = without_denormals(a * py + b * fy)
    counts = type(unit)(control[TIME_STEP]) / unit
    ahead = type(unit)(control[LOOK_AHEAD])
    phase = type(unit)(rounding_phase(control[STEP]))
    vx[i] = qx
    vy[i] = qy
    ux_out[i] = ux_in[i] + round_count((qx + ahead * (qx - px)) * counts, phase, ux_in[i])
    uy_out[i] = uy_in[i] + round_count((qy + ahead * (qy - py)) * counts, phase, uy_in[i])
    force_square = wp.float64(fx * fx + fy * fy)
    speed_square = wp.float64(qx * qx + qy * qy)
    wp.atomic_add(partial, block, KINETIC_PART, speed_square / wp.float64(im))
    wp.atomic_max(partial, block, SPEED_PART, speed_square)
    wp.atomic_max(partial, block, STRONGEST_PART, force_square)
    wp.atomic_add(partial, block, FORCE_PART, force_square)
