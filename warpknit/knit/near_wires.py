"""Where wires of a repeat are near each other in space, by samples of their centre lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from .centreline import Thread

PARTS = 4  # of the reach, between samples: distances are too large by up to 2 %
OWN_REACH = 4.0  # places of one wire that are nearer along it, over the reach, are neighbours


def near_wires(
    threads: Sequence[Thread], size: NDArray[np.float64], reach: float
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Distances (pair,) [m] of places within reach [m] of each other, and their stitches (pair, 2)."""
    strides = [max(1, int(reach / (PARTS * thread.spacing))) for thread in threads]
    points, stitch, wire, arc = (
        np.concatenate(parts)
        for parts in zip(
            *(
                (
                    thread.points[::stride],
                    thread.stitch[::stride],
                    np.full(len(thread.points[::stride]), number),
                    thread.spacing * np.arange(0, len(thread.points), stride),
                )
                for number, (thread, stride) in enumerate(zip(threads, strides, strict=True))
            ),
            strict=True,
        )
    )
    lowest, height = points[:, 2].min(), np.ptp(points[:, 2])
    box = np.array([*size, 2.0 * (height + reach)])
    placed = np.mod(points - [0.0, 0.0, lowest], box)
    tree = cKDTree(np.where(placed < box, placed, 0.0), boxsize=box)  # rounding may place a point at the far side
    first, second = tree.query_pairs(reach, output_type="ndarray").T
    along = np.abs(arc[first] - arc[second])
    along = np.minimum(along, np.array([thread.length for thread in threads])[wire[first]] - along)
    apart = (wire[first] != wire[second]) | (along > OWN_REACH * reach)
    first, second = first[apart], second[apart]
    offset = np.abs(points[first] - points[second])
    offset[:, :2] = np.abs(offset[:, :2] - np.round(offset[:, :2] / size) * size)
    return np.linalg.norm(offset, axis=1), np.stack([stitch[first], stitch[second]], axis=1)
