"""Sums rows of partial sums to fewer rows, for one thread on a GPU (control.py)."""

import warp as wp

from .native_text import native_text

ROWS = 1024  # that become one
ROW_LANES = 256


@wp.func_native(native_text("sum_rows", globals()))
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
