"""Contact of round wires: penalty with damping, and Coulomb friction with a memory of where a contact sticks.

At the closest points p and q of two curves (wire_curve.py), with n from q to p, the wires overlap by o = r_p + r_q - |p - q|,
r their radii, which grow with temperature as the wires do, and

    N = max(0, k o + c do/dt)                     pushes p along n and q back
    z' = z + dt v_t    T = - k_t z    |T| <= mu N   friction, where z is cut back when it would exceed its limit

v_t is the part across n of the velocity of one surface over the other, spin and tilt of the sections included, where the line
from p to q is divided as the radii are. T acts there too: on the nodes, and as a couple on the section of the segment. So
force, moment and power are those of the two surfaces. The sections turn with their segments and spin about them: their couples
become forces and torques in rod_step.py.

A contact belongs to the pair of segments between whose ends it stands. Where the closest point stands at a node and would go on
beyond it, it counts only where the wires are nearly parallel and touch along a line: each node of either wire is then a contact,
on whichever side of it the closest point of the next segment may be. Two segments may touch in two points; where these come
together to be one, they share its force.
"""

import warp as wp

from .control import CONTACT_STIFFNESS, LENGTH_FACTOR, STATUS, STATUS_RUNNING, TIME_STEP, TRAVEL
from .rod_frames import carried
from .wire_curve import (
    Nodes,
    carried_by_sections,
    closest_on_chords,
    closest_places,
    curve_through,
    is_kept_at_end,
    mixed,
    point_at,
    rest_shape,
    row,
    sag,
    shares,
    slope_at,
    stencil,
)
from .wire_pairs import ELSEWHERE

# of the distance of touching wires: those that part by less within a segment, or within that distance if it is longer, touch
LINE_PART = wp.constant(wp.float64(0.25))  # along a line, and those that part by more
POINT_PART = wp.constant(wp.float64(0.35))  # in a point
TWO_APART = wp.constant(wp.float64(0.5))  # of that distance, between two contacts of a pair from which on both count whole


@wp.func
def lever(levers: wp.types.matrix(shape=(3, 3), dtype=wp.float64), a: int) -> wp.vec3d:
    """[m] what one of the three sections carries."""
    return wp.vec3d(levers[a, 0], levers[a, 1], levers[a, 2])


@wp.func
def add_to_wire(
    i: int,
    w: wp.vec4d,
    force: wp.vec3d,
    levers: wp.types.matrix(shape=(3, 3), dtype=wp.float64),
    couple: wp.vec3d,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    contact_force: wp.array(dtype=wp.vec3d),
    contact_couple: wp.array(dtype=wp.vec3d),
):
    """Share a force on segment i out to four nodes, and to three sections by their levers; a couple goes to its own section."""
    after = following[i]
    w1 = w[1]
    w2 = w[2]
    before = previous[i]
    if before >= 0:
        wp.atomic_add(contact_force, before, w[0] * force)
        wp.atomic_add(contact_couple, before, wp.cross(lever(levers, 0), force))
    else:
        w1 += wp.float64(2.0) * w[0]
        w2 -= w[0]
    third = following[after]
    if third >= 0:
        wp.atomic_add(contact_force, third, w[3] * force)
        wp.atomic_add(contact_couple, after, wp.cross(lever(levers, 2), force))
    else:
        w2 += wp.float64(2.0) * w[3]
        w1 -= w[3]
    wp.atomic_add(contact_force, i, w1 * force)
    wp.atomic_add(contact_force, after, w2 * force)
    wp.atomic_add(contact_couple, i, couple + wp.cross(lever(levers, 1), force))


@wp.func
def node_velocities(
    i: int,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    velocity: wp.array(dtype=wp.vec3d),
) -> Nodes:
    """Velocities [m/s] of the four nodes of segment i as rows."""
    one = velocity[i]
    after = following[i]
    two = velocity[after]
    zero = wp.float64(2.0) * one - two
    if previous[i] >= 0:
        zero = velocity[previous[i]]
    three = wp.float64(2.0) * two - one
    if following[after] >= 0:
        three = velocity[following[after]]
    return wp.matrix_from_rows(zero, one, two, three)


