"""Minima of the distance of two curves (wire_curve.py) and saddles between, each within one segment.

Newton's method never leads away from a minimum: a step that increases the distance is halved, and one at an end stays there.
"""

import warp as wp

from .wire_curve import Powers, derivative_at, point_at, second_derivative_at

NEWTON_STEPS = 40
NEWTON_ACCURACY = wp.constant(wp.float64(1.0e-6))  # of a segment: convergence is quadratic below this step
SINGLE_STEP = wp.constant(wp.float64(5.0e-5))  # of a segment: a step of Newton's method from this near is the last one
WELL_CURVED = wp.constant(wp.float64(0.01))  # determinant of second derivatives over the square of their trace, of such a step
NEWTON_ROUND_OFF = wp.constant(wp.float64(1.0e-12))  # of a segment: smaller steps are not taken
MIN_CURVATURE = wp.constant(wp.float64(1.0e-4))  # smallest curvature of a Newton step, over the larger one
MAX_STEP = wp.constant(wp.float64(0.25))  # of a segment
SAME_PLACE = wp.constant(wp.float64(1.0e-6))  # of a segment: closer places are one
SADDLE_STEPS, FOLLOWING_STEPS, END_STEPS = 40, 6, 8
FAR = wp.constant(wp.float64(1.0e300))  # [m2] square of a distance
END_CURVATURE = wp.constant(wp.float64(0.25))  # smallest curvature of a step towards the place nearest to an end, of the chord
SAMPLES = 5  # places along a segment, of the grid that a search starts from
SAMPLE_SPACING = wp.constant(wp.float64(0.25))
Samples = wp.types.matrix(shape=(SAMPLES, 3), dtype=wp.float64)  # points on a curve, as rows


@wp.func
def is_bounded(place: wp.float64, slope: wp.float64) -> bool:
    """Whether a place in 0 .. 1 is at an end and the distance, with this slope, decreases beyond it."""
    return (place <= wp.float64(0.0) and slope > wp.float64(0.0)) or (place >= wp.float64(1.0) and slope < wp.float64(0.0))


@wp.func
def newton_step(gs: wp.float64, gt: wp.float64, ss: wp.float64, st: wp.float64, tt: wp.float64) -> wp.vec2d:
    """Newton step of (s, t) towards a minimum, from the gradient (gs, gt) and the second derivatives.

    The absolute values of the principal curvatures are used, so that the step leaves a saddle.
    """
    half = wp.float64(0.5)
    mean = half * (ss + tt)
    lean = half * (ss - tt)
    size = wp.sqrt(lean * lean + st * st)
    axis = wp.vec2d(wp.float64(1.0), wp.float64(0.0))
    if size > wp.float64(0.0):
        axis = wp.normalize(wp.where(lean >= wp.float64(0.0), wp.vec2d(lean + size, st), wp.vec2d(st, size - lean)))
    steep = wp.abs(mean + size)
    flat = wp.abs(mean - size)
    least = MIN_CURVATURE * wp.max(steep, flat)
    steep = wp.max(steep, least)
    flat = wp.max(flat, least)
    along = (axis[0] * gs + axis[1] * gt) / steep
    across_it = (axis[0] * gt - axis[1] * gs) / flat
    step = wp.vec2d(across_it * axis[1] - along * axis[0], -along * axis[1] - across_it * axis[0])
    return step * wp.min(wp.float64(1.0), MAX_STEP / wp.max(wp.abs(step[0]), wp.max(wp.abs(step[1]), MAX_STEP)))


@wp.func
def room(place: wp.float64, step: wp.float64) -> wp.float64:
    """Share of a step from a place in 0 .. 1 that stays in 0 .. 1: 0 at an end and out of it, else at most 1."""
    if place + step > wp.float64(1.0):
        return (wp.float64(1.0) - place) / step
    if place + step < wp.float64(0.0):
        return -place / step
    return wp.float64(1.0)


