"""Arrays of contact: rest data of the wires and pairs of segments that may touch, on the device; contacts on the host."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from ..compute.arrays import Precision, array, new_arrays
from ..compute.host import fetch, is_in_place, shared, store
from ..kernels.wire_closest import PLACES
from ..kernels.wire_curve import Bump
from .rest_curve import RestCurve
from .rods import Rods

SLIPS = 2  # elastic slips of a pair: one for each minimum of the distance
SLIP_ARRAYS = ("slip_step", "slip_place", "elastic_slip")


@dataclass(frozen=True)
class WireArrays:
    """Rest data for contact, with the curve on which wires touch."""

    node_arc: wp.array = array(wp.float64)  # [m]
    node_radius: wp.array = array(wp.float64)  # [m]
    rest_slope: wp.array = array(wp.vec2d)
    rest_bump: wp.array = array(Bump)
    rest_bulge: wp.array = array(wp.float64)
    slope_weight: wp.array = array(wp.vec4d)
    wire_length: wp.array = array(wp.float64, "wire")  # [m]
    wire_period: wp.array = array(wp.vec3d, "wire")  # [m]

    @staticmethod
    def of(rods: Rods, curve: RestCurve, device: str) -> WireArrays:
        """Arrays of rods that touch on a curve."""
        values = {"node_arc": rods.arc, "node_radius": rods.wire_radius[rods.wire_of], "slope_weight": curve.slope_weight}
        values |= {f"rest_{name}": getattr(curve, name) for name in ("slope", "bump", "bulge")}
        return new_arrays(WireArrays, device, {}, values | {"wire_length": rods.wire_length, "wire_period": rods.wire_period})


@dataclass(frozen=True)
class TouchArrays:
    """Pairs of segments that may touch, with forces and places (kernels/wire_contact_forces.py).

    Pairs are in the order of their first segments; `touch_of_second` lists them in the order of their second segments.
    """

    capacity: int
    touch_pair: wp.array = array(wp.int32, "touch")  # in the list of all pairs
    touch_count: wp.array = array(wp.int32, "one")
    touch_awake: wp.array = array(wp.int32, "touch")  # those to look at: all, on a GPU those that do not sleep
    touch_awake_count: wp.array = array(wp.int32, "one")
    touch_left: wp.array = array(wp.int32, "touch")  # of these to search: all, on a GPU those that do not go on from before
    touch_left_count: wp.array = array(wp.int32, "one")
    touch_found: wp.array = array(wp.int32, "touch")  # contacts that need forces: all; on a GPU only those that touch
    touch_found_count: wp.array = array(wp.int32, "one")
    touch_first_start: wp.array = array(wp.int32, "start")
    touch_second_start: wp.array = array(wp.int32, "start")
    touch_of_second: wp.array = array(wp.int32, "touch")
    touch_followed: wp.array = array(wp.int32, "touch")  # what goes on from the step before (kernels/wire_contact_by_batch.py)
    touch_loaded: wp.array = array(wp.int32, "touch")  # 0 where there is no force
    touch_force: wp.array = array("vec3", "node")  # [8 touch] [N] on the four nodes of either segment
    touch_couple: wp.array = array("vec3", "section")  # [6 touch] [N m] on three sections of either segment
    # of each place of a pair, PLACES a touch
    touch_overlap: wp.array = array(wp.float64, "place")  # [m]
    touch_normal_force: wp.array = array(wp.float64, "place")  # [N]
    touch_friction: wp.array = array(wp.vec3d, "slip")  # [N] on the first wire; not without friction
    touch_normal: wp.array = array(wp.vec3d, "place")  # towards the first wire
    touch_slip_work: wp.array = array(wp.float64, "slip")  # [J] of slip beyond the Coulomb limit, of an increment or in real time

    @staticmethod
    def of(nodes: int, device: str, precision: Precision, capacity: int = 1, *, with_friction: bool = False) -> TouchArrays:
        """Empty ones."""
        counts = {"touch": capacity, "one": 1, "start": nodes + 1, "node": 8 * capacity, "section": 6 * capacity}
        counts |= {"place": PLACES * capacity, "slip": PLACES * capacity if with_friction else 1}
        values: dict[str, object] = {"capacity": capacity}
        if is_in_place(device):
            every, count = (shared(np.arange(n, dtype=np.int32), wp.int32, device) for n in (capacity, 1))
            values |= {"touch_awake": every, "touch_left": every, "touch_found": every}
            values |= dict.fromkeys(("touch_count", "touch_awake_count", "touch_left_count", "touch_found_count"), count)
        return new_arrays(TouchArrays, device, counts, values, precision)


@dataclass(frozen=True)
class SlipArrays:
    """Elastic slips of listed pairs, two contacts each; double-buffered by the parity of the step.

    Rounding to single precision changes a slip by 6e-8 of its size. In a relaxation it is rounded once an equilibrium.
    """

    capacity: int  # pairs
    slip_step: wp.array = array(wp.int32, "slip")  # that the slip is for; -1 where there is none
    slip_place: wp.array = array(wp.vec2, "slip")
    elastic_slip: wp.array = array(wp.vec3, "slip")  # [m]

    @staticmethod
    def of(capacity: int, device: str) -> SlipArrays:
        """No slips, of up to `capacity` pairs."""
        slips = new_arrays(SlipArrays, device, {"slip": (2, SLIPS * capacity)}, {"capacity": capacity})  # type: ignore[dict-item]
        store(slips.slip_step, -1)
        return slips

    def keep(self, half: int, begin: int, end: int) -> None:
        """Copy entries of pairs `begin` to `end` to this half from the other one."""
        first, count = SLIPS * begin, SLIPS * (end - begin)
        if count > 0:  # a copy of none would be one of all
            for entries in (getattr(self, name) for name in SLIP_ARRAYS):
                wp.copy(entries[half], entries[1 - half], first, first, count)

    def state_dict(self, begin: int, end: int) -> dict[str, np.ndarray]:
        """Arrays of pairs `begin` to `end` for a checkpoint."""
        return {name: fetch(getattr(self, name))[:, SLIPS * begin : SLIPS * end] for name in SLIP_ARRAYS}

    def load_state_dict(self, kept: dict[str, np.ndarray], others: SlipArrays, begin: int, end: int) -> None:
        """Restore what `state_dict` returned, in place of these pairs of `others`."""
        for name in SLIP_ARRAYS:
            values, other = fetch(getattr(self, name)).copy(), fetch(getattr(others, name))
            parts = other[:, : SLIPS * begin], kept[name], other[:, SLIPS * end :]
            new = np.concatenate(parts, axis=1)[:, : values.shape[1]]
            values[:, : new.shape[1]] = new
            store(getattr(self, name), values)


def take_turns(one: tuple[int, ...], other: tuple[int, ...]) -> bool:
    """Whether lists of two versions (number, capacity) are used in turn.

    A list that has grown keeps the parity of its number.
    """
    return one[1:] == other[1:] and (one[0] - other[0]) % 2 == 1


@dataclass(frozen=True)
class Contacts:
    """Contacts on the host; arrays [contact]. `first` and `second` are the first nodes of the two segments.

    Two contacts of the same segments with different shifts are contacts with different periodic images.

    A saddle between two contacts of a pair counts as a contact with a negative force (kernels/wire_weights.py).
    """

    first: np.ndarray
    second: np.ndarray
    place: np.ndarray  # (contact, 2) on the segments, 0 .. 1
    shift: np.ndarray  # (contact, 3) [m] at rest, periodic shift of the second segment next to the first
    force: np.ndarray  # [N] normal
    friction: np.ndarray  # (contact, 3) [N] on the first
    normal: np.ndarray  # (contact, 3) towards the first
    overlap: np.ndarray  # [m] negative: gap

    @property
    def push(self) -> np.ndarray:
        """(contact, 3) [N] force on the first wire."""
        return np.asarray(self.force[:, None] * self.normal + self.friction)
