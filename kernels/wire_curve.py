"""The smooth curve of a wire through its nodes.

On the segment from node 1 to node 2, with nodes 0 and 3 beside it and relative to node 1, for s in 0 .. 1

    p(s) = h10 M1 + h01 (x2 - x1) + h11 M2 + s^2 (1 - s)^2 (B0 + s B1 + s^2 B2 + s^3 B3)
    M1 = m0 (x1 - x0 + L_before A1) + m1 (x2 - x1 + L A1)     M2 = m2 (x2 - x1 + L A2) + m3 (x3 - x2 + L_next A2)
    h10 = s (1 - s)^2    h01 = s^2 (3 - 2 s)    h11 = s^2 (s - 1)

with the lengths L of the segments at rest. m0 L_before : m1 L = L : L_before, as the slope of the parabola through three nodes. A
belongs to a node and rotates with the sections of both segments; B belongs to a segment and rotates with its section,

    A = a1 d1 + a2 d2        B0 = b0 d1 + b1 d2     ...     B3 = b6 d1 + b7 d2

so the curve has a unique direction at each node in any shape of the wire. With a, b and the sizes of m fitted it equals the true
centre line wherever the wire has its rest shape. Without A and B, and with all m = 1/2, it is a Catmull-Rom curve. A force F at p
acts on the four nodes with the weights

    w0 = -m0 h10    w1 = 1 - h01 + (m0 - m1) h10 - m2 h11    w2 = h01 + m1 h10 + (m2 - m3) h11    w3 = m3 h11

and on the section of a segment with the couple c x F, where c is the part of p that rotates with it. The weights sum to one, so
force and moment are conserved, and both are minus the gradient of the energy. Beyond its end a wire is straight: x0 = 2 x1 - x2.
"""

from typing import Any

import warp as wp

PARALLEL = wp.constant(wp.float64(1.0e-8))  # squared sine below which two chords count as parallel
MAX_SLOPE_WEIGHT = wp.constant(wp.float64(4.0 / 27.0))  # largest s (1 - s)^2
MAX_RATIO = 1.8  # of m0 + |1 - m1| and m3 + |1 - m2|, the largest mean: 1 where segments are alike
# largest approach of two curves for a unit motion of all nodes: 2 of their chords, and of either sag 2 MAX_SLOPE_WEIGHT MAX_RATIO
# from either end
CLOSING_RATE = wp.constant(wp.float64(2.0 + 32.0 / 27.0 * MAX_RATIO))

Nodes = wp.types.matrix(shape=(4, 3), dtype=wp.float64)  # of a segment and adjacent to it, as rows
Powers = wp.types.matrix(shape=(8, 3), dtype=wp.float64)  # coefficients of 1, s, s^2 .. s^7, as rows
Bump = wp.types.vector(length=8, dtype=wp.float64)  # b0 .. b7
# m L A1 of the previous and own section, m L A2 of the own and next section, B0 .. B3
Shape = wp.types.matrix(shape=(8, 3), dtype=wp.float64)
CHORDS, CHORD_ENDS, CHORD_STEP = 4, 5, wp.constant(wp.float64(0.25))  # of a curve, by which its distance is bounded
CHORD_MARGIN = wp.constant(wp.float64(2.0))  # on their sag at the middles: 1.2 was seen, where a curve turns back
ChordEnds = wp.types.matrix(shape=(CHORD_ENDS, 3), dtype=wp.float64)


@wp.func
def row(matrix: Any, a: int) -> wp.vec3d:
    """One row of a matrix with three columns."""
    return wp.vec3d(matrix[a, 0], matrix[a, 1], matrix[a, 2])


@wp.func
def hermite_10(s: wp.float64) -> wp.float64:
    """h10(s)."""
    return s * (wp.float64(1.0) - s) * (wp.float64(1.0) - s)


@wp.func
def hermite_11(s: wp.float64) -> wp.float64:
    """h11(s)."""
    return s * s * (s - wp.float64(1.0))


@wp.func
def node_weights(s: wp.float64, m: wp.vec4d) -> wp.vec4d:
    """w_a(s), with the weights of the edges in the slopes."""
    h10 = hermite_10(s)
    h01 = s * s * (wp.float64(3.0) - wp.float64(2.0) * s)
    h11 = hermite_11(s)
    return wp.vec4d(
        -m[0] * h10, wp.float64(1.0) - h01 + (m[0] - m[1]) * h10 - m[2] * h11, h01 + m[1] * h10 + (m[2] - m[3]) * h11, m[3] * h11
    )


