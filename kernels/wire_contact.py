"""Contact of round wires: penalty, and Coulomb friction with a memory of where a contact sticks.

At the closest points p and q of two curves (wire_curve.py), with n from q to p, the wires overlap by o = r_p + r_q - |p - q|,
r their radii, which grow with temperature as the wires do, and

    N = k o where o > 0                           pushes p along n and q back
    z' = z + dt v_t    T = - k_t z    |T| <= mu N   friction, where z is cut back when it would exceed its limit

v_t is the part across n of the velocity of one surface over the other, what the load carries both by included, and spin and tilt
of the sections, where the line from p to q is divided as the radii are. T acts there too: on the nodes, and as a couple on the
section of the segment. So force, moment and power are those of the two surfaces. The sections turn with their segments and spin
about them: their couples become forces and torques in rod_step.py.

What a contact at an end of a segment counts, and two of a pair: wire_shares.py.
"""

import warp as wp

from .control import CONTACT_STIFFNESS, LENGTH_FACTOR, STATUS, STATUS_RUNNING, STEP, TIME_STEP
from .rod_frames import carried
from .wire_closest import NOT_NEAR, ONE_PLACE, is_kept_at_end
from .wire_curve import carried_by_sections, curve_through, lever, point_at, rest_shape, row, shares, slope_at, stencil
from .wire_motion import node_velocities, point_velocity, section_rate
from .wire_pairs import ELSEWHERE
from .wire_shares import inside_share, line_share, saddle_share, share_of_friction
from .wire_stick import stuck_slip


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


