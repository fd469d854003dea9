"""The smooth curve of a wire through its nodes, and the closest points of two such curves.

On the segment from node 1 to node 2, with nodes 0 and 3 beside it (Catmull-Rom: slopes (x2 - x0)/2 and (x3 - x1)/2),

    p(s) = sum of w_a(s) x_a         w0 = -h10/2    w1 = 1 - h01 - h11/2    w2 = h01 + h10/2    w3 = h11/2
    h10 = s (1 - s)^2    h01 = s^2 (3 - 2 s)    h11 = s^2 (s - 1)

The shares w add up to one and are linear in nothing but the nodes, so a force shared out by them keeps force and moment.
Where a wire ends, it goes on straight: x0 = 2 x1 - x2.
"""

import warp as wp

NEWTON_STEPS = 8
NEWTON_ACCURACY = wp.constant(wp.float64(1.0e-12))  # of a segment
PARALLEL = wp.constant(wp.float64(1.0e-8))  # squared sine below which two chords count as parallel
MOST_SLOPE = wp.constant(wp.float64(2.0 / 27.0))  # largest s (1 - s)^2, times half: slopes are means of two edges
LEAST_ANGLE = wp.constant(wp.float64(1.0e-2))  # squared sine that Newton's steps reckon with at least: they stay short beyond


@wp.func
def shares(s: wp.float64) -> wp.vec4d:
    """w_a(s)."""
    half = wp.float64(0.5)
    one = wp.float64(1.0)
    h10 = s * (one - s) * (one - s)
    h01 = s * s * (wp.float64(3.0) - wp.float64(2.0) * s)
    h11 = s * s * (s - one)
    return wp.vec4d(-half * h10, one - h01 - half * h11, h01 + half * h10, half * h11)


@wp.func
def share_slopes(s: wp.float64) -> wp.vec4d:
    """dw_a/ds."""
    half = wp.float64(0.5)
    one = wp.float64(1.0)
    three = wp.float64(3.0)
    h10 = (one - s) * (one - three * s)
    h01 = wp.float64(6.0) * s * (one - s)
    h11 = s * (three * s - wp.float64(2.0))
    return wp.vec4d(-half * h10, -h01 - half * h11, h01 + half * h10, half * h11)


@wp.func
def share_bends(s: wp.float64) -> wp.vec4d:
    """d2w_a/ds2."""
    half = wp.float64(0.5)
    six = wp.float64(6.0)
    h10 = six * s - wp.float64(4.0)
    h01 = six - wp.float64(12.0) * s
    h11 = six * s - wp.float64(2.0)
    return wp.vec4d(-half * h10, -h01 - half * h11, h01 + half * h10, half * h11)


@wp.func
def mixed(w: wp.vec4d, nodes: wp.types.matrix(shape=(4, 3), dtype=wp.float64)) -> wp.vec3d:
    """sum of w_a x_a; the nodes are the rows."""
    return wp.transpose(nodes) * w


@wp.func
def row(nodes: wp.types.matrix(shape=(4, 3), dtype=wp.float64), a: int) -> wp.vec3d:
    """One of the four nodes."""
    return wp.vec3d(nodes[a, 0], nodes[a, 1], nodes[a, 2])


@wp.func
def stencil(
    i: int,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=wp.vec3d),
) -> wp.types.matrix(shape=(4, 3), dtype=wp.float64):
    """Positions [m] of the four nodes of segment i, unwrapped along the wire from its first node, as rows."""
    one = position[i]
    edge = length[i] * tangent[i]
    two = one + edge
    zero = one - edge
    before = previous[i]
    if before >= 0:
        zero = one - length[before] * tangent[before]
    three = two + edge
    after = following[i]
    if following[after] >= 0:
        three = two + length[after] * tangent[after]
    return wp.matrix_from_rows(zero, one, two, three)


