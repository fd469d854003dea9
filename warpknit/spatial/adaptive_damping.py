"""Damping of a relaxation of rods: the critical damping of the slowest mode that still moves (numerics.renewed_damping).

The motion between two convergence checks gives Rayleigh's quotient by the fictitious masses, and the mean kinetic energy.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.host import fetch, store_at, zeros
from ..kernels.rod_checks import find_motion, keep_motion
from ..mechanics.numerics import FASTEST_DAMPING, renewed_damping
from .fictitious_masses import FictitiousMasses
from .rod_step import CHECK_STEPS, RodStepper

VIBRATION = 3.0  # speed of the whole motion over the mean motion, above which it counts
# largest speed that counts by diagonal masses over banded ones: smooth motion's grows with the nodes a loop, from
# 10 to 13 with 20 over 20 to 25 with 28 to 57 to 63 with 64
SMOOTH = 24.0
LEAST_DAMPING = 0.003  # [1/s] banded masses leave few modes slower than half of that


class AdaptiveDamping:
    """Renews the damping of worlds by their motion from check to check; measures its energy (kernels/rod_checks.py)."""

    KEPT = ("_last", "_has_last", "_last_slide")  # not the mean energy, which each check renews

    def __init__(self, stepper: RodStepper, masses: FictitiousMasses, *, has_history: bool, knows_smooth: bool) -> None:
        """has_history: whether wires slide or yield, also while they vibrate; knows_smooth: see `kinetic_energy`."""
        self._stepper, self._masses, self._knows_smooth = stepper, masses, knows_smooth
        self._vibration = 1.0 if has_history else VIBRATION
        nodes, device = stepper.rods.node_count, stepper.device
        self._last: dict[str, wp.array] = {  # [node] state at the last check; once `find_motion` has run, the motion since then
            "last_place": zeros(nodes, wp.vec3d, device),  # [m]
            "last_force": zeros(nodes, wp.vec3d, device),  # [N]
            "last_angle": zeros(nodes, wp.float64, device),  # [rad]
            "last_torque": zeros(nodes, wp.float64, device),  # [N m]
        }
        self._partial = zeros(len(stepper.arrays.block_first), wp.float64, device)  # [block]
        self._launch = stepper.launcher()
        # [world]
        self._has_last = np.zeros(stepper.worlds, dtype=bool)  # whether the state at the last check is known
        self._last_slide = np.zeros_like(self._slide())  # see `_slide`, at the last check
        self._mean_energy = np.full(stepper.worlds, np.nan)  # [J] kinetic energy of the mean motion since then, where known

    def renew(self, rows: np.ndarray, *, boundary: tuple[np.ndarray, np.ndarray] | None = None) -> None:
        """Renew the damping by the motion since the last check; in the state last evaluated.

        boundary: [row] [J] motion of the strains times the change of their forces, and twice the kinetic energy of that motion.
        """
        self._mean_energy[rows] = np.nan
        has_last = self._has_last[rows]
        rows = rows[has_last]
        if not len(rows):
            return
        stepper, steering = self._stepper, self._stepper.steering
        self._launch("motion", find_motion, partial=self._partial, **self._last)
        work = stepper.sums.total(fetch(self._partial)[:, None], rows)[:, 0]
        self._has_last[rows] = False
        if len(self._last_slide):  # both nodes move, and carry the mass; the force counts once
            place, force = (self._slide() - self._last_slide).T
            by_world = (value.reshape(stepper.worlds, -1) for value in (place, force))
            work += np.array([float(p @ f) for p, f in zip(*by_world, strict=True)])[rows]
            store_at(self._last["last_place"], (stepper.clamps.sliding_node, 1), place[:, None])
        moved = self._masses.twice_energy(self._last["last_place"], self._last["last_angle"], "moved", rows)
        if boundary is not None:
            work, moved = work + boundary[0][has_last], moved + boundary[1][has_last]
        self._mean_energy[rows] = 0.5 * moved / CHECK_STEPS**2
        steering.set(rows, damping=renewed_damping(steering.damping[rows], -work, moved, LEAST_DAMPING))

    def _slide(self) -> np.ndarray:
        """(sliding clamp, 2) [m] places of the sliding clamps, and [N] their forces."""
        clamps = self._stepper.clamps
        return np.zeros((0, 2)) if clamps is None else np.stack([clamps.place, clamps.force[:, 1]], axis=1)

    def kinetic_energy(self, rows: np.ndarray) -> np.ndarray:
        """[row] [J] of the mean motion since the last check; after a move from outside, of all motion.

        Where a contact comes and goes, its nodes vibrate about an equilibrium. Vibrations count VIBRATION times less, with
        diagonal masses, which overestimate smooth motion (SMOOTH). knows_smooth: motion with equal energies by banded masses and
        mean motion is no vibration: a loose mesh drifts for long with hardly any force.
        """
        whole, mean = 0.5 * self._stepper.steering.kinetic_twice[rows], self._mean_energy[rows]
        vibrates = ~(whole / self._vibration**2 <= mean)
        if vibrates.any():
            banded = 0.5 * self._masses.twice_kinetic_energy(rows)
            if self._knows_smooth:
                vibrates &= ~(banded / self._vibration**2 <= mean)
            whole = np.where(vibrates, np.minimum(whole, SMOOTH**2 * banded), whole)
        by_all = np.where(np.isnan(mean), whole, np.fmax(mean, whole / self._vibration**2))
        return np.where(vibrates, by_all, mean)

    def keep_motion(self, rows: np.ndarray) -> None:
        """Keep the state last evaluated for the next `renew`; velocities become kinetic energy in the control array."""
        self._launch("keep", keep_motion, **self._last)
        self._has_last[rows], self._last_slide = True, self._slide()
        self._stepper.steering.set(rows, kinetic_twice=self._masses.twice_kinetic_energy(rows))

    def stop_motion(self, rows: np.ndarray) -> None:
        """Stop all motion, after the state was moved from outside."""
        stepper, state, clamps = self._stepper, self._stepper.state, self._stepper.clamps
        stepper.steering.set(rows, damping=FASTEST_DAMPING, speed_max=0.0)
        for speed in (state.velocity, state.spin, *([] if clamps is None else [clamps.velocity])):
            stepper.store_rows(speed, rows, 0.0)
        self.reset(rows)

    def reset(self, rows: np.ndarray) -> None:
        """Start the estimate anew, after the state was moved from outside; velocities are kept."""
        self._has_last[rows] = False
