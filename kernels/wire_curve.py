"""The smooth curve of a wire through its nodes, and the closest points of two such curves.

On the segment from node 1 to node 2, with nodes 0 and 3 beside it and relative to node 1, for s in 0 .. 1

    p(s) = h10 M1 + h01 (x2 - x1) + h11 M2 + s^2 (1 - s)^2 (B0 + s B1)
    M1 = (x2 - x0)/2 + A1     M2 = (x3 - x1)/2 + A2
    h10 = s (1 - s)^2    h01 = s^2 (3 - 2 s)    h11 = s^2 (s - 1)

Without A and B it is Catmull-Rom's curve. With them it is the centre line as it was made, wherever the wire has its shape at
rest: A belongs to a node and is carried by the mean of the sections on either side of it, B belongs to a segment and is carried
by its section,

    A = (a1 (d1_before + d1) + a2 (d2_before + d2))/2        B0 = b0 d1 + b1 d2     B1 = b2 d1 + b3 d2

so that the curve has one tangent at a node whatever shape the wire takes. A force F at p acts on the four nodes with the shares

    w0 = -h10/2    w1 = 1 - h01 - h11/2    w2 = h01 + h10/2    w3 = h11/2

and on the section of a segment with the couple c x F, c being what it carries of p. The shares add up to one, so force and moment
are kept, and both are minus the gradient of the energy. Where a wire ends, it goes on straight: x0 = 2 x1 - x2.
"""

import warp as wp

NEWTON_STEPS = 20
NEWTON_ACCURACY = wp.constant(wp.float64(1.0e-12))  # of a segment
PARALLEL = wp.constant(wp.float64(1.0e-8))  # squared sine below which two chords count as parallel
MOST_SLOPE = wp.constant(wp.float64(2.0 / 27.0))  # largest s (1 - s)^2, times half: slopes are means of two edges
LEAST_CURVATURE = wp.constant(wp.float64(1.0e-4))  # over the steeper one, that Newton's steps reckon with at least
LONGEST_STEP = wp.constant(wp.float64(0.25))  # of a segment
LEAST_BARRIER = wp.constant(wp.float64(1.0e-9))  # between two closest points, of the distance at which wires touch

Nodes = wp.types.matrix(shape=(4, 3), dtype=wp.float64)  # of a segment and beside it, as rows
Powers = wp.types.matrix(shape=(6, 3), dtype=wp.float64)  # what a curve has of 1, s, s^2 .. s^5, as rows
Shape = wp.types.matrix(
    shape=(6, 3), dtype=wp.float64
)  # A1 of the section before and the own, A2 of the own and the one behind, B0, B1


@wp.func
def slope_share_before(s: wp.float64) -> wp.float64:
    """h10(s)."""
    return s * (wp.float64(1.0) - s) * (wp.float64(1.0) - s)


@wp.func
def slope_share_after(s: wp.float64) -> wp.float64:
    """h11(s)."""
    return s * s * (s - wp.float64(1.0))


@wp.func
def shares(s: wp.float64) -> wp.vec4d:
    """w_a(s)."""
    half = wp.float64(0.5)
    one = wp.float64(1.0)
    h10 = slope_share_before(s)
    h01 = s * s * (wp.float64(3.0) - wp.float64(2.0) * s)
    h11 = slope_share_after(s)
    return wp.vec4d(-half * h10, one - h01 - half * h11, h01 + half * h10, half * h11)


@wp.func
def mixed(w: wp.vec4d, nodes: Nodes) -> wp.vec3d:
    """sum of w_a x_a; the nodes are the rows."""
    return wp.transpose(nodes) * w


@wp.func
def across(director: wp.vec3d, tangent: wp.vec3d, one: wp.float64, two: wp.float64) -> wp.vec3d:
    """one d1 + two d2."""
    return one * director + two * wp.cross(tangent, director)


@wp.func
def rest_shape(
    i: int,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=wp.vec4d),
    tangent: wp.array(dtype=wp.vec3d),
    director: wp.array(dtype=wp.vec3d),
) -> Shape:
    """[m] what segment i and those beside it carry of its curve."""
    half = wp.float64(0.5)
    own = director[i]
    t = tangent[i]
    a = half * rest_slope[i]
    b = rest_bump[i]
    zero = wp.vec3d()
    before = previous[i]
    if before >= 0:
        zero = across(director[before], tangent[before], a[0], a[1])
    after = following[i]
    next_a = half * rest_slope[after]
    three = wp.vec3d()
    if following[after] >= 0:
        three = across(director[after], tangent[after], next_a[0], next_a[1])
    return wp.matrix_from_rows(
        zero,
        across(own, t, a[0], a[1]),
        across(own, t, next_a[0], next_a[1]),
        three,
        across(own, t, b[0], b[1]),
        across(own, t, b[2], b[3]),
    )


@wp.func
def curve_through(nodes: Nodes, shape: Shape) -> Powers:
    """Powers of s of the curve from node 1 to node 2."""
    half = wp.float64(0.5)
    two = wp.float64(2.0)
    x1 = row(nodes, 1)
    edge = row(nodes, 2) - x1
    m1 = half * (row(nodes, 2) - row(nodes, 0)) + rise(shape, 0) + rise(shape, 1)
    m2 = half * (row(nodes, 3) - x1) + rise(shape, 2) + rise(shape, 3)
    b0 = rise(shape, 4)
    b1 = rise(shape, 5)
    return wp.matrix_from_rows(
        x1,
        m1,
        wp.float64(3.0) * edge - two * m1 - m2 + b0,
        m1 + m2 - two * edge - two * b0 + b1,
        b0 - two * b1,
        b1,
    )