@wp.func
def closest_on_curves(p: Powers, q: Powers, start: wp.vec2d) -> wp.vec4d:
    """Places (s, t) in 0 .. 1 of the closest points of two curves, by Newton's method from `start`, and its last step.

    A step that increases the distance is halved. The last step exceeds NEWTON_ACCURACY along lines of almost equal distance; the
    places are then the nearest ones visited. Last comes 1 where the places are a saddle of the distance, inside both segments.
    """
    step_size = wp.float64(0.0)
    determinant = wp.float64(0.0)
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    half = wp.float64(0.5)
    s = start[0]
    t = start[1]
    before_s = start[0]
    before_t = start[1]
    nearest = FAR
    for _step in range(NEWTON_STEPS):
        r = point_at(p, s) - point_at(q, t)
        if wp.length_sq(r) > nearest and step_size > NEWTON_ACCURACY:
            s = half * (s + before_s)
            t = half * (t + before_t)
            step_size = half * step_size
            continue
        nearest = wp.length_sq(r)
        before_s = wp.float64(s)
        before_t = wp.float64(t)
        dp = derivative_at(p, s)
        dq = derivative_at(q, t)
        gs = wp.dot(r, dp)
        gt = -wp.dot(r, dq)
        ss = wp.dot(dp, dp) + wp.dot(r, second_derivative_at(p, s))
        tt = wp.dot(dq, dq) - wp.dot(r, second_derivative_at(q, t))
        s_stays = is_bounded(s, gs)
        t_stays = is_bounded(t, gt)
        if s_stays and t_stays:
            step_size = zero
            break
        st = -wp.dot(dp, dq)
        determinant = ss * tt - st * st
        step = newton_step(gs, gt, ss, st, tt)
        if not s_stays and not t_stays:
            s_stays = room(s, step[0]) == zero
            t_stays = room(t, step[1]) == zero
        if t_stays:
            step = newton_step(gs, zero, ss, zero, wp.dot(dq, dq))
        if s_stays:
            step = newton_step(zero, gt, wp.dot(dp, dp), zero, tt)
        if wp.abs(step[0]) + wp.abs(step[1]) < NEWTON_ROUND_OFF:
            step_size = zero
            break
        share = wp.min(room(s, step[0]), room(t, step[1]))
        s = wp.clamp(s + share * step[0], zero, one)
        t = wp.clamp(t + share * step[1], zero, one)
        step_size = wp.abs(s - before_s) + wp.abs(t - before_t)
        if share < one:
            step_size = wp.max(step_size, NEWTON_ACCURACY)
        elif step_size < SINGLE_STEP and determinant > WELL_CURVED * (ss + tt) * (ss + tt):
            step_size = zero
        if step_size < NEWTON_ACCURACY:
            break
    if step_size >= NEWTON_ACCURACY:
        return wp.vec4d(before_s, before_t, step_size, zero)
    is_inside = wp.min(s, t) > zero and wp.max(s, t) < one
    return wp.vec4d(s, t, step_size, wp.where(is_inside and determinant < zero, one, zero))


@wp.func
def saddle_between(p: Powers, q: Powers, one_end: wp.vec2d, other_end: wp.vec2d) -> wp.vec2d:
    """Saddle (s, t) of the distance between two minima, the second one farther along p.

    For every s the nearest t; of these the s at which the distance is largest, by Newton's method within a bracket.
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
        dp = derivative_at(p, s)
        r = at_p - point_at(q, t)
        dq = derivative_at(q, t)
        tt = wp.dot(dq, dq)
        is_inside = bool(True)
        for _other in range(NEWTON_STEPS):
            tt = wp.max(wp.dot(dq, dq) - wp.dot(r, second_derivative_at(q, t)), MIN_CURVATURE * wp.dot(dq, dq))
            wanted = t + wp.clamp(wp.dot(r, dq) / tt, -MAX_STEP, MAX_STEP)
            next_t = wp.clamp(wanted, zero, one)
            is_inside = next_t == wanted
            step_size = wp.abs(next_t - t)
            t = next_t
            r = at_p - point_at(q, t)
            dq = derivative_at(q, t)
            if step_size < NEWTON_ACCURACY:
                break
        rise = wp.dot(r, dp)
        if rise > zero:
            low = s
        else:
            high = s
        curvature = wp.dot(dp, dp) + wp.dot(r, second_derivative_at(p, s))
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
def followed_saddle(p: Powers, q: Powers, start: wp.vec2d) -> wp.vec3d:
    """Saddle (s, t) of the distance near `start` by Newton's method, and its last step: 1 where none is found inside."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    s = start[0]
    t = start[1]
    step_size = one
    for _step in range(FOLLOWING_STEPS):
        r = point_at(p, s) - point_at(q, t)
        dp = derivative_at(p, s)
        dq = derivative_at(q, t)
        gs = wp.dot(r, dp)
        gt = -wp.dot(r, dq)
        ss = wp.dot(dp, dp) + wp.dot(r, second_derivative_at(p, s))
        tt = wp.dot(dq, dq) - wp.dot(r, second_derivative_at(q, t))
        st = -wp.dot(dp, dq)
        determinant = ss * tt - st * st
        if determinant >= zero:
            return wp.vec3d(s, t, one)
        ds = (gt * st - gs * tt) / determinant
        dt = (gs * st - gt * ss) / determinant
        step_size = wp.abs(ds) + wp.abs(dt)
        s += ds
        t += dt
        if wp.min(s, t) <= zero or wp.max(s, t) >= one:
            return wp.vec3d(s, t, one)
        if step_size < NEWTON_ACCURACY:
            break
    return wp.vec3d(s, t, step_size)


@wp.func
def projected_end(p: Powers, q: Powers, end: wp.float64) -> wp.vec2d:
    """(s, t) of an end of one curve, and its projection on the other chord."""
    q1 = point_at(q, wp.float64(0.0))
    chord = point_at(q, wp.float64(1.0)) - q1
    place = wp.dot(point_at(p, end) - q1, chord) / wp.dot(chord, chord)
    return wp.vec2d(end, wp.clamp(place, wp.float64(0.0), wp.float64(1.0)))


