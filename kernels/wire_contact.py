"""Contact of round wires: penalty with damping, and Coulomb friction with a memory of where a contact sticks.

At the closest points p and q of two curves (wire_curve.py), with n from q to p, the wires overlap by o = r_p + r_q - |p - q|,
r their radii, and

    N = max(0, k o + c do/dt)                     pushes p along n and q back
    z' = z + dt v_t    T = - k_t z    |T| <= mu N   friction, where z is cut back when it would exceed its limit

v_t is the part across n of the velocity of one surface over the other, spin and tilt of the sections included, where the line
from p to q is divided as the radii are. T acts there too: on the nodes, as a couple of the segment and as torque about it. So
force, moment and power are those of the two surfaces.

A contact belongs to one pair: one whose closest point stands at the end of a segment is left to the segment that begins there,
and one that stands at its beginning, and would go on before it, counts only where the wires are nearly parallel and touch
along a line: each node of either wire is then a contact.
"""

import warp as wp

from .control import CONTACT_STIFFNESS, STATUS, STATUS_RUNNING, TIME_STEP, TRAVEL
from .rod_frames import carried
from .wire_curve import closest_on_chords, closest_on_curves, is_kept_at_end, mixed, row, sag, share_slopes, shares, stencil
from .wire_pairs import ELSEWHERE

LINE_SINE = wp.constant(wp.float64(0.25))  # of the angle between wires: below it they touch along a line,
POINT_SINE = wp.constant(wp.float64(0.35))  # above this in a point


@wp.func
def add_to_nodes(
    i: int,
    w: wp.vec4d,
    force: wp.vec3d,
    couple: wp.vec3d,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    contact_force: wp.array(dtype=wp.vec3d),
    contact_torque: wp.array(dtype=wp.float64),
):
    """Share a force out to the four nodes of segment i; a couple as forces on its two nodes and torque about it."""
    after = following[i]
    w1 = w[1]
    w2 = w[2]
    before = previous[i]
    if before >= 0:
        wp.atomic_add(contact_force, before, w[0] * force)
    else:
        w1 += wp.float64(2.0) * w[0]
        w2 -= w[0]
    third = following[after]
    if third >= 0:
        wp.atomic_add(contact_force, third, w[3] * force)
    else:
        w2 += wp.float64(2.0) * w[3]
        w1 -= w[3]
    lever = wp.cross(couple, tangent[i]) / length[i]
    wp.atomic_add(contact_force, i, w1 * force - lever)
    wp.atomic_add(contact_force, after, w2 * force + lever)
    wp.atomic_add(contact_torque, i, wp.dot(couple, tangent[i]))


