"""Arrays on the device that only the convergence checks of rods need."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..compute.host import shared
from ..kernels.rod_checks import STATE_COLUMNS
from .rods import Rods


@dataclass(frozen=True)
class CheckArrays:
    """What the checks of rods need beside their rest data and their state; [node] unless noted."""

    KEPT = ("thermal_strain", "last_place", "last_force", "last_angle", "last_torque")

    bow_weight: wp.array  # vec2d, see Rods.bow_weights
    bow_at_rest: wp.array  # relative excess of the arc over the chord of each segment as knitted
    thermal_strain: wp.array  # of the segments, relative to the length factor
    is_sliding: wp.array  # int, 1 where a clamp moves the node
    stiffening: wp.array  # [wire] by which the softened stiffness of a wire is multiplied
    # state at the last check; from `motion` on the motion since then
    last_place: wp.array  # vec3d [m]
    last_force: wp.array  # vec3d [N]
    last_angle: wp.array  # [rad]
    last_torque: wp.array  # [N m]
    state_partial: wp.array  # [block, STATE_COLUMNS]
    partial: wp.array  # [block]


def check_arrays(rods: Rods, sliding: np.ndarray, bow_at_rest: np.ndarray, blocks: int, device: str) -> CheckArrays:
    """Arrays for so many blocks of nodes; sliding: nodes of clamps that move; bow_at_rest [node]."""
    nodes = rods.node_count
    is_sliding = np.zeros(nodes, dtype=np.int32)
    is_sliding[sliding] = 1

    def reals(count: int = nodes) -> wp.array:
        return wp.zeros(count, dtype=wp.float64, device=device)

    def vectors() -> wp.array:
        return wp.zeros(nodes, dtype=wp.vec3d, device=device)

    return CheckArrays(
        bow_weight=wp.array(np.stack(rods.bow_weights, axis=1), dtype=wp.vec2d, device=device),
        bow_at_rest=shared(bow_at_rest, wp.float64, device),
        thermal_strain=reals(),
        is_sliding=wp.array(is_sliding, dtype=wp.int32, device=device),
        stiffening=reals(len(rods.wire_first)),
        last_place=vectors(),
        last_force=vectors(),
        last_angle=reals(),
        last_torque=reals(),
        state_partial=wp.zeros((blocks, STATE_COLUMNS), dtype=wp.float64, device=device),
        partial=reals(blocks),
    )
