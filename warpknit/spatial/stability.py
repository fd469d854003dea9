"""Whether an equilibrium is stable: a disturbance must not grow.

A mesh that is alike on both sides may follow a path of equilibria beyond the load at which it would buckle: forces balance, but
any disturbance grows. Damping that suits the stable motion hides it, as such a disturbance grows slowly then. Once the mesh has
converged, its nodes are moved at random, and it moves on with little damping: a stable mesh swings about its equilibrium and
loses energy, an unstable one gains kinetic energy until it has left. Then it is relaxed again.
"""

from __future__ import annotations

import numpy as np

from ..measure.strain import strain_text
from ..mechanics.numerics import FASTEST_DAMPING
from .model import SpatialModel
from .rod_relaxation import RodRelaxation
from .wire_contact import WireContact

DISTURBANCE, SEED = 0.03, 1  # of the thickness times the residual tolerance: standard deviation of the displacements
DAMPING = 0.02  # over a step, of the motion that follows
LEAST_CHECKS, MOST_CHECKS = 8, 80  # convergence checks of that motion
GROWN = 4.0  # kinetic energy over the least so far, by which the disturbance has grown


class Stability:
    """The test of one level after the other, of every world."""

    KEPT = ("_checks", "_energy", "_least", "_is_over", "has_left")

    def __init__(self, model: SpatialModel, relaxation: RodRelaxation, contact: WireContact) -> None:
        self.model, self.relaxation, self.contact = model, relaxation, contact
        worlds = relaxation.stepper.worlds
        self._checks = np.zeros(worlds, dtype=int)  # [world] since the disturbance of this level
        self._energy, self._least = np.full((2, worlds), np.inf)  # [J] kinetic energy at the last of them, and the least so far
        self._is_over = np.ones(worlds, dtype=bool)
        self.has_left = np.zeros(worlds, dtype=bool)  # whether a mesh has left an equilibrium that was not stable, in this level

    def begin(self, world: int = 0) -> None:
        """Test the next equilibrium that is found."""
        self._checks[world], self._least[world], self._is_over[world], self.has_left[world] = 0, np.inf, False, False

    @property
    def is_running(self) -> np.ndarray:
        """[world] whether the mesh moves as disturbed."""
        return (self._checks > 0) & ~self._is_over

    def after_check(self, ratio: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """[row] the residual ratio of a check, infinite while a mesh is tested; starts, continues and ends tests."""
        tests = ~(self._is_over[rows] | ((self._checks[rows] == 0) & (ratio >= 1.0)))
        if not tests.any():
            return ratio
        ratio, rows = ratio.copy(), rows[tests]
        ratio[tests] = np.inf
        energy, before = self.relaxation.kinetic_energy(rows), self._energy[rows]
        checks = self._checks[rows]
        if (checks == 0).any():
            self._disturb(rows[checks == 0])
        energy[checks == 0] = np.inf
        is_over = (checks > 0) & ((checks >= MOST_CHECKS) | ((checks >= LEAST_CHECKS) & (energy < before)))
        over = rows[is_over]
        self._is_over[over] = True
        self.relaxation.begin_anew(over)
        self.relaxation.stepper.steering.set(over, damping=FASTEST_DAMPING)
        self._energy[rows], self._least[rows] = energy, np.minimum(self._least[rows], energy)
        self._checks[rows] += 1
        self.has_left[rows] |= energy > GROWN * self._least[rows]
        self.hold_damping()
        return ratio

    def hold_damping(self) -> None:
        """Damp meshes little while they are tested."""
        running = np.flatnonzero(self.is_running)
        if len(running):
            self.relaxation.stepper.steering.set(running, damping=DAMPING)

    def note(self, world: int = 0) -> str:
        """That a mesh has left an equilibrium, for the user."""
        strains = strain_text(self.relaxation.stepper.steering.gradient[world])
        return f"at strains of {strains} an equilibrium was not stable: the mesh left it for another"

    def _disturb(self, rows: np.ndarray) -> None:
        stepper = self.relaxation.stepper
        strip = stepper.strip
        nodes = strip.whole.node_count // stepper.worlds
        size = DISTURBANCE * self.model.scene.solver.residual_tolerance * strip.whole.section.thickness
        shift = size * np.random.default_rng(SEED).standard_normal((nodes, 3))
        here = strip.nodes_of_mesh if stepper.worlds == 1 else np.arange(nodes)
        free = self.relaxation.free.reshape(stepper.worlds, -1)[rows]
        place = stepper.state.displacement
        stepper.store_rows(place, rows, stepper.by_world(place)[rows] + np.where(free[..., None], shift[here], 0.0))
        self.contact.search(rows)
        self.relaxation.reset_damping_estimate(rows)