@wp.kernel
def push_wires_apart(
    # in: pairs
    pair_count: wp.array(dtype=wp.int32),
    pair_start: wp.array(dtype=wp.int32),
    pair_count_of: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    pair_way: wp.array(dtype=wp.float64),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    node_radius: wp.array(dtype=wp.float64),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=wp.vec4d),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    apart: wp.float64,
    friction: wp.float64,
    stick_share: wp.float64,
    # state in
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    director: wp.array(dtype=wp.vec3d),
    displacement: wp.array(dtype=wp.vec3d),
    velocity: wp.array(dtype=wp.vec3d),
    spin: wp.array(dtype=wp.float64),
    # in and out: what sticks, by whether the step is odd
    stuck_step: wp.array2d(dtype=wp.int32),
    stuck_place: wp.array2d(dtype=wp.vec2d),
    stuck_by: wp.array2d(dtype=wp.vec3d),
    # out: [m] overlap, [N] normal force and friction on the first wire, unit normal towards it
    pair_overlap: wp.array(dtype=wp.float64),
    pair_force: wp.array(dtype=wp.float64),
    pair_friction: wp.array(dtype=wp.vec3d),
    pair_normal: wp.array(dtype=wp.vec3d),
    contact_force: wp.array(dtype=wp.vec3d),
    contact_couple: wp.array(dtype=wp.vec3d),
    deepest: wp.array(dtype=wp.float64),
):
    """One thread a pair, at the places that `find_closest_places` found. `stick_share` is k_t/k. What does not count has the
    overlap -ELSEWHERE."""
    pair = wp.tid()
    if pair >= pair_count[0]:
        return
    found = pair_found[pair]
    if found <= NOT_NEAR:
        return
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    i = pair_first[pair]
    j = pair_second[pair]
    p = stencil(i, previous, following, position, length, tangent)
    q = stencil(j, previous, following, position, length, tangent)
    moved = carried(pair_shift[pair], control)
    q = q + wp.matrix_from_rows(moved, moved, moved, moved)
    grown = control[LENGTH_FACTOR]
    touch = grown * (node_radius[i] + node_radius[j])
    shape_p = grown * rest_shape(i, previous, following, rest_slope, rest_bump, tangent, director)
    shape_q = grown * rest_shape(j, previous, following, rest_slope, rest_bump, tangent, director)
    curve_p = curve_through(p, shape_p)
    curve_q = curve_through(q, shape_q)
    way = pair_way[pair]
    is_same = way != ELSEWHERE
    is_running = control[STATUS] == STATUS_RUNNING
    step = int(control[STEP])
    has_more_p = following[following[i]] >= 0
    has_more_q = following[following[j]] >= 0
    last = wp.where(found == ONE_PLACE, 1, 3)
    overlaps = wp.vec3d()
    counted = wp.vec3d()  # shares that the places have; of the saddle, less than none
    without_saddle = one
    for a in range(3):
        k = 3 * pair + a
        pair_force[k] = zero
        pair_overlap[k] = -ELSEWHERE
        if a < last:
            near = pair_place[k]
            s = near[0]
            t = near[1]
            r = point_at(curve_p, s) - point_at(curve_q, t)
            dp = slope_at(curve_p, s)
            dq = slope_at(curve_q, t)
            overlaps[a] = touch - wp.length(r)
            share = one
            inside = inside_share(near)
            s_goes_on = is_kept_at_end(s, wp.dot(r, dp)) and ((s <= zero and previous[i] >= 0) or (s >= one and has_more_p))
            t_goes_on = is_kept_at_end(t, -wp.dot(r, dq)) and ((t <= zero and previous[j] >= 0) or (t >= one and has_more_q))
            if is_same and wp.abs(way + t * natural_length[j] - s * natural_length[i]) < apart * node_radius[i]:
                share = zero
                inside = zero
            elif s_goes_on and t_goes_on:
                share = zero
            elif s_goes_on or t_goes_on:
                share = line_share(curve_p, curve_q, near, length[i], length[j], touch)
                inside = share
            elif (s >= one and has_more_p) or (t >= one and has_more_q):
                share = zero
            elif a < 2 and inside < one:
                inside = wp.max(inside, line_share(curve_p, curve_q, near, length[i], length[j], touch))
            counted[a] = share
            if a < 2 and found != ONE_PLACE:
                without_saddle = without_saddle * (one - inside * saddle_share(near, pair_place[3 * pair + 2]))
            elif a == 2:
                counted[2] = (without_saddle - one) * share
    for a in range(last):
        share = counted[a]
        if share == zero:
            continue
        k = 3 * pair + a
        near = pair_place[k]
        s = near[0]
        t = near[1]
        r = point_at(curve_p, s) - point_at(curve_q, t)
        overlap = overlaps[a]
        pair_overlap[k] = overlap
        n = r / (touch - overlap)
        pair_normal[k] = n
        if overlap <= zero:
            continue
        w = shares(s)
        v = shares(t)
        levers_p = carried_by_sections(shape_p, s)
        levers_q = carried_by_sections(shape_q, t)
        stiffness = control[CONTACT_STIFFNESS]
        normal_force = share * stiffness * overlap
        drag = wp.vec3d()
        couple_p = wp.vec3d()
        couple_q = wp.vec3d()
        if friction > zero and a < 2:
            velocity_p = node_velocities(i, p, previous, following, control, displacement, velocity)
            velocity_q = node_velocities(j, q, previous, following, control, displacement, velocity)
            apart_speed = point_velocity(i, w, velocity_p, levers_p, previous, following, length, tangent, spin)
            apart_speed -= point_velocity(j, v, velocity_q, levers_q, previous, following, length, tangent, spin)
            lever_p = -(grown * node_radius[i] / touch) * r
            lever_q = (grown * node_radius[j] / touch) * r
            rate_p = section_rate(i, row(velocity_p, 2) - row(velocity_p, 1), length, tangent, spin)
            rate_q = section_rate(j, row(velocity_q, 2) - row(velocity_q, 1), length, tangent, spin)
            over = apart_speed + wp.cross(rate_p, lever_p) - wp.cross(rate_q, lever_q)
            over = over - wp.dot(over, n) * n
            slip = stuck_slip(pair, i, j, near, step, previous, following, pair_start, pair_count_of, pair_second,
                              stuck_step, stuck_place, stuck_by)  # fmt: skip
            slip = slip - wp.dot(slip, n) * n
            if is_running:
                slip = slip + control[TIME_STEP] * over
            own = share
            if found != ONE_PLACE:
                own = share * share_of_friction(overlap, overlaps[1 - a], -counted[2] * overlaps[2])
            drag = -(stick_share * stiffness * own) * slip
            limit = friction * own * normal_force / share
            size = wp.length(drag)
            if size > limit:
                slip = slip * (limit / size)
                drag = drag * (limit / size)
            couple_p = wp.cross(lever_p, drag)
            couple_q = wp.cross(lever_q, -drag)
            if is_running:
                after = (step + 1) % 2
                stuck_step[after, 2 * pair + a] = step + 1
                stuck_place[after, 2 * pair + a] = near
                stuck_by[after, 2 * pair + a] = slip
        if a < 2:
            wp.atomic_max(deepest, 0, overlap)
        pair_force[k] = normal_force
        pair_friction[k] = drag
        push = normal_force * n + drag
        add_to_wire(i, w, push, levers_p, couple_p, previous, following, contact_force, contact_couple)
        add_to_wire(j, v, -push, levers_q, couple_q, previous, following, contact_force, contact_couple)
