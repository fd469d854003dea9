"""History variables: stick places of contacts, plastic turning of wires, anchors of bodies on the ground.

They are updated at every equilibrium.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from ..compute.launch import bind
from ..kernels.anchored_bodies import draw_anchors
from ..kernels.contact_friction import stick_contacts
from .host_state import read_strip
from .model import Model
from .state import State
from .step import anchor_launch


class HistoryVariables:
    """Updates the history variables, and sums the dissipated energy."""

    KEPT = ("dissipated",)

    def __init__(self, model: Model, state: State) -> None:
        self.model, self.state = model, state
        self.dissipated = 0.0  # [J]
        self._slipped = wp.zeros(len(state.pair_stuck), dtype=wp.float64, device=model.device)

    def advance(self) -> None:
        """Update the history variables from an equilibrium."""
        if len(self.state.pair_stuck):
            model, state = self.model, self.state
            sources = (model.rest, model.mesh, state, model.constants)
            bind(stick_contacts, model.pair_count, *sources, slipped=self._slipped).run(model.device)
            own = slice(None) if model.strip is None else model.strip.pair
            self._dissipate(np.sum(self._slipped.numpy()[own]))
        if self.model.yield_moment:
            self._yield()
        if self.model.treatment.anchored:
            self._draw_anchors()

    def _draw_anchors(self) -> None:
        """Move the anchors of bodies whose spring is at its force limit."""
        bodies = self.model.panel.body_count
        anchor_launch(draw_anchors, bodies, self.model, self.state).run(self.model.device)

    def _yield(self) -> None:
        """Update plastic turning: backward Euler, bilinear bending with kinematic hardening."""
        host = read_strip(self.model, self.state)
        kept = self.model.scene.wire.hardening
        beyond = host.turning - host.plastic_turn - host.back_turn
        change = np.sign(beyond) * np.maximum(np.abs(beyond) - host.yield_turn, 0.0) * (1.0 - kept)
        self.state.plastic_turn.assign(host.plastic_turn + change)
        if kept < 1.0:
            self.state.back_turn.assign(host.back_turn + kept / (1.0 - kept) * change)
        self._dissipate(self.model.yield_moment * np.sum(np.abs(change)))

    def _dissipate(self, energy: float) -> None:
        """Add dissipated energy [J] of all ranks."""
        self.dissipated += float(self.model.ranks.sum(np.array([energy]))[0])
