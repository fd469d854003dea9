"""Strains of directions given by tension, as unknowns of the relaxation (kernels/control.py): what checks need for it.

A step adds up its own nominal stress, in counts whose sum does not depend on threads, ranks or worlds. A convergence check renews
the masses of the strains from the affine stiffness, and takes their motion into the estimate of the damping.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..measure import tension_scale
from ..measure.strain import clamp_rotation, rotation, stretch, true_stress

COUNTS = 2.0**58  # of EA times the length of all wires: whole numbers in float64 up to a mean strain of 3 %, which no wire takes
STRAIN_LIMIT = 3e-4  # of a step
FAST = 0.5  # of that limit: faster strains count as loading
MASS = 1.0  # over the affine stiffness; from 0.5 to 2 the steps are the same
LEAST_STIFFNESS = 0.02  # of EI/C^3: of a slack mesh
PROBE, PROBE_CHECKS = 1e-4, 4  # strain of the affine stiffness, well above round-off, and convergence checks between two of them
TOLERANCE = 2e-3  # of a tension, relative to the wanted one or to half of the larger tension; at most
TOLERANCE_SHARE = 1.0 / 3.0  # the same over the residual tolerance: soft meshes answer heat by few tolerances of their strain
ENDLESS = 5.0  # strain beyond which a mesh does not carry its tension: yarns of a knit are straight long before
LEAST_TENSION = 0.01  # of EI/C^3: below it tensions count as zero


class DrivenStrain:
    """Strains of worlds; arrays (world, direction), weft and warp."""

    KEPT = ("wanted", "_mass", "_stiffness", "_checks", "_begun", "_last_strain", "_last_force", "carried", "tension", "largest")

    def __init__(self, group: Any, worlds: int, rigidity: float) -> None:
        """group: the `Worlds` (worlds.py) of these strains; rigidity [N m]: sum of EA times length over the wires of a world."""
        model = group.model
        self._group, self._steering = group, group.steering
        self._area, self._clamp_share = model.panel.area, model.panel.clamp_share  # [m2] at rest; (2,) of the size
        self._scale = tension_scale(model)  # [N/m] EI/C^3
        self.tolerance = min(TOLERANCE, TOLERANCE_SHARE * model.scene.solver.residual_tolerance)
        self.wanted = np.full((worlds, 2), np.nan)  # [N/m] over the whole size, where a direction is given by tension
        self.tension, self.largest = np.zeros((2, worlds, 2))  # [N/m] at the last check, and largest of an equilibrium
        self._mass = np.ones((worlds, 2))  # [N/m]
        self._stiffness = np.zeros((worlds, 2, 2))  # [N/m] change of tensions by strains that all nodes follow
        # convergence checks of all levels, so that worlds that begin together probe together; and when this level began
        self._checks, self._begun = np.zeros((2, worlds), dtype=int)
        self._last_strain, self._last_force = np.full((2, worlds, 2), np.nan)  # at the last convergence check
        self.carried = np.zeros((worlds, 2))  # [N/m] by the affine stiffness, by which strains have changed tensions
        self._steering.set(
            None, cell_area=self._area, stress_unit=rigidity / COUNTS, strain_limit=STRAIN_LIMIT,
            strain_range=model.scene.history_increment,
        )  # fmt: skip

    def driven(self, rows: np.ndarray) -> np.ndarray:
        """(row, 2) bool: directions given by tension."""
        return np.isfinite(self.wanted[rows])

    def at_limit(self, rows: np.ndarray) -> np.ndarray:
        """(row, 2) bool: directions whose strain has changed by as much as a history allows until the next equilibrium."""
        return np.asarray(self._steering.at_limit[rows] > 0.0) & self.driven(rows)

    def is_fast(self, rows: np.ndarray) -> np.ndarray:
        """[row] whether strains move as fast as while a load is applied."""
        return np.asarray(np.abs(self._steering.strain_speed[rows]).max(axis=1) > FAST * STRAIN_LIMIT)

    def is_endless(self, rows: np.ndarray) -> np.ndarray:
        """[row] whether a mesh has been strained without carrying its tension."""
        return np.asarray((self.driven(rows) & (self._strain(rows) > ENDLESS)).any(axis=1))

    def found(self, rows: np.ndarray) -> None:
        """Note that worlds are in equilibrium."""
        self.largest[rows] = np.maximum(self.largest[rows], self.tension[rows] / self._clamp_share)

    def forget(self, rows: np.ndarray) -> None:
        """Let strains of worlds without a history change freely again until the next equilibrium."""
        driven = rows[self.driven(rows).any(axis=1)]
        if len(driven):
            self._steering.set(driven, strain_origin=self._strain(driven), at_limit=0.0)

    # --- tensions

    def _strain(self, rows: np.ndarray) -> np.ndarray:
        """(row, 2) strains of the boundary."""
        return np.diagonal(stretch(self._steering.gradient[rows]), axis1=1, axis2=2) - 1.0

    def _tension(self, rows: np.ndarray, stress: np.ndarray) -> np.ndarray:
        """(row, 2) [N/m] true tensions of nominal stresses (row, 2, 2) [N/m]."""
        gradient = self._steering.gradient[rows]
        angle = clamp_rotation(gradient)
        if angle.any():
            stress, gradient = rotation(angle) @ stress, stretch(gradient)
        return np.diagonal(true_stress(stress, gradient), axis1=1, axis2=2)

    def _probe(self, rows: np.ndarray) -> None:
        """Renew the affine stiffness of worlds, and the masses of their strains; they are to be evaluated anew."""
        gradient = self._steering.gradient[rows]
        back, now = np.swapaxes(rotation(clamp_rotation(gradient)), 1, 2), stretch(gradient)
        both = np.zeros((2, 2, len(rows), 2))  # side, sign
        for side, sign in np.ndindex(2, 2):
            there = now.copy()
            there[:, side, side] += PROBE * (1 - 2 * sign)
            self._steering.set(rows, gradient=back @ there)
            both[side, sign] = self._tension(rows, self._group.stress_at(rows))
        self._steering.set(rows, gradient=gradient)
        self._stiffness[rows] = np.moveaxis((both[:, 0] - both[:, 1]) / (2.0 * PROBE), 0, 2)
        stiffness = np.abs(self._stiffness[rows]).sum(axis=2)
        self._mass[rows] = MASS * np.maximum(stiffness, LEAST_STIFFNESS * self._scale)
        self._steering.set(rows, strain_mass=self._mass[rows])

    # --- levels

    def begin(self, rows: np.ndarray, wanted: np.ndarray) -> None:
        """Begin loads of worlds: from the tension now to the `wanted` one (row, 2) [N/m], nan where a strain is given."""
        self.wanted[rows] = wanted * self._clamp_share
        self._begun[rows] = self._checks[rows]
        self._last_strain[rows] = np.nan
        own = rows[np.isfinite(wanted).any(axis=1)]
        origin = self._strain(rows)
        self._steering.set(rows, is_driven=0.0, strain_speed=0.0, at_limit=0.0, strain_origin=origin)
        if not len(own):
            return
        self.tension[own] = self._tension(own, self._group.stress_at(own))
        self._probe(own)
        driven = self.driven(own)
        begin = np.where(driven, self.tension[own], 0.0)
        self._steering.set(own, is_driven=driven, tension_from=begin, tension_to=np.where(driven, self.wanted[own], 0.0))

    # --- convergence checks

    def renew_masses(self, rows: np.ndarray) -> None:
        """Renew the masses of the strains where it is time to; before the evaluation of a check."""
        checks = self._checks[rows]
        is_due = (checks % PROBE_CHECKS == 0) & (checks >= self._begun[rows] + PROBE_CHECKS)
        due = rows[self.driven(rows).any(axis=1) & is_due]
        if len(due):
            self._probe(due)
        self._checks[rows] += 1

    def motion(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Motion of the strains since the last check times the change of their forces [row] [J]; twice its kinetic energy.

        The tensions belong to the state last evaluated.
        """
        work, energy, driven = np.zeros(len(rows)), np.zeros(len(rows)), self.driven(rows)
        which = driven.any(axis=1)
        if not which.any():
            return work, energy
        own, driven = rows[which], driven[which]
        strain, tension = self._strain(own), self._tension(own, self._group.stress_now(own))
        force = np.where(driven, tension * (1.0 + strain[:, ::-1]), 0.0)
        is_known = np.isfinite(self._last_strain[own]) & driven
        moved = np.where(is_known, strain - self._last_strain[own], 0.0)
        work[which] = -self._area * np.sum(moved * np.where(is_known, force - self._last_force[own], 0.0), axis=1)
        energy[which] = self._area * np.sum(self._mass[own] * moved**2, axis=1)
        self.tension[own], self._last_strain[own], self._last_force[own] = tension, strain, force
        self.carried[own] += np.diagonal(self._stiffness[own], axis1=1, axis2=2) * moved
        return work, energy

    def ratio(self, rows: np.ndarray) -> np.ndarray:
        """[row] what tensions lack over its tolerance, at this check; 0 where strains are given, or one is at its limit."""
        wanted, tension, at_limit = self.wanted[rows], self.tension[rows], self.at_limit(rows).any(axis=1)
        least = np.maximum(LEAST_TENSION * self._scale, 0.5 * np.abs(tension).max(axis=1))[:, None]
        with np.errstate(invalid="ignore"):
            missing = np.abs(wanted - tension) / np.maximum(np.abs(wanted), least)
        return np.asarray(np.where(self.driven(rows), missing, 0.0).max(axis=1) * ~at_limit / self.tolerance)

    def rest(self, rows: np.ndarray, rests: np.ndarray) -> None:
        """Hold the strains of some worlds, and release the others; rests [row]."""
        moves = self.driven(rows) & ~rests[:, None]
        speed = np.where(moves, self._steering.strain_speed[rows], 0.0)
        self._steering.set(rows, is_driven=moves, strain_speed=speed)
