"""Contact of round wires: penalty, and Coulomb friction with elastic slip.

At the closest points p and q of two curves (wire_curve.py), with the unit vector n from q to p, the wires overlap by
o = r_p + r_q - |p - q|, where the radii r grow with temperature as the wires do, and

    N = k (o + a) where o + a > 0                   normal force, along n on p and along -n on q
    z' = z + dt v_t    T = - k_t z    |T| <= mu N   friction; the elastic slip z is scaled back at the Coulomb limit

In real time z is scaled back at every step. A relaxation is a step of backward Euler from one equilibrium to the next: z is what
was left at the one before and the way since of one surface over the other, of the points that touch now. So it is a function of
the state, and scaled back at the equilibrium that ends the increment. z turns about n with the mean of both wires.

The penalty k and the offset a, an augmented Lagrangian multiplier over the penalty, are given at the nodes: k is the mean and a
the sum of both wires, each interpolated along its segment. k_t is the same everywhere.

v_t is the tangential velocity of one surface over the other: affine velocity of the load, velocity of the nodes, spin and tilt of
the sections, at the point that divides the line from p to q as the radii. T acts at the same point: as forces on the nodes and a
couple on the section of the segment. So force, moment and power equal the surfaces'. The couples on the sections become forces
and torques in rod_motion.py.

Weights of contacts at the end of a segment, and of two contacts of one pair: wire_weights.py.
"""

from typing import Any

import warp as wp

from .control import (
    CONTACT_STIFFNESS,
    DRIVE,
    FRICTION,
    LENGTH_FACTOR,
    STATUS,
    STATUS_ACCEPTING,
    STATUS_RUNNING,
    STEP,
    TIME_STEP,
    is_halted,
)  # fmt: skip
from .rod_frames import affine_map
from .wire_closest import FOLLOWED_FORCE, NOT_NEAR, ONE_PLACE
from .wire_curve import Bump, curve_through, derivative_at, node_weights, point_at, rest_shape, row, section_offsets, stencil
from .wire_friction import (
    node_velocities,
    point_velocity,
    previous_slip,
    section_weights,
    surface_before,
    surface_rate,
    surface_turn,
)
from .wire_minima import is_bounded
from .wire_near import first_of_share
from .wire_pairs import NO_COMMON_WIRE
from .wire_weights import friction_weight, line_weight, saddle_weight


@wp.func
def between(one: wp.float64, other: wp.float64, place: wp.float64) -> wp.float64:
    """Linear interpolation at a place 0 .. 1."""
    return one + place * (other - one)


@wp.func
def push_wire(
    side: int,
    i: int,
    w: wp.vec4d,
    force: wp.vec3d,
    levers: wp.types.matrix(shape=(3, 3), dtype=wp.float64),
    couple: wp.vec3d,
    shares: wp.vec3d,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    touch_force: wp.array(dtype=Any),
    touch_couple: wp.array(dtype=Any),
):
    """Distribute a force and a couple on segment i to nodes and sections. By levers to sections, the couple by
    shares.

    side: twice the number of the touch, and 1 for the second wire.
    """
    f = 4 * side
    g = 3 * side
    after = following[i]
    w1 = w[1]
    w2 = w[2]
    if previous[i] >= 0:
        touch_force[f] = touch_force.dtype(wp.vec3d(touch_force[f]) + w[0] * force)
        turn = wp.cross(row(levers, 0), force) + shares[0] * couple
        touch_couple[g] = touch_couple.dtype(wp.vec3d(touch_couple[g]) + turn)
    else:
        w1 += wp.float64(2.0) * w[0]
        w2 -= w[0]
    if following[after] >= 0:
        touch_force[f + 3] = touch_force.dtype(wp.vec3d(touch_force[f + 3]) + w[3] * force)
        turn = wp.cross(row(levers, 2), force) + shares[2] * couple
        touch_couple[g + 2] = touch_couple.dtype(wp.vec3d(touch_couple[g + 2]) + turn)
    else:
        w2 += wp.float64(2.0) * w[3]
        w1 -= w[3]
    touch_force[f + 1] = touch_force.dtype(wp.vec3d(touch_force[f + 1]) + w1 * force)
    touch_force[f + 2] = touch_force.dtype(wp.vec3d(touch_force[f + 2]) + w2 * force)
    turn = wp.cross(row(levers, 1), force) + shares[1] * couple
    touch_couple[g + 1] = touch_couple.dtype(wp.vec3d(touch_couple[g + 1]) + turn)


