"""Softening and penalty of a relaxation, and the running multipliers that take their error out again.

A wire is softened no more than it can bear: the softened stretch must stay small beside what bending gives. For a wire whose
nodes lie off its chord by y (root mean square), bending gives about y^2/EI a length and stretch s/EA, so s is at most
y^2 EA/(BEND_OVER_STRETCH EI); a closed wire has no chord that something could impose. Wires straighten under load, so the
bound is renewed at every level. A wire whose softened strain grows past SOFTENING_STRAIN is softened half as much, and the
contact penalty is doubled when a body sinks in past PENETRATION_STIFFEN; fictitious masses follow (model.node_mass).
"""

from __future__ import annotations

import numpy as np
import warp as wp

from . import measure
from .kernels import control as c
from .kernels.multipliers import update_pair_offset, update_tension_offset
from .kernels.wires_by_block import BLOCK_SIZE
from .model import MASS_MARGIN, Model, block_threads, unit_step_mass
from .state import State

PATIENCE = 4  # updates in a row that a limit must be passed, without coming down by itself, before numbers are renewed
RATE = 0.4  # of a multiplier an update, at the start of a level
RATE_LEAST = 0.02
RATE_PATIENCE = 10  # updates without progress before the rate is lowered: wires that answer late would make it swing
PENETRATION_LIMIT = 0.004  # wire diameters that a closed pair may overlap in a steady state
PENETRATION_STIFFEN = 0.05  # wire diameters at which the contact penalty is doubled
SOFTENING_STRAIN = 0.02  # softened axial strain at which a wire's softening is halved
AXIAL_ERROR = 2e-5  # strain by which a softened segment may miss its true stretch in a steady state
BEND_OVER_STRETCH = 3.0  # least ratio of what bending and softened stretch give to an imposed pull


class Multipliers:
    """Moves the multipliers of a state and renews stiffnesses that the load has outgrown."""

    def __init__(self, model: Model, state: State) -> None:
        self.model = model
        self.state = state
        self._sunk = 0.0
        self._sinking = 0  # updates in a row with bodies sunk in
        self._stretched = np.zeros(len(model.panel.wire_first), dtype=int)  # [wire] updates in a row
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
        return {"sunk": np.array(numbers, dtype=float), "stretched": self._stretched}

    def recall(self, kept: dict[str, np.ndarray]) -> None:
        self._sunk, sinking, self._rate, self._best, waited = kept["sunk"].tolist()
        self._sinking, self._waited = int(sinking), int(waited)
        self._stretched = kept["stretched"].copy()

    def bound_softening(self, reading: measure.Reading) -> None:
        """Soften each wire no more than its shape bears."""
        model, panel = self.model, self.model.panel
        if panel.boundary == "periodic":
            return
        y = offset_from_chord(reading)
        most = np.maximum(1.0, y**2 * model.axial_stiffness / (BEND_OVER_STRETCH * model.bending_stiffness))
        now = self.state.wire_axial.numpy().astype(np.float64)
        self._restiffen(np.maximum(now, np.minimum(model.axial_stiffness / most, model.axial_stiffness)), None, reading.tension)

    def update(self, tension: wp.array) -> float:
        """Move every multiplier once; what is still missing, 1 being the most that counts as steady.

        tension: [node] of the current state, on the device.
        """
        model, state = self.model, self.state
        host = tension.numpy().astype(np.float64)
        axial = state.wire_axial.numpy().astype(np.float64)
        own = np.abs(host - state.tension_offset.numpy())
        strain = np.maximum.reduceat(own, model.panel.wire_first) / axial
        self._stretched = np.where(strain > SOFTENING_STRAIN, self._stretched + 1, 0)
        stiffer = np.where(self._stretched >= PATIENCE, np.minimum(2.0 * axial, model.axial_stiffness), axial)
        self._stretched[self._stretched >= PATIENCE] = 0
        penalty = float(state.read_control()[int(c.CONTACT_STIFFNESS)])
        closed = state.pair_force.numpy() > 0
        sunk = 0.0
        if closed.any():
            sunk = float(np.max(np.abs(state.pair_gap.numpy()[closed]))) / model.scene.wire.diameter
            wp.launch(
                update_pair_offset,
                dim=model.pair_count,
                inputs=[wp.float64(self._rate), state.pair_force, state.pair_offset],
                device=model.device,
            )
        missing = np.abs(own / np.repeat(axial, model.panel.wire_count) - np.abs(host) / model.axial_stiffness).max()
        self._move_offsets(tension, stiffer)
        self._sinking = self._sinking + 1 if sunk > PENETRATION_STIFFEN and sunk > 0.8 * self._sunk else 0
        self._sunk = sunk
        too_soft = self._sinking >= PATIENCE
        if too_soft:
            self._sinking = 0
        if np.any(stiffer != axial) or too_soft:
            self._set_stiffness(stiffer, 2.0 * penalty if too_soft else penalty)
        left = max(float(missing) / AXIAL_ERROR, sunk / PENETRATION_LIMIT)
        self._slow_down_without_progress(left)
        return left

    def _restiffen(self, axial: np.ndarray, penalty: float | None, tension: np.ndarray) -> None:
        if np.all(axial <= self.state.wire_axial.numpy().astype(np.float64) * (1 + 1e-6)):
            return
        device = self.model.device
        self._move_offsets(wp.array(tension, dtype=self.model.precision.real, device=device), axial, rate=0.0)
        self._set_stiffness(axial, penalty)

    def _move_offsets(self, tension: wp.array, axial: np.ndarray, rate: float | None = None) -> None:
        model, mesh, state = self.model, self.model.mesh, self.state
        rate = self._rate if rate is None else rate
        wp.launch(
            update_tension_offset,
            dim=block_threads(model),
            inputs=[
                mesh.block_first, mesh.block_count, mesh.block_wire, BLOCK_SIZE, wp.float64(rate),
                state.wire_axial, wp.array(axial, dtype=model.precision.real, device=model.device),
                wp.float64(model.axial_stiffness), tension, state.tension_offset,
            ],
            device=model.device,
        )  # fmt: skip

    def _set_stiffness(self, axial: np.ndarray, penalty: float | None) -> None:
        """Renew the stiffnesses and with them the fictitious masses."""
        model, state = self.model, self.state
        control = {}
        if penalty is None:
            penalty = float(state.read_control()[int(c.CONTACT_STIFFNESS)])
        else:
            control = {c.CONTACT_STIFFNESS: penalty, c.BODY_INVERSE_MASS: 1.0 / (MASS_MARGIN * penalty)}
        h = float(model.table.spacing.min())
        at_start = unit_step_mass(model.axial_stiffness / model.softening, model.bending_stiffness, model.contact_stiffness, h)
        mass = unit_step_mass(axial, model.bending_stiffness, penalty, h) / at_start
        state.wire_axial.assign(axial)
        state.wire_mass.assign(mass)
        state.write_control(control)


def offset_from_chord(r: measure.Reading) -> np.ndarray:
    """[wire] [m] root mean square distance of a wire's nodes from the straight line through its ends."""
    panel = r.model.panel
    node, _ = measure.positions(r)
    first, last = panel.wire_first, panel.wire_first + panel.wire_count - 1
    chord = node[last, :2] - node[first, :2]
    length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-30)
    normal = np.repeat(np.stack([-chord[:, 1], chord[:, 0]], axis=1) / length[:, None], panel.wire_count, axis=0)
    off = np.sum((node[:, :2] - np.repeat(node[first, :2], panel.wire_count, axis=0)) * normal, axis=1)
    return np.sqrt(np.add.reduceat(off**2, first) / panel.wire_count)