@wp.func
def sag(nodes: wp.types.matrix(shape=(4, 3), dtype=wp.float64)) -> wp.float64:
    """[m] that the curve leaves its chord by at most: 4/27 of what the slopes at either end differ from the chord."""
    edge = row(nodes, 2) - row(nodes, 1)
    before = wp.length(edge - (row(nodes, 1) - row(nodes, 0)))
    after = wp.length(edge - (row(nodes, 3) - row(nodes, 2)))
    return MOST_SLOPE * (before + after)


@wp.func
def closest_on_chords(p1: wp.vec3d, p2: wp.vec3d, q1: wp.vec3d, q2: wp.vec3d) -> wp.vec2d:
    """Places (s, t) in 0 .. 1 of the closest points of two straight segments; of parallel ones, the middle of what overlaps.

    C. Ericson 2005, Real-Time Collision Detection, 5.1.9.
    """
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    d1 = p2 - p1
    d2 = q2 - q1
    r = p1 - q1
    a = wp.dot(d1, d1)
    e = wp.dot(d2, d2)
    b = wp.dot(d1, d2)
    c = wp.dot(d1, r)
    f = wp.dot(d2, r)
    determinant = a * e - b * b
    s = zero
    if determinant > PARALLEL * a * e:
        s = wp.clamp((b * f - c * e) / determinant, zero, one)
    else:
        first = -c / a
        second = first + b / a
        low = wp.clamp(wp.min(first, second), zero, one)
        high = wp.clamp(wp.max(first, second), zero, one)
        s = wp.float64(0.5) * (low + high)
    t = (b * s + f) / e
    if t < zero:
        t = zero
        s = wp.clamp(-c / a, zero, one)
    elif t > one:
        t = one
        s = wp.clamp((b - c) / a, zero, one)
    return wp.vec2d(s, t)


@wp.func
def is_kept_at_end(place: wp.float64, slope: wp.float64) -> bool:
    """Whether a place in 0 .. 1 stands at an end that the distance, with this slope, would have it go beyond."""
    return (place <= wp.float64(0.0) and slope > wp.float64(0.0)) or (place >= wp.float64(1.0) and slope < wp.float64(0.0))


@wp.func
def closest_on_curves(
    p: wp.types.matrix(shape=(4, 3), dtype=wp.float64), q: wp.types.matrix(shape=(4, 3), dtype=wp.float64), start: wp.vec2d
) -> wp.vec2d:
    """Places (s, t) in 0 .. 1 of the closest points of two curves near each other, by Newton's method from `start`."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    s = start[0]
    t = start[1]
    for _step in range(NEWTON_STEPS):
        r = mixed(shares(s), p) - mixed(shares(t), q)
        dp = mixed(share_slopes(s), p)
        dq = mixed(share_slopes(t), q)
        gs = wp.dot(r, dp)
        gt = -wp.dot(r, dq)
        pp = wp.dot(dp, dp)
        qq = wp.dot(dq, dq)
        ss = wp.max(pp + wp.dot(r, mixed(share_bends(s), p)), wp.float64(0.1) * pp)
        tt = wp.max(qq - wp.dot(r, mixed(share_bends(t), q)), wp.float64(0.1) * qq)
        st = -wp.dot(dp, dq)
        ds = -gs / ss
        dt = -gt / tt
        s_stays = is_kept_at_end(s, gs)
        t_stays = is_kept_at_end(t, gt)
        if not s_stays and not t_stays:
            determinant = wp.max(ss * tt - st * st, LEAST_ANGLE * ss * tt)
            ds = (st * gt - tt * gs) / determinant
            dt = (st * gs - ss * gt) / determinant
        if s_stays:
            ds = zero
        if t_stays:
            dt = zero
        before_s = s
        before_t = t
        s = wp.clamp(s + ds, zero, one)
        t = wp.clamp(t + dt, zero, one)
        if wp.abs(s - before_s) + wp.abs(t - before_t) < NEWTON_ACCURACY:
            break
    return wp.vec2d(s, t)