@wp.kernel
def find_contact_forces(
    # in: the pairs that may touch, the ones to look at, and all pairs
    touch_pair: wp.array(dtype=wp.int32),
    touch_followed: wp.array(dtype=wp.int32),
    touch_found: wp.array(dtype=wp.int32),
    touch_found_count: wp.array(dtype=wp.int32),
    touch_is_listed: int,
    touch_first_start: wp.array(dtype=wp.int32),
    first_node: int,
    end_node: int,
    part: int,
    parts: int,
    threads: int,
    pair_start: wp.array(dtype=wp.int32),
    pair_count_of: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    pair_arc_separation: wp.array(dtype=wp.float64),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    node_wire: wp.array(dtype=wp.int32),
    node_radius: wp.array(dtype=wp.float64),
    wire_period: wp.array(dtype=wp.vec3d),
    rest_row: wp.array(dtype=wp.int32),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=Bump),
    slope_weight: wp.array(dtype=wp.vec4d),
    contact_penalty: wp.array(dtype=wp.float64),
    contact_offset: wp.array(dtype=wp.float64),
    # in: what steers the step
    world_nodes: int,
    control: wp.array2d(dtype=wp.float64),
    min_arc_separation: wp.float64,
    stick_share: wp.float64,
    # state in
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
    displacement: wp.array(dtype=wp.vec3d),
    velocity: wp.array(dtype=Any),
    spin: wp.array(dtype=Any),
    # in: the equilibrium before, of a relaxation with friction
    before_position: wp.array(dtype=wp.vec3d),
    before_length: wp.array(dtype=wp.float64),
    before_tangent: wp.array(dtype=Any),
    before_director: wp.array(dtype=Any),
    before_control: wp.array2d(dtype=wp.float64),
    # in and out: elastic slip, double-buffered by the parity of the step
    slip_step: wp.array2d(dtype=wp.int32),
    slip_place: wp.array2d(dtype=wp.vec2),
    elastic_slip: wp.array2d(dtype=wp.vec3),
    # out: of each place, [m] overlap, [N] normal force and friction on the first wire, unit normal towards it
    touch_overlap: wp.array(dtype=wp.float64),
    touch_normal_force: wp.array(dtype=wp.float64),
    touch_friction: wp.array(dtype=wp.vec3d),
    touch_normal: wp.array(dtype=wp.vec3d),
    # in and out: [J] work of the slip beyond the Coulomb limit, of an accepted equilibrium or in real time, from zero
    touch_slip_work: wp.array(dtype=wp.float64),
    # out: whether a touch pushes at all; [m] largest overlap
    touch_loaded: wp.array(dtype=wp.int32),
    max_penetration: wp.array2d(dtype=wp.float64),
    # in and out: forces on the four nodes of either segment, and couples on its three sections, from zero
    touch_force: wp.array(dtype=Any),
    touch_couple: wp.array(dtype=Any),
):
    """Contact forces of a part's pairs at known places, shared by its threads. Except pairs that have their force.

    `stick_share` is k_t over the penalty in `control`. A contact without weight has the overlap -NO_COMMON_WIRE.
    """
    first = first_of_share(touch_is_listed, touch_found_count, touch_first_start, first_node, end_node, part, parts)
    end = first_of_share(touch_is_listed, touch_found_count, touch_first_start, first_node, end_node, part + 1, parts)
    for listed in range(first + wp.tid(), end, threads):
        touch = touch_found[listed]
        if touch_followed[touch] == FOLLOWED_FORCE:
            continue
        pair = touch_pair[touch]
        world = pair_first[pair] / world_nodes
        steer = control[world]
        if is_halted(steer):
            continue
        touch_loaded[touch] = 0
        before = before_control[world]
        found = pair_found[pair]
        if found <= NOT_NEAR:
            continue
        zero = wp.float64(0.0)
        one = wp.float64(1.0)
        pushes = bool(False)
        i = pair_first[pair]
        j = pair_second[pair]
        p = stencil(i, previous, following, position, length, tangent)
        q = stencil(j, previous, following, position, length, tangent)
        offset = affine_map(pair_shift[pair], steer)
        q = q + wp.matrix_from_rows(offset, offset, offset, offset)
        length_factor = steer[LENGTH_FACTOR]
        contact_distance = length_factor * (node_radius[i] + node_radius[j])
        shape_p = rest_shape(i, previous, following, natural_length, rest_row, rest_slope, rest_bump, slope_weight,
                             tangent, director)  # fmt: skip
        shape_q = rest_shape(j, previous, following, natural_length, rest_row, rest_slope, rest_bump, slope_weight,
                             tangent, director)  # fmt: skip
        shape_p = length_factor * shape_p
        shape_q = length_factor * shape_q
        curve_p = curve_through(p, shape_p, slope_weight[rest_row[i]])
        curve_q = curve_through(q, shape_q, slope_weight[rest_row[j]])
        separation = pair_arc_separation[pair]
        is_same = separation != NO_COMMON_WIRE
        is_running = steer[STATUS] == STATUS_RUNNING
        is_accepting = steer[STATUS] == STATUS_ACCEPTING
        is_increment = steer[DRIVE] == zero
        has_more_p = following[following[i]] >= 0
        has_more_q = following[following[j]] >= 0
        last = wp.where(found == ONE_PLACE, 1, 3)
        next_i = following[i]
        next_j = following[j]
        overlaps = wp.vec3d()  # and offsets
        weights = wp.vec3d()  # of the contacts; negative for the saddle
        without_saddle = one
        for a in range(3):
            touch_normal_force[3 * touch + a] = zero
            touch_overlap[3 * touch + a] = -NO_COMMON_WIRE
            if a < last:
                place = pair_place[3 * pair + a]
                s = place[0]
                t = place[1]
                r = point_at(curve_p, s) - point_at(curve_q, t)
                dp = derivative_at(curve_p, s)
                dq = derivative_at(curve_q, t)
                offset_a = between(contact_offset[i], contact_offset[next_i], s) + between(
                    contact_offset[j], contact_offset[next_j], t
                )
                overlaps[a] = contact_distance - wp.length(r) + offset_a
                weight = one
                is_separate = bool(True)
                s_goes_on = is_bounded(s, wp.dot(r, dp)) and ((s <= zero and previous[i] >= 0) or (s >= one and has_more_p))
                t_goes_on = is_bounded(t, -wp.dot(r, dq)) and ((t <= zero and previous[j] >= 0) or (t >= one and has_more_q))
                if (
                    is_same
                    and wp.abs(separation + t * natural_length[j] - s * natural_length[i]) < min_arc_separation * node_radius[i]
                ):
                    weight = zero
                    is_separate = False
                elif (s_goes_on and t_goes_on) or (s >= one and has_more_p and not s_goes_on):
                    weight = zero
                elif t >= one and has_more_q and not t_goes_on:
                    weight = zero
                elif s_goes_on or t_goes_on:
                    weight = line_weight(p, q, place, r, dp, dq, contact_distance)
                weights[a] = weight
                if a < 2 and found != ONE_PLACE and is_separate:
                    without_saddle = without_saddle * (one - saddle_weight(place, pair_place[3 * pair + 2]))
                elif a == 2:
                    weights[2] = (without_saddle - one) * weight
        for a in range(last):
            weight = weights[a]
            if weight == zero:
                continue
            k = 3 * touch + a
            place = pair_place[3 * pair + a]
            s = place[0]
            t = place[1]
            r = point_at(curve_p, s) - point_at(curve_q, t)
            overlap = overlaps[a]
            distance = wp.length(r)
            touch_overlap[k] = contact_distance - distance
            n = r / distance
            touch_normal[k] = n
            if overlap <= zero:
                continue
            w = node_weights(s, slope_weight[rest_row[i]])
            v = node_weights(t, slope_weight[rest_row[j]])
            levers_p = section_offsets(shape_p, s)
            levers_q = section_offsets(shape_q, t)
            penalty_p = between(contact_penalty[i], contact_penalty[next_i], s)
            penalty_q = between(contact_penalty[j], contact_penalty[next_j], t)
            stiffness = wp.float64(0.5) * (penalty_p + penalty_q)
            normal_force = weight * stiffness * overlap
            friction_force = wp.vec3d()
            couple_p = wp.vec3d()
            couple_q = wp.vec3d()
            shares_p = wp.vec3d()
            shares_q = wp.vec3d()
            if steer[FRICTION] > zero and a < 2:
                lever_p = -(length_factor * node_radius[i] / contact_distance) * r
                lever_q = (length_factor * node_radius[j] / contact_distance) * r
                way = wp.vec3d()
                turn = wp.vec2d(one, zero)
                if is_increment:
                    way = affine_map(pair_shift[pair], before)
                    way += surface_before(j, t, lever_q, previous, following, natural_length, rest_row, rest_slope, rest_bump,
                                          slope_weight, tangent, director, before_position, before_length,
                                          before_tangent, before_director, before)  # fmt: skip
                    way -= surface_before(i, s, lever_p, previous, following, natural_length, rest_row, rest_slope, rest_bump,
                                          slope_weight, tangent, director, before_position, before_length,
                                          before_tangent, before_director, before)  # fmt: skip
                    turn = surface_turn(i, s, n, previous, following, tangent, before_tangent)
                    turn += surface_turn(j, t, n, previous, following, tangent, before_tangent)
                elif is_running:
                    velocity_p = node_velocities(i, p, previous, following, steer, displacement, velocity)
                    velocity_q = node_velocities(j, q, previous, following, steer, displacement, velocity)
                    slip_velocity = point_velocity(i, w, velocity_p, levers_p, previous, following, length, tangent, spin)
                    slip_velocity -= point_velocity(j, v, velocity_q, levers_q, previous, following, length, tangent, spin)
                    rate_p = surface_rate(i, s, velocity_p, previous, following, length, tangent, spin)
                    rate_q = surface_rate(j, t, velocity_q, previous, following, length, tangent, spin)
                    way = steer[TIME_STEP] * (slip_velocity + wp.cross(rate_p, lever_p) - wp.cross(rate_q, lever_q))
                    turn[1] = wp.float64(0.5) * steer[TIME_STEP] * wp.dot(n, rate_p + rate_q)
                oldest = int(wp.where(is_increment, before[STEP], steer[STEP]))
                elastic = previous_slip(pair, i, j, place, int(steer[STEP]) % 2, oldest, previous, following, node_wire,
                                     node_radius, wire_period, pair_start, pair_count_of, pair_second, pair_shift,
                                     slip_step, slip_place, elastic_slip)  # fmt: skip
                slip = elastic + way
                slip = slip - wp.dot(slip, n) * n
                slip = (turn[0] * slip + turn[1] * wp.cross(n, slip)) / wp.length(turn)
                own = weight
                if found != ONE_PLACE:
                    own = weight * friction_weight(overlap, overlaps[1 - a], weights[1 - a], -weights[2] * overlaps[2])
                friction_force = -(stick_share * steer[CONTACT_STIFFNESS] * own) * slip
                limit = steer[FRICTION] * own * normal_force / weight
                size = wp.length(friction_force)
                if size > limit:
                    if is_accepting or (is_running and not is_increment):
                        touch_slip_work[k] = touch_slip_work[k] + limit * (one - limit / size) * wp.length(slip)
                    friction_force = friction_force * (limit / size)
                    slip = slip * (limit / size)
                couple_p = wp.cross(lever_p, friction_force)
                couple_q = wp.cross(lever_q, -friction_force)
                shares_p = section_weights(i, s, previous, following)
                shares_q = section_weights(j, t, previous, following)
                if is_running or is_accepting:
                    step = int(steer[STEP])
                    after = (step + 1) % 2
                    slip_step[after, 2 * pair + a] = step + 1
                    slip_place[after, 2 * pair + a] = wp.vec2(place)
                    elastic_slip[after, 2 * pair + a] = wp.vec3(wp.where(is_increment and is_running, elastic, slip))
            if a < 2:
                wp.atomic_max(max_penetration, part + world, 0, contact_distance - distance)
            touch_normal_force[k] = normal_force
            if touch_friction.shape[0] > 1:
                touch_friction[k] = friction_force
            push = normal_force * n + friction_force
            if not pushes:
                pushes = True
                for k8 in range(8):
                    touch_force[8 * touch + k8] = touch_force.dtype()
                for k6 in range(6):
                    touch_couple[6 * touch + k6] = touch_couple.dtype()
            push_wire(2 * touch, i, w, push, levers_p, couple_p, shares_p, previous, following, touch_force, touch_couple)
            push_wire(2 * touch + 1, j, v, -push, levers_q, couple_q, shares_q, previous, following, touch_force, touch_couple)
        if pushes:
            touch_loaded[touch] = 1
