"""The damping of a relaxation: near critical for the slowest mode that still moves (kernels/relax.py)."""

from __future__ import annotations

import math

import numpy as np
import warp as wp

from .kernels import control as c
from .kernels.relax import sum_rayleigh
from .model import Model
from .state import State
from .step import ForceProbe, Stepper

SLOWEST_WAVE = 3.0  # loops of wire: bending waves longer than this are left overdamped; they carry next to nothing
FASTEST = 0.2


class SlowestMode:
    """Renews the damping at every look; the state of the last look is its memory."""

    def __init__(self, model: Model, state: State, stepper: Stepper) -> None:
        self.model = model
        self.state = state
        self.probe = ForceProbe(model, state, stepper)
        h = float(model.table.spacing.min())
        wave_number = 2.0 * math.pi / (SLOWEST_WAVE * model.scene.model.nodes_per_loop * h)
        heaviest = 1.0 / float(model.rest.inverse_mass.numpy().min())
        self._slowest = 2.0 * math.sqrt(model.bending_stiffness * wave_number**4 * h / heaviest)  # [1/s]
        nodes, device = model.panel.node_count, model.device
        kinds = [model.precision.coordinate] * 2 + [model.precision.real] * 2
        self._last = [wp.zeros(nodes, dtype=kind, device=device) for kind in kinds]
        self._partial = wp.zeros((len(model.panel.block_first), 2), dtype=wp.float64, device=device)
        self._sum = [self._record(parity) for parity in (0, 1)]

    def _record(self, parity: int) -> wp.Launch:
        model, state = self.model, self.state
        return wp.launch(
            sum_rayleigh,
            dim=len(model.panel.block_first),
            inputs=[
                model.mesh.block_first, model.mesh.block_count, model.mesh.block_table, model.mesh.block_wire,
                state.wire_mass, model.rest.inverse_mass,
                model.precision.real(model.precision.unit),
                state.node_ux[parity], state.node_uy[parity],
                self.probe.acceleration_x, self.probe.acceleration_y, *self._last, self._partial,
            ],
            device=model.device,
            record_cmd=True,
        )  # fmt: skip

    def memory(self) -> dict[str, np.ndarray]:
        """What a checkpoint keeps."""
        return {f"look_{k}": value.numpy().copy() for k, value in enumerate(self._last)}

    def recall(self, kept: dict[str, np.ndarray]) -> None:
        for k, value in enumerate(self._last):
            value.assign(kept[f"look_{k}"])

    def look(self, *, use: bool) -> None:
        """Take in the state; with `use`, set the damping from what happened since the last look."""
        state = self.state
        self.probe.evaluate()
        self._sum[state.parity].launch()
        if not use or state.read_control()[int(c.DRIVE)] != 0.0:
            return
        force, moved = self.model.ranks.exact_sum(self._partial.numpy())
        if moved > 0.0 and force > 0.0:
            rate = min(max(2.0 * math.sqrt(force / moved), self._slowest), FASTEST)
            now = float(state.read_control()[int(c.DAMPING)])
            self.state.write_control({c.DAMPING: math.sqrt(now * rate)})
