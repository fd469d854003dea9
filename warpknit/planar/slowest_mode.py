"""The damping of a relaxation: near critical for the slowest mode that still moves (kernels/rayleigh.py)."""

from __future__ import annotations

import numpy as np
import warp as wp

from ..kernels import control as c
from ..kernels.rayleigh import sum_rayleigh
from ..launch import bind
from ..numerics import SLOWEST_WAVE, renewed_damping, slowest_damping
from .model import Model
from .state import State
from .step import ForceProbe, Stepper


class SlowestMode:
    """Renews the damping at every look; the state of the last look is its memory."""

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
        self._sum = [self._record(parity) for parity in (0, 1)]

    def _record(self, parity: int) -> wp.Launch:
        model, state = self.model, self.state
        kept = dict(zip(("last_ux", "last_uy", "last_acceleration_x", "last_acceleration_y"), self._last, strict=True))
        return bind(
            sum_rayleigh, len(model.panel.block_first), model.rest, model.mesh, state, model.constants, self.probe,
            ux=state.node_ux[parity], uy=state.node_uy[parity], partial=self.partial, **kept,
        ).record(model.device)  # fmt: skip

    def state_dict(self) -> dict[str, np.ndarray]:
        """What a checkpoint keeps."""
        return {f"look_{k}": value.numpy().copy() for k, value in enumerate(self._last)}

    def load_state_dict(self, kept: dict[str, np.ndarray]) -> None:
        for k, value in enumerate(self._last):
            value.assign(kept[f"look_{k}"])

    def update(self, *, use: bool) -> None:
        """Take in the state; with `use`, set the damping from what happened since the last look."""
        state = self.state
        self.probe.evaluate()
        self.launch_sum()
        control = state.read_control()
        if use and control[int(c.DRIVE)] == 0.0:
            renewed = self.renewed(control[int(c.DAMPING)], self.model.ranks.exact_sum(self.partial.numpy()))
            self.state.write_control({c.DAMPING: float(renewed)})

    def launch_sum(self) -> None:
        """Sum up what moved since the last look, after the probe; this state becomes that of the last look."""
        self._sum[self.state.parity].launch()

    def renewed(self, damping: np.ndarray, total: np.ndarray) -> np.ndarray:
        """Damping (...) [1/s] after one of `damping`, by the sums (..., 2) over what kernels/rayleigh.py left; unchanged where
        nothing moved. A leading axis counts replicas."""
        return renewed_damping(damping, total[..., 0], total[..., 1], self._slowest)