@wp.func
def carried_by_sections(shape: Shape, s: wp.float64) -> wp.types.matrix(shape=(3, 3), dtype=wp.float64):
    """[m] what the sections of the segment before, of the own and of the one behind carry of p(s), as rows."""
    h10 = slope_share_before(s)
    h11 = slope_share_after(s)
    both = s * (wp.float64(1.0) - s)
    own = h10 * rise(shape, 1) + h11 * rise(shape, 2) + (both * both) * (rise(shape, 4) + s * rise(shape, 5))
    return wp.matrix_from_rows(h10 * rise(shape, 0), own, h11 * rise(shape, 3))


@wp.func
def rise(rows: Powers, a: int) -> wp.vec3d:
    """One of the six rows."""
    return wp.vec3d(rows[a, 0], rows[a, 1], rows[a, 2])


@wp.func
def point_at(curve: Powers, s: wp.float64) -> wp.vec3d:
    """p(s) [m]."""
    s2 = s * s
    s3 = s2 * s
    p = rise(curve, 0) + s * rise(curve, 1) + s2 * rise(curve, 2)
    return p + s3 * rise(curve, 3) + (s2 * s2) * rise(curve, 4) + (s2 * s3) * rise(curve, 5)


@wp.func
def slope_at(curve: Powers, s: wp.float64) -> wp.vec3d:
    """dp/ds."""
    s2 = s * s
    p = rise(curve, 1) + (wp.float64(2.0) * s) * rise(curve, 2) + (wp.float64(3.0) * s2) * rise(curve, 3)
    return p + (wp.float64(4.0) * s2 * s) * rise(curve, 4) + (wp.float64(5.0) * s2 * s2) * rise(curve, 5)


@wp.func
def bend_at(curve: Powers, s: wp.float64) -> wp.vec3d:
    """d2p/ds2."""
    p = wp.float64(2.0) * rise(curve, 2) + (wp.float64(6.0) * s) * rise(curve, 3)
    return p + (wp.float64(12.0) * s * s) * rise(curve, 4) + (wp.float64(20.0) * s * s * s) * rise(curve, 5)


@wp.func
def row(nodes: Nodes, a: int) -> wp.vec3d:
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
) -> Nodes:
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
def sag(nodes: Nodes, rest_bulge: wp.float64) -> wp.float64:
    """[m] that the curve leaves its chord by at most: 4/27 of what the slopes at either end differ from the chord, and what it
    has of the shape at rest."""
    edge = row(nodes, 2) - row(nodes, 1)
    before = wp.length(edge - (row(nodes, 1) - row(nodes, 0)))
    after = wp.length(edge - (row(nodes, 3) - row(nodes, 2)))
    return MOST_SLOPE * (before + after) + rest_bulge


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
def closest_on_curves(p: Powers, q: Powers, start: wp.vec2d) -> wp.vec2d:
    """Places (s, t) in 0 .. 1 of the closest points of two curves near each other, by Newton's method from `start`."""
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
        step = newton_step(gs, gt, ss, -wp.dot(dp, dq), tt)
        if t_stays:
            step = newton_step(gs, zero, ss, zero, wp.dot(dq, dq))
        if s_stays:
            step = newton_step(zero, gt, wp.dot(dp, dp), zero, tt)
        if s_stays and t_stays:
            break
        before_s = s
        before_t = t
        s = wp.clamp(s + step[0], zero, one)
        t = wp.clamp(t + step[1], zero, one)
        if wp.abs(s - before_s) + wp.abs(t - before_t) < NEWTON_ACCURACY:
            break
    return wp.vec2d(s, t)


@wp.func
def is_between(place: wp.vec2d) -> bool:
    """Whether both places stand between the ends of their segments."""
    low = wp.min(place[0], place[1])
    high = wp.max(place[0], place[1])
    return low > wp.float64(0.0) and high < wp.float64(1.0)


@wp.func
def is_saddle(p: Powers, q: Powers, place: wp.vec2d) -> bool:
    """Whether the distance of two curves falls on two sides of a place where it is level."""
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
def closest_places(p: Powers, q: Powers, start: wp.vec2d, touch: wp.float64, reach: wp.float64) -> wp.vec4d:
    """Places (s, t) of the closest points of two curves, and of those of a second minimum of their distance between the ends of
    both, by rising s; a second s below 0 where there is none, or the first is farther than `reach` [m].

    Wires that hook each other at a small angle touch on either side of where they cross, nearer to each other than a segment
    is long. Between two minima the distance rises by LEAST_BARRIER of `touch` [m] or more.
    """
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    half = wp.float64(0.5)
    found = closest_on_curves(p, q, start)
    on_saddle = is_between(found) and is_saddle(p, q, found)
    if not on_saddle and wp.length(point_at(p, found[0]) - point_at(q, found[1])) > reach:
        return wp.vec4d(found[0], found[1], -one, zero)
    far = wp.where(found[0] > half, zero, one)
    other = closest_on_curves(p, q, beside_end(p, q, far))
    if on_saddle:
        found = closest_on_curves(p, q, beside_end(p, q, one - far))
    single = wp.vec4d(found[0], found[1], -one, zero)
    if not is_between(other):
        return single
    near = wp.length(point_at(p, found[0]) - point_at(q, found[1]))
    other_near = wp.length(point_at(p, other[0]) - point_at(q, other[1]))
    middle = half * (found + other)
    barrier = wp.length(point_at(p, middle[0]) - point_at(q, middle[1]))
    if barrier < wp.max(near, other_near) + LEAST_BARRIER * touch:
        return single
    if other[0] < found[0]:
        return wp.vec4d(other[0], other[1], found[0], found[1])
    return wp.vec4d(found[0], found[1], other[0], other[1])