@wp.func
def weighted_sum(w: wp.vec4d, nodes: Nodes) -> wp.vec3d:
    """sum of w_a x_a; the nodes are the rows."""
    return wp.transpose(nodes) * w


@wp.func
def section_vector(director: Any, tangent: Any, one: wp.float64, two: wp.float64) -> wp.vec3d:
    """one d1 + two d2."""
    d = wp.vec3d(director)
    return one * d + two * wp.cross(wp.vec3d(tangent), d)


@wp.func
def rest_shape(
    i: int,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    rest_row: wp.array(dtype=wp.int32),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=Bump),
    slope_weight: wp.array(dtype=wp.vec4d),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
) -> Shape:
    """Rest-shape offsets m L A and B [m] of segment i, as rows. `rest_row` [node] is the row of its rest data,
    shared by wires of one shape.
    """
    own = director[i]
    t = tangent[i]
    here = rest_row[i]
    m = slope_weight[here]
    length = natural_length[i]
    a = rest_slope[here]
    b = rest_bump[here]
    zero = wp.vec3d()
    before = previous[i]
    if before >= 0:
        zero = (m[0] * natural_length[before]) * section_vector(director[before], tangent[before], a[0], a[1])
    after = following[i]
    next_a = rest_slope[rest_row[after]]
    three = wp.vec3d()
    if following[after] >= 0:
        three = (m[3] * natural_length[after]) * section_vector(director[after], tangent[after], next_a[0], next_a[1])
    return wp.matrix_from_rows(
        zero,
        (m[1] * length) * section_vector(own, t, a[0], a[1]),
        (m[2] * length) * section_vector(own, t, next_a[0], next_a[1]),
        three,
        section_vector(own, t, b[0], b[1]),
        section_vector(own, t, b[2], b[3]),
        section_vector(own, t, b[4], b[5]),
        section_vector(own, t, b[6], b[7]),
    )


@wp.func
def curve_through(nodes: Nodes, shape: Shape, m: wp.vec4d) -> Powers:
    """Polynomial coefficients of the curve from node 1 to node 2; m are the weights of the edges in the slopes."""
    two = wp.float64(2.0)
    x1 = row(nodes, 1)
    edge = row(nodes, 2) - x1
    m1 = m[0] * (x1 - row(nodes, 0)) + m[1] * edge + row(shape, 0) + row(shape, 1)
    m2 = m[2] * edge + m[3] * (row(nodes, 3) - row(nodes, 2)) + row(shape, 2) + row(shape, 3)
    b0 = row(shape, 4)
    b1 = row(shape, 5)
    b2 = row(shape, 6)
    b3 = row(shape, 7)
    return wp.matrix_from_rows(
        x1,
        m1,
        wp.float64(3.0) * edge - two * m1 - m2 + b0,
        m1 + m2 - two * edge - two * b0 + b1,
        b0 - two * b1 + b2,
        b1 - two * b2 + b3,
        b2 - two * b3,
        b3,
    )


@wp.func
def curve_of_segment(
    i: int,
    nodes: Nodes,
    length_factor: wp.float64,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    natural_length: wp.array(dtype=wp.float64),
    rest_row: wp.array(dtype=wp.int32),
    rest_slope: wp.array(dtype=wp.vec2d),
    rest_bump: wp.array(dtype=Bump),
    slope_weight: wp.array(dtype=wp.vec4d),
    tangent: wp.array(dtype=Any),
    director: wp.array(dtype=Any),
) -> Powers:
    """Curve of segment i through its `stencil`, with its rest shape."""
    shape = rest_shape(i, previous, following, natural_length, rest_row, rest_slope, rest_bump, slope_weight, tangent, director)
    return curve_through(nodes, length_factor * shape, slope_weight[rest_row[i]])


@wp.func
def section_offsets(shape: Shape, s: wp.float64) -> wp.types.matrix(shape=(3, 3), dtype=wp.float64):
    """[m] parts of p(s) that rotate with the previous, own and next section, as rows."""
    h10 = hermite_10(s)
    h11 = hermite_11(s)
    both = s * (wp.float64(1.0) - s)
    bump = row(shape, 4) + s * (row(shape, 5) + s * (row(shape, 6) + s * row(shape, 7)))
    own = h10 * row(shape, 1) + h11 * row(shape, 2) + (both * both) * bump
    return wp.matrix_from_rows(h10 * row(shape, 0), own, h11 * row(shape, 3))


