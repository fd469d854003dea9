"""Neighbour search; the kernels are in kernels/contact_search.py."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import warp as wp

from ..compute.launch import bind
from ..kernels.contact_search import find_nearest_segments
from .model import Model
from .state import State

SAG = 0.15  # of the node spacing: largest distance of a wire from the chord of a segment (radius 0.8 spacings)
RAMP_SHARE = 0.2  # of the margin: reserved for the affine motion between two searches of a ramp
MARGIN = 0.1  # in course spacings: largest approach of a body and a wire before the next search


class NeighbourSearch:
    """The search for the initial segment of each pair."""

    KEPT = ("searches", "_expected", "_gradient")

    def __init__(self, model: Model, state: State) -> None:
        self.model = model
        self.state = state
        self.margin = MARGIN * model.scene.knit.course_spacing
        # the nearer node of a touched segment is within half a (stretched) spacing along the wire
        self.radius = model.contact_reach + self.margin + 0.75 * float(model.table.spacing.max())
        self.searches = 0
        self._expected = 0.0
        self._gradient = np.array([1.0, 0.0, 0.0, 1.0])

    def follow(self, gradient: np.ndarray) -> None:
        """Search again when the load has used half of its reserve; see `expect`."""
        moved = 2.0 * float(np.abs(gradient - self._gradient).max()) * self.radius
        if moved > 0.5 * self._expected:
            self.expect(RAMP_SHARE * self.margin)

    def expect(self, motion: float) -> None:
        """Search, and reserve `motion` [m] of the margin for the load until the next call."""
        self._expected = motion
        self.search()

    def search(self) -> None:
        """Seed every open pair, and reset the travel budget.

        Pairs of a hook with another contact constraint never sleep and need no search.
        """
        budget = max(0.5 * self.margin - self._expected, 0.1 * self.margin) if self.model.pair_count else np.inf
        self.state.steering.set(load_motion=self._expected, travel=0.0, travel_limit=budget, status=0.0)
        if self.model.pair_count and self.model.treatment.is_free:
            self._launches[self.state.parity].launch()
        self.searches += 1
        self._gradient = self.state.gradient.ravel()

    @cached_property
    def _launches(self) -> list[wp.Launch]:
        """The search from the displacements of each parity."""
        model, state = self.model, self.state
        real, spacing = model.precision.real, float(model.table.spacing.max())
        return [
            bind(
                find_nearest_segments, model.pair_count, model.rest, model.mesh, state, model.constants,
                radius=real(self.radius), half_chord=real(0.6 * spacing), sag=real(SAG * spacing),
                reach=real(model.contact_reach), ux=state.node_ux[parity], uy=state.node_uy[parity],
            ).record(model.device)
            for parity in (0, 1)
        ]  # fmt: skip
