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

from .kernels import control as c
from .kernels.multipliers import update_pair_offset, update_tension_offset
from .kernels.wires_by_block import BLOCK_SIZE
from .look import Look, Sums
from .model import Model, block_threads
from .numerics import TURN_ALLOWANCE, unit_step_mass
from .state import State

PATIENCE = 4  # updates in a row that a limit must be passed, without coming down by itself, before numbers are renewed
RATE = 0.4  # of a multiplier an update, at the start of a level
RATE_LEAST = 0.02
RATE_PATIENCE = 10  # updates without progress before the rate is lowered: wires that answer late would make it swing
PENETRATION_LIMIT = 0.004  # wire diameters that a closed pair may overlap in a steady state
PENETRATION_STIFFEN = 0.05  # wire diameters at which the contact penalty is doubled
SOFTENING_STRAIN = 0.02  # softened axial strain at which a wire's softening is halved
TAUT_FACTOR = 4.0
TAUT_PATIENCE = 6  # updates in a row without convergence before a wire counts as taut
TAUT_LENGTH = 8.0  # loops: a longer wire always has slack
MASS_HEADROOM = 1.1  # a renewed mass over the least that is stable
AXIAL_ERROR = 2e-5  # strain by which a softened segment may miss its true stretch in a steady state
RATE_AT = 4  # argument of update_tension_offset; tension and strain stand 4 and 5 behind it
BEND_OVER_STRETCH = 3.0  # least ratio of what bending and softened stretch give to an imposed pull


