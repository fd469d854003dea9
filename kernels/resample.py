"""Values along wires at the nodes of another division of the same wires.

Node j of a wire stands at the place begin + step j of the other division, counted in its nodes. Its value is a cubic through the
four nearest nodes. Values of segments stand half a node behind.
"""

import warp as wp


@wp.func
def cubic_weights(t: wp.float64) -> wp.vec4d:
    """Weights of four values at 0, 1, 2, 3 in their cubic at t."""
    one = wp.float64(1.0)
    two = wp.float64(2.0)
    three = wp.float64(3.0)
    return wp.vec4d(
        -(t - one) * (t - two) * (t - three) / wp.float64(6.0),
        t * (t - two) * (t - three) / two,
        -t * (t - one) * (t - three) / two,
        t * (t - one) * (t - two) / wp.float64(6.0),
    )


@wp.kernel
def resample_along_wires(
    # in: wires of both divisions, open
    node_wire: wp.array(dtype=wp.int32),
    wire_first: wp.array(dtype=wp.int32),
    other_first: wp.array(dtype=wp.int32),
    other_count: wp.array(dtype=wp.int32),
    wire_begin: wp.array(dtype=wp.float64),
    wire_step: wp.array(dtype=wp.float64),
    # in: 1 for values of segments, else 0
    of_segments: int,
    # in: values of the other division
    other: wp.array(dtype=wp.float64),
    # out
    value: wp.array(dtype=wp.float64),
):
    """One thread a node; places beyond the ends take the value of the end."""
    i = wp.tid()
    wire = node_wire[i]
    half = wp.float64(0.5) * wp.float64(of_segments)
    last = other_count[wire] - 1 - of_segments
    place = wire_begin[wire] + wire_step[wire] * (wp.float64(i - wire_first[wire]) + half) - half
    place = wp.clamp(place, wp.float64(0.0), wp.float64(last))
    begin = wp.clamp(int(wp.floor(place)) - 1, 0, last - 3)
    w = cubic_weights(place - wp.float64(begin))
    at = other_first[wire] + begin
    value[i] = w[0] * other[at] + w[1] * other[at + 1] + w[2] * other[at + 2] + w[3] * other[at + 3]
