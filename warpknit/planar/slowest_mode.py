"""Damping of a relaxation: near critical for the slowest active mode, by Rayleigh quotients (kernels/rayleigh.py)."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.host import fetch
from ..compute.launch import Launch, bind
from ..kernels.rayleigh import sum_rayleigh
from ..mechanics.numerics import SLOWEST_WAVE, renewed_damping, slowest_damping
from .model import Model
from .state import State
from .step import ForceProbe, Stage, Stepper


class SlowestMode:
    """Updates the damping at every convergence check, from the change since the last one."""

    KEPT = ("_last",)

    def __init__(self, model: Model, state: State, stepper: Stepper) -> None:
        self.model = model
        self.state = state
        self.probe = ForceProbe(model, state, stepper)
        h = float(model.table.spacing.min())
        wave = SLOWEST_WAVE * model.scene.model.nodes_per_loop * h
        heaviest = 1.0 / float(model.rest.inverse_mass.numpy().min())
        self._slowest = slowest_damping(model.bending_stiffness, wave, h, heaviest)
        nodes, device = model.panel.node_count, model.device
        kinds = [model.precision.coordinate] * 2 + [model.precision.real] * 2
        self._last = [wp.zeros(nodes, dtype=kind, device=device) for kind in kinds]
        self.partial = wp.zeros((len(model.panel.block_first), 2), dtype=wp.float64, device=device)  # see kernels/rayleigh.py

    def sum(self, stepper: Stepper, part: int) -> list[Launch]:
        """Stage of work after the probe: sum the changes since the last check, and store the state."""
        model, state, (block, blocks) = self.model, self.state, stepper.blocks_of(part)
        kept = dict(zip(("last_ux", "last_uy", "last_acceleration_x", "last_acceleration_y"), self._last, strict=True))
        return [
            bind(
                sum_rayleigh, blocks, model.rest, model.mesh, state, model.constants, self.probe, first_block=block,
                ux=state.node_ux[state.parity], uy=state.node_uy[state.parity], partial=self.partial, **kept,
            )
        ]  # fmt: skip

    def update(self, *then: Stage, use: bool) -> None:
        """Store the state, and run other stages of work; with `use`, set the damping from the change since the last check."""
        state = self.state
        self.probe.evaluate(self.sum, *then)
        control = state.steering.read()
        if use and control.drive == 0.0:
            renewed = self.renewed(control.damping, self.model.ranks.exact_sum(fetch(self.partial)))
            self.state.steering.set(damping=float(renewed))

    def renewed(self, damping: np.ndarray, total: np.ndarray) -> np.ndarray:
        """Updated damping (...) [1/s] from the sums (..., 2) of kernels/rayleigh.py; unchanged without motion.

        A leading axis counts replicas.
        """
        return renewed_damping(damping, total[..., 0], total[..., 1], self._slowest)