@wp.func
def node_velocities(
    i: int,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    velocity: wp.array(dtype=wp.vec3d),
) -> wp.types.matrix(shape=(4, 3), dtype=wp.float64):
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
    nodes: wp.types.matrix(shape=(4, 3), dtype=wp.float64), length: wp.float64, tangent: wp.vec3d, spin: wp.float64
) -> wp.vec3d:
    """[1/s] at which the section of a segment turns: tilt of the segment and spin about it; `nodes` are velocities."""
    apart = wp.vec3d(nodes[2, 0] - nodes[1, 0], nodes[2, 1] - nodes[1, 1], nodes[2, 2] - nodes[1, 2])
    return wp.cross(tangent, apart) / length + spin * tangent


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
    contact_torque: wp.array(dtype=wp.float64),
    deepest: wp.array(dtype=wp.float64),
):
    """One thread a pair. `stick_share` is k_t/k. A pair that does not count, or whose curves are farther apart than `reach` times
    the distance at which they touch, has the overlap -ELSEWHERE.
    """
    k = wp.tid()
    if k >= pair_count[0]:
        return
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    pair_force[k] = zero
    pair_overlap[k] = -ELSEWHERE
    if control[TRAVEL] < pair_wake[k]:
        return
    i = pair_first[k]
    j = pair_second[k]
    p = stencil(i, previous, following, position, length, tangent)
    q = stencil(j, previous, following, position, length, tangent)
    moved = carried(pair_shift[k], control)
    q = q + wp.matrix_from_rows(moved, moved, moved, moved)
    touch = node_radius[i] + node_radius[j]
    start = closest_on_chords(row(p, 1), row(p, 2), row(q, 1), row(q, 2))
    chords = row(p, 1) + start[0] * (row(p, 2) - row(p, 1)) - row(q, 1) - start[1] * (row(q, 2) - row(q, 1))
    if wp.length(chords) > reach * touch + sag(p) + sag(q):
        return
    near = closest_on_curves(p, q, start)
    s = near[0]
    t = near[1]
    way = pair_way[k]
    is_same = way != ELSEWHERE
    if is_same and wp.abs(way + t * natural_length[j] - s * natural_length[i]) < apart * node_radius[i]:
        return
    w = shares(s)
    v = shares(t)
    r = mixed(w, p) - mixed(v, q)
    distance = wp.length(r)
    dp = mixed(share_slopes(s), p)
    dq = mixed(share_slopes(t), q)
    share = one
    has_more_p = following[following[i]] >= 0
    has_more_q = following[following[j]] >= 0
    if (s >= one and has_more_p) or (t >= one and has_more_q):
        return
    s_ends = is_kept_at_end(s, wp.dot(r, dp)) and previous[i] >= 0 and s <= zero
    t_ends = is_kept_at_end(t, -wp.dot(r, dq)) and previous[j] >= 0 and t <= zero
    if s_ends or t_ends:
        sine = wp.length(wp.cross(dp, dq)) / (wp.length(dp) * wp.length(dq))
        share = wp.clamp((POINT_SINE - sine) / (POINT_SINE - LINE_SINE), zero, one)
        if share == zero:
            return
    overlap = touch - distance
    pair_overlap[k] = overlap
    pair_place[k] = near
    n = r / distance
    pair_normal[k] = n
    if overlap <= zero:
        pair_slip[k] = wp.vec3d()
        return
    wp.atomic_max(deepest, 0, overlap)
    a = node_velocities(i, previous, following, velocity)
    b = node_velocities(j, previous, following, velocity)
    apart_speed = mixed(w, a) - mixed(v, b)
    stiffness = control[CONTACT_STIFFNESS]
    normal_force = share * wp.max(zero, stiffness * overlap - damping * wp.dot(apart_speed, n))
    drag = wp.vec3d()
    couple_p = wp.vec3d()
    couple_q = wp.vec3d()
    if friction > zero:
        lever_p = -(node_radius[i] / touch) * r
        lever_q = (node_radius[j] / touch) * r
        over = apart_speed + wp.cross(section_rate(a, length[i], tangent[i], spin[i]), lever_p)
        over = over - wp.cross(section_rate(b, length[j], tangent[j], spin[j]), lever_q)
        over = over - wp.dot(over, n) * n
        slip = pair_slip[k]
        slip = slip - wp.dot(slip, n) * n
        if control[STATUS] == STATUS_RUNNING:
            slip = slip + control[TIME_STEP] * over
        drag = -(stick_share * stiffness * share) * slip
        limit = friction * normal_force
        size = wp.length(drag)
        if size > limit:
            slip = slip * (limit / size)
            drag = drag * (limit / size)
        pair_slip[k] = slip
        couple_p = wp.cross(lever_p, drag)
        couple_q = wp.cross(lever_q, -drag)
    pair_force[k] = normal_force
    pair_friction[k] = drag
    push = normal_force * n + drag
    add_to_nodes(i, w, push, couple_p, previous, following, length, tangent, contact_force, contact_torque)
    add_to_nodes(j, v, -push, couple_q, previous, following, length, tangent, contact_force, contact_torque)