@wp.func
def turned(place: wp.vec2d) -> wp.vec2d:
    """The places of a pair of segments with the second one first."""
    return wp.vec2d(place[1], place[0])


@wp.func
def nearer_end(place: wp.float64) -> wp.float64:
    """The end, 0 or 1, next to a place inside a segment; of a place at an end, the other one."""
    if place <= wp.float64(0.0) or place >= wp.float64(1.0):
        return wp.float64(1.0) - place
    return wp.round(place)


@wp.func
def falling_end(p: Powers, q: Powers, place: wp.vec2d) -> wp.vec3d:
    """End of p nearer to a minimum, and nearest place of q: (s, t), and squared distance [m2]. FAR where the
    distance does not decrease beyond the end.

    The search ends early where the rest of its steps cannot change that.
    """
    end = nearer_end(place[0])
    at_p = point_at(p, end)
    dp = derivative_at(p, end)
    outwards = wp.float64(2.0) * end - wp.float64(1.0)
    t = place[1]
    for _step in range(END_STEPS):
        r = at_p - point_at(q, t)
        dq = derivative_at(q, t)
        square = wp.dot(dq, dq)
        curvature = wp.max(square - wp.dot(r, second_derivative_at(q, t)), END_CURVATURE * square)
        step = wp.clamp(t + wp.dot(r, dq) / curvature, wp.float64(0.0), wp.float64(1.0)) - t
        rise = outwards * wp.dot(r, dp)
        if rise > wp.float64(2.0) * wp.abs(step) * wp.length(dp) * wp.length(dq):
            return wp.vec3d(end, t, FAR)
        t += step
        if wp.abs(step) < NEWTON_ACCURACY:
            break
    r = at_p - point_at(q, t)
    return wp.vec3d(end, t, wp.where(outwards * wp.dot(r, dp) < wp.float64(0.0), wp.length_sq(r), FAR))


@wp.func
def beyond_saddle(p: Powers, q: Powers, place: wp.vec2d) -> wp.vec4d:
    """As `closest_on_curves`, from an end with less distance beyond, across a saddle; else `place`.

    Of either segment the end nearer to the minimum at `place` is tried; of both the one with the least distance counts.
    """
    of_p = falling_end(p, q, place)
    of_q = falling_end(q, p, turned(place))
    end = wp.vec2d(of_p[0], of_p[1])
    if of_q[2] < of_p[2]:
        end = wp.vec2d(of_q[1], of_q[0])
    if wp.min(of_p[2], of_q[2]) < FAR and are_distinct(end, place):
        return closest_on_curves(p, q, end)
    return wp.vec4d(place[0], place[1], wp.float64(0.0), wp.float64(0.0))


@wp.func
def distance_at(p: Powers, q: Powers, place: wp.vec2d) -> wp.float64:
    """[m] distance of two points of two curves."""
    return wp.length(point_at(p, place[0]) - point_at(q, place[1]))


@wp.func
def nearest_sample(p: Powers, q: Powers) -> wp.vec2d:
    """The places (s, t) of least distance on a grid of SAMPLES places along either curve."""
    nearest = FAR
    place = wp.vec2d()
    on_q = Samples()
    for b in range(SAMPLES):
        at_q = point_at(q, SAMPLE_SPACING * wp.float64(b))
        for axis in range(3):
            on_q[b, axis] = at_q[axis]
    for a in range(SAMPLES):
        s = SAMPLE_SPACING * wp.float64(a)
        at_p = point_at(p, s)
        for b in range(SAMPLES):
            square = wp.length_sq(at_p - wp.vec3d(on_q[b, 0], on_q[b, 1], on_q[b, 2]))
            if square < nearest:
                nearest = square
                place = wp.vec2d(s, SAMPLE_SPACING * wp.float64(b))
    return place


@wp.func
def saddle_of(p: Powers, q: Powers, one: wp.vec2d, other: wp.vec2d) -> wp.vec2d:
    """`saddle_between` two places in any order. Along the curve on which they are farther apart."""
    if wp.abs(other[0] - one[0]) >= wp.abs(other[1] - one[1]):
        if other[0] >= one[0]:
            return saddle_between(p, q, one, other)
        return saddle_between(p, q, other, one)
    if other[1] >= one[1]:
        return turned(saddle_between(q, p, turned(one), turned(other)))
    return turned(saddle_between(q, p, turned(other), turned(one)))


@wp.func
def are_distinct(one: wp.vec2d, other: wp.vec2d) -> bool:
    """Whether two searches found different places."""
    return wp.abs(one[0] - other[0]) + wp.abs(one[1] - other[1]) >= SAME_PLACE


@wp.func
def is_beside(sample: wp.vec2d, place: wp.vec2d) -> bool:
    """Whether a place stands between the neighbours of a sample."""
    return wp.max(wp.abs(sample[0] - place[0]), wp.abs(sample[1] - place[1])) <= SAMPLE_SPACING