@wp.func
def section_rate(
    segment: int,
    apart: wp.vec3d,
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    spin: wp.array(dtype=wp.float64),
) -> wp.vec3d:
    """[1/s] at which the section of a segment turns: tilt of the segment and spin about it. `apart` [m/s]: velocity of its second
    node less that of its first."""
    return wp.cross(tangent[segment], apart) / length[segment] + spin[segment] * tangent[segment]


@wp.func
def point_velocity(
    i: int,
    w: wp.vec4d,
    nodes: Nodes,
    levers: wp.types.matrix(shape=(3, 3), dtype=wp.float64),
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    spin: wp.array(dtype=wp.float64),
) -> wp.vec3d:
    """[m/s] of a point of the curve of segment i; `nodes` are velocities."""
    speed = mixed(w, nodes)
    before = previous[i]
    if before >= 0:
        rate = section_rate(before, row(nodes, 1) - row(nodes, 0), length, tangent, spin)
        speed += wp.cross(rate, lever(levers, 0))
    speed += wp.cross(section_rate(i, row(nodes, 2) - row(nodes, 1), length, tangent, spin), lever(levers, 1))
    after = following[i]
    if following[after] >= 0:
        rate = section_rate(after, row(nodes, 3) - row(nodes, 2), length, tangent, spin)
        speed += wp.cross(rate, lever(levers, 2))
    return speed


