"""Augmented Lagrangian multipliers of a relaxation, which correct the errors of softening and contact penalty.

The softening of a wire is bounded, so that its compliance in stretch stays small against that in bending. With nodes at an rms
distance y from its chord, the compliance is about y^2/EI a length in bending and s/EA in stretch, so s is at most
y^2 EA/(BEND_OVER_STRETCH EI). Closed wires have no imposed chord and no bound. Wires straighten under load, so the bound is
updated at every level. The softening is halved where the softened strain exceeds SOFTENING_STRAIN, the contact penalty is
doubled where the penetration exceeds PENETRATION_STIFFEN. A short open wire whose multipliers do not converge near equilibrium
is taut: its softening is divided by TAUT_FACTOR. Fictitious masses follow the stiffnesses, the tension and the sharpest turn
of each wire (numerics.unit_step_mass).
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.host import fetch, store
from ..compute.launch import Launch, bind
from ..kernels.multiplier_update import update_pair_offset, update_tension_offset
from ..kernels.wire_forces import BLOCK_SIZE
from .diagnostics import Diagnostics, Sums
from .model import Model
from .multiplier_rules import MultiplierRules
from .state import State
from .step import Stepper

BEND_OVER_STRETCH = 3.0  # smallest ratio of the compliances in bending and in softened stretch


class Multipliers:
    """Updates the multipliers of a state, and its stiffnesses and masses."""

    def __init__(self, model: Model, state: State, diagnostics: Diagnostics) -> None:
        """`diagnostics` holds the tensions and strains of the last convergence check."""
        self.model = model
        self.state = state
        self.diagnostics = diagnostics
        self.rules = MultiplierRules(model)
        self.axial = wp.zeros_like(state.wire_axial)  # [wire] [N] stiffness after the update

    def begin_level(self) -> None:
        """Reset the rate at the start of a level."""
        self.rules.begin_level()

    def bound_softening(self) -> None:
        """Bound the softening of each wire by its shape."""
        model, panel = self.model, self.model.panel
        if panel.boundary == "periodic":
            return
        y = self.diagnostics.distance_from_chord()
        max_softening = np.maximum(1.0, y**2 * model.axial_stiffness / (BEND_OVER_STRETCH * model.bending_stiffness))
        now = fetch(self.state.wire_axial).astype(np.float64)
        axial = np.maximum(now, np.minimum(model.axial_stiffness / max_softening, model.axial_stiffness))
        if not model.ranks.any(bool(np.any(axial > now * (1 + 1e-6)))):
            return
        sums = self.diagnostics.sums()
        self._move_offsets(axial, rate=0.0)
        self.renew(axial, self.state.steering.contact_stiffness, sums)

    def update(self, sums: Sums, *, nearly_converged: bool) -> float:
        """Update every multiplier once; return the constraint error over its tolerance."""
        stiffer = self.rules.renewed_axial_stiffness(fetch(self.state.wire_axial).astype(np.float64), sums, nearly_converged)
        penalty = self.state.steering.contact_stiffness
        self._move_offsets(stiffer, float(self.rules.rate))
        self.renew(stiffer, float(self.rules.renewed_penalty(np.float64(penalty), sums)), sums)
        return float(self.rules.residual_ratio(sums))

    def _move_offsets(self, axial: np.ndarray, rate: float) -> None:
        store(self.axial, axial)
        self.state.steering.set(multiplier_rate=rate)
        self.diagnostics.stepper.run(self.move)

    def move(self, stepper: Stepper, part: int) -> list[Launch]:
        """Stage of work: the update of the multipliers."""
        model, state = self.model, self.state
        block, blocks = stepper.blocks_of(part)
        pair, pairs = stepper.team.share(model.pair_count, part)
        return [
            bind(update_pair_offset, pairs, state, first_pair=pair),
            bind(
                update_tension_offset, blocks * BLOCK_SIZE, model.mesh, state, model.constants, self.diagnostics,
                first_block=block, axial_before=state.wire_axial, axial=self.axial,
            ),
        ]  # fmt: skip

    def renew(self, axial: np.ndarray, penalty: float, sums: Sums) -> None:
        """Set new stiffnesses, and raise the fictitious masses where the step is unstable."""
        state = self.state
        before = fetch(state.wire_mass).astype(np.float64)
        mass = self.rules.renewed_mass(before, axial, np.float64(penalty), sums)
        if penalty != state.steering.contact_stiffness:
            state.stiffen_contact(penalty)
        if np.any(axial != fetch(state.wire_axial)):
            store(state.wire_axial, axial)
        if np.any(mass != before):
            store(state.wire_mass, mass)
