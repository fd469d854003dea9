"""Sums over the mesh on a GPU, in stages: rows of partial sums become fewer, in the same order always."""

from __future__ import annotations

import math

import warp as wp

from ..kernels.control import PARTIAL_COUNT
from ..kernels.row_sums import ROW_LANES, ROWS, sum_rows
from .host import is_in_place
from .launch import Launch, bind

FEW_ROWS = 64  # that one thread adds


def fewer_rows(partial: wp.array) -> tuple[list[Launch], wp.array]:
    """Launches that add up rows (row, PARTIAL_COUNT), and the at most FEW_ROWS rows that they leave.

    None on the CPU, where a single thread adds them as fast.
    """
    launches: list[Launch] = []
    while not is_in_place(partial.device) and len(partial) > FEW_ROWS:
        rows = math.ceil(len(partial) / ROWS)
        fewer = wp.zeros((rows, int(PARTIAL_COUNT)), dtype=wp.float64, device=partial.device)
        launches.append(bind(sum_rows, rows * ROW_LANES, threads_a_block=ROW_LANES, partial=partial, fewer=fewer))
        partial = fewer
    return launches, partial
