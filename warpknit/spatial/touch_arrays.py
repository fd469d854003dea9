"""Pairs of segments that may touch, on the device: what contact finds in a step, and where the forces of a segment stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..compute.host import is_in_place, shared, zeros
from ..compute.precision import DOUBLE, Precision
from ..kernels.wire_closest import PLACES
from .rods import Rods


@dataclass(frozen=True)
class TouchArrays:
    """Pairs of segments that may touch, with forces and places (kernels/wire_contact_forces.py).

    A pair is a first segment's by its own number, and a second segment's by `touch_of_second`.
    """

    touch_pair: wp.array  # [touch] int, in the list of all pairs
    touch_count: wp.array  # [1]
    touch_awake: wp.array  # [touch] int, those to look at: all, on a GPU those that do not sleep
    touch_awake_count: wp.array  # [1]
    touch_left: wp.array  # [touch] int, of these those to search: all, on a GPU those that do not go on from the step before
    touch_left_count: wp.array  # [1]
    touch_found: wp.array  # [touch] int, contacts that need forces: all; on a GPU only those that touch
    touch_found_count: wp.array  # [1]
    touch_first_start: wp.array  # [node + 1] int
    touch_second_start: wp.array  # [node + 1]
    touch_of_second: wp.array  # [touch] int
    touch_followed: wp.array  # [touch] int, what goes on from the step before (kernels/wire_contact_by_batch.py)
    touch_loaded: wp.array  # [touch] int, 0 where there is no force
    touch_force: wp.array  # [8 touch] vec3d [N] on the four nodes of either segment
    touch_couple: wp.array  # [6 touch] vec3d [N m] on three sections of either segment
    # of each place of a pair, PLACES a touch
    touch_overlap: wp.array  # [m]
    touch_normal_force: wp.array  # [N]
    touch_friction: wp.array  # vec3d [N] on the first wire; not without friction
    touch_normal: wp.array  # vec3d towards the first wire
    touch_slip_work: wp.array  # [J] of slip beyond the Coulomb limit, of an increment or in real time; not without friction

    @property
    def capacity(self) -> int:
        return self.touch_pair.shape[0]

    @staticmethod
    def of(nodes: int, capacity: int, device: str, precision: Precision = DOUBLE, *, with_friction: bool = False) -> TouchArrays:
        """Empty ones."""

        def whole(count: int) -> wp.array:
            return zeros(count, wp.int32, device)

        def reals(count: int) -> wp.array:
            return zeros(count, wp.float64, device)

        def vectors(count: int) -> wp.array:
            return zeros(count, wp.vec3d, device)

        places, count = PLACES * capacity, whole(1)
        pairs = shared(np.arange(capacity, dtype=np.int32), wp.int32, device), count
        awake, left, found = 3 * (pairs,) if is_in_place(device) else [(whole(capacity), whole(1)) for _ in range(3)]
        return TouchArrays(
            whole(capacity), count, *awake, *left, *found, whole(nodes + 1), whole(nodes + 1), whole(capacity), whole(capacity),
            whole(capacity),
            zeros(8 * capacity, precision.vec3, device), zeros(6 * capacity, precision.vec3, device),
            reals(places), reals(places),
            vectors(places if with_friction else 1), vectors(places), reals(places if with_friction else 1),
        )  # fmt: skip


def no_contact(rods: Rods, device: str, precision: Precision = DOUBLE) -> TouchArrays:
    """No pairs."""
    return TouchArrays.of(rods.node_count, 1, device, precision)
