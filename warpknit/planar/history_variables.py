"""What a mesh remembers of the way it was loaded: where its contacts stick, how its wires have yielded, and what holds
bodies on the ground.

It changes from one steady state to the next.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ..kernels.anchored_bodies import draw_anchors
from ..kernels.friction import stick_contacts
from .host_state import read_strip
from .model import Model
from .state import State
from .step import ground_arguments


class Path:
    """Keeps what depends on the path, and the energy that went with it."""

    def __init__(self, model: Model, state: State) -> None:
        self.model, self.state = model, state
        self.dissipated = 0.0  # [J]
        self._slipped = wp.zeros(len(state.pair_stuck), dtype=wp.float64, device=model.device)

    def advance(self) -> None:
        """Take the state, which is at rest, as a step of the path."""
        if len(self.state.pair_stuck):
            model, state = self.model, self.state
            wp.launch(
                stick_contacts,
                dim=model.pair_count,
                inputs=[
                    state.control, wp.float64(model.scene.contact.friction), model.mesh.pair_table, model.rest.rest_length,
                    state.pair_slide, state.pair_u, state.pair_force, state.pair_stuck, self._slipped,
                ],
                device=model.device,
            )  # fmt: skip
            own = slice(None) if model.strip is None else model.strip.pair
            self._dissipate(np.sum(self._slipped.numpy()[own]))
        if self.model.yield_moment:
            self._yield()
        if self.model.treatment.anchored:
            self._draw_anchors()

    def _draw_anchors(self) -> None:
        """Have what bodies are tied to on the ground follow, where it is at the limit of what it bears."""
        s = self.state
        inputs = [*ground_arguments(self.model, s), s.body_ux, s.body_uy, s.anchor_x, s.anchor_y]
        wp.launch(draw_anchors, dim=self.model.panel.body_count, inputs=inputs, device=self.model.device)

    def _yield(self) -> None:
        """Take on the set of the wires: backward Euler of bilinear bending with kinematic hardening."""
        host = read_strip(self.model, self.state)
        kept = self.model.scene.wire.hardening
        beyond = host.turning - host.plastic_turn - host.back_turn
        change = np.sign(beyond) * np.maximum(np.abs(beyond) - host.yield_turn, 0.0) * (1.0 - kept)
        self.state.plastic_turn.assign(host.plastic_turn + change)
        if kept < 1.0:
            self.state.back_turn.assign(host.back_turn + kept / (1.0 - kept) * change)
        self._dissipate(self.model.yield_moment * np.sum(np.abs(change)))

    def _dissipate(self, energy: float) -> None:
        """Add energy [J] that is gone in this rank's part of the mesh, and in that of the others."""
        self.dissipated += float(self.model.ranks.sum(np.array([energy]))[0])

    def memory(self) -> dict[str, np.ndarray]:
        """What a checkpoint keeps."""
        return {"path_dissipated": np.array(self.dissipated)}

    def recall(self, kept: dict[str, np.ndarray]) -> None:
        """Put back what `memory` returned."""
        self.dissipated = float(kept["path_dissipated"])