class Multipliers:
    """Moves the multipliers of a state and renews stiffnesses that the load has outgrown."""

    def __init__(self, model: Model, state: State) -> None:
        self.model = model
        self.state = state
        self._sunk = 0.0
        self._sinking = 0  # updates in a row with bodies sunk in
        self._stretched = np.zeros(len(model.panel.wire_first), dtype=int)  # [wire] updates in a row
        self._unsettled = np.zeros(len(model.panel.wire_first), dtype=int)  # [wire] updates in a row without convergence
        self._imposed = np.zeros(len(model.panel.wire_first))  # [wire] strain missing in the mean, at the last update
        self._short = (model.panel.wire_count < TAUT_LENGTH * model.scene.model.nodes_per_loop) & ~model.panel.wire_closed
        self._record()
        self.begin_level()

    def begin_level(self) -> None:
        """Start with the full rate again."""
        self._rate, self._best, self._waited = RATE, np.inf, 0

    def _slow_down_without_progress(self, left: float) -> None:
        if left < 0.9 * self._best:
            self._best, self._waited = left, 0
            return
        self._waited += 1
        if self._waited >= RATE_PATIENCE:
            self._waited = 0
            self._rate = max(0.7 * self._rate, RATE_LEAST)

    def memory(self) -> dict[str, np.ndarray]:
        """What a checkpoint keeps."""
        numbers = [self._sunk, self._sinking, self._rate, self._best, self._waited]
        return {
            "sunk": np.array(numbers, dtype=float),
            "stretched": self._stretched,
            "unsettled": self._unsettled,
            "imposed": self._imposed,
        }

    def recall(self, kept: dict[str, np.ndarray]) -> None:
        self._sunk, sinking, self._rate, self._best, waited = kept["sunk"].tolist()
        self._sinking, self._waited = int(sinking), int(waited)
        self._stretched, self._unsettled, self._imposed = (
            kept[name].copy() for name in ("stretched", "unsettled", "imposed")
        )

    def bound_softening(self, look: Look) -> None:
        """Soften each wire no more than its shape bears."""
        model, panel = self.model, self.model.panel
        if panel.boundary == "periodic":
            return
        y = look.distance_from_chord()
        most = np.maximum(1.0, y**2 * model.axial_stiffness / (BEND_OVER_STRETCH * model.bending_stiffness))
        now = self.state.wire_axial.numpy().astype(np.float64)
        axial = np.maximum(now, np.minimum(model.axial_stiffness / most, model.axial_stiffness))
        if not model.ranks.any(bool(np.any(axial > now * (1 + 1e-6)))):
            return
        sums = look.take()
        self._move_offsets(look, axial, rate=0.0)
        self._renew(axial, float(self.state.read_control()[int(c.CONTACT_STIFFNESS)]), sums)

    def update(self, look: Look, sums: Sums, *, nearly_steady: bool) -> float:
        """Move every multiplier once, by what a look has just summed up; what is still missing, 1 being the most that counts
        as steady."""
        axial = self.state.wire_axial.numpy().astype(np.float64)
        # strains are those of the arc: the chord of a wire that straightens grows, however stiff the wire is. A segment gives
        # way to its neighbours at once; what is missing in the mean is what the ends impose
        stiffer = self._outgrown(axial, sums.strain_max, sums.error_mean, nearly_steady)
        penalty = float(self.state.read_control()[int(c.CONTACT_STIFFNESS)])
        sunk = sums.gap_max / self.model.scene.wire.diameter
        self._update_pairs.set_param_at_index(0, wp.float64(self._rate))
        self._update_pairs.launch()
        self._move_offsets(look, stiffer, self._rate)
        self._sinking = self._sinking + 1 if sunk > PENETRATION_STIFFEN and sunk > 0.8 * self._sunk else 0
        self._sunk = sunk
        if self._sinking >= PATIENCE:
            self._sinking, penalty = 0, 2.0 * penalty
        self._renew(stiffer, penalty, sums)
        left = max(sums.error_largest / AXIAL_ERROR, sunk / PENETRATION_LIMIT)
        self._slow_down_without_progress(left)
        return left

    def _outgrown(self, axial: np.ndarray, strain: np.ndarray, imposed: np.ndarray, nearly_steady: bool) -> np.ndarray:
        """Axial stiffness [wire] [N], raised where the softening is more than a wire bears."""
        true = self.model.axial_stiffness
        self._stretched = np.where(strain > SOFTENING_STRAIN, self._stretched + 1, 0)
        stuck = self._short & (imposed > AXIAL_ERROR) & (imposed > 0.8 * self._imposed) & nearly_steady
        self._unsettled = np.where(stuck, self._unsettled + 1, 0)
        self._imposed = imposed
        factor = np.where(self._stretched >= PATIENCE, 2.0, 1.0)
        factor = np.where(self._unsettled >= TAUT_PATIENCE, TAUT_FACTOR, factor)
        self._stretched[factor > 1.0] = 0
        self._unsettled[factor > 1.0] = 0
        return np.minimum(factor * axial, true)

    def _move_offsets(self, look: Look, axial: np.ndarray, rate: float) -> None:
        self._axial.assign(axial)
        for index, value in ((RATE_AT, wp.float64(rate)), (RATE_AT + 4, look.tension), (RATE_AT + 5, look.strain)):
            self._update_wires.set_param_at_index(index, value)
        self._update_wires.launch()

    def _record(self) -> None:
        """The two launches of an update, to be repeated with other numbers."""
        model, mesh, state, device = self.model, self.model.mesh, self.state, self.model.device
        self._axial = wp.zeros_like(state.wire_axial)
        arguments = [
            mesh.block_first, mesh.block_count, mesh.block_wire, BLOCK_SIZE, wp.float64(0.0),
            state.wire_axial, self._axial, wp.float64(model.axial_stiffness),
            state.tension_offset, state.tension_offset, state.tension_offset,
        ]  # fmt: skip
        self._update_wires = wp.launch(
            update_tension_offset, dim=block_threads(model), inputs=arguments, device=device, record_cmd=True
        )
        self._update_pairs = wp.launch(
            update_pair_offset,
            dim=max(1, model.pair_count),
            inputs=[wp.float64(0.0), state.pair_force, state.pair_offset],
            device=device,
            record_cmd=True,
        )

    def _renew(self, axial: np.ndarray, penalty: float, sums: Sums) -> None:
        """Renew stiffnesses, and raise the fictitious masses of the wires where they no longer suffice."""
        model, state = self.model, self.state
        h = float(model.table.spacing.min())
        stiffness = model.bending_stiffness
        bent = np.where(sums.turning_max > TURN_ALLOWANCE, 0.5 * np.pi, 0.0)
        at_start = unit_step_mass(model.axial_stiffness / model.softening, stiffness, model.contact_stiffness, h)
        needed = unit_step_mass(axial, stiffness, penalty, h, bent, sums.tension_max) / at_start
        mass = state.wire_mass.numpy().astype(np.float64)
        # the rest table's masses have a margin for a load like that of the start
        short = needed > mass * MASS_HEADROOM
        if penalty != float(state.read_control()[int(c.CONTACT_STIFFNESS)]):
            state.stiffen_contact(penalty)
        if np.any(axial != state.wire_axial.numpy()):
            state.wire_axial.assign(axial)
        if short.any():
            state.wire_mass.assign(np.where(short, needed * MASS_HEADROOM, mass))
