"""Softening and penalty of a relaxation, and the running multipliers that take their error out again.

A wire is softened no more than it can bear: the softened stretch must stay small beside what bending gives. For a wire whose
nodes lie off its chord by y (root mean square), bending gives about y^2/EI a length and stretch s/EA, so s is at most
y^2 EA/(BEND_OVER_STRETCH EI); a closed wire has no chord that something could impose. Wires straighten under load, so the
bound is renewed at every level. A wire whose softened strain grows past SOFTENING_STRAIN is softened half as much, and the
contact penalty is doubled when a body sinks in past PENETRATION_STIFFEN. A short open wire whose multipliers do not
converge once the mesh is nearly at rest is taut: its softening is divided by TAUT_FACTOR. Fictitious masses follow the
stiffnesses, the tension and the sharpest turn of each wire (numerics.unit_step_mass).
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ..kernels import control as c
from ..kernels.multipliers import update_pair_offset, update_tension_offset
from ..launch import bind
from .diagnostics import Diagnostics, Sums
from .model import Model, block_threads
from .multiplier_rules import MultiplierRules
from .state import State

BEND_OVER_STRETCH = 3.0  # least ratio of what bending and softened stretch give to an imposed pull


class Multipliers:
    """Moves the multipliers of a state and renews stiffnesses that the load has outgrown."""

    def __init__(self, model: Model, state: State, diagnostics: Diagnostics) -> None:
        """`look` leaves the tensions and strains that the multipliers move by."""
        self.model = model
        self.state = state
        self.diagnostics = diagnostics
        self.rules = MultiplierRules(model)
        self.axial = wp.zeros_like(state.wire_axial)  # [wire] [N] that a move goes over to
        self._record()

    def begin_level(self) -> None:
        """Start with the full rate again."""
        self.rules.begin_level()

    def state_dict(self) -> dict[str, np.ndarray]:
        """What a checkpoint keeps."""
        return self.rules.state_dict()

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        self.rules.load_state_dict(kept)

    def bound_softening(self) -> None:
        """Soften each wire no more than its shape bears."""
        model, panel = self.model, self.model.panel
        if panel.boundary == "periodic":
            return
        y = self.diagnostics.distance_from_chord()
        most = np.maximum(1.0, y**2 * model.axial_stiffness / (BEND_OVER_STRETCH * model.bending_stiffness))
        now = self.state.wire_axial.numpy().astype(np.float64)
        axial = np.maximum(now, np.minimum(model.axial_stiffness / most, model.axial_stiffness))
        if not model.ranks.any(bool(np.any(axial > now * (1 + 1e-6)))):
            return
        sums = self.diagnostics.sums()
        self._move_offsets(axial, rate=0.0)
        self.renew(axial, float(self.state.read_control()[int(c.CONTACT_STIFFNESS)]), sums)

    def update(self, sums: Sums, *, nearly_steady: bool) -> float:
        """Move every multiplier once, by what a look has just summed up; what is still missing, 1 being the most that counts
        as steady."""
        stiffer = self.rules.outgrown(self.state.wire_axial.numpy().astype(np.float64), sums, nearly_steady)
        penalty = float(self.state.read_control()[int(c.CONTACT_STIFFNESS)])
        self._move_offsets(stiffer, float(self.rules.rate))
        self.renew(stiffer, float(self.rules.stiffened(np.float64(penalty), sums)), sums)
        return float(self.rules.left(sums))

    def _move_offsets(self, axial: np.ndarray, rate: float) -> None:
        self.axial.assign(axial)
        self.state.write_control({c.MULTIPLIER_RATE: rate})
        for launch in self.launches:
            launch()

    def _record(self) -> None:
        """The launches of a move, to be repeated with other numbers."""
        model, state = self.model, self.state
        wires = bind(
            update_tension_offset, block_threads(model), model.mesh, state, model.constants, self.diagnostics,
            axial_before=state.wire_axial, axial=self.axial,
        )  # fmt: skip
        pairs = bind(update_pair_offset, max(1, model.pair_count), state)
        self.launches = [launch.record(model.device).launch for launch in (pairs, wires)]

    def renew(self, axial: np.ndarray, penalty: float, sums: Sums) -> None:
        """Renew stiffnesses, and raise the fictitious masses of the wires where they no longer suffice."""
        state = self.state
        before = state.wire_mass.numpy().astype(np.float64)
        mass = self.rules.mass(before, axial, np.float64(penalty), sums)
        if penalty != float(state.read_control()[int(c.CONTACT_STIFFNESS)]):
            state.stiffen_contact(penalty)
        if np.any(axial != state.wire_axial.numpy()):
            state.wire_axial.assign(axial)
        if np.any(mass != before):
            state.wire_mass.assign(mass)