@wp.kernel
def find_wire_contacts(
    # pairs
    pair_count: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    pair_way: wp.array(dtype=wp.float64),
    pair_wake: wp.array(dtype=wp.float64),
    # wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    node_radius: wp.array(dtype=wp.float64),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=wp.vec4d),
    rest_bulge: wp.array(dtype=wp.float64),
    # what steers the step
    control: wp.array(dtype=wp.float64),
    apart: wp.float64,
    reach: wp.float64,
    damping: wp.float64,
    friction: wp.float64,
    stick_share: wp.float64,
    # state in
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    director: wp.array(dtype=wp.vec3d),
    velocity: wp.array(dtype=wp.vec3d),
    spin: wp.array(dtype=wp.float64),
    # in and out
    pair_slip: wp.array(dtype=wp.vec3d),
    # out: [m] overlap, [N] normal force and friction on the first wire, unit normal towards it, places on the segments
    pair_overlap: wp.array(dtype=wp.float64),
    pair_force: wp.array(dtype=wp.float64),
    pair_friction: wp.array(dtype=wp.vec3d),
    pair_normal: wp.array(dtype=wp.vec3d),
    pair_place: wp.array(dtype=wp.vec2d),
    contact_force: wp.array(dtype=wp.vec3d),
    contact_couple: wp.array(dtype=wp.vec3d),
    deepest: wp.array(dtype=wp.float64),
):
    """One thread a pair, which has two contacts at most. `stick_share` is k_t/k. A pair that does not count, or whose curves are
    farther apart than `reach` times the distance at which they touch, has the overlap -ELSEWHERE.
    """
    pair = wp.tid()
    if pair >= pair_count[0]:
        return
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    for k in range(2 * pair, 2 * pair + 2):
        pair_force[k] = zero
        pair_overlap[k] = -ELSEWHERE
    if control[TRAVEL] < pair_wake[pair]:
        return
    i = pair_first[pair]
    j = pair_second[pair]
    p = stencil(i, previous, following, position, length, tangent)
    q = stencil(j, previous, following, position, length, tangent)
    moved = carried(pair_shift[pair], control)
    q = q + wp.matrix_from_rows(moved, moved, moved, moved)
    grown = control[LENGTH_FACTOR]
    touch = grown * (node_radius[i] + node_radius[j])
    start = closest_on_chords(row(p, 1), row(p, 2), row(q, 1), row(q, 2))
    chords = row(p, 1) + start[0] * (row(p, 2) - row(p, 1)) - row(q, 1) - start[1] * (row(q, 2) - row(q, 1))
    if wp.length(chords) > reach * touch + sag(p, grown * rest_bulge[i]) + sag(q, grown * rest_bulge[j]):
        return
    shape_p = grown * rest_shape(i, previous, following, rest_slope, rest_bump, tangent, director)
    shape_q = grown * rest_shape(j, previous, following, rest_slope, rest_bump, tangent, director)
    curve_p = curve_through(p, shape_p)
    curve_q = curve_through(q, shape_q)
    places = closest_places(curve_p, curve_q, start, touch, reach * touch)
    is_single = places[2] < zero
    way = pair_way[pair]
    is_same = way != ELSEWHERE
    has_more_p = following[following[i]] >= 0
    has_more_q = following[following[j]] >= 0
    velocity_p = node_velocities(i, previous, following, velocity)
    velocity_q = node_velocities(j, previous, following, velocity)
    for k in range(2 * pair, 2 * pair + wp.where(is_single, 1, 2)):
        is_second = k > 2 * pair
        near = wp.where(is_second, wp.vec2d(places[2], places[3]), wp.vec2d(places[0], places[1]))
        s = near[0]
        t = near[1]
        if is_same and wp.abs(way + t * natural_length[j] - s * natural_length[i]) < apart * node_radius[i]:
            continue
        r = point_at(curve_p, s) - point_at(curve_q, t)
        distance = wp.length(r)
        dp = slope_at(curve_p, s)
        dq = slope_at(curve_q, t)
        share = wp.float64(1.0)
        if not is_single:
            between = wp.length(point_at(curve_p, places[0]) - point_at(curve_p, places[2]))
            share = wp.float64(0.5) + wp.min(wp.float64(0.5), between / (TWO_APART * touch))
        s_goes_on = is_kept_at_end(s, wp.dot(r, dp)) and ((s <= zero and previous[i] >= 0) or (s >= one and has_more_p))
        t_goes_on = is_kept_at_end(t, -wp.dot(r, dq)) and ((t <= zero and previous[j] >= 0) or (t >= one and has_more_q))
        if s_goes_on and t_goes_on:
            continue
        if s_goes_on or t_goes_on:
            sine = wp.length(wp.cross(dp, dq)) / (wp.length(dp) * wp.length(dq))
            part = sine * wp.max(wp.max(length[i], length[j]) / touch, one)
            share = share * wp.clamp((POINT_PART - part) / (POINT_PART - LINE_PART), zero, one)
            if share == zero:
                continue
        elif (s >= one and has_more_p) or (t >= one and has_more_q):
            continue
        overlap = touch - distance
        pair_overlap[k] = overlap
        pair_place[k] = near
        n = r / distance
        pair_normal[k] = n
        slip = wp.vec3d()
        if overlap <= zero:
            pair_slip[k] = slip
            continue
        wp.atomic_max(deepest, 0, overlap)
        w = shares(s)
        v = shares(t)
        levers_p = carried_by_sections(shape_p, s)
        levers_q = carried_by_sections(shape_q, t)
        apart_speed = point_velocity(i, w, velocity_p, levers_p, previous, following, length, tangent, spin)
        apart_speed -= point_velocity(j, v, velocity_q, levers_q, previous, following, length, tangent, spin)
        stiffness = control[CONTACT_STIFFNESS]
        normal_force = share * wp.max(zero, stiffness * overlap - damping * wp.dot(apart_speed, n))
        drag = wp.vec3d()
        couple_p = wp.vec3d()
        couple_q = wp.vec3d()
        if friction > zero:
            lever_p = -(grown * node_radius[i] / touch) * r
            lever_q = (grown * node_radius[j] / touch) * r
            rate_p = section_rate(i, row(velocity_p, 2) - row(velocity_p, 1), length, tangent, spin)
            rate_q = section_rate(j, row(velocity_q, 2) - row(velocity_q, 1), length, tangent, spin)
            over = apart_speed + wp.cross(rate_p, lever_p) - wp.cross(rate_q, lever_q)
            over = over - wp.dot(over, n) * n
            slip = pair_slip[k] - wp.dot(pair_slip[k], n) * n
            if control[STATUS] == STATUS_RUNNING:
                slip = slip + control[TIME_STEP] * over
            drag = -(stick_share * stiffness * share) * slip
            limit = friction * normal_force
            size = wp.length(drag)
            if size > limit:
                slip = slip * (limit / size)
                drag = drag * (limit / size)
            couple_p = wp.cross(lever_p, drag)
            couple_q = wp.cross(lever_q, -drag)
        pair_slip[k] = slip
        if is_single:
            pair_slip[k + 1] = slip  # where one contact parts into two, both stick as it did
        pair_force[k] = normal_force
        pair_friction[k] = drag
        push = normal_force * n + drag
        add_to_wire(i, w, push, levers_p, couple_p, previous, following, contact_force, contact_couple)
        add_to_wire(j, v, -push, levers_q, couple_q, previous, following, contact_force, contact_couple)
