"""Sums over contacts at a convergence check, and bounds on their stiffness (kernels/contact_checks.py)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from ..compute.host import fetch
from ..compute.team import SharedLaunches
from ..kernels import contact_checks as k
from ..kernels.rod_stress import sum_contact_stress, sum_segment_stress
from .contact_arrays import TouchArrays
from .pair_search import PairList
from .rest_curve import RestCurve
from .rod_step import RodStepper

STICK_SHARE = 0.5  # tangential over normal stiffness


@dataclass(frozen=True)
class ContactSums:
    """Sums over the contacts with a force in the state last evaluated; [world] of those asked for."""

    mean_push: np.ndarray  # [N] mean force of those that push; 0 without any
    pushing: np.ndarray  # contacts that push
    overlap_max: np.ndarray  # [m] largest overlap or gap; of forces below the mean, in proportion; not of saddles
    overlap_square: np.ndarray  # [m2] squares of the same, summed


class ContactChecks:
    """Sums over all contacts of a stepper, the same for any number of threads."""

    def __init__(self, stepper: RodStepper, wires: object, curve: RestCurve, *, has_friction: bool) -> None:
        """wires: rest data for contact, on the device; curve: the one on which wires touch."""
        self._stepper, self._wires, self._has_friction = stepper, wires, has_friction
        rods = stepper.rods
        self._of_wires = {
            "thickness": wp.float64(rods.section.thickness),
            "thickest": wp.float64(max(2.0 * rods.radius_beside, float(rods.of_wires("thickness").max()))),
        }
        stepper.steering.set(weight_square=curve.weight_square, lever=curve.lever)
        # by list of pairs: two alternate
        self._recorded: dict[tuple[int, int], SharedLaunches] = {}
        blocks, device = len(stepper.arrays.block_first), stepper.device
        self._segment_stress, self._contact_stress = (wp.zeros(blocks, dtype=wp.vec4d, device=device) for _ in range(2))
        self._partial = wp.zeros((blocks, k.CONTACT_COLUMNS), dtype=wp.float64, device=device)

    def use(self, pairs: PairList, touch: TouchArrays) -> None:
        """Read these lists from now on."""
        key = pairs.number, touch.capacity
        if key not in self._recorded:
            kept = [one for one in self._recorded if one[1] == touch.capacity][-1:]
            self._recorded = {one: self._recorded[one] for one in kept}
            self._recorded[key] = SharedLaunches(self._stepper.team, self._stepper.device, self._stepper.few)
        self._launches, self._touch, self._pairs = self._recorded[key], touch, pairs

    def launch(self, kernel: wp.Kernel, *sources: object, **named: Any) -> None:
        """Launch a kernel for the own blocks or nodes, on the lists in use."""
        every = (self._wires, self._touch, self._pairs, *sources)
        self._stepper.share_launch(self._launches, kernel.key, kernel, *every, **named)

    def sums(self, rows: np.ndarray | None = None) -> ContactSums:
        """Sums over contacts with a force in the last evaluated state; all worlds or `rows`."""
        sums = self._stepper.sums
        rows = self._stepper.rows if rows is None else rows

        def total() -> np.ndarray:
            self.launch(k.sum_contacts, contact_partial=self._partial)
            return sums.total(fetch(self._partial), rows)

        pushing, force = total()[:, [int(k.PUSHING), int(k.PUSH_SUM)]].T
        mean = np.divide(force, pushing, out=np.zeros(len(rows)), where=pushing > 0.0)
        self._stepper.steering.set(rows, mean_push=np.maximum(mean, 1e-300))
        square = total()[:, int(k.ERROR_SQUARE)]
        return ContactSums(mean, pushing, sums.largest(fetch(self._partial), rows)[:, int(k.ERROR_MAX)], square)

    def stress(self, rows: np.ndarray) -> np.ndarray:
        """(world, 2, 2) [N m] of segments and contacts, in the state last evaluated (kernels/rod_stress.py)."""
        self.launch(sum_segment_stress, segment_stress=self._segment_stress)
        self.launch(sum_contact_stress, contact_stress=self._contact_stress, has_friction=int(self._has_friction))
        parts = np.concatenate([fetch(self._segment_stress), fetch(self._contact_stress)], axis=1)
        total = self._stepper.sums.total(parts, rows)
        return np.asarray(total[:, :4] + total[:, 4:]).reshape(-1, 2, 2)

    def bound_stiffness(self, rows: np.ndarray) -> None:
        """Write bounds on the stiffness of contacts into `sweep` of the state. Up to the gap of the last evaluation."""
        steering = self._stepper.steering
        steering.set(rows, sticking=STICK_SHARE * steering.contact_stiffness[rows] if self._has_friction else 0.0)
        self.launch(k.bound_contact_stiffness, **self._of_wires)