@wp.func
def point_at(curve: Powers, s: wp.float64) -> wp.vec3d:
    """p(s) [m]."""
    p = row(curve, 7)
    for k in range(1, 8):
        p = row(curve, 7 - k) + s * p
    return p


@wp.func
def derivative_at(curve: Powers, s: wp.float64) -> wp.vec3d:
    """dp/ds."""
    p = wp.float64(7.0) * row(curve, 7)
    for k in range(1, 7):
        p = wp.float64(7 - k) * row(curve, 7 - k) + s * p
    return p


@wp.func
def second_derivative_at(curve: Powers, s: wp.float64) -> wp.vec3d:
    """d2p/ds2."""
    p = wp.float64(42.0) * row(curve, 7)
    for k in range(1, 6):
        p = wp.float64((7 - k) * (6 - k)) * row(curve, 7 - k) + s * p
    return p


@wp.func
def stencil(
    i: int,
    previous: wp.array(dtype=wp.int32),
    following: wp.array(dtype=wp.int32),
    position: wp.array(dtype=wp.vec3d),
    length: wp.array(dtype=wp.float64),
    tangent: wp.array(dtype=Any),
) -> Nodes:
    """Positions [m] of the four nodes of segment i as rows, unwrapped along the wire."""
    one = position[i]
    edge = length[i] * wp.vec3d(tangent[i])
    two = one + edge
    zero = one - edge
    before = previous[i]
    if before >= 0:
        zero = one - length[before] * wp.vec3d(tangent[before])
    three = two + edge
    after = following[i]
    if following[after] >= 0:
        three = two + length[after] * wp.vec3d(tangent[after])
    return wp.matrix_from_rows(zero, one, two, three)


@wp.func
def sag(nodes: Nodes, rest_bulge: wp.float64, m: wp.vec4d) -> wp.float64:
    """[m] bound on the distance of the curve from its chord: 4/27 of the slope differences at both ends, plus the bulge."""
    one = wp.float64(1.0)
    edge = row(nodes, 2) - row(nodes, 1)
    before = wp.length(m[0] * (row(nodes, 1) - row(nodes, 0)) + (m[1] - one) * edge)
    after = wp.length(m[3] * (row(nodes, 3) - row(nodes, 2)) + (m[2] - one) * edge)
    return MAX_SLOPE_WEIGHT * (before + after) + rest_bulge


@wp.func
def closest_on_chords(p1: wp.vec3d, p2: wp.vec3d, q1: wp.vec3d, q2: wp.vec3d) -> wp.vec2d:
    """Places (s, t) in 0 .. 1 of the closest points of two straight segments; of parallel ones, the middle of their overlap.

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
def chord_ends(curve: Powers) -> ChordEnds:
    """Points at equal steps of s [m], as rows."""
    ends = ChordEnds()
    s = wp.float64(0.0)
    for k in range(CHORD_ENDS):
        point = point_at(curve, s)
        for a in range(3):
            ends[k, a] = point[a]
        s += CHORD_STEP
    return ends


@wp.func
def sag_of_chords(curve: Powers, ends: ChordEnds) -> wp.float64:
    """[m] distance of the curve from its chords: CHORD_MARGIN times the largest one at the middle of a chord."""
    largest = wp.float64(0.0)
    s = wp.float64(0.5) * CHORD_STEP
    for k in range(CHORDS):
        between = wp.float64(0.5) * (row(ends, k) + row(ends, k + 1))
        largest = wp.max(largest, wp.length(point_at(curve, s) - between))
        s += CHORD_STEP
    return CHORD_MARGIN * largest


@wp.func
def curve_distance(p: Powers, q: Powers) -> wp.float64:
    """[m] bound on the distance of two curves: of CHORDS chords of each, less their sags."""
    of_p = chord_ends(p)
    of_q = chord_ends(q)
    least = wp.float64(1.0e30)
    for i in range(CHORDS):
        p1 = row(of_p, i)
        p2 = row(of_p, i + 1)
        for j in range(CHORDS):
            q1 = row(of_q, j)
            q2 = row(of_q, j + 1)
            near = closest_on_chords(p1, p2, q1, q2)
            least = wp.min(least, wp.length_sq(p1 + near[0] * (p2 - p1) - q1 - near[1] * (q2 - q1)))
    return wp.sqrt(least) - sag_of_chords(p, of_p) - sag_of_chords(q, of_q)
