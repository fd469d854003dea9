"""Neighbour search; the kernels are in kernels/contact_search.py."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import warp as wp

from ..compute.launch import bind
from ..compute.steering import Steering
from ..kernels.contact_search import find_nearest_segments
from .model import Model
from .state import State

SAG = 0.15  # of the node spacing: largest distance of a wire from the chord of a segment (radius 0.8 spacings)
MARGIN = 0.1  # in course spacings: largest approach of a body and a wire before the next search


class NeighbourSearch:
    """The search for the initial segment of each pair."""

    KEPT = ("searches",)

    def __init__(self, model: Model, state: State) -> None:
        self.model = model
        self.state = state
        self.margin = MARGIN * model.scene.knit.course_spacing
        # the nearer node of a touched segment is within half a (stretched) spacing along the wire
        self.radius = model.contact_reach + self.margin + 0.75 * float(model.table.spacing.max())
        self.searches = 0
        # half of the relative motion of a body and a wire by a unit strain of the load, at rest within twice the radius
        state.steering.set(pair_reach=self.radius)

    def search(self) -> None:
        """Seed every open pair, and reset the travel budget.

        Pairs of a hook with another contact constraint never sleep and need no search.
        """
        budget = 0.5 * self.margin if self.model.pair_count else np.inf
        self.state.steering.set(travel=0.0, travel_limit=budget, status=Steering.RUNNING)
        if self.model.pair_count and self.model.treatment.is_free:
            self._launches[self.state.parity].launch()
        self.searches += 1

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
