"""Where two wires are closest to each other: the minima of the distance of their curves (wire_curve.py), segment by segment.

Where wires hook at a small angle they touch on either side of where they cross, and the two places may be nearer to each other
than a segment is long. So the minima are looked for from both ends of a segment. Where the two searches end in different places,
the distance has a saddle between them, on the way from one to the other.

A pair of segments is looked at only where its chords, less what the curves leave them by, come as near as wires that touch; it
then sleeps until things have travelled as far as it is apart. Steps go on from the places of the step before, and look for
further ones once things have travelled by RENEWAL.
"""

import warp as wp

from .control import LENGTH_FACTOR, RAMP_STEP, RAMP_STEPS, STATUS, STATUS_RUNNING, TRAVEL
from .rod_frames import carried
from .wire_curve import (
    CLOSING,
    Powers,
    bend_at,
    closest_on_chords,
    curve_through,
    point_at,
    rest_shape,
    row,
    sag,
    slope_at,
    stencil,
)

NEWTON_STEPS = 20
NEWTON_ACCURACY = wp.constant(wp.float64(1.0e-8))  # of a segment: a step after which the next would be its square
NEWTON_ROUND_OFF = wp.constant(wp.float64(1.0e-12))  # of a segment: a step that is not taken, so that a place found stays
LEAST_CURVATURE = wp.constant(wp.float64(1.0e-4))  # over the steeper one, that Newton's steps reckon with at least
LONGEST_STEP = wp.constant(wp.float64(0.25))  # of a segment
SAME_PLACE = wp.constant(wp.float64(1.0e-6))  # of a segment, between places that are one
LEAST_BARRIER = wp.constant(wp.float64(1.0e-9))  # between two places, of the distance at which wires touch
SADDLE_STEPS = 40
RENEWAL = wp.constant(wp.float64(0.01))  # of the distance of touching wires
PLACES = 3  # of a pair: two minima and the saddle between them

NOT_NEAR = wp.constant(0)  # what a pair was found to have: below zero where it does not touch there
ONE_PLACE = wp.constant(1)
TWO_PLACES = wp.constant(2)


@wp.func
def is_kept_at_end(place: wp.float64, slope: wp.float64) -> bool:
    """Whether a place in 0 .. 1 stands at an end that the distance, with this slope, would have it go beyond."""
    return (place <= wp.float64(0.0) and slope > wp.float64(0.0)) or (place >= wp.float64(1.0) and slope < wp.float64(0.0))


@wp.func
def newton_step(gs: wp.float64, gt: wp.float64, ss: wp.float64, st: wp.float64, tt: wp.float64) -> wp.vec2d:
    """Step of (s, t) down a function with gradient (gs, gt) and these second derivatives: Newton's, with the sizes of the two
    curvatures in place of them, so that it leaves a saddle."""
    half = wp.float64(0.5)
    mean = half * (ss + tt)
    lean = half * (ss - tt)
    size = wp.sqrt(lean * lean + st * st)
    axis = wp.vec2d(wp.float64(1.0), wp.float64(0.0))
    if size > wp.float64(0.0):
        axis = wp.normalize(wp.where(lean >= wp.float64(0.0), wp.vec2d(lean + size, st), wp.vec2d(st, size - lean)))
    steep = mean + size
    flat = wp.max(wp.abs(mean - size), LEAST_CURVATURE * steep)
    along = (axis[0] * gs + axis[1] * gt) / steep
    across_it = (axis[0] * gt - axis[1] * gs) / flat
    step = wp.vec2d(across_it * axis[1] - along * axis[0], -along * axis[1] - across_it * axis[0])
    return step * wp.min(wp.float64(1.0), LONGEST_STEP / wp.max(wp.abs(step[0]), wp.max(wp.abs(step[1]), LONGEST_STEP)))


@wp.func
def closest_on_curves(p: Powers, q: Powers, start: wp.vec2d) -> wp.vec3d:
    """Places (s, t) in 0 .. 1 of the closest points of two curves near each other, by Newton's method from `start`, and the
    length of its last step, which is larger than NEWTON_ACCURACY along lines of almost one distance."""
    way = wp.float64(0.0)
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    s = start[0]
    t = start[1]
    for _step in range(NEWTON_STEPS):
        r = point_at(p, s) - point_at(q, t)
        dp = slope_at(p, s)
        dq = slope_at(q, t)
        gs = wp.dot(r, dp)
        gt = -wp.dot(r, dq)
        ss = wp.dot(dp, dp) + wp.dot(r, bend_at(p, s))
        tt = wp.dot(dq, dq) - wp.dot(r, bend_at(q, t))
        s_stays = is_kept_at_end(s, gs)
        t_stays = is_kept_at_end(t, gt)
        if s_stays and t_stays:
            way = zero
            break
        step = newton_step(gs, gt, ss, -wp.dot(dp, dq), tt)
        if t_stays:
            step = newton_step(gs, zero, ss, zero, wp.dot(dq, dq))
        if s_stays:
            step = newton_step(zero, gt, wp.dot(dp, dp), zero, tt)
        if wp.abs(step[0]) + wp.abs(step[1]) < NEWTON_ROUND_OFF:
            way = zero
            break
        before_s = s
        before_t = t
        s = wp.clamp(s + step[0], zero, one)
        t = wp.clamp(t + step[1], zero, one)
        way = wp.abs(s - before_s) + wp.abs(t - before_t)
        if way < NEWTON_ACCURACY:
            break
    return wp.vec3d(s, t, way)


