"""Rows of partial sums become fewer, on a GPU before one thread adds what is left (control.py)."""

import warp as wp

from warpknit.kernels.native import SHARING, STEERING, SUM_OF_LANES, constants

ROWS = 1024  # that become one
ROW_LANES = 256

_SUM = (
    STEERING
    + SHARING
    + constants(ROWS=ROWS)
    + r"""
    const int begin = ROWS * group, left = partial.shape[0] - begin, count = left < ROWS ? left : ROWS;
    double kinetic = 0, fastest = 0, strongest = 0, square = 0;
    EVERY(k, 0, count) {
        const double* part = partial.data + PARTIAL_COUNT * (size_t)(begin + k);
        kinetic += part[KINETIC_PART];
        fastest = part[SPEED_PART] > fastest ? part[SPEED_PART] : fastest;
        strongest = part[STRONGEST_PART] > strongest ? part[STRONGEST_PART] : strongest;
        square += part[FORCE_PART];
    }
    double* row = fewer.data + PARTIAL_COUNT * group;
"""
    + SUM_OF_LANES
)


@wp.func_native(_SUM)
def sum_group(
    # in
    group: wp.int32,
    lane: wp.int32,
    partial: wp.array2d(dtype=wp.float64),
    # out
    fewer: wp.array2d(dtype=wp.float64),
): ...


@wp.kernel
def sum_rows(
    # in
    threads_a_block: int,
    partial: wp.array2d(dtype=wp.float64),
    # out: a row for ROWS of them
    fewer: wp.array2d(dtype=wp.float64),
):
    """`threads_a_block` threads for ROWS rows; the order in which they are added is fixed."""
    thread = wp.tid()
    sum_group(thread / threads_a_block, thread % threads_a_block, partial, fewer)
