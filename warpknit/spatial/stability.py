"""Whether an equilibrium is stable: a disturbance must not grow.

A mesh that is alike on both sides may follow a path of equilibria beyond the load at which it would buckle: forces balance, but
any disturbance grows. Damping that suits the stable motion hides it, as such a disturbance grows slowly then. Once the mesh has
converged, its nodes are moved at random, and it moves on with little damping: a stable mesh swings about its equilibrium and
loses energy, an unstable one gains kinetic energy until it has left. Then it is relaxed again.
"""

from __future__ import annotations

import math

import numpy as np

from ..compute.host import fetch, store
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
    """The test of one level after the other."""

    def __init__(self, model: SpatialModel, relaxation: RodRelaxation, contact: WireContact, notes: list[str]) -> None:
        """notes: for the user, to which what was not stable is added."""
        self.model, self.relaxation, self.contact, self.notes = model, relaxation, contact, notes
        self._checks = 0  # since the disturbance of this level
        self._energy = self._least = math.inf  # [J] kinetic energy at the last of them, and the least so far
        self._is_over = True
        self.has_left = False  # whether a mesh has left an equilibrium that was not stable, in this level

    def begin(self) -> None:
        """Test the next equilibrium that is found."""
        self._checks, self._least, self._is_over, self.has_left = 0, math.inf, False, False

    @property
    def is_running(self) -> bool:
        """Whether the mesh moves as disturbed."""
        return self._checks > 0 and not self._is_over

    def after_check(self, ratio: float) -> float:
        """The residual ratio of a convergence check, infinite while the mesh is tested; starts, continues and ends the test."""
        if self._is_over or (self._checks == 0 and ratio >= 1.0):
            return ratio
        energy, before = self.relaxation.kinetic_energy(), self._energy
        if self._checks == 0:
            self._disturb()
            energy = math.inf
        elif self._checks >= MOST_CHECKS or (self._checks >= LEAST_CHECKS and energy < before):
            self._is_over = True
            self.relaxation.begin_anew()
            self.relaxation.stepper.state.steering.set(damping=FASTEST_DAMPING)
        self._energy, self._least, self._checks = energy, min(self._least, energy), self._checks + 1
        if energy > GROWN * self._least and not self.has_left:
            self.has_left = True
            self._note()
        self.hold_damping()
        return math.inf

    def hold_damping(self) -> None:
        """Damp the mesh little while it is tested."""
        if self.is_running:
            self.relaxation.stepper.state.steering.set(damping=DAMPING)

    def _note(self) -> None:
        strains = strain_text(self.relaxation.stepper.state.gradient)
        note = f"at strains of {strains} an equilibrium was not stable: the mesh left it for another"
        if note not in self.notes:
            self.notes.append(note)

    def _disturb(self) -> None:
        strip, state = self.relaxation.stepper.strip, self.relaxation.stepper.state
        size = DISTURBANCE * self.model.scene.solver.residual_tolerance * strip.whole.section.thickness
        shift = size * np.random.default_rng(SEED).standard_normal((strip.whole.node_count, 3))[strip.nodes_of_mesh]
        store(state.displacement, fetch(state.displacement) + np.where(self.relaxation.free[:, None], shift, 0.0))
        self.contact.search()
        self.relaxation.reset_damping_estimate()

    def state_dict(self) -> dict[str, np.ndarray]:
        """Arrays for a checkpoint."""
        return {"stability": np.array([self._checks, self._energy, self._least, self._is_over, self.has_left])}

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        """Restore what `state_dict` returned."""
        checks, self._energy, self._least, is_over, has_left = kept["stability"].tolist()
        self._checks, self._is_over, self.has_left = int(checks), bool(is_over), bool(has_left)