@wp.func
def saddle_between(p: Powers, q: Powers, one_end: wp.vec2d, other_end: wp.vec2d) -> wp.vec2d:
    """Places (s, t) on the way between two minima, the second one farther along p, where the distance is largest on the way and
    least across it.

    For every s the nearest t; of these the s at which the distance stops rising, by Newton's method within a bracket.
    """
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    half = wp.float64(0.5)
    low = one_end[0]
    high = other_end[0]
    s = half * (low + high)
    t = half * (one_end[1] + other_end[1])
    for _step in range(SADDLE_STEPS):
        at_p = point_at(p, s)
        dp = slope_at(p, s)
        r = at_p - point_at(q, t)
        dq = slope_at(q, t)
        tt = wp.dot(dq, dq)
        is_inside = bool(True)
        for _other in range(NEWTON_STEPS):
            tt = wp.max(wp.dot(dq, dq) - wp.dot(r, bend_at(q, t)), LEAST_CURVATURE * wp.dot(dq, dq))
            wanted = t + wp.clamp(wp.dot(r, dq) / tt, -LONGEST_STEP, LONGEST_STEP)
            now = wp.clamp(wanted, zero, one)
            is_inside = now == wanted
            way = wp.abs(now - t)
            t = now
            r = at_p - point_at(q, t)
            dq = slope_at(q, t)
            if way < NEWTON_ACCURACY:
                break
        rise = wp.dot(r, dp)
        if rise > zero:
            low = s
        else:
            high = s
        curvature = wp.dot(dp, dp) + wp.dot(r, bend_at(p, s))
        if is_inside:
            st = wp.dot(dp, dq)
            curvature -= st * st / tt
        before = s
        s = half * (low + high)
        if curvature < zero:
            newton = before - rise / curvature
            if newton > low and newton < high:
                s = newton
        if wp.abs(s - before) < NEWTON_ACCURACY:
            break
    return wp.vec2d(s, t)


@wp.func
def is_saddle(p: Powers, q: Powers, place: wp.vec2d) -> bool:
    """Whether the distance of two curves falls on two sides of a place between their ends where it is level."""
    low = wp.min(place[0], place[1])
    high = wp.max(place[0], place[1])
    if low <= wp.float64(0.0) or high >= wp.float64(1.0):
        return False
    r = point_at(p, place[0]) - point_at(q, place[1])
    dp = slope_at(p, place[0])
    dq = slope_at(q, place[1])
    ss = wp.dot(dp, dp) + wp.dot(r, bend_at(p, place[0]))
    tt = wp.dot(dq, dq) - wp.dot(r, bend_at(q, place[1]))
    st = wp.dot(dp, dq)
    return ss * tt < st * st


@wp.func
def beside_end(p: Powers, q: Powers, end: wp.float64) -> wp.vec2d:
    """(s, t) of an end of one curve and of the place next to it on the chord of the other."""
    q1 = point_at(q, wp.float64(0.0))
    chord = point_at(q, wp.float64(1.0)) - q1
    place = wp.dot(point_at(p, end) - q1, chord) / wp.dot(chord, chord)
    return wp.vec2d(end, wp.clamp(place, wp.float64(0.0), wp.float64(1.0)))


@wp.func
def distance_at(p: Powers, q: Powers, place: wp.vec2d) -> wp.float64:
    """[m] of two points of two curves."""
    return wp.length(point_at(p, place[0]) - point_at(q, place[1]))


@wp.func
def saddle_of(p: Powers, q: Powers, one: wp.vec2d, other: wp.vec2d) -> wp.vec2d:
    """`saddle_between` two places in whatever order, looked for along the curve on which they are farther apart."""
    if wp.abs(other[0] - one[0]) >= wp.abs(other[1] - one[1]):
        if other[0] >= one[0]:
            return saddle_between(p, q, one, other)
        return saddle_between(p, q, other, one)
    ahead = wp.vec2d(one[1], one[0])
    behind = wp.vec2d(other[1], other[0])
    if other[1] < one[1]:
        ahead = wp.vec2d(other[1], other[0])
        behind = wp.vec2d(one[1], one[0])
    turned = saddle_between(q, p, ahead, behind)
    return wp.vec2d(turned[1], turned[0])


@wp.func
def are_apart(one: wp.vec2d, other: wp.vec2d) -> bool:
    """Whether two searches ended in different places."""
    return wp.abs(one[0] - other[0]) + wp.abs(one[1] - other[1]) >= SAME_PLACE


@wp.kernel
def find_closest_places(
    # in: pairs
    pair_count: wp.array(dtype=wp.int32),
    pair_first: wp.array(dtype=wp.int32),
    pair_second: wp.array(dtype=wp.int32),
    pair_shift: wp.array(dtype=wp.vec3d),
    # in: wires
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    node_radius: wp.array(dtype=wp.float64),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=wp.vec4d),
    rest_bulge: wp.array(dtype=wp.float64),
    # in: what steers the step
    control: wp.array(dtype=wp.float64),
    reach: wp.float64,
    # state in
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
    director: wp.array(dtype=wp.vec3d),
    # in and out: [m] travel at which a pair may touch, up to which its places are followed, and those places
    pair_wake: wp.array(dtype=wp.float64),
    pair_renewal: wp.array(dtype=wp.float64),
    pair_found: wp.array(dtype=wp.int32),
    pair_place: wp.array(dtype=wp.vec2d),
):
    """One thread a pair. A step looks at what may touch; a state that is only evaluated has all pairs looked at anew whose
    curves may be nearer than `reach` times the distance at which they touch."""
    pair = wp.tid()
    if pair >= pair_count[0]:
        return
    is_running = control[STATUS] == STATUS_RUNNING
    is_loaded = control[RAMP_STEP] >= control[RAMP_STEPS]  # before, the load moves things beside what they travel
    travel = control[TRAVEL]
    found = pair_found[pair]
    pair_found[pair] = NOT_NEAR
    if is_running and travel < pair_wake[pair]:
        return
    i = pair_first[pair]
    j = pair_second[pair]
    p = stencil(i, previous, following, position, length, tangent)
    q = stencil(j, previous, following, position, length, tangent)
    moved = carried(pair_shift[pair], control)
    q = q + wp.matrix_from_rows(moved, moved, moved, moved)
    grown = control[LENGTH_FACTOR]
    touch = grown * (node_radius[i] + node_radius[j])
    chords = closest_on_chords(row(p, 1), row(p, 2), row(q, 1), row(q, 2))
    r = row(p, 1) + chords[0] * (row(p, 2) - row(p, 1)) - row(q, 1) - chords[1] * (row(q, 2) - row(q, 1))
    gap = wp.length(r) - sag(p, grown * rest_bulge[i]) - sag(q, grown * rest_bulge[j]) - touch
    if is_running:
        if gap > wp.float64(0.0):
            if is_loaded:
                pair_wake[pair] = travel + gap / CLOSING
            return
    elif gap > (reach - wp.float64(1.0)) * touch:
        return
    curve_p = curve_through(p, grown * rest_shape(i, previous, following, rest_slope, rest_bump, tangent, director))
    curve_q = curve_through(q, grown * rest_shape(j, previous, following, rest_slope, rest_bump, tangent, director))
    one = wp.vec2d()
    other = wp.vec2d()
    from_one = wp.vec3d()
    from_other = wp.vec3d()
    k = 3 * pair
    was_two = wp.abs(found) == TWO_PLACES
    is_followed = found != NOT_NEAR and (was_two or (is_running and is_loaded and travel <= pair_renewal[pair]))
    if is_followed:
        from_one = closest_on_curves(curve_p, curve_q, pair_place[k])
        from_other = from_one
        if was_two:
            from_other = closest_on_curves(curve_p, curve_q, pair_place[k + 1])
        one = wp.vec2d(from_one[0], from_one[1])
        other = wp.vec2d(from_other[0], from_other[1])
        is_followed = wp.max(from_one[2], from_other[2]) < NEWTON_ACCURACY and not is_saddle(curve_p, curve_q, one)
        is_followed = is_followed and was_two == are_apart(one, other)
    if not is_followed:
        from_one = closest_on_curves(curve_p, curve_q, beside_end(curve_p, curve_q, wp.float64(0.0)))
        from_other = closest_on_curves(curve_p, curve_q, beside_end(curve_p, curve_q, wp.float64(1.0)))
        one = wp.vec2d(from_one[0], from_one[1])
        other = wp.vec2d(from_other[0], from_other[1])
        pair_renewal[pair] = travel + RENEWAL * touch
    now = ONE_PLACE
    nearest = distance_at(curve_p, curve_q, one)
    if are_apart(one, other):
        saddle = saddle_of(curve_p, curve_q, one, other)
        other_distance = distance_at(curve_p, curve_q, other)
        barrier = LEAST_BARRIER * touch
        if distance_at(curve_p, curve_q, saddle) > wp.max(nearest, other_distance) + barrier:
            now = TWO_PLACES
            pair_place[k + 2] = saddle
        elif wp.abs(nearest - other_distance) < barrier:  # along a line
            from_one = closest_on_curves(curve_p, curve_q, chords)
            one = wp.vec2d(from_one[0], from_one[1])
        elif other_distance < nearest:
            one = other
        nearest = wp.min(nearest, other_distance)
    if wp.max(from_one[2], from_other[2]) >= NEWTON_ACCURACY:
        pair_renewal[pair] = -wp.float64(1.0)
    pair_place[k] = one
    pair_place[k + 1] = other
    pair_found[pair] = wp.where(is_running and nearest >= touch, -now, now)
